// The bound on compression (solvers/xpbd/volume_bound.hpp) for blocks on a device. Its first part
// is one more element of a block's sweep (push_tet in block_step.hpp). Other blocks know of a push
// by the average alone, so that in a steady state a tet with vertices in several stays below J_min
// by what one substep would press it: little, unless substeps are long. The other parts need all
// blocks, and a frame of blocks is one launch. So a frame is first run as a whole. If it ends with
// a tet below J_halt, it is run again from its start, substep by substep, with the whole bound
// after each; a frame that begins with a tet there is run like that at once. For a tet whose own Cs
// (stability.hpp) is above `long_step` J_min takes J_halt's place. Both decisions follow from
// states at the borders of frames, so a run goes on from a checkpoint to the same bits. A tet that
// is below the limit for some substeps, and above it again at the end of the frame, is left to the
// law and to the first part.
#pragma once

#include <optional>

#include "sim/backend/cuda/block_pushes.cuh"
#include "sim/backend/cuda/volume_bound.cuh"

namespace viscera::sim {

// Measured: at rest tets of Cs .5 then lie at J .23 to .30, of .6 and more below .2
// (docs/results/body.md).
inline constexpr double long_step = 0.5;

using Members = std::vector<unsigned char>;  // [members] whether each is meant

// How many tets of a member are at the end of a frame ...
struct VolumeCounts {
  int watched;   // below VolumeBound::watched
  int at_limit;  // at the limit of the first part, or below it
  int below;     // below it
};

// J of each tet of each member at the end of a frame; [members] counts, which begin at zero.
template <class T>
__global__ void count_volumes(int count, const Tet* locals_of_tet, const Mat3<T>* rest,
                              const Vec3<T>* u, int locals, const T* limits, VolumeCounts* counts) {
  const int t = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (t >= count) return;
  const std::size_t member = blockIdx.y;
  Vec3<T> corners[4];
  for (int i = 0; i < 4; ++i) corners[i] = u[member * locals + locals_of_tet[t][i]];
  const T strain = NeoHookean::volume_strain(displacement_gradient(corners, rest[t]));
  if (!(strain < T(VolumeBound::watched - 1.0))) return;
  atomicAdd(&counts[member].watched, 1);
  const T limit = limits[member * count + t];
  if (strain < limit + T(0.01)) atomicAdd(&counts[member].at_limit, 1);
  if (strain < limit - T(VolumeBound::tolerance)) {
    atomicAdd(&counts[member].below, 1);
  }
}

// The last substep by vertices: blocks have its end alone.
template <class T>
__global__ void find_substep(int vertices, const int* local_of, const Vec3<T>* u, const Vec3<T>* v,
                             const Added<T>* added, TimeRule<T> rule, Vec3<T>* before, Vec3<T>* d) {
  const int i = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (i >= vertices) return;
  const int local = local_of[i];
  d[i] = rule.way(v[local], added[local]);
  before[i] = u[local] - d[i];
}

// `d` is with them.
template <class T>
__global__ void add_corrections(int locals, const int* vertex_of, const Vec3<T>* corrections,
                                const Vec3<T>* d, TimeRule<T> rule, Vec3<T>* u, Vec3<T>* v,
                                Added<T>* added) {
  const int local = static_cast<int>(blockIdx.x * blockDim.x + threadIdx.x);
  if (local >= locals) return;
  const Vec3<T> correction = corrections[vertex_of[local]];
  if (!touches(correction)) return;
  rule.move(correction, u[local], v[local], added[local]);
  if (rule.share == T(0)) return;
  rule.after_stop(correction, d[vertex_of[local]], v[local], added[local]);
}

template <class T>
class CudaBlockBound {
 public:
  // For `members` with displacements u, velocities v and what was added, [members * locals] on the
  // device.
  CudaBlockBound(BoundedTets<T> tets, const BlockLayout& layout, const Program<T>& program,
                 int members, Vec3<T>* u, Vec3<T>* v, Added<T>* added)
      : tets_(std::move(tets)),
        vertices_(static_cast<int>(program.rest.size())),
        locals_(static_cast<int>(layout.locals().size())),
        rule_(program.rule),
        u_(u),
        v_(v),
        added_(added) {
    if (is_empty()) return;
    std::vector<int> local_of, vertex_of;
    for (int i = 0; i < vertices_; ++i) local_of.push_back(layout.locals_of(i)[0]);
    for (const LocalVertex& local : layout.locals()) vertex_of.push_back(local.vertex);
    std::vector<Tet> locals_of_tet = tets_.vertices;
    for (Tet& tet : locals_of_tet) {
      for (int& corner : tet) corner = local_of[corner];
    }
    bound_.emplace(tets_, vertices_);
    locals_of_tet_ = DeviceArray<Tet>(locals_of_tet);
    local_of_ = DeviceArray<int>(local_of);
    vertex_of_ = DeviceArray<int>(vertex_of);
    inverse_mass_ = DeviceArray<T>(program.inverse_mass);
    before_ = DeviceArray<Vec3<T>>(vertices_);
    d_ = DeviceArray<Vec3<T>>(vertices_);
    limits_ = DeviceArray<T>(members * tets_.vertices.size());
    counts_ = DeviceArray<VolumeCounts>(members);
    found_.resize(members);
    acts_.assign(members, 1);
    device_acts_ = DeviceArray<unsigned char>(acts_);
    corrections_.resize(members);
    const BlockTets in_blocks = layout.tets_in_blocks(tets_.vertices);
    std::vector<Mat3<T>> rest_inverse;
    for (const int t : in_blocks.tets) rest_inverse.push_back(tets_.rest_inverse[t]);
    most_of_a_block_ = in_blocks.most();
    begin_ = DeviceArray<int>(in_blocks.begin);
    corners_ = DeviceArray<LocalVertices<4>>(in_blocks.corners);
    rest_inverse_ = DeviceArray<Mat3<T>>(rest_inverse);
  }

  static std::size_t bytes(const BoundedTets<T>& tets, std::size_t vertices, std::size_t locals) {
    if (tets.vertices.empty()) return 0;
    return CudaVolumeBound<T>::bytes(tets, vertices) +
           tets.vertices.size() * (sizeof(Tet) + sizeof(LocalVertices<4>) + sizeof(Mat3<T>)) +
           vertices * (2 * sizeof(Vec3<T>) + sizeof(T) + sizeof(int)) + locals * sizeof(int);
  }

  bool is_empty() const { return tets_.vertices.empty(); }
  // To be told of each member.
  void set_model(int member, const Model& model) {
    std::vector<T> limits;
    for (std::size_t t = 0; t < tets_.vertices.size(); ++t) {
      const bool is_long = shear_number(model, t, rule_.dt) > long_step;
      limits.push_back(static_cast<T>((is_long ? VolumeBound::least : VolumeBound::halted) - 1.0));
    }
    limits_.upload(limits, member * limits.size());
  }
  // What acts within a frame.
  BoundView<T> view() const {
    return {begin_.get(), corners_.get(), rest_inverse_.get(), device_acts_.get(),
            most_of_a_block_};
  }
  // Members for which the bound acts and that have a tet there.
  Members at_limit() const { return members_with(&VolumeCounts::at_limit); }
  Members below_limit() const { return members_with(&VolumeCounts::below); }

  void begin_at(int member, const State& state, const Stream& stream) {
    if (is_empty()) return;
    count(stream);
    set_acts(member, tets_.begins_at(state));
  }

  // Looks at the end of a frame.
  void count(const Stream& stream) {
    constexpr int width = 256;
    const int tets = static_cast<int>(tets_.vertices.size());
    const dim3 grid((tets + width - 1) / width, static_cast<unsigned>(found_.size()));
    check(cudaMemsetAsync(counts_.get(), 0, counts_.size() * sizeof(VolumeCounts), stream),
          "clearing");
    count_volumes<T><<<grid, width, 0, stream>>>(tets, locals_of_tet_.get(), bound_->rest_inverse(),
                                                 u_, locals_, limits_.get(), counts_.get());
    check(cudaMemcpyAsync(found_.data(), counts_.get(), counts_.size() * sizeof(VolumeCounts),
                          cudaMemcpyDeviceToHost, stream),
          "downloading");
    stream.finish("looking at volumes");
  }
  // What the end of a frame says of the next.
  void end_frame() {
    for (std::size_t member = 0; member < found_.size(); ++member) {
      set_acts(static_cast<int>(member),
               VolumeBound::goes_on(acts_[member], found_[member].watched, tets_.vertices.size()));
    }
  }

  // After a substep of these.
  void correct(const Members& members, const Stream& stream) {
    for (std::size_t member = 0; member < found_.size(); ++member) {
      if (!members[member]) continue;
      Graph& graph = corrections_[member];
      if (graph.size() == 0) {
        graph = Graph(stream, [&] { enqueue_corrections(stream, member * locals_); });
      }
      graph.launch(stream, "bounding compression");
    }
  }

 private:
  void set_acts(int member, bool acts) {
    if (acts == static_cast<bool>(acts_[member])) return;
    acts_[member] = acts;
    device_acts_.upload({acts_[member]}, member);
  }
  Members members_with(int VolumeCounts::*which) const {
    Members members(found_.size());
    for (std::size_t member = 0; member < found_.size(); ++member) {
      members[member] = acts_[member] && found_[member].*which > 0;
    }
    return members;
  }

  void enqueue_corrections(cudaStream_t stream, std::size_t first) const {
    constexpr int width = 256;
    const auto blocks = [](int threads) { return (threads + width - 1) / width; };
    find_substep<T><<<blocks(vertices_), width, 0, stream>>>(vertices_, local_of_.get(), u_ + first,
                                                             v_ + first, added_ + first, rule_,
                                                             before_.get(), d_.get());
    bound_->enqueue_always(stream, before_.get(), d_.get(), inverse_mass_.get(), rule_.dt);
    add_corrections<T><<<blocks(locals_), width, 0, stream>>>(
        locals_, vertex_of_.get(), bound_->corrections(), d_.get(), rule_, u_ + first, v_ + first,
        added_ + first);
  }

  BoundedTets<T> tets_;
  int vertices_, locals_;
  TimeRule<T> rule_;  // of members for which the bound acts
  Vec3<T>*u_, *v_;
  Added<T>* added_;
  std::optional<CudaVolumeBound<T>> bound_;
  DeviceArray<Tet> locals_of_tet_;
  DeviceArray<int> local_of_;   // [vertices] the first of each
  DeviceArray<int> vertex_of_;  // [locals]
  DeviceArray<T> inverse_mass_;
  DeviceArray<Vec3<T>> before_, d_;  // [vertices] m, of a member's substep
  DeviceArray<T> limits_;  // [members * tets] of J - 1, what the first part alone has to keep
  DeviceArray<VolumeCounts> counts_;
  std::vector<VolumeCounts> found_;  // [members] at the end of the last frame
  Members acts_;                     // in the next
  DeviceArray<unsigned char> device_acts_;
  // Of the tets in blocks: BoundView has their shapes.
  int most_of_a_block_ = 0;
  DeviceArray<int> begin_;
  DeviceArray<LocalVertices<4>> corners_;
  DeviceArray<Mat3<T>> rest_inverse_;
  std::vector<Graph> corrections_;  // [members] those that were needed
};

}  // namespace viscera::sim
