#include "stages/tetmesh/read_request.hpp"

#include <fmt/format.h>

#include <cmath>

#include "pipeline/base/log.hpp"
#include "stages/image/image_io.hpp"
#include "stages/mesh/surface_io.hpp"
#include "stages/mesh/tet_io.hpp"
#include "stages/program/param_values.hpp"

namespace viscera {
namespace {

template <class Choice>
Choice choice(const StageRun& run, const char* param,
              const std::map<std::string, Choice>& choices) {
  return choices.at(run.param<std::string>(param));
}

RegionRequest read_region(const std::string& name, const Json& given) {
  const std::string prefix = "regions." + name + ".";
  check_plain_name(name, "regions", "region");  // it names an array of a file
  const Json values = resolve(region_params(), given, "parameters", prefix);
  const auto corner = [&](const char* key) { return read_place(values.at(key), prefix + key); };
  RegionRequest region{.name = name,
                       .side = values.at("side").get<std::string>(),
                       .box = std::nullopt,
                       .border_size = values.at("border_size").get<double>()};
  if (values.at("within").is_null() != region.side.empty()) {
    throw Error(ExitCode::bad_config,
                {.where = "parameters",
                 .field = prefix + (region.side.empty() ? "side" : "within"),
                 .found = "nothing",
                 .allowed = "both side and within, or neither: {side: superior, within: 30 mm}"});
  }
  if (!region.side.empty()) region.within = values.at("within").get<double>();
  if (!values.at("box_lo").is_null() || !values.at("box_hi").is_null())
    region.box = Box{corner("box_lo"), corner("box_hi")};
  return region;
}

}  // namespace

Param size_param() {
  return quantity("", nullptr, "mm", 0.05, 500.0, "cell size of the label");
}

std::vector<Param> region_params() {
  return {{.name = "side",
           .fallback = "",
           .doc = "a side of the labels, or of the surface, as superior; with `within`"},
          quantity("within", nullptr, "mm", 1e-3, 1e6, "distance from that side"),
          quantity("border_size", 1.0, "1", 0.02, 1.0,
                   "size of cells where its border meets the body's surface, as a part of the cell "
                   "size (route fields)"),
          {.name = "box_lo",
           .type = ParamType::list,
           .fallback = nullptr,
           .doc = "corner of a box with the least coordinates, [x, y, z], LPS"},
          {.name = "box_hi",
           .type = ParamType::list,
           .fallback = nullptr,
           .doc = "corner of a box with the largest coordinates"}};
}

std::vector<RegionRequest> read_regions(const Json& given) {
  std::vector<RegionRequest> regions;
  for (const auto& [name, value] : given.items()) regions.push_back(read_region(name, value));
  return regions;
}

MeshRequest request_of(const StageRun& run) {
  using Request = MeshRequest;
  Request request;
  request.route = choice<Request::Route>(run, "route",
                                         {{"auto", Request::Route::automatic},
                                          {"fields", Request::Route::fields},
                                          {"surface", Request::Route::surface}});
  request.mesher = choice<Request::Mesher>(
      run, "mesher", {{"cgal", Request::Mesher::cgal}, {"hxt", Request::Mesher::hxt}});
  request.improver = choice<Request::Improver>(run, "improve",
                                               {{"auto", Request::Improver::own},
                                                {"own", Request::Improver::own},
                                                {"cgal", Request::Improver::cgal},
                                                {"none", Request::Improver::none}});
  request.facet_size = run.param<double>("facet_size");
  request.facet_distance = run.param<double>("facet_distance");
  request.facet_angle = run.param<double>("facet_angle");
  request.radius_edge = run.param<double>("radius_edge");
  request.lattice = run.param<double>("lattice");
  request.sliver_angle = run.param<double>("sliver_angle");
  if (run.has_param("sigma")) request.sigma = run.param<double>("sigma");
  request.interface_size = run.param<double>("interface_size");
  request.grading = run.param<double>("grading");
  const Param size = size_param();
  for (const auto& [name, value] : run.params().at("sizes").items()) {
    request.sizes[name] =
        resolve_required(size, value, "parameters", "sizes." + name).get<double>();
  }
  request.regions = read_regions(run.params().at("regions"));
  if (run.has_param("target_tets")) request.target_tets = run.param<std::size_t>("target_tets");
  return request;
}

void take_size_field(TetMesh mesh, const std::string& file, MeshRequest& request) {
  const auto refuse = [&file](std::string field, std::string found, std::string allowed) {
    return Error(ExitCode::bad_input,
                 {.where = file,
                  .field = std::move(field),
                  .found = std::move(found),
                  .allowed = std::move(allowed),
                  .remedy = "give the size_field.vtu that viscera-simulate writes with certify"});
  };
  const auto refuse_sizes = [&](std::string found) {
    return refuse(fmt::format("CellData/{}", relative_size), std::move(found),
                  "for each tet a part of the cell size, more than 0");
  };
  const auto found = mesh.cell_data.find(relative_size);
  if (found == mesh.cell_data.end()) throw refuse_sizes("no such array");
  std::vector<float> sizes = found->second;
  for (const float size : sizes)
    if (!(size > 0.0f && std::isfinite(size))) throw refuse_sizes(fmt::format("{:g}", size));
  if (const auto wanted = mesh.numbers.find(wanted_tets); wanted != mesh.numbers.end()) {
    const double tets = wanted->second;
    if (!(tets >= fewest_tets && tets <= most_tets)) {
      throw refuse(fmt::format("FieldData/{}", wanted_tets), fmt::format("{:g}", tets),
                   fmt::format("{:.0f} to {:.0f}", fewest_tets, most_tets));
    }
    log::info("{} asks for {:.0f} tets", file, tets);
    request.target_tets = static_cast<std::size_t>(tets);
  }
  request.size_field = {std::move(mesh), std::move(sizes), file};
}

MeshRequest read_request(const StageRun& run) {
  MeshRequest request = request_of(run);
  // Before any file is read.
  const bool by_fields = request.by_fields(run.has_input("labels"), run.has_input("surface"));
  if (run.has_input("size_field")) {
    const auto& file = run.input("size_field");
    take_size_field(read_vtu(file), file.string(), request);
  }
  if (run.has_input("labels")) {
    request.labels = read_image(run.input("labels")).image;
    request.labels_file = run.input("labels").string();
  }
  // Beside labels a surface is only measured against, unless the route asks for it.
  if (!by_fields) {
    request.surface = read_vtp(run.input("surface"));
    request.surface_file = run.input("surface").string();
  }
  return request;
}

}  // namespace viscera
