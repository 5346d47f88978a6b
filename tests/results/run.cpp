#include "tests/results/run.hpp"

#include <Eigen/Geometry>
#include <cstdlib>
#include <limits>

#include "tests/results/twins.hpp"

namespace viscera::sim {
namespace {

// Implicit steps are larger: two where the others take 64.
Scene after_policy(const Model& model, Scene scene, const SolverOptions& options) {
  if (options.method == Method::fem) scene.time.substeps = (scene.time.substeps + 31) / 32;
  apply_policy(model, scene, options);
  return scene;
}

std::string device_asked_for() {
  const char* const device = std::getenv("VISCERA_TEST_DEVICE");
  return device ? device : "";
}

std::unique_ptr<Solver> make_under_test(const Model& model, const Scene& scene,
                                        const SolverOptions& options) {
  if (!runs_on_cuda() || !what_cuda_lacks(scene, options).empty()) {
    return make_on_cpu(model, scene, options);
  }
  auto cuda = make_on_cuda(model, scene, options);
  // Blocks are others on a device, so that a run on the CPU is no twin.
  if (in_blocks(options) || device_asked_for() != "cuda+cpu") return cuda;
  const char* const methods[] = {"xpbd", "pbd", "tled"};
  const char* const schemes[] = {"gauss_seidel", "block_gauss_seidel", "jacobi"};
  SolverOptions on_cpu = options, in_full_precision = options;
  on_cpu.threads = in_full_precision.threads = 0;
  in_full_precision.precision = Precision::fp64;
  const bool single = options.precision == Precision::fp32;
  return std::make_unique<Twins>(
      std::move(cuda), make_on_cpu(model, scene, on_cpu),
      make_on_cpu(model, scene, in_full_precision), model.size(), single ? 0.0 : 1e-15,
      fmt::format("{} {} fp{}, {} tets, {} × {} a frame of {:.3g} ms",
                  methods[static_cast<int>(options.method)],
                  schemes[static_cast<int>(options.scheme)], single ? 32 : 64, model.tet_count(),
                  scene.time.substeps, options.iterations, 1e3 * scene.time.frame_s));
}

}  // namespace

bool runs_on_cuda() {
  return device_asked_for().starts_with("cuda");
}

Run::Run(const Model& model, const Scene& scene, const SolverOptions& options)
    : model_(model),
      scene_(after_policy(model, scene, options)),
      options_(options),
      solver_(make_under_test(model, scene_, options)) {
  look();
}

void Run::look() {
  state_ = solver_->state();
  now_ = solver_->diagnose(model_, scene_, state_);
  finite_ = state_.finite();
  peak_energy_ = std::max(peak_energy_, now_.total());
  peak_speed_ = std::max(peak_speed_, now_.max_speed);
  min_j_ = std::min(min_j_, now_.min_j);
}

bool Run::advance() {
  solver_->advance_frame();
  ++frames_;
  look();
  return finite_;
}

void Run::advance_to(double seconds) {
  while (finite_ && time() < seconds - 1e-9) advance();
}

void Run::settle(double speed, double seconds, double keep) {
  while (advance() && time() < seconds - 1e-9 && now_.max_speed > speed) {
    State slower = state_;
    for (auto& v : slower.v) v *= keep;
    solver_->set_state(slower);
  }
}

double Run::free_fall() const {
  const double dt = scene_.time.substep_s(), n = std::round(time() / dt);
  return 9.80665 * dt * dt * n * (scene_.time.order == 2 ? n : n + 1.0) / 2.0;
}

double Run::elastic_density() const {
  double sum = 0.0;  // mu V, J
  for (std::size_t t = 0; t < model_.tet_count(); ++t) {
    sum += lame(model_.material(t)).mu * model_.volume[t];
  }
  return now_.elastic / sum;
}

double Run::rigid_aligned_rms() const {
  if (!finite_) return std::numeric_limits<double>::quiet_NaN();
  const auto n = static_cast<Eigen::Index>(model_.vertex_count());
  Eigen::Matrix3Xd rest(3, n), now(3, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const Vec3<double>&x = model_.rest[i], y = x + state_.u[i];
    rest.col(i) << x.x, x.y, x.z;
    now.col(i) << y.x, y.y, y.z;
  }
  const Eigen::Matrix4d best = Eigen::umeyama(rest, now, false);
  const Eigen::Matrix3Xd copy =
      (best.topLeftCorner<3, 3>() * rest).colwise() + best.topRightCorner<3, 1>().eval();
  return (now - copy).norm() / std::sqrt(static_cast<double>(n)) / model_.size();
}

State equilibrium(const Model& model, const Scene& scene) {
  SolverOptions newton{.method = Method::fem, .threads = 1};
  newton.fem.time = FemOptions::Time::quasi_static;
  newton.fem.tolerance = 1e-9;
  const auto solver = make_on_cpu(model, scene, newton);
  solver->advance_frame();
  return solver->state();
}

State equilibrium_from(const State& start, const Model& model, const Scene& scene, int order) {
  SolverOptions newton{.method = Method::fem};
  newton.fem.time = FemOptions::Time::quasi_static;
  newton.fem.order = order;
  const auto solver = make_on_cpu(model, scene, newton);
  solver->set_state(start);
  solver->advance_frame();
  return solver->state();
}

State at_rest(const Model& model) {
  State state;
  state.u.resize(model.vertex_count());
  state.v.resize(model.vertex_count());
  return state;
}

double rms_difference(const Model& model, const State& a, const State& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < model.vertex_count(); ++i) {
    sum += dot(a.u[i] - b.u[i], a.u[i] - b.u[i]);
  }
  return std::sqrt(sum / static_cast<double>(model.vertex_count())) / model.size();
}

}  // namespace viscera::sim
