#include "stages/live/window/body_view.hpp"

#include <vtkCellArray.h>
#include <vtkFloatArray.h>
#include <vtkPlaneSource.h>
#include <vtkPointData.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>

#include <algorithm>

#include "stages/simulate/body.hpp"

namespace viscera::live {
namespace {

// Of the outermost material and of those within, told apart without red against green.
constexpr std::array<Color, 5> palette = {{{0.78, 0.36, 0.30},
                                           {0.95, 0.80, 0.25},
                                           {0.22, 0.45, 0.80},
                                           {0.35, 0.70, 0.65},
                                           {0.75, 0.55, 0.80}}};
constexpr double translucent = 0.4;

vtkSmartPointer<vtkFloatArray> array_of(const std::vector<float>& values, int components) {
  auto array = vtkSmartPointer<vtkFloatArray>::New();
  array->SetNumberOfComponents(components);
  array->SetNumberOfTuples(static_cast<vtkIdType>(values.size()) / components);
  std::ranges::copy(values, array->GetPointer(0));
  return array;
}

vtkSmartPointer<vtkPoints> points_of(const std::vector<float>& positions) {
  auto points = vtkSmartPointer<vtkPoints>::New();
  points->SetData(array_of(positions, 3));
  return points;
}

vtkSmartPointer<vtkPolyData> data_of(const std::vector<sim::Triangle>& faces,
                                     const std::vector<float>& positions) {
  auto cells = vtkSmartPointer<vtkCellArray>::New();
  for (const auto& [a, b, c] : faces) {
    const vtkIdType corners[3] = {a, b, c};
    cells->InsertNextCell(3, corners);
  }
  auto data = vtkSmartPointer<vtkPolyData>::New();
  data->SetPoints(points_of(positions));
  data->SetPolys(cells);
  return data;
}

vtkSmartPointer<vtkActor> actor_of(vtkPolyData* data, vtkLookupTable* table, const Color& color,
                                   double opacity) {
  auto mapper = vtkSmartPointer<vtkPolyDataMapper>::New();
  mapper->SetInputData(data);
  if (table) mapper->SetLookupTable(table);
  mapper->UseLookupTableScalarRangeOn();
  mapper->ScalarVisibilityOff();
  auto actor = vtkSmartPointer<vtkActor>::New();
  actor->SetMapper(mapper);
  auto* property = actor->GetProperty();
  property->SetColor(color[0], color[1], color[2]);
  property->SetOpacity(opacity);
  property->SetInterpolationToPhong();
  property->SetAmbient(0.12);
  property->SetSpecular(0.25);
  property->SetSpecularPower(20.0);
  return actor;
}

}  // namespace

BodyView::BodyView(const Session& session, vtkRenderer& renderer)
    : body_(session.body()),
      surfaces_(surfaces_of(body_)),
      measurer_(body_, surfaces_),
      positions_(positions_mm(body_, {std::vector<Point>(body_.vertex_count()), {}})),
      table_(vtkSmartPointer<vtkLookupTable>::New()) {
  table_->SetHueRange(0.62, 0.08);
  table_->SetSaturationRange(0.8, 0.9);
  table_->SetValueRange(0.75, 1.0);
  std::size_t inner = 0;
  for (std::size_t i = 0; i < surfaces_.all.size(); ++i) {
    if (i == surfaces_.outermost) continue;
    add(i, renderer, palette[1 + inner++ % (palette.size() - 1)], 1.0);
  }
  add(surfaces_.outermost, renderer, palette[0], translucent);  // last: drawn over what is within
  const auto rest = data_of(surfaces_.all[surfaces_.outermost].faces, positions_);
  ghost_ = actor_of(rest, table_, {0.6, 0.65, 0.7}, 0.12);
  ghost_->GetProperty()->SetRepresentationToWireframe();
  ghost_->PickableOff();
  renderer.AddActor(ghost_);
}

BodyView::BodyView(const Session& session, vtkRenderer& renderer, const Color& overlay)
    : body_(session.body()),
      surfaces_(surfaces_of(body_)),
      measurer_(body_, surfaces_),
      positions_(positions_mm(body_, {std::vector<Point>(body_.vertex_count()), {}})),
      table_(vtkSmartPointer<vtkLookupTable>::New()) {
  add(surfaces_.outermost, renderer, overlay, 0.35);
  actors_.back()->PickableOff();
}

void BodyView::add(std::size_t surface, vtkRenderer& renderer, const Color& color, double opacity) {
  drawn_.push_back(surface);
  data_.push_back(data_of(surfaces_.all[surface].faces, positions_));
  actors_.push_back(actor_of(data_.back(), table_, color, opacity));
  renderer.AddActor(actors_.back());
}

void BodyView::show(const Snapshot& snapshot, Measure measure) {
  positions_ = positions_mm(body_, snapshot.state);
  for (std::size_t i = 0; i < data_.size(); ++i) {
    data_[i]->SetPoints(points_of(positions_));
    const auto normals = normals_of(surfaces_.all[drawn_[i]].faces, positions_);
    data_[i]->GetPointData()->SetNormals(array_of(normals, 3));
  }
  color(snapshot, measure);
}

// The scale reaches from the least to the most of what is shown, so that it is never a lie.
void BodyView::color(const Snapshot& snapshot, Measure measure) {
  const bool by_value = measure != Measure::material;
  if (by_value) {
    const auto values = measurer_.measure(measure, snapshot);
    float low = values.empty() ? 0.0F : 1e30F, high = -low;
    for (const std::size_t surface : drawn_) {
      for (const auto& face : surfaces_.all[surface].faces) {
        for (const int v : face) low = std::min(low, values[v]), high = std::max(high, values[v]);
      }
    }
    table_->SetRange(low, std::max(high, low + 1e-6F));
    const auto scalars = array_of(values, 1);
    for (const auto& data : data_) data->GetPointData()->SetScalars(scalars);
  }
  for (const auto& actor : actors_) actor->GetMapper()->SetScalarVisibility(by_value);
}

void BodyView::show_ghost(bool on) {
  if (ghost_) ghost_->SetVisibility(on);
}

void BodyView::tint_outermost(const Color& color) {
  actors_.back()->GetProperty()->SetColor(color[0], color[1], color[2]);
}

void BodyView::set_translucent(bool on) {
  actors_.back()->GetProperty()->SetOpacity(on ? translucent : 1.0);
}

const sim::Triangle& BodyView::face(const vtkActor* actor, vtkIdType cell) const {
  const auto found = std::ranges::find(actors_, actor, [](const auto& a) { return a.Get(); });
  return surfaces_.all[drawn_[found - actors_.begin()]].faces[cell];
}

void show_grounds(const Session& session, const sim::Scene& scene, vtkRenderer& renderer) {
  const sim::Model& body = session.body();
  const double half = m_to_mm * body.size();
  for (const auto& params : scene.params<sim::Ground>()) {
    const auto ground = sim::Ground::device<double>(body, params);
    const Point center = m_to_mm * (body.origin + ground.offset * ground.normal);
    auto plate = vtkSmartPointer<vtkPlaneSource>::New();
    plate->SetOrigin(-half, -half, 0.0);
    plate->SetPoint1(half, -half, 0.0);
    plate->SetPoint2(-half, half, 0.0);
    plate->SetCenter(center.x, center.y, center.z);
    plate->SetNormal(ground.normal.x, ground.normal.y, ground.normal.z);
    plate->Update();
    auto actor = actor_of(plate->GetOutput(), nullptr, {0.45, 0.48, 0.52}, 0.35);
    actor->GetProperty()->SetAmbient(0.5);
    actor->PickableOff();
    renderer.AddActor(actor);
  }
}

}  // namespace viscera::live
