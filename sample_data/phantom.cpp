// make-phantom: draws the formulas of phantom_shape.hpp on an oblique grid of unequal spacing
// and writes it as a gzip NRRD of labels. The same program gives the same bytes. FINER (1 to 4)
// divides the spacing: 3 makes a volume of 25 million voxels.
#include <fmt/format.h>

#include <cstdlib>
#include <exception>
#include <iostream>

#include "sample_data/phantom_grid.hpp"
#include "stages/image/image_io.hpp"

int main(int argc, char** argv) {
  const int finer = argc == 3 ? std::atoi(argv[2]) : 1;
  if (argc < 2 || argc > 3 || argv[1][0] == '-' || finer < 1 || finer > 4) {
    std::cerr << "usage: make-phantom FILE.nrrd [FINER]\n";
    return 2;
  }
  try {
    viscera::write_nrrd(argv[1], viscera::phantom::draw(finer));
  } catch (const std::exception& e) {
    std::cerr << "make-phantom: " << e.what() << "\n";
    return 1;
  }
  return 0;
}
