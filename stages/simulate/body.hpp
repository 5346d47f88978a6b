// The mesh as the simulation takes it, and positions as it gives them back: millimetres and metres
// meet here and nowhere else.
#pragma once

#include "sim/model/model.hpp"
#include "sim/model/state.hpp"
#include "stages/mesh/tet_mesh.hpp"

namespace viscera {

inline constexpr double mm_to_m = 1e-3, m_to_mm = 1e3;

// Throws sim::Refusal as sim::make_model does.
sim::Model make_body(const TetMesh& mesh, const std::map<int, sim::Material>& by_label);

// [tets] m3, of a mesh that says it (missing_volume), else empty.
std::vector<double> missing_volumes(const TetMesh& mesh);

// x, y, z of every vertex, LPS mm.
std::vector<float> positions_mm(const sim::Model& model, const sim::State& state);

// The middle of a tet as it was scanned, LPS mm.
std::array<double, 3> scanned_place(const sim::Model& model, std::size_t tet);

}  // namespace viscera
