// A body in a VTK renderer: the surface of each material, the outermost translucent, and the
// outline of its rest shape. Millimetres.
#pragma once

#include <vtkActor.h>
#include <vtkLookupTable.h>
#include <vtkPoints.h>
#include <vtkPolyData.h>
#include <vtkRenderer.h>
#include <vtkSmartPointer.h>

#include <array>

#include "stages/live/shown.hpp"

namespace viscera::live {

using Color = std::array<double, 3>;

class BodyView {
 public:
  // All materials in the scene's colours; or, as an overlay, the outermost surface in one colour.
  BodyView(const Session& session, vtkRenderer& renderer);
  BodyView(const Session& session, vtkRenderer& renderer, const Color& overlay);

  void show(const Snapshot& snapshot, Measure measure);
  void show_ghost(bool on);
  void tint_outermost(const Color& color);
  void set_translucent(bool on);

  // The actors that can be taken hold of, and the vertices of a cell of one.
  const std::vector<vtkSmartPointer<vtkActor>>& actors() const { return actors_; }
  const sim::Triangle& face(const vtkActor* actor, vtkIdType cell) const;
  vtkLookupTable& colors() { return *table_; }
  const std::string& outermost_name() const { return surfaces_.all[surfaces_.outermost].name; }
  const std::vector<float>& positions() const { return positions_; }  // as drawn, mm

 private:
  void add(std::size_t surface, vtkRenderer& renderer, const Color& color, double opacity);
  void color(const Snapshot& snapshot, Measure measure);

  const sim::Model& body_;
  Surfaces surfaces_;
  Measurer measurer_;
  std::vector<float> positions_;
  std::vector<std::size_t> drawn_;  // the surface of each actor
  std::vector<vtkSmartPointer<vtkPolyData>> data_;
  std::vector<vtkSmartPointer<vtkActor>> actors_;
  vtkSmartPointer<vtkActor> ghost_;
  vtkSmartPointer<vtkLookupTable> table_;
};

// The grounds that a scene names, as plates under the body.
void show_grounds(const Session& session, const sim::Scene& scene, vtkRenderer& renderer);

}  // namespace viscera::live
