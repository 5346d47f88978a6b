// Which material is where, as a function of continuous position: a body field decides inside from
// outside at the level that keeps the body's volume; inside it the largest of the labels' smoothed
// fields wins, each with a bias that keeps the label's volume. Neighbouring materials share their
// interface by construction. Voxel-mm frame.
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "stages/image/label_field.hpp"
#include "stages/mesh/vec.hpp"

namespace viscera {

class MaterialFields {
 public:
  // `sigma`: Gaussian in mm. The image must hold at least one label; Error(bad_input) beyond 255.
  MaterialFields(const LabelImage& image, double sigma);

  const Frame& frame() const { return frame_; }
  const std::vector<int>& ids() const { return ids_; }
  // Aims each label, and the body as a whole (id 0), at its voxel volume times a factor (1 where
  // none is given). Flat facets cut the corners of curved interfaces; a mesh that came out too
  // small is met by aiming higher. `share`, by voxel, in (0, 1]: in what proportion the body's
  // surface moves for that; empty: alike everywhere.
  void aim(const std::map<int, double>& factors, const Field& share = {});

  double level() const { return level_; }
  const std::vector<double>& biases() const { return biases_; }  // in the order of ids()

  // The id at `p`, 0 outside the body.
  int at(const std::array<double, 3>& p) const;

  // By how much the field of label `a` leads that of `b` at `p`, biases included, and the gradient
  // of that per mm; between 0 (outside) and any label it is the body's field that counts. Zero on
  // the interface of the two. Clamped to the grid.
  double lead(const std::array<double, 3>& p, int a, int b, std::array<double, 3>& gradient) const;

  // The least and greatest coordinates of the body, LPS mm, where its surface crosses the edges of
  // the grid; at other levels (aim) by a fraction of a voxel elsewhere.
  std::pair<Vec, Vec> extent() const;

  // The id that wins at `p` whether or not the body reaches there; 0 outside the grid.
  int nearest(const std::array<double, 3>& p) const;

 private:
  // The grid cell around a point: its corners' values, and where the point lies within it.
  struct Cell {
    std::array<const float*, 8> corner;
    std::array<double, 3> part;
  };
  bool locate(const std::array<double, 3>& p, Cell& cell) const;
  int evaluate(const std::array<double, 3>& p, double level) const;
  int winner(const double* values) const;
  std::size_t width() const { return ids_.size() > 1 ? ids_.size() + 1 : 1; }
  void match_labels(const std::vector<double>& wanted);
  double bias_of(const Field& lead, const std::vector<std::size_t>& inside, double wanted) const;

  Frame frame_;
  std::vector<int> ids_;
  std::vector<double> voxels_;  // of each label
  Field body_;                  // the smoothed mask of all labels
  std::vector<float> values_;   // [voxel][1 + labels]: the body as aimed, then the labels
  std::vector<double> biases_;
  double level_ = 0.5;
};

}  // namespace viscera
