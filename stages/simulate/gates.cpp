#include "stages/simulate/gates.hpp"

#include <algorithm>

namespace viscera::simulate_gates {

const GateInfo damping_acting(
    "damping_acting", ">=", "1",
    "Less of the viscosity acts than the scene asks for: the body swings longer and more than its "
    "material would; where it comes to rest is not affected.",
    "set scheme: gauss_seidel or solver: fem, or raise substeps");
const GateInfo inverted_end(
    "inverted_end", "<=", "1",
    "Tets are turned inside out in the last frame: positions and stresses near them are wrong, and "
    "the body is not at rest.",
    "raise substeps, set solver: xpbd or fem, set element: linear, or lower tetmesh.cell_size "
    "where the body is thin");
constexpr const char* adapt_remedy =
    "raise adapt.at_most or adapt.rounds, or substeps where the solver's part is large, or "
    "time.end (simulate.end) where the body was not at rest, or put supports into "
    "tetmesh.regions; or allow more by ";
const GateInfo adapt_total(
    "adapt_total", "<=", "1",
    "The body at rest is farther off than `adapt` asks for, or how far is not known: positions are "
    "not good to this share of the displacement, and no finer mesh follows.",
    std::string(adapt_remedy) + "adapt.total");
const GateInfo adapt_within(
    "adapt_within", "<=", "mm",
    "What `adapt` names is farther off at rest than it asks for, or how far is not known: its "
    "place is not good to this length, and no finer mesh follows.",
    std::string(adapt_remedy) + "adapt.within");

namespace {

struct Expectable {
  const char *metric, *unit, *meaning, *remedy;
};

constexpr const char* steadier = "raise substeps, or lower tetmesh.cell_size, or change ";

const Expectable table[] = {
    {"contact_time", "s",
     "The body touches the ground or an obstacle at another time than expected.",
     "check clearance, gravity and the motion of obstacles in the scene, or change "},
    {"rest_time", "s",
     "The body comes to rest at another time than expected, or not at all: figures at the end may "
     "be those of a moving body.",
     "raise time.end (simulate.end) or the materials' damping, or change "},
    {"min_J", "1",
     "A tet is compressed or stretched more than expected: its strain may be beyond what the "
     "material's law holds for.",
     steadier},
    {"inverted_max", "1",
     "Tets are turned inside out in some frames: positions and stresses near them are wrong in "
     "these frames, and the motion after them may be.",
     "raise substeps, set solver: xpbd or fem, set element: linear, lower tetmesh.cell_size where "
     "the body is thin, or change "},
    {"inverted_frames", "1",
     "Tets are turned inside out in more frames than expected: positions and stresses near them "
     "are wrong in these frames.",
     "raise substeps, set solver: xpbd or fem, set element: linear, lower tetmesh.cell_size where "
     "the body is thin, or change "},
    {"volume_ratio_end", "1",
     "The body's volume at the end differs from that at rest by more than expected: it is more "
     "compressible than it should be.",
     "raise the materials' nu, or raise substeps, or change "},
    {"displacement_max_end", "mm",
     "The body ends farther from its scanned place, or nearer to it, than expected.",
     "check materials, loads and attachments in the scene, or change "},
    {"residual_share_end", "1",
     "Forces are not in balance at the end: the body is not at rest, and its stresses still "
     "change.",
     "raise time.end or the materials' damping, or change "},
    {"smoothness_rest", "1", "Neighbouring tets of the mesh differ in size more than expected.",
     "lower tetmesh.grading, give labels equal sizes, or change "},
    {"smoothness_max_deformation", "1",
     "Neighbouring tets of the deformed body differ in size more than expected: the deformation is "
     "concentrated in few of them.",
     steadier},
    {"stability_Cs_max", "1",
     "The time step is longer than the smallest, stiffest tet bears: XPBD may be unstable there.",
     "raise substeps, or set stability: substeps, or change "},
    {"stability_switched_tets", "1",
     "Tets follow the corotational law in place of Neo-Hookean: their stress is not that of the "
     "scene's material.",
     "raise substeps, or change "},
    {"stability_kappa_max", "1",
     "The constraint of volume is much stiffer than inertia: XPBD comes to rest farther from the "
     "material's shape than expected.",
     "raise substeps, or set accuracy_limit, or change "},
    {"stability_courant_max", "1",
     "The time step is longer than a wave takes across the smallest tet: explicit steps are "
     "unstable.",
     "raise substeps, or raise tetmesh.cell_size, or change "},
    {"error_total", "mm",
     "The body at rest is farther off than allowed, or how far is not known: positions are not "
     "good "
     "to this length.",
     "set certify: true and element: auto, or lower tetmesh.cell_size, or change "},
    {"error_total_share", "1",
     "The body at rest is farther off than allowed, or how far is not known: positions are not "
     "good "
     "to this share of the displacement.",
     "set certify: true and element: auto, or lower tetmesh.cell_size, or change "},
    {"locking_estimate", "1",
     "Elements lock: deflections in bending may come out too small by up to this share.",
     "set solver: fem with fem_order: 2, or lower nu or tetmesh.cell_size, or change "},
};

}  // namespace

std::vector<std::string> expectable() {
  std::vector<std::string> names;
  for (const auto& one : table) names.push_back(one.metric);
  return names;
}

GateInfo expected(const std::string& metric, const std::string& comparison) {
  const auto* found = std::ranges::find(table, metric, &Expectable::metric);
  return {metric, comparison, found->unit, found->meaning,
          std::string(found->remedy) + "expect." + metric + " in the scene"};
}

std::vector<GateInfo> all() {
  std::vector<GateInfo> gates = {damping_acting, inverted_end, adapt_total, adapt_within};
  for (const auto& metric : expectable())
    for (const char* comparison : {">=", "<="}) gates.push_back(expected(metric, comparison));
  return gates;
}

}  // namespace viscera::simulate_gates
