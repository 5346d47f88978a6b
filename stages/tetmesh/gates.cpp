#include "stages/tetmesh/gates.hpp"

namespace viscera::mesh_gates {

const GateInfo volume_error(
    "volume_error", "<=", "1",
    "The body of the mesh has another volume than its input: mass and weight are wrong by that "
    "share.",
    "lower cell_size, or raise target_tets, or raise max_volume_error");
const GateInfo label_volume_error(
    "volume_error", "<=", "1",
    "The label has another volume in the mesh than in its input: its mass, and how much of the "
    "body has its stiffness, are wrong by that share.",
    "give the label smaller cells with sizes, raise volume_passes, or raise max_label_error");
const GateInfo min_dihedral(
    "min_dihedral", ">=", "deg",
    "The mesh has slivers: they shorten the time step of the whole run, and strains in them are "
    "less accurate.",
    "set improve: own, lower cell_size where labels are thin, or lower min_dihedral");
const GateInfo inverted("inverted", "<=", "1",
                        "Tets have no positive volume: no simulation can start from them.",
                        "set improve: own, or change cell_size a little");
const GateInfo duplicates(
    "duplicates", "<=", "1",
    "Tets or points occur twice: mass is counted twice there, or parts that look joined are not.",
    "merge them in the program that made the mesh, or let viscera-tetmesh make it from labels");
const GateInfo stray_points("stray_points", "<=", "1",
                            "Points belong to no tet: they have no mass and cannot be simulated.",
                            "remove them in the program that made the mesh");
const GateInfo non_manifold(
    "non_manifold", "<=", "1",
    "Parts of the boundary meet at an edge or a point only: they hinge there without resistance, "
    "and contact has no side.",
    "lower cell_size, or mend the mesh in the program that made it");
const GateInfo components(
    "components", "<=", "1",
    "The mesh falls into more bodies than its input: parts that belong together move apart.",
    "lower cell_size so that thin connections are meshed, or keep: largest in viscera-labels");
const GateInfo lost_volume(
    "lost_volume", "<=", "1",
    "Parts of the body are not in the mesh: their mass and stiffness are missing.",
    "lower cell_size, or sigma where smoothing removes them, or raise max_lost_volume");
const GateInfo lost_distance(
    "lost_distance", "<=", "cell sizes",
    "The body reaches farther out than the mesh: the shape is wrong there, and contact comes too "
    "late.",
    "lower cell_size, or sigma where smoothing removes the part, or raise max_lost_distance");
const GateInfo max_distance(
    "max_distance", "<=", "mm",
    "The mesh and the surface lie farther apart than allowed: the shape is wrong there.",
    "lower cell_size, or raise max_distance");
const GateInfo altitude_min(
    "altitude_min", ">=", "mm",
    "Tets are too flat for the substeps asked for: a simulation with that many is unstable.",
    "raise cell_size or substeps, or set improve: own");
const GateInfo target_tets(
    "target_tets", "<=", "1",
    "No cell size gave the number of tets asked for: time and accuracy are those of another mesh.",
    "set cell_size in place of target_tets, or another target_tets");

std::vector<GateInfo> all() {
  return {volume_error, label_volume_error, min_dihedral, inverted,    duplicates,
          stray_points, non_manifold,       components,   lost_volume, lost_distance,
          max_distance, altitude_min,       target_tets};
}

}  // namespace viscera::mesh_gates
