#include <fmt/format.h>

#include <Eigen/Dense>
#include <fstream>
#include <sstream>

#include "sim/model/probe.hpp"
#include "tests/measured/page.hpp"
#include "tests/measured/ways.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {
namespace {

constexpr int beads_across = 7;
constexpr double side = 0.08;  // m, of the cube
constexpr double allowed_mm = 0.5;
// Layers of beads lie across z. The outer two are what moves the block between them.
constexpr int first_layer = 1, last_layer = beads_across;

struct Bead {
  int layer;
  std::vector<Vec3<double>> at;  // m, at rest and then by state
};

struct Beads {
  std::vector<Bead> all;
  std::vector<std::string> states;  // without the state at rest
};

// Rows of three numbers of a bead and three coordinates a state, mm, below two rows of headings.
Beads read_beads(const std::filesystem::path& file) {
  std::ifstream in(file);
  Beads beads;
  for (std::string line; std::getline(in, line);) {
    std::vector<std::string> cells;
    std::istringstream row(line);
    for (std::string cell; std::getline(row, cell, ',');) cells.push_back(cell);
    if (cells.size() > 3 && cells[0].find("bead") != std::string::npos) {
      for (std::size_t c = 6; c < cells.size(); c += 3) beads.states.push_back(cells[c]);
    }
    if (cells.empty() || cells[0].empty() || !std::isdigit(cells[0][0])) continue;
    Bead bead{};
    try {
      bead.layer = std::stoi(cells.at(2));
      for (std::size_t c = 3; c + 2 < cells.size(); c += 3) {
        bead.at.push_back(1e-3 * Vec3<double>{std::stod(cells[c]), std::stod(cells[c + 1]),
                                              std::stod(cells[c + 2])});
      }
    } catch (const std::logic_error&) {
      continue;  // a line that is not of a bead
    }
    if (bead.at.size() == beads.states.size() + 1) beads.all.push_back(bead);
  }
  if (beads.all.size() != beads_across * beads_across * beads_across) {
    throw std::runtime_error(
        fmt::format("{}: {} beads in place of {}", file.string(), beads.all.size(), 7 * 7 * 7));
  }
  return beads;
}

// A polynomial of a displacement in some of the coordinates, by least squares.
class Polynomial {
 public:
  using Terms = Eigen::VectorXd (*)(const Vec3<double>&);
  Polynomial(Terms terms, const std::vector<Vec3<double>>& places,
             const std::vector<Vec3<double>>& values)
      : terms_(terms) {
    const auto rows = static_cast<Eigen::Index>(places.size());
    Eigen::MatrixXd a(rows, terms(places[0]).size()), b(rows, 3);
    for (Eigen::Index r = 0; r < rows; ++r) {
      a.row(r) = terms(places[r]).transpose();
      b.row(r) << values[r].x, values[r].y, values[r].z;
    }
    factors_ = a.colPivHouseholderQr().solve(b);
  }
  Vec3<double> at(const Vec3<double>& place) const {
    const Eigen::RowVector3d u = terms_(place).transpose() * factors_;
    return {u[0], u[1], u[2]};
  }

 private:
  Terms terms_;
  Eigen::MatrixXd factors_;
};

Eigen::VectorXd quadratic_across(const Vec3<double>& p) {
  Eigen::VectorXd terms(6);
  terms << 1.0, p.x, p.y, p.x * p.x, p.x * p.y, p.y * p.y;
  return terms;
}

Eigen::VectorXd cubic(const Vec3<double>& p) {
  Eigen::VectorXd terms(20);
  int next = 0;
  for (int i = 0; i <= 3; ++i) {
    for (int j = 0; i + j <= 3; ++j) {
      for (int k = 0; i + j + k <= 3; ++k) {
        terms[next++] = std::pow(p.x, i) * std::pow(p.y, j) * std::pow(p.z, k);
      }
    }
  }
  return terms;
}

double rms_mm(const std::vector<Vec3<double>>& errors) {
  double sum = 0.0;
  for (const auto& e : errors) sum += dot(e, e);
  return 1e3 * std::sqrt(sum / static_cast<double>(errors.size()));
}

// The block between the outer layers of beads, and where its beads are.
class Block {
 public:
  explicit Block(const Beads& beads) : beads_(beads), model_(make(beads)) {
    for (const Bead& bead : beads.all) {
      if (!is_outer(bead)) probes_.push_back(probe_of_point(model_, "bead", bead.at[0] - low_));
    }
  }

  static bool is_outer(const Bead& bead) {
    return bead.layer == first_layer || bead.layer == last_layer;
  }
  const Model& model() const { return model_; }

  // The outer layers as measured, and between them what is linear.
  State start(std::size_t state) const {
    const Polynomial upper = layer(first_layer, state), lower = layer(last_layer, state);
    State start = at_rest(model_);
    for (std::size_t i = 0; i < model_.vertex_count(); ++i) {
      const Vec3<double> place = model_.rest[i] + model_.origin;
      const double share = place.z / height_;
      start.u[i] = share * upper.at(place) + (1.0 - share) * lower.at(place);
    }
    return start;
  }
  // Computed less measured, of the inner beads, m.
  std::vector<Vec3<double>> errors(const State& found, std::size_t state) const {
    std::vector<Vec3<double>> errors;
    for (const Bead& bead : beads_.all) {
      if (is_outer(bead)) continue;
      errors.push_back(probes_[errors.size()].mean_of(found.u) - (bead.at[state] - bead.at[0]));
    }
    return errors;
  }
  // What the smoothest field that could be meant leaves of the measured displacements.
  double noise_mm(std::size_t state) const {
    std::vector<Vec3<double>> places, moved, left;
    for (const Bead& bead : beads_.all) {
      places.push_back(bead.at[0] - low_);
      moved.push_back(bead.at[state] - bead.at[0]);
    }
    const Polynomial smooth(cubic, places, moved);
    for (std::size_t b = 0; b < places.size(); ++b) left.push_back(smooth.at(places[b]) - moved[b]);
    return rms_mm(left);
  }
  // Of the beads in the middle of y: measured and computed.
  std::string picture(const State& found, std::size_t state) const {
    Drawing drawing({-14.0, -14.0}, {94.0, 84.0}, 7.0);
    std::size_t inner = 0;
    for (const Bead& bead : beads_.all) {
      const Vec3<double> rest = bead.at[0] - low_, now = bead.at[state] - low_;
      const bool is_shown = std::abs(rest.y - 0.5 * side) < 0.06 * side;
      if (is_shown) {
        drawing.dot({1e3 * rest.x, 1e3 * rest.z}, 2.0, "#bbbbbb");
        drawing.dot({1e3 * now.x, 1e3 * now.z}, 5.0, "#222222", false);
      }
      if (is_outer(bead)) continue;
      const Vec3<double> computed = rest + probes_[inner++].mean_of(found.u);
      if (is_shown) drawing.dot({1e3 * computed.x, 1e3 * computed.z}, 2.5, "#d1495b");
    }
    drawing.text({-12.0, 79.0}, "grey: at rest; circles: measured; red: computed (inner beads)");
    return drawing.svg();
  }

 private:
  // m, the corner of the block: beads lie in the middle of the cube's sides.
  Model make(const Beads& beads) {
    Vec3<double> mean;
    double top = 0.0, bottom = 0.0;
    constexpr double a_layer = beads_across * beads_across;
    for (const Bead& bead : beads.all) {
      mean += (1.0 / static_cast<double>(beads.all.size())) * bead.at[0];
      if (bead.layer == first_layer) top += bead.at[0].z / a_layer;
      if (bead.layer == last_layer) bottom += bead.at[0].z / a_layer;
    }
    height_ = top - bottom;
    low_ = {mean.x - 0.5 * side, mean.y - 0.5 * side, bottom};
    Model model = make_five_tet_box(
        {side, side, height_}, {16, 16, 12},
        {.youngs_modulus = 15.3e3, .poisson_ratio = 0.499, .density = 980.0, .damping = 0.01});
    for (std::size_t i = 0; i < model.vertex_count(); ++i) {
      const double z = model.rest[i].z + model.origin.z;
      model.fixed[i] = z < 1e-9 || z > height_ - 1e-9;
    }
    return model;
  }
  Polynomial layer(int number, std::size_t state) const {
    std::vector<Vec3<double>> places, moved;
    for (const Bead& bead : beads_.all) {
      if (bead.layer != number) continue;
      places.push_back(bead.at[0] - low_);
      moved.push_back(bead.at[state] - bead.at[0]);
    }
    return {quadratic_across, places, moved};
  }

  const Beads& beads_;
  double height_ = 0.0;
  Vec3<double> low_;
  Model model_;
  std::vector<Probe> probes_;  // of the inner beads
};

}  // namespace

MeasuredBody truth_cube(const std::filesystem::path& data) {
  MeasuredBody body{
      .name = "Truth Cube",
      .about =
          "A cube of silicone, 8 cm, with 343 beads that CT shows at rest and pressed (Kerdok et "
          "al., \"Truth cube: establishing physical standards for soft tissue simulation\", Med. "
          "Image Anal. 7, 2003; positions from the data of OpenSurgSim). nu .499, E 15.3 kPa, 980 "
          "kg/m3. The outer two of the seven layers of beads, which move by other amounts than the "
          "nominal ones and not as if they were glued to plates, are led as they were measured "
          "(a polynomial of second order for each); the beads of the five layers between, the "
          "sides of the block being free, are predicted. Nothing is fitted: E does not matter "
          "to displacements. The measurement's own: what a polynomial of third order leaves of "
          "its displacements."};
  const std::filesystem::path file = data / "truth_cube_uniaxial.csv";
  if (!std::filesystem::exists(file)) {
    body.skipped = "there is no truth_cube_uniaxial.csv in VISCERA_MEASURED";
    return body;
  }
  const Beads beads = read_beads(file);
  const Block block(beads);
  Scene scene = elastic_scene();
  for (std::size_t k = 1; k <= beads.states.size(); ++k) {
    const State start = block.start(k);
    const double noise = block.noise_mm(k), moved = rms_mm(block.errors(at_rest(block.model()), k));
    const auto row = [&](const std::string& name, const State& found, double seconds) {
      const auto errors = block.errors(found, k);
      double largest = 0.0;
      for (const auto& e : errors) largest = std::max(largest, 1e3 * norm(e));
      body.rows.push_back(
          {beads.states[k - 1], "rms of the inner beads", name, rms_mm(errors), allowed_mm, noise,
           "mm", fmt::format("at most {:.2f}; they move by {:.2f} rms", largest, moved), seconds});
    };
    row("none: linear between the layers", start, 0.0);
    for (const Way& way : ways()) {
      const auto [state, seconds] = way.settle(block.model(), scene, start);
      row(way.name, state, seconds);
      if (k == beads.states.size() && way.name == ways().front().name) {
        body.pictures.push_back({"truth_cube.svg",
                                 "The beads of the middle plane, pressed by " +
                                     beads.states[k - 1] + ", by " + way.name + ".",
                                 block.picture(state, k)});
      }
    }
  }
  return body;
}

}  // namespace viscera::sim
