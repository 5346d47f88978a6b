#include <fmt/format.h>
#include <vtkNew.h>
#include <vtkUnstructuredGrid.h>
#include <vtkUnstructuredGridReader.h>

#include "tests/measured/page.hpp"
#include "tests/measured/ways.hpp"
#include "tests/results/run.hpp"

namespace viscera::sim {
namespace {

constexpr double length = 0.182;  // m, along z

Model read(const std::filesystem::path& file) {
  vtkNew<vtkUnstructuredGridReader> reader;
  reader->SetFileName(file.c_str());
  reader->Update();
  vtkUnstructuredGrid& grid = *reader->GetOutput();
  std::vector<Vec3<double>> points;
  for (vtkIdType i = 0; i < grid.GetNumberOfPoints(); ++i) {
    const double* p = grid.GetPoint(i);
    points.push_back({p[0], p[1], p[2]});
  }
  std::vector<Tet> tets;
  for (vtkIdType c = 0; c < grid.GetNumberOfCells(); ++c) {
    vtkNew<vtkIdList> ids;
    grid.GetCellPoints(c, ids);
    if (ids->GetNumberOfIds() != 4) continue;
    Tet tet;
    for (int k = 0; k < 4; ++k) tet[k] = static_cast<int>(ids->GetId(k));
    const Vec3<double>& o = points[tet[0]];
    if (dot(cross(points[tet[1]] - o, points[tet[2]] - o), points[tet[3]] - o) < 0.0) {
      std::swap(tet[1], tet[2]);
    }
    tets.push_back(tet);
  }
  const std::vector<int> labels(tets.size(), 1);
  Model model = make_model(
      points, tets, labels,
      {{1,
        {.youngs_modulus = 1491.6e3, .poisson_ratio = 0.4751, .density = 963.0, .damping = 0.01}}});
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    model.fixed[i] = model.rest[i].z + model.origin.z < 1e-6;
  }
  return model;
}

// Mean of the vertices about z, mm: y and z as they are deformed.
Drawing::Point mean_at(const Model& model, const State& state, double z, double reach) {
  Drawing::Point sum{};
  int count = 0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    const Vec3<double> rest = model.rest[i] + model.origin;
    if (std::abs(rest.z - z) > reach) continue;
    sum[0] += 1e3 * (rest.z + state.u[i].z), sum[1] += 1e3 * (rest.y + state.u[i].y);
    ++count;
  }
  return {sum[0] / count, sum[1] / count};
}

std::vector<Drawing::Point> axis_of(const Model& model, const State& state) {
  std::vector<Drawing::Point> axis;
  for (int k = 0; k <= 26; ++k) axis.push_back(mean_at(model, state, 0.007 * k, 0.004));
  return axis;
}

}  // namespace

MeasuredBody pdms_cylinder(const std::filesystem::path& data) {
  MeasuredBody body{
      .name = "PDMS cylinder",
      .about =
          "r 4.25, L 182 mm, clamped at one end, bent by its own weight (Mazier et al., \"Inverse "
          "simulation of soft bodies\", 2022; a mesh of fenics-inverseFEM). 963 kg/m3, E 1,491.6 "
          "kPa and nu .4751, the small-strain moduli of the authors' Mooney-Rivlin law. Its "
          "measured tip is not among the data: errors are those against quadratic tets on the same "
          "mesh, in percent of the tip's drop, and the tip is what a measurement may be held "
          "against."};
  const char* const colours[] = {"#222222", "#d1495b", "#8d99ae", "#66a182"};
  Drawing drawing({-8.0, -130.0}, {190.0, 20.0}, 4.5);
  const std::filesystem::path file = data / "pdms_cylinder" / "cylinderPDMS12724Vol.vtk";
  if (!std::filesystem::exists(file)) {
    body.skipped = "there is no pdms_cylinder/cylinderPDMS12724Vol.vtk in VISCERA_MEASURED";
    return body;
  }
  const Model model = read(file);
  Scene scene = elastic_scene();
  scene.params<Gravity>().emplace_back().direction = {0.0, -1.0, 0.0};
  Drawing::Point truth{};
  for (std::size_t w = 0; w < ways().size(); ++w) {
    const Way& way = ways()[w];
    if (way.name == "pbd") continue;  // its stiffness is not E
    const auto [state, seconds] = way.settle(model, scene, at_rest(model));
    const auto tip = mean_at(model, state, length, 1e-6);
    if (w == 0) truth = tip;
    const double off = std::hypot(tip[0] - truth[0], tip[1] - truth[1]);
    body.rows.push_back({fmt::format("{} tets", model.tet_count()), "tip", way.name,
                         100.0 * off / std::abs(truth[1]), 2.0, NAN, "% of the drop",
                         fmt::format("tip at y {:.2f}, z {:.2f} mm", tip[1], tip[0]), seconds});
    drawing.line(axis_of(model, state), colours[w], 2.5);
    drawing.text({0.0, -70.0 - 8.0 * static_cast<double>(w)}, way.name, colours[w]);
  }
  drawing.text({-6.0, 13.0}, "axis of the cylinder, seen from the side; mm / 4.5 px");
  body.pictures.push_back({"pdms_cylinder.svg", "The axis of the bent cylinder.", drawing.svg()});
  return body;
}

}  // namespace viscera::sim
