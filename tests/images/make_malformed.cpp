// make-malformed FOLDER: writes the corpus of malformed images, for tests by hand and for fuzzing.
#include <exception>
#include <iostream>

#include "tests/images/malformed.hpp"

int main(int argc, char** argv) {
  if (argc != 2 || argv[1][0] == '-') {
    std::cerr << "usage: make-malformed FOLDER\n";
    return 2;
  }
  try {
    std::filesystem::create_directories(argv[1]);
    for (const auto& bad : viscera::testing::write_malformed(argv[1]))
      std::cout << bad.name << ": " << bad.says << "\n";
  } catch (const std::exception& e) {
    std::cerr << "make-malformed: " << e.what() << "\n";
    return 1;
  }
  return 0;
}
