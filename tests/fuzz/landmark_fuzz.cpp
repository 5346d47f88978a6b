// Landmarks of others under libFuzzer: the same bytes as each of the four formats are read or
// refused.
#include "stages/mesh/landmark_io.hpp"
#include "tests/fuzz/fuzz_file.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace viscera;
  for (const char* name : {"a.csv", "a.fcsv", "a.mrk.json", "a.annot"}) {
    fuzz::may_refuse([&] {
      const Landmarks landmarks = read_landmarks(fuzz::as_file(name, bytes, size));
      landmarks_as_table(landmarks.all);
    });
  }
  return 0;
}
