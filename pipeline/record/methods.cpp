#include "pipeline/record/methods.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>

namespace viscera::engine {
namespace {

// Sources that several entries have.
constexpr const char* xpbd =
    "Macklin M, Müller M, Chentanez N. XPBD: position-based simulation of compliant constrained "
    "dynamics. Motion in Games, 2016.";
constexpr const char* pbd =
    "Müller M, Heidelberger B, Hennix M, Ratcliff J. Position based dynamics. J Vis Commun Image "
    "Represent 18:109-118, 2007.";
constexpr const char* constraints_of_neo_hookean =
    "Macklin M, Müller M. A constraint-based formulation of stable Neo-Hookean materials. Motion, "
    "Interaction and Games, 2021.";
constexpr const char* stable_neo_hookean =
    "Smith B, de Goes F, Kim T. Stable Neo-Hookean flesh simulation. ACM Trans Graph 37(2), 2018.";
constexpr const char* mooney_rivlin =
    "The tissue follows the Mooney-Rivlin law with each material's Young's modulus and Poisson's "
    "ratio, in a form that stays finite when an element is inverted.";
constexpr const char* source_of_mooney_rivlin =
    "Rivlin RS. Large elastic deformations of isotropic materials IV. Phil Trans R Soc A "
    "241:379-397, 1948.";
constexpr const char* ogden =
    "The tissue follows Ogden's law with each material's Young's modulus and Poisson's ratio, in "
    "a form that stays finite when an element is inverted.";
constexpr const char* source_of_ogden =
    "Ogden RW. Large deformation isotropic elasticity: on the correlation of theory and "
    "experiment for incompressible rubberlike solids. Proc R Soc A 326:565-584, 1972.";
constexpr const char* linear = "The tissue is linearly elastic.";
constexpr const char* limit_of_linear =
    "Linear elasticity is for small strains and rotations: a body that turns swells.";
constexpr const char* stvk = "The tissue follows the St. Venant-Kirchhoff law.";
constexpr const char* source_of_stvk =
    "Sifakis E, Barbic J. FEM simulation of 3D deformable solids. SIGGRAPH courses, 2012.";
constexpr const char* limit_of_stvk =
    "The St. Venant-Kirchhoff law softens in compression and may invert.";
constexpr const char* smoothed =
    "Liu GR, Nguyen-Thoi T. Smoothed Finite Element Methods. CRC Press, 2010.";
constexpr const char* hooke =
    "Mehrabadi MM, Cowin SC. Eigentensors of linear anisotropic elastic materials. Q J Mech Appl "
    "Math 43:15-41, 1990.";
constexpr const char* friction =
    "Macklin M, Müller M, Chentanez N, Kim TY. Unified particle physics for real-time "
    "applications. ACM Trans Graph 33(4), 2014.";
constexpr const char* impact =
    "Mirtich B. Impulse-based Dynamic Simulation of Rigid Body Systems. PhD thesis, University of "
    "California, Berkeley, 1996.";
constexpr const char* continuum =
    "Bonet J, Wood RD. Nonlinear Continuum Mechanics for Finite Element Analysis. 2nd edition, "
    "Cambridge University Press, 2008.";
constexpr const char* time_steps =
    "Hairer E, Wanner G. Solving Ordinary Differential Equations II. Springer, 1996.";

constexpr const char* given_mesh = "tetmesh of a given mesh";

// A sentence may name params and metrics of its stage in braces: their values stand there with
// their units. It is left out where the run has no such value.
struct Method {
  const char* kind;
  const char* name;
  std::vector<const char*> sentences;
  std::vector<const char*> sources;
  std::vector<const char*> limits = {};
};

const Method obstacle_of(const char* name, const char* sentence) {
  return {"effect",
          name,
          {sentence},
          {friction, impact},
          {"Obstacles act on the vertices of the body: what is smaller than the triangles of its "
           "surface fits between them."}};
}

const std::vector<Method> known_methods = {
    {"stage",
     "labels",
     {"The segmentation was reduced to its materials; components and holes smaller than "
      "{min_component} were given to their neighbours, and of connected bodies was kept: {keep}."},
     {}},
    {"stage",
     "surface",
     {"The surface of each material was extracted as an isosurface of its mask (method: {method}; "
      "Gaussian of standard deviation {sigma})."},
     {"Lorensen WE, Cline HE. Marching cubes: a high resolution 3D surface construction algorithm. "
      "Computer Graphics 21(4):163-169, 1987.",
      "Schroeder W, Maynard R, Geveci B. Flying edges: a high-performance scalable isocontouring "
      "algorithm. IEEE LDAV, 2015."}},
    {"stage",
     "tetmesh",
     {"The volume was meshed by Delaunay refinement with a bound on the circumradius of "
      "{cell_size}.",
      "The mesh has {tets} tetrahedra and {points} vertices; its smallest dihedral angle is "
      "{dihedral_min}."},
     {"Boissonnat JD, Oudot S. Provably good sampling and meshing of surfaces. Graph Models "
      "67:405-451, 2005.",
      "Jamin C, Alliez P, Yvinec M, Boissonnat JD. CGALmesh: a generic framework for Delaunay mesh "
      "generation. ACM Trans Math Softw 41(4), 2015."},
     {"The distance of the meshed surface from the patient's own is not known: it is that of the "
      "segmentation and of its smoothing."}},
    {"stage",
     given_mesh,
     {"A given mesh was taken and checked: it has {tets} tetrahedra and {points} vertices; its "
      "smallest dihedral angle is {dihedral_min}."},
     {}},
    {"improve",
     "own",
     {"The mesh was improved by topological changes and by moving vertices, the worst tetrahedra "
      "first."},
     {"Freitag LA, Ollivier-Gooch C. Tetrahedral mesh improvement using swapping and smoothing. "
      "Int "
      "J Numer Methods Eng 40:3979-4002, 1997.",
      "Klingner BM, Shewchuk JR. Aggressive tetrahedral mesh improvement. 16th International "
      "Meshing Roundtable, 2008."}},
    {"improve",
     "cgal",
     {"Slivers were removed by perturbation and exudation of the mesh's vertices."},
     {}},
    {"stage",
     "simulate",
     {"The motion was computed in {precision} precision on {device}, in frames with {substeps} "
      "substeps each.",
      "The simulation ended after {frames} frames; the body came to rest after {rest_time}."},
     {}},
    {"stage", "report", {"The results were summarised on one page."}, {}},
    {"stage", "compare", {"The runs were compared with one another."}, {}},
    {"stage", "cohort", {"The figures of all cases were collected on one page."}, {}},

    {"solver",
     "xpbd",
     {"The equations of motion were solved by extended position based dynamics (XPBD; "
      "iterations a substep: {iterations})."},
     {xpbd},
     {"XPBD with few iterations leaves an error of its own, which the error bar has as its part of "
      "the solver."}},
    {"solver",
     "pbd",
     {"The constraints were solved by position based dynamics (PBD; iterations a substep: "
      "{iterations})."},
     {pbd},
     {"The stiffness of PBD depends on iterations and substeps: its tissue has no modulus."}},
    {"solver",
     "tled",
     {"The equations of motion were solved by total Lagrangian explicit dynamics."},
     {"Miller K, Joldes G, Lance D, Wittek A. Total Lagrangian explicit dynamics finite element "
      "algorithm for computing soft tissue deformation. Commun Numer Methods Eng 23:121-134, "
      "2007."},
     {"Explicit dynamics has no bound on compression: single tetrahedra may turn inside out for "
      "some frames."}},
    {"solver",
     "fem",
     {"The balance of forces was solved by implicit finite elements: Newton's method with a line "
      "search, to a residual of {fem_tolerance} of the forces."},
     {continuum}},
    {"scheme",
     "gauss_seidel",
     {"Elements were solved one after the other (Gauss-Seidel), in parallel within colours of "
      "elements that share no vertex."},
     {}},
    {"scheme",
     "block_gauss_seidel",
     {"Elements were solved by Gauss-Seidel within blocks of the mesh, which exchange forces "
      "through dual variables after every substep. A time step of second order goes on by a mean "
      "of all changes before it, each of which weighs 0.8 times the next, not by the last alone."},
     {},
     {"At as many substeps blocks rest further from equilibrium than elements by colours do."}},
    {"scheme",
     "jacobi",
     {"All elements were solved from the same state (Jacobi), with the corrections divided by a "
      "factor of {split}."},
     {}},
    {"element",
     "linear",
     {"Elements are linear tetrahedra."},
     {},
     {"Linear tetrahedra lock: they are too stiff in bending and in nearly incompressible "
      "tissue."}},
    {"element",
     "smoothed",
     {"The strain of linear tetrahedra was averaged over the tetrahedra around each edge "
      "(edge-based smoothed finite elements)."},
     {smoothed},
     {"Smoothed elements bend a few percent too little where few of them lie across a body."}},
    {"element", "quadratic", {"Elements are quadratic tetrahedra of ten nodes."}, {continuum}},
    {"time order",
     "1",
     {"Time steps are those of the implicit Euler method."},
     {time_steps},
     {"Time steps of first order lose energy: vibrations die away faster than the damping says."}},
    {"time order",
     "2",
     {"Time steps are of second order (the backward differentiation formula BDF2)."},
     {time_steps}},
    {"option",
     "accuracy_limit",
     {"Elements hold their forces from one substep to the next, so that the body rests where its "
      "law says."},
     {},
     {"Held forces are exact at rest only: swinging stays too soft and is damped less."}},
    {"option",
     "certify",
     {"The discretisation error at rest was estimated by equilibria of linear and of quadratic "
      "tetrahedra on the same mesh, found by Newton's method."},
     {"Bank RE, Smith RK. A posteriori error estimates based on hierarchical bases. SIAM J Numer "
      "Anal 30:921-935, 1993."},
     {"The error bar rests on the saturation assumption and does not know how far the surface is "
      "from the patient's, nor whether materials and loads are right."}},
    {"option",
     "forces",
     {"Resultants and moments of supports, obstacles and loads were found from the balance of "
      "momentum."},
     {}},

    {"effect", "gravity", {"Gravity acts on all of the body."}, {}},
    {"effect",
     "grip",
     {"The tissue around a point was led by a compliant hold, a critically damped oscillator."},
     {},
     {"The flesh lags behind a compliant hold by what it resists."}},
    {"effect", "fixed", {"Vertices of the supports were held at rest (Dirichlet condition)."}, {}},
    {"effect",
     "prescribed",
     {"Vertices were led along prescribed displacements (Dirichlet condition)."},
     {}},
    {"effect",
     "viscosity",
     {"The tissue is damped as a Kelvin-Voigt solid with each material's relaxation time."},
     {},
     {"Where damping acts as an explicit force it is lowered on the smallest and stiffest "
      "tetrahedra to stay stable; the gate damping_acting says how much of it acts."}},
    {"effect",
     "pressure",
     {"Pressure acts on a patch of the surface and follows it."},
     {continuum}},
    {"effect",
     "load",
     {"A load of constant size and direction acts on a part of the body."},
     {continuum}},
    {"effect",
     "neo_hookean",
     {"The tissue is stable Neo-Hookean with each material's Young's modulus and Poisson's ratio, "
      "solved as two constraints of each tetrahedron."},
     {constraints_of_neo_hookean, stable_neo_hookean},
     {"The tissue is isotropic and homogeneous within each material."}},
    {"effect",
     "smoothed_neo_hookean",
     {"The tissue is stable Neo-Hookean with each material's Young's modulus and Poisson's ratio, "
      "solved as two constraints of each smoothing domain."},
     {constraints_of_neo_hookean, stable_neo_hookean},
     {"The tissue is isotropic and homogeneous within each material."}},
    {"effect",
     "grouped_volume",
     {"Most of the tissue's stiffness against a change of volume acts on disjoint groups of some "
      "eight tetrahedra, so that nearly incompressible tissue does not lock."},
     {"de Souza Neto EA, Pires FMA, Owen DRJ. F-bar-based linear triangles and tetrahedra for "
      "finite strain analysis of nearly incompressible solids. Part I. Int J Numer Methods Eng "
      "62:353-383, 2005."}},
    {"effect",
     "mooney_rivlin",
     {mooney_rivlin},
     {source_of_mooney_rivlin, stable_neo_hookean},
     {"The tissue is isotropic and homogeneous within each material."}},
    {"effect",
     "smoothed_mooney_rivlin",
     {mooney_rivlin},
     {source_of_mooney_rivlin, stable_neo_hookean},
     {"The tissue is isotropic and homogeneous within each material."}},
    {"effect",
     "ogden",
     {ogden},
     {source_of_ogden, stable_neo_hookean},
     {"The tissue is isotropic and homogeneous within each material."}},
    {"effect",
     "smoothed_ogden",
     {ogden},
     {source_of_ogden, stable_neo_hookean},
     {"The tissue is isotropic and homogeneous within each material."}},
    {"effect", "linear", {linear}, {hooke}, {limit_of_linear}},
    {"effect", "smoothed_linear", {linear}, {hooke}, {limit_of_linear}},
    {"effect", "stvk", {stvk}, {source_of_stvk, hooke}, {limit_of_stvk}},
    {"effect", "smoothed_stvk", {stvk}, {source_of_stvk, hooke}, {limit_of_stvk}},
    {"effect",
     "corotational",
     {"The tissue follows corotational linear elasticity."},
     {"Müller M, Gross M. Interactive virtual materials. Graphics Interface, 2004.",
      "Chao I, Pinkall U, Sanan P, Schröder P. A simple geometric model for elastic deformations. "
      "ACM Trans Graph 29(4), 2010.",
      hooke},
     {"Corotational elasticity is too soft in large compression."}},
    {"effect",
     "distance",
     {"Springs along the edges of the tetrahedra have each material's shear modulus."},
     {"Van Gelder A. Approximate simulation of elastic membranes by triangulated spring meshes. J "
      "Graph Tools 3(2):21-41, 1998."},
     {"A network of springs is isotropic on the average only."}},
    {"effect",
     "volume",
     {"The volume of the tetrahedra is kept with each material's first Lamé constant."},
     {constraints_of_neo_hookean}},
    {"effect",
     "fibre",
     {"Fibres resist being stretched and not being compressed (transverse isotropy)."},
     {"Spencer AJM. Continuum Theory of the Mechanics of Fibre-Reinforced Composites. Springer, "
      "1984.",
      "Holzapfel GA, Gasser TC, Ogden RW. A new constitutive framework for arterial wall mechanics "
      "and a comparative study of material models. J Elasticity 61:1-48, 2000."}},
    {"effect",
     "prony",
     {"The tissue is viscoelastic in shear: branches of a Prony series (generalised Maxwell "
      "solid)."},
     {"Simo JC, Hughes TJR. Computational Inelasticity. Springer, 1998."}},
    {"effect",
     "spring",
     {"A patch of the surface rests on an elastic bed of Winkler's kind."},
     {"Winkler E. Die Lehre von der Elasticität und Festigkeit. Dominicus, Prag, 1867."}},
    {"effect",
     "shape_matching",
     {"Regions of the body are drawn back to their shape at rest (shape matching)."},
     {"Müller M, Heidelberger B, Teschner M, Gross M. Meshless deformations based on shape "
      "matching. ACM Trans Graph 24(3):471-478, 2005."},
     {"Shape matching is no material law: its stiffness depends on the size of the regions."}},
    {"effect",
     "self_contact",
     {"The surface does not pass through itself: vertices stay off triangles, with Coulomb "
      "friction."},
     {pbd, friction},
     {"Edges that cross without a vertex over a triangle are not seen by self-contact."}},
    obstacle_of("ground", "A plane below the body supports it, with Coulomb friction."),
    obstacle_of("plane", "Rigid planes are obstacles, with Coulomb friction."),
    obstacle_of("sphere", "Rigid spheres are obstacles, with Coulomb friction."),
    obstacle_of("capsule", "Rigid capsules are obstacles, with Coulomb friction."),
    obstacle_of("box", "Rigid boxes are obstacles, with Coulomb friction."),
};

const Method* find_method(const std::string& kind, const std::string& name) {
  const auto found = std::ranges::find_if(
      known_methods, [&](const Method& one) { return one.kind == kind && one.name == name; });
  return found == known_methods.end() ? nullptr : &*found;
}

std::string value_text(const Json& value) {
  return value.is_number_float() ? fmt::format("{:.4g}", value.get<double>()) : text_of(value);
}

std::string with_unit(const Json& value, const std::string& unit) {
  return value_text(value) + (unit.empty() || unit == "1" ? "" : " " + unit);
}

// Of a metric that has a smallest, a mean and a largest value, the smallest.
std::optional<std::string> figure(const FinishedStage& stage, const std::string& name) {
  const Manifest& manifest = stage.manifest;
  if (name == "device") return manifest.device;
  if (const Metric* const metric = find_metric(stage, name)) {
    const Json& value = metric->value;
    if (value.is_object() && value.contains("min")) return with_unit(value["min"], metric->unit);
    if (value.is_primitive() && !value.is_null()) return with_unit(value, metric->unit);
  }
  const auto param = manifest.params.find(name);
  if (param == manifest.params.end() || !param->is_primitive() || param->is_null()) return {};
  const auto unit = manifest.param_units.find(name);
  return with_unit(*param, unit == manifest.param_units.end() ? "" : unit->second);
}

// "" when the run has no value for one of the names.
std::string filled(const std::string& sentence, const FinishedStage& stage) {
  std::string text;
  std::size_t at = 0;
  for (auto open = sentence.find('{'); open != std::string::npos; open = sentence.find('{', at)) {
    const auto close = sentence.find('}', open);
    const auto value = figure(stage, sentence.substr(open + 1, close - open - 1));
    if (!value) return "";
    text += sentence.substr(at, open - at) + *value;
    at = close + 1;
  }
  return text + sentence.substr(at);
}

class Composer {
 public:
  void add(const FinishedStage& stage, const std::string& kind, const std::string& name) {
    const Method* const method = find_method(kind, name);
    if (!method) return;  // a stage or an effect of another version
    std::string text;
    for (const char* const sentence : method->sentences) {
      const std::string one = filled(sentence, stage);
      if (!one.empty()) text += (text.empty() ? "" : " ") + one;
    }
    if (text.empty()) return;
    std::string references;
    for (const char* const source : method->sources)
      references += fmt::format("{}{}", references.empty() ? "" : ", ", number_of(source));
    if (!references.empty()) text.insert(text.size() - 1, " [" + references + "]");
    paragraph_ += (paragraph_.empty() ? "" : " ") + text;
    for (const char* const limit : method->limits) {
      if (!std::ranges::count(limits_, limit)) limits_.emplace_back(limit);
    }
  }
  Json result() const {
    return {{"paragraph", paragraph_}, {"sources", sources_}, {"limits", limits_}};
  }

 private:
  std::size_t number_of(const std::string& source) {
    const auto found = std::ranges::find(sources_, source);
    if (found != sources_.end()) return 1 + (found - sources_.begin());
    sources_.push_back(source);
    return sources_.size();
  }

  std::string paragraph_;
  std::vector<std::string> sources_, limits_;
};

// What `improve: auto` stands for: a given mesh stays as it is.
void add_mesh(Composer& composer, const FinishedStage& stage) {
  const bool is_given = stage.manifest.inputs.count("mesh") > 0;
  composer.add(stage, "stage", is_given ? given_mesh : stage.name());
  const std::string improve = stage.manifest.params.value("improve", "");
  composer.add(stage, "improve", improve != "auto" ? improve : is_given ? "none" : "own");
}

void add_simulation(Composer& composer, const FinishedStage& stage, const Json& scene) {
  const auto chosen = [&](const char* kind, const Json& name) {
    if (!name.is_null()) composer.add(stage, kind, value_text(name));
  };
  const Json& params = stage.manifest.params;
  chosen("solver", params.value("solver", Json()));
  chosen("scheme", metric_value(&stage, "scheme"));
  chosen("element", metric_value(&stage, "element"));
  chosen("time order", metric_value(&stage, "time_order"));
  const Json effects = metric_value(&stage, "effects_on");
  for (const auto& effect : effects) chosen("effect", effect);
  if (scene.contains("accuracy_limit")) chosen("option", "accuracy_limit");
  for (const char* const option : {"certify", "forces"}) {
    if (params.value(option, Json()) == true) chosen("option", option);
  }
}

}  // namespace

bool has_method(const std::string& kind, const std::string& name) {
  return find_method(kind, name) != nullptr;
}

Json methods_of(const FinishedRun& run) {
  Composer composer;
  for (const FinishedStage& stage : run.stages) {
    if (stage.name() == "tetmesh") {
      add_mesh(composer, stage);
    } else {
      composer.add(stage, "stage", stage.name());
    }
    if (stage.name() == "simulate") add_simulation(composer, stage, run.scene);
  }
  return composer.result();
}

}  // namespace viscera::engine
