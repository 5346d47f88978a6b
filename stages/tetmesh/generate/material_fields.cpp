#include "stages/tetmesh/generate/material_fields.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "pipeline/base/error.hpp"
#include "stages/image/mask.hpp"

namespace viscera {
namespace {

constexpr std::size_t max_labels = 255;

}  // namespace

MaterialFields::MaterialFields(const LabelImage& image, double sigma) : frame_(image.frame) {
  std::vector<std::size_t> counts(65536);
  for (const auto id : image.voxels) ++counts[id];
  for (int id = 1; id < 65536; ++id) {
    if (counts[id] == 0) continue;
    ids_.push_back(id);
    voxels_.push_back(static_cast<double>(counts[id]));
  }
  if (ids_.size() > max_labels) {
    throw Error(ExitCode::bad_input,
                {.field = "labels",
                 .found = fmt::format("{} of them", ids_.size()),
                 .allowed = fmt::format("at most {} materials in one mesh", max_labels),
                 .remedy = "choose or merge labels in viscera-labels"});
  }
  const std::size_t width = this->width();
  values_.resize(width * frame_.voxels());
  body_.assign(frame_.voxels(), 0.0f);
  // Each in a box of its own, beyond which its field is 0.
  for (std::size_t slot = 0; slot < width; ++slot) {
    const Mask mask =
        mask_around(image, slot == 0 ? 0 : ids_[slot - 1], reach_of_smoothing * sigma);
    const Field field = smooth_keeping_volume(mask.frame, mask.inside, sigma);
    std::array<int, 3> begin, end;  // in the volume
    for (int a = 0; a < 3; ++a) {
      begin[a] = std::max(0, mask.first[a]);
      end[a] = std::min(frame_.size[a], mask.first[a] + mask.frame.size[a]);
    }
    for (int k = begin[2]; k < end[2]; ++k)
      for (int j = begin[1]; j < end[1]; ++j)
        for (int i = begin[0]; i < end[0]; ++i) {
          const std::size_t v = frame_.index(i, j, k);
          const float value =
              field[mask.frame.index(i - mask.first[0], j - mask.first[1], k - mask.first[2])];
          (slot == 0 ? body_[v] : values_[v * width + slot]) = value;
        }
  }
  aim({});
}

void MaterialFields::aim(const std::map<int, double>& factors, const Field& share) {
  const auto factor = [&factors](int id) {
    const auto found = factors.find(id);
    return found == factors.end() ? 1.0 : found->second;
  };
  std::vector<double> wanted = voxels_;
  for (std::size_t l = 0; l < wanted.size(); ++l) wanted[l] *= factor(ids_[l]);
  const double volume =
      std::accumulate(voxels_.begin(), voxels_.end(), 0.0) * frame_.voxel_volume();
  const double aimed = factor(0) * volume;
  level_ = matched_level(frame_, body_, share.empty() ? aimed : volume);
  const Field& body = share.empty() ? body_ : matched_field(frame_, body_, share, level_, aimed);
  for (std::size_t v = 0; v < body.size(); ++v) values_[v * width()] = body[v];
  biases_.assign(ids_.size(), 0.0);
  if (ids_.size() > 1) match_labels(wanted);
}

// A bias counts in proportion to all labels' fields at the place: it shifts what they share, and
// nowhere lets a label win that has no part of it. (In the thin borders of others, where all fields
// are small, one that was aimed high would win anywhere in the body.)
int MaterialFields::winner(const double* values) const {
  const double sum = std::accumulate(values, values + ids_.size(), 0.0);
  std::size_t best = 0;
  for (std::size_t l = 1; l < ids_.size(); ++l)
    if (values[l] + biases_[l] * sum > values[best] + biases_[best] * sum) best = l;
  return static_cast<int>(best);
}

// A voxel of the body counts as far as it lies on a label's side, which over a voxel rises with the
// lead of the label as that changes from neighbour to neighbour: voxels counted by their centres
// would move an interface along the grid by whole layers. Labels are taken from small to large; the
// largest keeps bias 0 and receives what is left. Three sweeps settle labels that touch each other.
void MaterialFields::match_labels(const std::vector<double>& wanted) {
  const std::size_t labels = ids_.size();
  std::vector<std::size_t> inside;
  for (std::size_t v = 0; v < frame_.voxels(); ++v)
    if (values_[v * width()] > level_) inside.push_back(v);
  std::vector<std::size_t> order(labels);
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return voxels_[a] < voxels_[b]; });
  order.pop_back();
  // Of the best other label over this one, unbiased, as a share of all labels' fields; outside of
  // the body not a number.
  Field lead(frame_.voxels(), std::numeric_limits<float>::quiet_NaN());
  for (int sweep = 0; sweep < 3; ++sweep)
    for (const std::size_t l : order) {
      for (const std::size_t v : inside) {
        const float* values = &values_[v * width() + 1];
        const double sum = std::accumulate(values, values + labels, 0.0);
        double best = -std::numeric_limits<double>::max();
        for (std::size_t o = 0; o < labels; ++o)
          if (o != l) best = std::max(best, values[o] + biases_[o] * sum);
        lead[v] = static_cast<float>((best - values[l]) / std::max(sum, 1e-6));
      }
      biases_[l] = bias_of(lead, inside, wanted[l]);
    }
}

// The bias at which so many of these voxels have a smaller lead.
double MaterialFields::bias_of(const Field& lead, const std::vector<std::size_t>& inside,
                               double wanted) const {
  // Beyond half the field's range it would let a label appear where it never was.
  constexpr double most = 0.45;
  const std::array<std::size_t, 3> next = {
      1, static_cast<std::size_t>(frame_.size[0]),
      static_cast<std::size_t>(frame_.size[0]) * static_cast<std::size_t>(frame_.size[1])};
  // From a voxel's centre to its faces the lead changes by half of what it does to the neighbours.
  struct Near {
    double lead;         // at the centre
    double below = 0.0;  // how much smaller it gets within the voxel, and how much larger
    double above = 0.0;

    double share_below(double bias) const {
      const double beyond = bias - lead, reach = beyond < 0.0 ? below : above;
      return std::clamp(0.5 + 0.5 * beyond / std::max(reach, 1e-6), 0.0, 1.0);
    }
  };
  std::vector<Near> near;  // those that a bias may divide
  double always = 0.0;
  for (const std::size_t v : inside) {
    Near voxel{lead[v]};
    for (const std::size_t step : next) {
      const float behind = v >= step ? lead[v - step] : NAN;
      const float ahead = v + step < lead.size() ? lead[v + step] : NAN;
      double least = 0.0, greatest = 0.0;
      for (const float other : {behind, ahead}) {
        const double half = std::isfinite(other) ? 0.5 * (other - lead[v]) : 0.0;
        least = std::min(least, half), greatest = std::max(greatest, half);
      }
      voxel.below -= least, voxel.above += greatest;
    }
    if (voxel.lead + voxel.above < -most) {
      always += 1.0;
    } else if (voxel.lead - voxel.below < most) {
      near.push_back(voxel);
    }
  }
  double low = -most, high = most;
  for (int step = 0; step < 30; ++step) {
    const double middle = 0.5 * (low + high);
    double count = always;
    for (const Near& voxel : near) count += voxel.share_below(middle);
    (count < wanted ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

int MaterialFields::at(const std::array<double, 3>& p) const {
  return evaluate(p, level_);
}

int MaterialFields::nearest(const std::array<double, 3>& p) const {
  return evaluate(p, -std::numeric_limits<double>::max());
}

double MaterialFields::lead(const std::array<double, 3>& p, int a, int b,
                            std::array<double, 3>& gradient) const {
  Cell cell;
  std::array<double, 3> inside = p;
  for (int i = 0; i < 3; ++i)
    inside[i] = std::clamp(p[i], 0.0, (frame_.size[i] - 1) * frame_.spacing[i]);
  locate(inside, cell);
  const auto slot = [this](int id) {
    return static_cast<std::size_t>(std::lower_bound(ids_.begin(), ids_.end(), id) - ids_.begin());
  };
  const bool outer = a == 0 || b == 0;
  const std::size_t of_a = outer ? 0 : slot(a), of_b = outer ? 0 : slot(b);
  double value = outer ? -level_ : 0.0;
  gradient = {};
  for (int c = 0; c < 8; ++c) {
    const float* const fields = cell.corner[c] + 1;
    const double here = outer ? cell.corner[c][0]
                              : fields[of_a] - fields[of_b] +
                                    (biases_[of_a] - biases_[of_b]) *
                                        std::accumulate(fields, fields + ids_.size(), 0.0);
    std::array<double, 3> weight, slope;
    for (int i = 0; i < 3; ++i) {
      const bool far = (c >> i) & 1;
      weight[i] = far ? cell.part[i] : 1.0 - cell.part[i];
      slope[i] = (far ? 1.0 : -1.0) / frame_.spacing[i];
    }
    value += weight[0] * weight[1] * weight[2] * here;
    gradient[0] += slope[0] * weight[1] * weight[2] * here;
    gradient[1] += weight[0] * slope[1] * weight[2] * here;
    gradient[2] += weight[0] * weight[1] * slope[2] * here;
  }
  const double sign = a == 0 ? -1.0 : 1.0;
  for (double& g : gradient) g *= sign;
  return sign * value;
}

std::pair<Vec, Vec> MaterialFields::extent() const {
  constexpr double far = std::numeric_limits<double>::max();
  std::pair<Vec, Vec> box{{far, far, far}, {-far, -far, -far}};
  const std::size_t strides[3] = {1, static_cast<std::size_t>(frame_.size[0]),
                                  static_cast<std::size_t>(frame_.size[0]) * frame_.size[1]};
  std::size_t voxel = 0;
  for (int z = 0; z < frame_.size[2]; ++z)
    for (int y = 0; y < frame_.size[1]; ++y)
      for (int x = 0; x < frame_.size[0]; ++x, ++voxel) {
        const std::array<int, 3> at{x, y, z};
        const double here = values_[voxel * width()] - level_;
        for (int axis = 0; axis < 3; ++axis) {
          if (at[axis] + 1 == frame_.size[axis]) continue;
          const double next = values_[(voxel + strides[axis]) * width()] - level_;
          if ((here > 0.0) == (next > 0.0)) continue;
          Vec p;
          for (int a = 0; a < 3; ++a)
            p[a] = (at[a] + (a == axis ? here / (here - next) : 0.0)) * frame_.spacing[a];
          const Vec place = frame_.to_lps(p);
          for (int a = 0; a < 3; ++a) {
            box.first[a] = std::min(box.first[a], place[a]);
            box.second[a] = std::max(box.second[a], place[a]);
          }
        }
      }
  return box;
}

bool MaterialFields::locate(const std::array<double, 3>& p, Cell& cell) const {
  std::array<std::size_t, 3> at;
  for (int a = 0; a < 3; ++a) {
    const double index = p[a] / frame_.spacing[a];
    if (!(index >= 0.0 && index <= frame_.size[a] - 1)) return false;
    at[a] = static_cast<std::size_t>(std::min(static_cast<int>(index), frame_.size[a] - 2));
    cell.part[a] = index - static_cast<double>(at[a]);
  }
  const std::size_t width = this->width();
  const std::size_t dy = frame_.size[0], dz = dy * static_cast<std::size_t>(frame_.size[1]);
  const float* base = &values_[((at[2] * frame_.size[1] + at[1]) * dy + at[0]) * width];
  for (int c = 0; c < 8; ++c)
    cell.corner[c] = base + ((c & 1 ? 1 : 0) + (c & 2 ? dy : 0) + (c & 4 ? dz : 0)) * width;
  return true;
}

int MaterialFields::evaluate(const std::array<double, 3>& p, double level) const {
  Cell cell;
  if (!locate(p, cell)) return 0;
  const auto& [corner, part] = cell;
  std::array<double, 8> weight;
  double body = 0.0;
  for (int c = 0; c < 8; ++c) {
    const bool x = c & 1, y = c & 2, z = c & 4;
    weight[c] =
        (x ? part[0] : 1 - part[0]) * (y ? part[1] : 1 - part[1]) * (z ? part[2] : 1 - part[2]);
    body += weight[c] * *corner[c];
  }
  if (body <= level) return 0;
  const std::size_t labels = ids_.size();
  if (labels == 1) return ids_[0];
  std::array<double, max_labels> values;  // filled up to labels
  for (std::size_t l = 0; l < labels; ++l) {
    values[l] = 0.0;
    for (int c = 0; c < 8; ++c) values[l] += weight[c] * corner[c][l + 1];
  }
  return ids_[winner(values.data())];
}

}  // namespace viscera
