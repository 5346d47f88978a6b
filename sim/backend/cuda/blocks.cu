// Block Gauss-Seidel on a CUDA device: what the kernel of a frame (cuda/block_kernel.cuh) is
// given, how states enter and leave, and how frames are run.
#include <cuda_runtime.h>

#include <algorithm>
#include <barrier>
#include <cstring>

#include "sim/backend/cuda/block_bound.cuh"
#include "sim/backend/cuda/block_kernel.cuh"
#include "sim/backend/cuda/block_setup.cuh"
#include "sim/backend/cuda/blocks.hpp"
#include "sim/backend/cuda/memory.cuh"
#include "sim/solvers/across_devices.hpp"
#include "sim/solvers/xpbd/damping_choice.hpp"

namespace viscera::sim {

// nvcc must take an effect for what the host's compiler takes it for. Where it did not, blocks on a
// device were solved by another method than on the host, with a larger error at rest.
static_assert(is_linearized_apart<NeoHookean> && is_linearizable<NeoHookean> &&
              has_reference<NeoHookean>);
static_assert(is_steered<Grip> && is_steered<Collider<Sphere>> && !is_steered<Gravity>);
static_assert(can_stop<Collider<Sphere>, double> && is_rate_force<Viscosity> &&
              history_of<Prony> > 0);

namespace {

constexpr int min_block = 150;     // tets: smaller blocks cost accuracy and are no faster
constexpr int max_wanted = 12000;  // tets: the vertices of larger ones leave no room for the work

template <class Effect, class T, EffectKind kind = Effect::kind>
struct Own {};
template <class Effect, class T>
struct Own<Effect, T, EffectKind::element> : DeviceElements<Effect, T> {
  using DeviceElements<Effect, T>::DeviceElements;
};

// Substeps of one launch, which nothing can interrupt: a few milliseconds.
constexpr int longest_launch = 1024;

constexpr int gather_threads = 256;

// u and v by vertex of those by local vertex, `first` of each vertex.
template <class T>
__global__ void gather_motion(int count, const int* first, const Vec3<T>* u, const Vec3<T>* v,
                              Vec3<T>* u_by_vertex, Vec3<T>* v_by_vertex) {
  const int vertex = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (vertex >= count) return;
  u_by_vertex[vertex] = u[first[vertex]];
  v_by_vertex[vertex] = v[first[vertex]];
}

// Which of the devices that step a body together.
struct Rank {
  int device = 0, devices = 1;
};
using Meeting = std::barrier<>;  // of the threads of all ranks

template <class T>
class CudaBlocks final : public Ensemble {
 public:
  CudaBlocks(const Model& model, const Scene& scene, const SolverOptions& options,
             int tets_per_block, int members, std::string name, Rank rank = {})
      : name_(std::move(name)),
        options_(options),
        members_(members),
        program_(model, scene, time_step_of(scene, options)),
        layout_(model, program_, tets_per_block, team_of(model, program_, tets_per_block)) {
    frame_.damped = (set_for<T>(named_in(program_)) & rate_forces) != 0;
    BoundedTets<T> bounded(model, scene, Method::xpbd);
    require_device_memory(bytes_needed(bounded));
    if (frame_.damped) take_values(model, scene);
    const std::vector<int> passes(members_, program_.viscous_step.passes);
    frame_.rate_passes = (rate_passes_ = DeviceArray<int>(passes)).get();
    frame_.dt = program_.dt;
    frame_.rule = program_.rule;
    frame_.locals = local_count();
    run_blocks_of(rank);
    frame_.team = layout_.team().lanes;
    frame_.single_block = layout_.team().single_block;
    constants_.emplace(layout_, program_);
    constants_->hand_to(frame_);
    make_state();
    bound_.emplace(std::move(bounded), layout_, program_, members_, u_.get(), v_.get(),
                   added_.get());
    for (int member = 0; member < members_; ++member) bound_->set_model(member, model);
    frame_.bound = bound_->view();
    place_effects(assess(model, scene).cs_max);
    if (!std::get<Effects::index_of<SelfContact>()>(program_.effects).empty()) {
      contact_.emplace(layout_, program_, constants_->first_local());
      frame_.self_contact = contact_->view();
    }
    launch_.emplace(named_in(program_), layout_.team().linearizes, own_, frame_);
    make_views();
    graph_ = Graph(stream_, [this] { launch_->enqueue(frame_, members_, stream_); });
    if (!bound_->is_empty()) {
      u_before_ = DeviceArray<Vec3<T>>(u_.size());
      v_before_ = DeviceArray<Vec3<T>>(v_.size());
      added_before_ = DeviceArray<Added<T>>(added_.size());
      duals_before_ = DeviceArray<Vec3<T>>(duals_.size());
    }
  }

  // Steps a body with others on other devices, which have been made alike; from now on all do the
  // same at the same time.
  void join(std::vector<const CudaBlocks*> others, Meeting& meeting) {
    for (const CudaBlocks* other : others) {
      frame_.messages_of_others[frame_.others++] = other->messages_.get();
    }
    others_ = std::move(others);
    meeting_ = &meeting;
  }
  // What else a state is of, of the blocks of the others, which stand still.
  void take_kept() {
    for (const CudaBlocks* other : others_) {
      const Frame<T>& theirs = other->frame_;
      const int end_block = theirs.first_block + theirs.blocks;
      const int begin = layout_.replicas_in(theirs.first_block).begin;
      const int count = layout_.replicas_in(end_block - 1).end - begin;
      for (int part = 0; part < parts(); ++part) {
        other->duals_.copy_to(duals_, part * replica_count() + begin, count, stream_);
      }
      Effects::for_each([&]<class Effect, std::size_t i>() {
        if constexpr (Effect::kind == EffectKind::element) {
          for (std::size_t k = 0; k < std::get<i>(own_).size(); ++k) {
            std::get<i>(other->own_)[k].copy_history_to(std::get<i>(own_)[k], theirs.first_block,
                                                        end_block, stream_);
          }
        }
      });
    }
    stream_.finish("taking what other devices have");
  }

  int size() const override { return members_; }

  void advance_frame() override {
    std::ranges::fill(has_begun_, 1);
    if (bound_->is_empty()) {
      run_whole_frame();
    } else {
      run_bounded_frame();
    }
    step_ += program_.substeps;
    if (contact_) contact_->check_room();
  }

  State motion(int member) const override {
    gather_vertices(member);
    return {cast_all<double>(u_by_vertex_.download()), cast_all<double>(v_by_vertex_.download()),
            step_ + ahead_.download(member, 1)[0]};
  }
  std::optional<DeviceMotion> motion_on_device(int member) override {
    gather_vertices(member);
    return DeviceMotion{.u = u_by_vertex_.get(),
                        .v = v_by_vertex_.get(),
                        .vertices = u_by_vertex_.size(),
                        .bytes = sizeof(T),
                        .device = current_device()};
  }
  State state(int member) const override {
    const std::size_t locals = local_count(), first = member * locals;
    State state = motion(member);
    program_.save_added(gathered(added_.download(first, locals)), state);
    const std::size_t duals = dual_count();
    state.duals = cast_all<double>(duals_.download(member * duals, duals));
    save_history(own_, state, member);
    return state;
  }
  void set_state(int member, const State& state) override {
    const std::size_t locals = local_count();
    u_.upload(spread(cast_all<T>(state.u)), member * locals);
    v_.upload(spread(cast_all<T>(state.v)), member * locals);
    added_.upload(spread(program_.added_before(state)), member * locals);
    has_begun_[member] = 1;
    const std::size_t duals = dual_count();
    duals_.upload(state.duals_for<T>(duals), member * duals);
    ahead_.upload({state.step - step_}, member);
    clear_messages(member, 1);
    load_history(own_, state, member);
    bound_->begin_at(member, state, stream_);
    if (contact_) contact_->forget();
  }
  void retune(int member, const Model& model, const Scene& scene) override {
    check_scene(scene);
    take_values(model, scene);
    rate_passes_.upload({program_.viscous_step.passes}, member);
    if (!has_begun_[member]) begin_still(member);
    const double cs = assess(model, scene).cs_max;
    bound_->set_model(member, model);
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto& effects = std::get<i>(program_.effects);
      for (std::size_t k = 0; k < effects.size(); ++k) {
        auto& views = std::get<i>(host_views_);
        if constexpr (Effect::kind == EffectKind::element) {
          auto& own = std::get<i>(own_)[k];
          const bool linearizes = layout_.linearizes(effects[k], program_, cs);
          own.linearizes[member] = linearizes;
          own.set_rest(member, layout_.rest_of(effects[k], program_, own, linearizes));
          views[member * effects.size() + k] = own.view(member);
        } else if constexpr (requires { effects[k].device; }) {
          views[member * effects.size() + k].device = effects[k].device;
        }
      }
    });
    upload_views();
    if (contact_) {
      contact_->retune(program_);
      frame_.self_contact = contact_->view();
    }
  }
  void steer(int member, const Scene& scene) override {
    check_scene(scene);
    program_.steer(scene);
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if constexpr (is_steered<Effect>) {
        const auto& effects = std::get<i>(program_.effects);
        auto& views = std::get<i>(host_views_);
        for (std::size_t k = 0; k < effects.size(); ++k) {
          views[member * effects.size() + k].device = effects[k].device;
        }
        static_cast<ArrayOf<Effect>&>(views_).array.upload(views);
      }
    });
  }
  std::size_t contact_count(int member) const override {
    const std::size_t locals = local_count(), all = frame_.contacts * locals;
    const auto touching = touching_.download(member * all, all);
    std::size_t count = 0;
    for (int k = 0; k < frame_.contacts; ++k) {
      for (int v = 0; v < vertex_count(); ++v) {
        const int local = layout_.locals_of(v)[0];
        const bool is_own = local >= frame_.first_local && local < frame_.end_local;
        if (is_own) count += touching[k * locals + local];
      }
    }
    if (contact_) count += contact_->count();
    return count;
  }
  ActingDamping damping() const override {
    return {false, program_.viscous_step.passes, layout_.split().replica_counts()};
  }
  std::string device() const override { return "cuda, " + name_; }
  bool off_host() const override { return true; }
  SubstepWork substep_work() const override {
    const double row = sizeof(Row<T>), vector = sizeof(Vec3<T>);
    // A vertex: v; a replica: u, d and its dual variables; between blocks: messages out and in.
    SubstepWork work{
        .shared_bytes = 2.0 * vector * (local_count() + static_cast<double>(dual_count())) +
                        3.0 * row * replica_count(),
        .global_bytes =
            2.0 * parts() * sizeof(Message<T>) * static_cast<double>(constants_->gathered()) +
            2.0 * sizeof(Added<T>) * local_count()};
    for_each_slot<EffectKind::element>(own_, [&]<class Effect>(const auto& own) {
      using Resident = ResidentConstants<Effect, T>;
      const double count = static_cast<double>(own.element_of.size());
      // u and d are read and d is written, by a linearised element d is read twice.
      const bool linearized = frame_.linearizes && is_linearizable<Effect> && own.linearizes[0];
      work.shared_bytes += count * Effect::arity * (linearized ? 4.0 : 3.0) * row;
      if (linearized) work.shared_bytes += count * 2.0 * work_of_element<Effect, T>;
      (own.resident >= 0 ? work.shared_bytes : work.global_bytes) += count * Resident::bytes;
      work.global_bytes += count * 2.0 * history_of<Effect> * sizeof(T);
      work.phases += own.max_phases;
    });
    return work;
  }

 private:
  template <class Effect>
  using View = EffectView<Effect, T>;
  template <class Effect>
  using OwnOf = Own<Effect, T>;
  template <class Effect>
  using ViewArray = DeviceArray<EffectView<Effect, T>>;
  template <class Effect>
  struct ArrayOf {
    ViewArray<Effect> array;
  };

  void take_values(const Model& model, const Scene& scene) {
    program_.retune({model, scene, program_.time_step,
                     damping_force_for(model, scene, options_, layout_.split().replica_counts())});
  }

  // Of the large arrays, if every member has materials of its own.
  std::size_t bytes_needed(const BoundedTets<T>& bounded) const {
    const std::size_t locals = local_count();
    const std::size_t vertex_state =
        locals * (2 * sizeof(Vec3<T>) + sizeof(Added<T>)) + dual_count() * sizeof(Vec3<T>);
    const int copies_of_state = bounded.vertices.empty() ? 1 : 2;
    std::size_t shared = locals * (sizeof(Vec3<T>) + 3 * sizeof(T) + 4 * sizeof(int));
    std::size_t own = copies_of_state * vertex_state + 2 * parts() * locals * sizeof(Message<T>) +
                      bounded.vertices.size() * sizeof(T);
    for_each_slot<EffectKind::element>(program_.effects, [&]<class Effect>(const auto& effect) {
      const std::size_t elements = effect.rest.size();
      shared += elements * sizeof(LocalVertices<Effect::arity>);
      own += elements * (sizeof(AlignedRest<typename Effect::template Rest<T>>) +
                         2 * history_of<Effect> * sizeof(T));
    });
    shared += CudaBlockContact<T>::bytes(program_, locals);
    shared += CudaBlockBound<T>::bytes(bounded, vertex_count(), locals);
    shared += static_cast<std::size_t>(vertex_count()) * (sizeof(int) + 2 * sizeof(Vec3<T>));
    return shared + members_ * own;
  }

  void run_blocks_of(const Rank& rank) {
    const int all = layout_.block_count();
    const Range own = part_of({0, all}, rank.device, rank.devices);
    frame_.first_block = own.begin;
    frame_.blocks = own.end - own.begin;
    if (frame_.blocks == 0) {
      throw Refusal(Refusal::Cause::device, "devices", std::to_string(rank.devices),
                    "at most " + std::to_string(all) + ", the blocks of this body", "use fewer");
    }
    frame_.first_local = layout_.locals_in(frame_.first_block).begin;
    frame_.end_local = layout_.locals_in(own.end - 1).end;
  }

  void make_state() {
    u_by_vertex_ = DeviceArray<Vec3<T>>(vertex_count());
    v_by_vertex_ = DeviceArray<Vec3<T>>(vertex_count());
    const std::size_t all = static_cast<std::size_t>(members_) * local_count();
    frame_.u = (u_ = DeviceArray<Vec3<T>>(all)).get();
    frame_.v = (v_ = DeviceArray<Vec3<T>>(all)).get();
    frame_.added = (added_ = DeviceArray<Added<T>>(all)).get();
    has_begun_.assign(members_, 0);
    for (int member = 0; member < members_; ++member) begin_still(member);
    frame_.all_replicas = replica_count();
    frame_.duals = (duals_ = DeviceArray<Vec3<T>>(members_ * dual_count())).get();
    frame_.messages = (messages_ = DeviceArray<Message<T>>(2 * parts() * all)).get();
    frame_.ahead = (ahead_ = DeviceArray<unsigned long long>(members_)).get();
    chosen_.assign(members_, 1);
    frame_.runs = (runs_ = DeviceArray<unsigned char>(chosen_)).get();
  }

  // At rest, with what its own loads would have added: program_ is the member's.
  void begin_still(int member) {
    const std::vector<Vec3<double>> still(vertex_count());
    added_.upload(spread(program_.added_before({still, still})), member * local_count());
  }

  static EffectSet named_in(const Program<T>& program) {
    EffectSet named = 0;
    Effects::for_each([&]<class Effect, std::size_t i>() {
      if (!std::get<i>(program.effects).empty()) named |= EffectSet{1} << i;
    });
    return named;
  }
  static BlockTeam team_of(const Model& model, const Program<T>& program, int tets_per_block) {
    BlockTeam team = team_for(tets_per_block, static_cast<int>(model.tet_count()));
    if (!has_several_widths<T>(named_in(program))) {
      team.lanes = std::min(team.lanes, min_width);
      team.single_block = false;
    }
    return team;
  }

  void place_effects(double cs) {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      const auto& effects = std::get<i>(program_.effects);
      const int count = static_cast<int>(effects.size());
      // Self-contact has a view of its own (frame_.self_contact).
      const bool has_views = Effect::kind != EffectKind::self_contact;
      static_cast<Views<EffectView<Effect, T>>&>(frame_.effects).count = has_views ? count : 0;
      if (Effect::kind == EffectKind::contact) frame_.contacts += count;
      if constexpr (Effect::kind == EffectKind::element) {
        for (const auto& effect : effects) {
          const bool linearizes = layout_.linearizes(effect, program_, cs);
          auto elements = layout_.lay_out(effect, program_, linearizes);
          frame_.max_table += table_size(elements.max_phases());
          auto& own = std::get<i>(own_).emplace_back(std::move(elements), members_);
          std::ranges::fill(own.linearizes, linearizes);
        }
      }
    });
    touching_ = DeviceArray<unsigned char>(static_cast<std::size_t>(members_) * frame_.contacts *
                                           local_count());
    frame_.touching = touching_.get();
  }

  void make_views() {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      auto& views = std::get<i>(host_views_);
      for (int member = 0; member < members_; ++member) {
        if constexpr (Effect::kind == EffectKind::element) {
          for (const auto& own : std::get<i>(own_)) views.push_back(own.view(member));
        } else {
          for (const auto& effect : std::get<i>(program_.effects)) {
            if constexpr (requires { effect.device; }) views.push_back({{effect.device}});
          }
        }
      }
    });
    upload_views();
  }

  // In one launch, and in one a substep those members for which the bound on compression needs all
  // blocks.
  void run_bounded_frame() {
    Members by_substeps = bound_->at_limit();
    Members at_once = by_substeps;
    for (auto& member : at_once) member = !member;
    if (contains_any(at_once)) {
      keep_start();
      choose(at_once);
      run_whole_frame();
      bound_->count(stream_);
      const Members again = bound_->below_limit();
      for (int member = 0; member < members_; ++member) {
        if (!at_once[member] || !again[member]) continue;
        return_to_start(member);
        by_substeps[member] = true;
      }
      meet();
    }
    if (contains_any(by_substeps)) {
      choose(by_substeps);
      run_by_substeps(by_substeps);
      bound_->count(stream_);
    }
    bound_->end_frame();
  }

  void run_whole_frame() {
    for (int first = 0; first < program_.substeps; first += longest_launch) {
      options_.pause_point();
      frame_.pushes = !bound_->is_empty();
      launch(first, std::min(program_.substeps - first, longest_launch));
      stream_.finish("running a frame");
    }
    take_motion();
  }
  void run_by_substeps(const Members& members) {
    for (int substep = 0; substep < program_.substeps; ++substep) {
      options_.pause_point();
      frame_.pushes = false;  // the whole bound follows
      launch(substep, 1);
      take_motion();
      bound_->correct(members, stream_);
    }
  }
  // Of the blocks of the others, which have done the same substeps.
  void take_motion() {
    if (others_.empty()) return;
    stream_.finish("running a frame");
    meet();
    for (const CudaBlocks* other : others_) {
      const std::size_t begin = other->frame_.first_local;
      const std::size_t count = other->frame_.end_local - begin;
      other->u_.copy_to(u_, begin, count, stream_);
      other->v_.copy_to(v_, begin, count, stream_);
      other->added_.copy_to(added_, begin, count, stream_);
    }
    stream_.finish("taking what other devices have done");
    meet();
  }
  // None goes on before all have come so far.
  void meet() {
    if (meeting_) meeting_->arrive_and_wait();
  }
  static bool contains_any(const Members& members) {
    return std::ranges::find(members, 1) != members.end();
  }
  // Who takes part in the next launches.
  void choose(const Members& members) {
    if (members == chosen_) return;
    chosen_ = members;
    runs_.upload(members);
  }

  // As a graph: 2 us less than launches of their own.
  void launch(int first, int substeps) {
    frame_.substeps = substeps;
    frame_.done = step_ + first;
    graph_.change_argument<Frame<T>>([this](Frame<T>& frame) {
      const int first_member = frame.first_member;
      frame = frame_;
      frame.first_member = first_member;
    });
    graph_.launch(stream_, "launching a frame");
  }

  void keep_start() {
    u_.copy_to(u_before_, stream_);
    v_.copy_to(v_before_, stream_);
    added_.copy_to(added_before_, stream_);
    duals_.copy_to(duals_before_, stream_);
    for_each_slot<EffectKind::element>(own_, [this]<class Effect>(const auto& own) {
      own.history.copy_to(own.history_before, stream_);
    });
  }
  void return_to_start(int member) {
    const auto take_back = [&]<class Array>(const Array& before, Array& now) {
      const std::size_t each = now.size() / members_;
      before.copy_to(now, member * each, each, stream_);
    };
    take_back(u_before_, u_);
    take_back(v_before_, v_);
    take_back(added_before_, added_);
    take_back(duals_before_, duals_);
    for_each_slot<EffectKind::element>(
        own_, [&]<class Effect>(auto& own) { take_back(own.history_before, own.history); });
    stream_.finish("returning to the start of a frame");
    clear_messages(member, 1);
  }
  // Messages of an exchange that is to come again must not be taken for it.
  void clear_messages(int first, int members) {
    const std::size_t each = 2 * parts() * static_cast<std::size_t>(local_count());
    messages_.clear(first * each, members * each);
  }

  void upload_views() {
    Effects::for_each([&]<class Effect, std::size_t i>() {
      auto& array = static_cast<ArrayOf<Effect>&>(views_).array;
      array = ViewArray<Effect>(std::get<i>(host_views_));
      static_cast<Views<EffectView<Effect, T>>&>(frame_.effects).items = array.get();
    });
  }

  // u and v of a member by vertex, on the device.
  void gather_vertices(int member) const {
    const std::size_t begin = static_cast<std::size_t>(member) * local_count();
    const int blocks = (vertex_count() + gather_threads - 1) / gather_threads;
    gather_motion<<<blocks, gather_threads, 0, stream_>>>(vertex_count(), constants_->first_local(),
                                                          u_.get() + begin, v_.get() + begin,
                                                          u_by_vertex_.get(), v_by_vertex_.get());
    check(cudaGetLastError(), "gathering vertices");
    stream_.finish("gathering vertices");
  }

  // By local vertex to by vertex, and back.
  template <class Item>
  std::vector<Item> gathered(const std::vector<Item>& locals) const {
    std::vector<Item> field;
    for (int v = 0; v < vertex_count(); ++v) field.push_back(locals[layout_.locals_of(v)[0]]);
    return field;
  }
  template <class Item>
  std::vector<Item> spread(const std::vector<Item>& field) const {
    std::vector<Item> locals;
    for (const LocalVertex& local : layout_.locals()) locals.push_back(field[local.vertex]);
    return locals;
  }

  // Of dual variables of a replica, and of messages about a vertex.
  int parts() const { return frame_.damped ? 2 : 1; }
  std::size_t dual_count() const { return static_cast<std::size_t>(parts()) * replica_count(); }
  int replica_count() const { return layout_.replicas_in(layout_.block_count() - 1).end; }
  int local_count() const { return static_cast<int>(layout_.locals().size()); }
  int vertex_count() const { return static_cast<int>(program_.rest.size()); }

  std::string name_;
  SolverOptions options_;
  int members_;
  Program<T> program_;  // of the member that was tuned last
  BlockLayout layout_;
  Frame<T> frame_{};
  std::optional<BlockConstants<T>> constants_;
  std::optional<BlockLaunch<T>> launch_;
  Stream stream_;
  Graph graph_;
  std::uint64_t step_ = 0;
  Effects::Slots<OwnOf> own_;
  Effects::Slots<View> host_views_;
  Effects::Joined<ArrayOf> views_;
  DeviceArray<Vec3<T>> u_, v_, duals_;
  DeviceArray<Added<T>> added_;
  DeviceArray<int> rate_passes_;
  DeviceArray<Message<T>> messages_;
  DeviceArray<unsigned char> touching_;
  DeviceArray<unsigned long long> ahead_;
  Members has_begun_;  // with a state that was given, or frames
  Members chosen_;     // for launches
  DeviceArray<unsigned char> runs_;
  std::optional<CudaBlockBound<T>> bound_;
  std::optional<CudaBlockContact<T>> contact_;      // of the only member
  DeviceArray<Vec3<T>> u_by_vertex_, v_by_vertex_;  // of a member, when it was looked at
  std::vector<const CudaBlocks*> others_;           // that step the same body
  Meeting* meeting_ = nullptr;                      // with them
  // At the start of the frame.
  DeviceArray<Vec3<T>> u_before_, v_before_, duals_before_;
  DeviceArray<Added<T>> added_before_;
};

// One body on several devices: each has all of it and runs its part of the blocks.
template <class T>
class BlocksTogether final : public Ensemble {
 public:
  BlocksTogether(const Model& model, const Scene& scene, SolverOptions options, int tets_per_block,
                 const std::string& name)
      : pause_point_(std::move(options.pause_point)),
        devices_(options.devices, on_device),
        meeting_(options.devices),
        ranks_(options.devices) {
    options.pause_point = [] {};  // who left one frame undone would have the others wait
    for (int device = 0; device < devices_.size(); ++device) {
      devices_.on(device, [&] { connect(device, devices_.size()); });
    }
    devices_.on_each([&](int device) {
      ranks_[device] = std::make_unique<CudaBlocks<T>>(model, scene, options, tets_per_block, 1,
                                                       name, Rank{device, devices_.size()});
    });
    for (const auto& rank : ranks_) {
      std::vector<const CudaBlocks<T>*> others;
      for (const auto& other : ranks_) {
        if (other != rank) others.push_back(other.get());
      }
      rank->join(std::move(others), meeting_);
    }
  }

  int size() const override { return 1; }
  void advance_frame() override {
    pause_point_();
    devices_.on_each([this](int device) {
      try {
        ranks_[device]->advance_frame();
      } catch (...) {
        meeting_.arrive_and_drop();
        throw;
      }
    });
  }
  State state(int) const override {
    return on_first([](CudaBlocks<T>& rank) {
      rank.take_kept();
      return rank.state(0);
    });
  }
  State motion(int) const override {
    return on_first([](CudaBlocks<T>& rank) { return rank.motion(0); });
  }
  std::optional<DeviceMotion> motion_on_device(int) override {
    return on_first([](CudaBlocks<T>& rank) { return rank.motion_on_device(0); });
  }
  void set_state(int, const State& state) override {
    devices_.on_each([&](int device) { ranks_[device]->set_state(0, state); });
  }
  void retune(int, const Model& model, const Scene& scene) override {
    devices_.on_each([&](int device) { ranks_[device]->retune(0, model, scene); });
  }
  void steer(int, const Scene& scene) override {
    devices_.on_each([&](int device) { ranks_[device]->steer(0, scene); });
  }
  std::size_t contact_count(int) const override {
    std::size_t count = 0;
    for (int device = 0; device < devices_.size(); ++device) {
      count += devices_.on(device, [&] { return ranks_[device]->contact_count(0); });
    }
    return count;
  }
  ActingDamping damping() const override { return ranks_[0]->damping(); }
  std::string device() const override {
    return ranks_[0]->device() + ", " + std::to_string(ranks_.size()) + " of them";
  }
  bool off_host() const override { return true; }
  SubstepWork substep_work() const override { return ranks_[0]->substep_work(); }

 private:
  // One writes to the memory of the others.
  static void connect(int device, int devices) {
    for (int to = 0; to < devices; ++to) {
      if (to != device) let_write_to(to);
    }
  }
  static void let_write_to(int device) {
    int can = 0;
    check(cudaDeviceCanAccessPeer(&can, current_device(), device), "asking for another device");
    if (!can) {
      throw Refusal(Refusal::Cause::device, "devices", "GPUs that cannot write to one another",
                    "GPUs that are connected (NVLink, or PCIe with peer access)", "use devices: 1");
    }
    const cudaError_t status = cudaDeviceEnablePeerAccess(device, 0);
    if (status != cudaErrorPeerAccessAlreadyEnabled) return check(status, "reaching a device");
    cudaGetLastError();  // it is no error
  }

  template <class Work>
  auto on_first(const Work& work) const {
    return devices_.on(0, [&] { return work(*ranks_[0]); });
  }

  std::function<void()> pause_point_;
  DeviceTeam devices_;
  Meeting meeting_;
  std::vector<std::unique_ptr<CudaBlocks<T>>> ranks_;
};

template <class T>
std::unique_ptr<Ensemble> make_blocks(const Model& model, const Scene& scene,
                                      const SolverOptions& options, int tets_per_block, int members,
                                      const std::string& name) {
  if (options.devices > 1) {
    return std::make_unique<BlocksTogether<T>>(model, scene, options, tets_per_block, name);
  }
  return std::make_unique<CudaBlocks<T>>(model, scene, options, tets_per_block, members, name);
}

}  // namespace

std::unique_ptr<Ensemble> make_cuda_blocks(const Model& model, const Scene& scene,
                                           const SolverOptions& options, int members,
                                           const std::string& name) {
  // All blocks of a member run at once, one a multiprocessor, and those of all members if they can.
  const int processors = options.devices * device_attribute(cudaDevAttrMultiProcessorCount);
  const auto tets_in_each_of = [&model](int blocks) {
    return (static_cast<int>(model.tet_count()) + blocks - 1) / blocks;
  };
  const int shared_out = tets_in_each_of(std::max(1, processors / members));
  const int wanted =
      options.block_tets > 0 ? options.block_tets : std::clamp(shared_out, min_block, max_wanted);
  const int tets_per_block = std::max(wanted, tets_in_each_of(processors));
  const bool in_fp64 = options.precision == Precision::fp64;
  return (in_fp64 ? make_blocks<double> : make_blocks<float>)(model, scene, options, tets_per_block,
                                                              members, name);
}

}  // namespace viscera::sim
