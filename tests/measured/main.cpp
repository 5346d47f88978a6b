// Holds what the product computes of measured bodies against what was measured:
//   measured FOLDER [DATA]     writes measured.md, measured.csv and pictures into FOLDER
// DATA holds truth_cube_uniaxial.csv and pdms_cylinder/; bodies whose data are not there are
// skipped, and said so.
#include <fmt/format.h>

#include <cstdio>

#include "tests/measured/page.hpp"

int main(int argc, char** argv) {
  using namespace viscera::sim;
  if (argc < 2) return std::fputs("usage: measured FOLDER [DATA]\n", stderr), 2;
  const std::filesystem::path folder = argv[1], data = argc > 2 ? argv[2] : "";
  std::vector<MeasuredBody> bodies;
  int skipped = 0;
  const auto add = [&](MeasuredBody body) {
    for (const auto& row : body.rows) {
      fmt::print("{}, {}, {}: {:.3g} {} (allowed {:.3g}); {} [{:.1f} s]\n", body.name, row.state,
                 row.way, row.error, row.unit, row.allowed, row.note, row.seconds);
    }
    if (!body.skipped.empty()) fmt::print("{}: skipped, {}\n", body.name, body.skipped), ++skipped;
    std::fflush(stdout);
    bodies.push_back(std::move(body));
    write_page(folder, bodies);
  };
  try {
    add(truth_cube(data));
    add(silicone_beam());
    add(pdms_cylinder(data));
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 4;
  }
  fmt::print("{} bodies compared, {} skipped\n", bodies.size() - static_cast<std::size_t>(skipped),
             skipped);
}
