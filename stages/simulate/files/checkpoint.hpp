// checkpoint.h5: the whole state of a run, from which it goes on to the same bits.
//
//   /u, /v    float64 [n][3]   displacement m, velocity m/s
//   /history  float64 [k]      of effects (State::history)
//   /step     uint64           substeps done
//   /substep  float64          s
//   /body     float64          fingerprint_of() the body
//
// and, of solvers that have them, /added_u, /added_v, /carried, /held and /nodes
// (sim/model/state.hpp). The first 512 bytes hold the SHA-256 digest of all others, so that a
// damaged file is never gone on from.
//
// Single precision states are kept in double without loss.
#pragma once

#include <filesystem>
#include <optional>

#include "sim/model/state.hpp"
#include "sim/scene/scene.hpp"

namespace viscera {

// What tells bodies apart: of their shape at rest and their tets, not of their materials, with
// others of which a run may go on.
double fingerprint_of(const sim::Model& model);

void write_checkpoint(const std::filesystem::path& path, const sim::State& state, double substep_s,
                      std::optional<double> body = {});

// Throws Error(bad_input) for a file that is not one, or is that of another mesh or time grid.
sim::State read_checkpoint(const std::filesystem::path& path, std::size_t vertices,
                           const sim::TimeGrid& time, std::optional<double> body = {});

}  // namespace viscera
