#include "stages/tetmesh/mesher/mesh_job.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <tuple>

#include "pipeline/base/error.hpp"
#include "pipeline/base/log.hpp"
#include "stages/image/label_components.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/tetmesh/exchange/hxt.hpp"
#include "stages/tetmesh/generate/nesting.hpp"
#include "stages/tetmesh/generate/order.hpp"
#include "stages/tetmesh/improve/project_fields.hpp"
#include "stages/tetmesh/improve/project_surface.hpp"
#include "stages/tetmesh/quality/measure.hpp"

namespace viscera {
namespace {

// Measured on livers of 10,000 to 1.1 million tets by both routes, as peaks of the whole stage.
constexpr double program_bytes = 80e6, bytes_per_tet = 650.0, bytes_per_voxel = 12.0;
constexpr int trial_rounds = 2;  // of improvement: enough to know volumes and the number of tets
constexpr double closest_points = 0.5;  // of the cell size: closer ones may be thinned out
constexpr int search_tries = 8;
constexpr double search_tolerance = 0.03;
// How far a label may be aimed from its volume to make up for facets that cut its corners.
constexpr double aim_low = 0.8, aim_high = 1.5;

Error bad_route(std::string found, std::string remedy) {
  return Error(ExitCode::bad_config, {.where = "parameters",
                                      .field = "route",
                                      .found = std::move(found),
                                      .allowed = "auto, fields (needs labels) or surface (needs "
                                                 "surface)",
                                      .remedy = std::move(remedy)});
}

SurfaceMesh body_surface(const SurfaceMesh& all, const std::string& file) {
  if (auto body = body_of(all)) return std::move(*body);
  throw Error(ExitCode::bad_input,
              {.where = file,
               .field = "CellData/label",
               .found = fmt::format("{} labels and no surface of the whole body (label 0)",
                                    all.label_names.size()),
               .allowed = "one surface, or the body's among them",
               .remedy = "run viscera-surface with body=true, or use route: fields"});
}

}  // namespace

std::optional<SurfaceMesh> body_of(const SurfaceMesh& all) {
  if (all.label_names.size() == 1) return all;
  if (all.label_names.count(body_label)) return extract(all, body_label);
  return std::nullopt;
}

bool MeshRequest::by_fields(bool has_labels, bool has_surface) const {
  if (!has_labels && !has_surface)
    throw bad_route("neither labels nor surface given",
                    "add --in labels=FILE or --in surface=FILE");
  const bool result = route == Route::fields || (route == Route::automatic && has_labels);
  if (result && !has_labels) throw bad_route("fields, without labels", "add --in labels=FILE");
  if (!result && !has_surface) throw bad_route("surface, without one", "add --in surface=FILE");
  if (mesher == Mesher::hxt && improver == Improver::cgal) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = "improve",
                                       .found = "cgal, for tets that Mesh_3 did not make",
                                       .allowed = "own or none with mesher: hxt"});
  }
  return result;
}

MeshJob::MeshJob(MeshRequest request)
    : by_fields_(request.by_fields(request.labels.has_value(), request.surface.has_value())),
      hxt_(request.mesher == MeshRequest::Mesher::hxt),
      improve_(request.improver == MeshRequest::Improver::own),
      options_{.perturb_and_exude = request.improver == MeshRequest::Improver::cgal,
               .sliver_angle = request.sliver_angle},
      lattice_(request.lattice),
      factors_{.facet_size = request.facet_size,
               .facet_distance = request.facet_distance,
               .facet_angle = request.facet_angle,
               .radius_edge = request.radius_edge} {
  if (request.labels) take_labels(request);
  if (!by_fields_) take_surface(request);
  take_sizes(request);
  take_regions(request);
  check_sizes(request);
}

void MeshJob::take_labels(MeshRequest& request) {
  image_ = std::move(request.labels);
  const Frame& frame = image_->frame;
  for (const auto id : image_->voxels)
    if (id != 0) label_volumes_[id] += frame.voxel_volume();
  if (label_volumes_.empty() || std::min({frame.size[0], frame.size[1], frame.size[2]}) < 5) {
    throw Error(ExitCode::bad_input, {.where = request.labels_file,
                                      .field = "voxels",
                                      .found = "no label, or fewer than five voxels on an axis",
                                      .allowed = "a body with background around it",
                                      .remedy = "give the labels.nrrd of viscera-labels"});
  }
  for (const auto& [id, volume] : label_volumes_) {
    const auto known = image_->names.find(id);
    names_[id] = known == image_->names.end() ? fmt::format("label_{}", id) : known->second;
    body_volume_ += volume;
  }
  LabelImage body{.frame = frame, .voxels = image_->voxels};
  for (auto& id : body.voxels) id = id != 0;
  const auto components = find_components(body);
  bodies_ = static_cast<std::size_t>(std::count_if(components.list.begin(), components.list.end(),
                                                   [](const auto& c) { return c.label != 0; }));
  const bool open = std::any_of(components.list.begin(), components.list.end(),
                                [](const auto& c) { return c.label != 0 && c.on_border; });
  if (open) {
    throw Error(ExitCode::bad_input,
                {.where = request.labels_file,
                 .field = "voxels",
                 .found = "a label touches the border of the volume",
                 .allowed = "background all around",
                 .remedy = "pass the volume through viscera-labels, which pads"});
  }
  interfaces_.emplace(*image_);
  fields_.emplace(*image_, request.sigma.value_or(default_sigma(frame)));
  std::tie(extent_.lo, extent_.hi) = fields_->extent();
}

void MeshJob::take_sizes(const MeshRequest& request) {
  sizes_ = {.at_interfaces = request.interface_size, .grading = request.grading};
  for (const auto& [name, size] : request.sizes) {
    const auto label = std::find_if(names_.begin(), names_.end(), [&key = name](const auto& entry) {
      return entry.second == key;
    });
    if (label == names_.end()) {
      std::vector<std::string> known;
      for (const auto& [id, text] : names_) known.push_back(text);
      throw Error(ExitCode::bad_config, {.where = "parameters",
                                         .field = "sizes." + name,
                                         .found = "no label of that name",
                                         .remedy = suggest(name, known)});
    }
    sizes_.label_sizes[label->first] = size;
  }
  if (request.size_field && by_fields_) take_size_field(*request.size_field);
}

int MeshJob::largest_label() const {
  return std::ranges::max_element(label_volumes_, {},
                                  [](const auto& label) { return label.second; })
      ->first;
}

void MeshJob::take_size_field(const MeshRequest::SizedMesh& given) {
  constexpr double same_body = 0.9;  // of the voxels: a coarse mesh of it covers more
  sizes_.relative = sizes_by_voxel(image_->frame, given.mesh, given.sizes);
  sizes_.common_label = largest_label();
  std::size_t labelled = 0, covered = 0;
  for (std::size_t v = 0; v < image_->voxels.size(); ++v) {
    if (image_->voxels[v] == 0) continue;
    ++labelled;
    covered += sizes_.relative[v] > 0.0f;
  }
  const double share = static_cast<double>(covered) / static_cast<double>(labelled);
  if (share >= same_body) return;
  throw Error(ExitCode::bad_input,
              {.where = given.file,
               .field = "points",
               .found = fmt::format("a mesh that covers {:.0f} % of the labels", 100.0 * share),
               .allowed = fmt::format("a mesh of this body: {:.0f} % or more", 100.0 * same_body),
               .remedy = "give the size_field.vtu of a simulation of these labels"});
}

void MeshJob::take_regions(const MeshRequest& request) {
  if (!request.regions.empty() && options_.perturb_and_exude) {
    throw Error(ExitCode::bad_config, {.where = "parameters",
                                       .field = "improve",
                                       .found = "cgal, for tets that regions cut",
                                       .allowed = "own or none with regions"});
  }
  regions_ = make_regions(request.regions, extent_);
  planes_ = planes_of(regions_);
  for (const Region& region : regions_)
    if (region.border_size < 1.0) {
      sizes_.corners.push_back(
          {[region](const Vec& p) { return region.contains(p); }, region.border_size});
    }
}

void MeshJob::check_sizes(const MeshRequest& request) const {
  if (by_fields_ || (sizes_.uniform() && !request.size_field)) return;
  throw bad_route("surface, with sizes, interface_size, border_size or a size_field",
                  "add --in labels=FILE and use route: fields, or leave the sizes out");
}

void MeshJob::take_surface(const MeshRequest& request) {
  const std::string& file = request.surface_file;
  const SurfaceMesh surface = body_surface(*request.surface, file);
  surface_.emplace(surface, file);
  surface_projector_ = surface_projector(surface);
  extent_ = box_of(surface.points);
  check_nesting(surface, file);
  if (fields_) return;  // volumes and names come from the labels
  if (surface.label_names.begin()->first == body_label) {
    throw Error(ExitCode::bad_input,
                {.where = file,
                 .field = "CellData/label",
                 .found = "several materials, but no labels that say which is where",
                 .allowed = "one material, or --in labels as well",
                 .remedy = "add --in labels=FILE"});
  }
  names_ = surface.label_names;
  bodies_ = 0;
  for (const auto& shell : find_shells(surface)) {
    bodies_ += shell.volume > 0.0;
    body_volume_ += shell.volume;
  }
  label_volumes_[names_.begin()->first] = body_volume_;
}

// A lattice for every size that labels have of their own; where sizes are graded there is none.
std::vector<Inside> MeshJob::lattice(const Sizing& sizing) const {
  constexpr double graded = 0.9;
  if (lattice_ <= 0.0) return {};
  std::set<double> sizes;
  const auto own = [&](int label) {
    const auto given = sizes_.label_sizes.find(label);
    return given == sizes_.label_sizes.end() ? sizing.cell_size : given->second;
  };
  for (const auto& [label, volume] : label_volumes_) sizes.insert(own(label));
  std::vector<Inside> sites;
  for (const double size : sizes)
    for (const auto& site : seed_interior(*fields_, lattice_ * size)) {
      const double here = sizing.cell_size * sizing.scale_at(site.point);
      if (own(site.label) == size && here >= graded * size) sites.push_back(site);
    }
  return sites;
}

MeshJob::Sizes MeshJob::size_field(double cell_size) const {
  if (!by_fields_ || sizes_.uniform()) return nullptr;
  return std::make_shared<const SizeField>(*image_, sizes_, cell_size);
}

TetMesh MeshJob::refine(double cell_size, const Sizes& sizes, const Mesh3Options& options) const {
  Sizing sizing = factors_;
  sizing.cell_size = cell_size;
  sizing.facet_size *= cell_size;
  sizing.facet_distance *= cell_size;
  if (!by_fields_) {
    const auto interior =
        lattice_ > 0.0 ? surface_->seed_interior(lattice_ * cell_size) : std::vector<Inside>();
    return surface_->mesh(names_.begin()->first, interior, sizing, options);
  }
  double largest = 1.0;
  if (sizes) {
    sizing.scale = [sizes, cell_size](const Vec& p) { return sizes->at(p) / cell_size; };
    largest = sizes->largest() / cell_size;
  }
  const auto seeds = seed_interfaces(*fields_, *interfaces_, sizing, largest);
  return mesh_fields(*fields_, seeds, lattice(sizing), sizing, options);
}

void MeshJob::assign_labels(TetMesh& mesh) const {
  for (std::size_t t = 0; t < mesh.tets.size(); ++t) {
    Vec centre{};
    for (const int corner : mesh.tets[t]) centre = add(centre, scale(0.25, mesh.points[corner]));
    const int id = fields_->nearest(fields_->frame().from_lps(centre));
    if (id != 0) mesh.labels[t] += id - material_of(mesh.labels[t]);
  }
}

// Where sizes differ on purpose none is too small.
std::optional<Thinning> MeshJob::thinning(double cell_size) const {
  if (!sizes_.uniform()) return std::nullopt;
  return Thinning{closest_points * std::min(1.0, factors_.facet_size) * cell_size,
                  factors_.facet_distance * cell_size};
}

MeshJob::Result MeshJob::mesh(double cell_size) const {
  const auto progress = [](double part) { log::progress("tets", 0.5 + 0.5 * part, "improving"); };
  std::map<int, double> volumes{{body_label, body_volume_}};
  if (by_fields_) volumes.insert(label_volumes_.begin(), label_volumes_.end());
  return build(cell_size, size_field(cell_size), options_,
               {.graded = !sizes_.uniform(),
                .thinning = thinning(cell_size),
                .volumes = volumes,
                .progress = progress});
}

MeshJob::Result MeshJob::build(double cell_size, const Sizes& sizes, const Mesh3Options& mesh3,
                               const ImproveOptions& options) const {
  Result result{.mesh = refine(cell_size, sizes, mesh3)};
  TetMesh& mesh = result.mesh;
  mesh.label_names = names_;
  result.mended = mend_boundary(mesh, bodies_);
  if (hxt_ && !mesh.tets.empty()) mesh = fill_with_hxt(mesh);
  if (mesh.tets.empty()) return result;
  const Projector project =
      with_planes(by_fields_ ? field_projector(*fields_) : surface_projector_, planes_);
  cut_along(mesh, planes_, project);
  if (improve_) result.improved = improve(mesh, project, options);
  // Only now: on the surface route the improver has the whole body to work with.
  if (!by_fields_ && fields_) assign_labels(mesh);
  name_regions(mesh, regions_);
  order_along_hilbert_curve(mesh);
  return result;
}

LabelLoss MeshJob::loss(const TetMesh& mesh, double cell_size) const {
  const auto smoothed_away = [this](const std::array<double, 3>& place) {
    return by_fields_ && fields_->at(place) == 0;
  };
  return find_label_loss(*image_, mesh, cell_size, smoothed_away);
}

std::map<int, LabelLoss> MeshJob::misplaced(const TetMesh& mesh, double cell_size) const {
  std::map<int, LabelLoss> found;
  if (!by_fields_) return found;
  for (const auto& [id, volume] : label_volumes_) {
    if (id == largest_label()) continue;
    LabelImage own = *image_;
    for (auto& voxel : own.voxels)
      if (voxel != id) voxel = 0;
    TetMesh part = mesh;
    keep_tets(part, [&mesh, id = id](std::size_t t) { return mesh.labels[t] == id; });
    if (part.tets.empty()) continue;  // its volume says it
    found[id] = find_label_loss(own, part, cell_size, [](const auto&) { return false; });
  }
  return found;
}

double MeshJob::expected_tets(double cell_size) const {
  const double uniform = estimate_tets(body_volume_, cell_size, lattice_ * cell_size);
  const auto sizes = size_field(cell_size);
  return sizes ? uniform * sizes->crowding() : uniform;
}

void MeshJob::check_cell_size(double cell_size) const {
  const double estimate = expected_tets(cell_size);
  if (estimate <= most_tets) return;
  throw Error(
      ExitCode::bad_config,
      {.where = "parameters",
       .field = "cell_size",
       .found = fmt::format("{:.3g} mm asks for about {:.0f} million tets in {:.0f} ml", cell_size,
                            estimate / 1e6, body_volume_ / 1000.0),
       .allowed = fmt::format("at most {:.0f} million", most_tets / 1e6),
       .remedy = fmt::format("use {:.2g} mm or more", std::cbrt(expected_tets(1.0) / most_tets))});
}

double mesh_memory(double tets, double field_voxels) {
  return program_bytes + bytes_per_tet * tets + bytes_per_voxel * field_voxels;
}

double MeshJob::estimate_memory(double tets) const {
  const double voxels =
      fields_ ? static_cast<double>(fields_->frame().voxels() * (fields_->ids().size() + 1)) : 0.0;
  return mesh_memory(tets, voxels);
}

std::size_t MeshJob::calibrate(double cell_size) {
  const Sizes sizes = size_field(cell_size);
  const TetMesh trial =
      build(cell_size, sizes, {},
            {.rounds = trial_rounds, .graded = !sizes_.uniform(), .thinning = thinning(cell_size)})
          .mesh;
  if (!by_fields_) return trial.tets.size();
  std::map<int, double> found;
  for (std::size_t t = 0; t < trial.tets.size(); ++t) {
    const auto& tet = trial.tets[t];
    const double v = measure_tet(trial.points[tet[0]], trial.points[tet[1]], trial.points[tet[2]],
                                 trial.points[tet[3]])[volume];
    found[trial.labels[t]] += v;
    found[body_label] += v;
  }
  const auto correct = [&](int id, double wanted) {
    double& aim = aims_.try_emplace(id, 1.0).first->second;
    aim = std::clamp(aim * wanted / std::max(found[id], 0.5 * wanted), aim_low, aim_high);
  };
  correct(body_label, body_volume_);
  for (const auto& [id, wanted] : label_volumes_) correct(id, wanted);
  fields_->aim(aims_, sizes ? sizes->cut_corners() : Field());
  return trial.tets.size();
}

// The number of tets falls about as h^-3 in the large and as h^-2 where interfaces dominate: the
// slope between the last two tries, kept in that range, leads to the next.
double MeshJob::find_cell_size(std::size_t target) {
  const double wanted = std::log(static_cast<double>(target));
  double size = std::cbrt(expected_tets(1.0) / static_cast<double>(target));
  double best = size, best_miss = 1e9, slope = -3.0, last_size = 0.0, last_log = 0.0;
  for (int attempt = 1; attempt <= search_tries; ++attempt) {
    check_cell_size(size);
    log::progress("tets", 0.3 * (attempt - 1) / search_tries, "finding the cell size");
    const auto tets = calibrate(size);
    log::info("cell size {:.3f} mm: {} tets of {} wanted", size, tets, target);
    const double found = std::log(std::max<double>(1.0, static_cast<double>(tets)));
    const double miss = std::abs(found - wanted);
    if (miss < best_miss) {
      best_miss = miss;
      best = size;
    }
    if (miss < search_tolerance) break;
    if (attempt > 1 && size != last_size)
      slope = std::clamp((found - last_log) / std::log(size / last_size), -4.0, -1.0);
    last_size = size;
    last_log = found;
    size *= std::exp(std::clamp((wanted - found) / slope, -0.7, 0.7));
  }
  return best;
}

}  // namespace viscera
