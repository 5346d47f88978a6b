// make-phantom: draws the formulas of phantom_shape.hpp on an oblique grid of unequal spacing
// and writes it as a gzip NRRD of labels. The same program gives the same bytes.
#include <fmt/format.h>

#include <exception>
#include <iostream>

#include "sample_data/phantom_grid.hpp"
#include "stages/common/image_io.hpp"

int main(int argc, char** argv) {
  if (argc != 2 || argv[1][0] == '-') {
    std::cerr << "usage: make-phantom FILE.nrrd\n";
    return 2;
  }
  try {
    viscera::write_nrrd(argv[1], viscera::phantom::draw());
  } catch (const std::exception& e) {
    std::cerr << "make-phantom: " << e.what() << "\n";
    return 1;
  }
  return 0;
}
