#include "tests/mutate/choose.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <random>
#include <set>
#include <stdexcept>

#include "tests/mutate/find.hpp"

namespace viscera::mutate {
namespace {

namespace fs = std::filesystem;

struct Group {
  std::string name;
  std::size_t count;
  unsigned seed;
};
// How many of each folder; of the improver, those that test_improve links.
const std::vector<Group> groups = {{"sim/effects", 56, 1},
                                   {"sim/solvers", 56, 2},
                                   {"sim/backend", 46, 3},
                                   {"sim", 46, 4},
                                   {"stages/tetmesh/improve", 40, 5},
                                   {"pipeline/base", 30, 6},
                                   {"pipeline/contract", 6, 8},
                                   {"pipeline/engine", 30, 7}};

// Nothing of what these compute is a result: how long a wait spins, how many threads take part, in
// which of a GPU's banks a number lies, and what is printed.
const std::set<std::string> left_out = {"sim/backend/cpu/pace.hpp", "sim/base/team.hpp",
                                        "sim/backend/banks.hpp",    "pipeline/base/log.cpp",
                                        "pipeline/base/log.hpp",    "sim/backend/cuda/no_cuda.cpp"};

// The innermost that a file stands in; "" for none.
std::string group_of(const std::string& file) {
  std::string innermost;
  for (const Group& group : groups) {
    if (file.starts_with(group.name + "/") && group.name.size() > innermost.size()) {
      innermost = group.name;
    }
  }
  return innermost;
}

bool belongs(const Group& group, const fs::path& file) {
  const std::string name = file.filename().string();
  if (left_out.count(file.string()) || group_of(file.string()) != group.name) return false;
  if (file.extension() != ".cpp" && file.extension() != ".hpp") return false;
  if (name.find("cuda") != std::string::npos) return false;  // for a GPU alone
  return group.name != "stages/tetmesh/improve" || name.starts_with("improve") ||
         name == "project_fields.cpp";
}

// Independent of the library, unlike std::shuffle.
void shuffle(std::vector<Place>& places, std::mt19937& random) {
  for (std::size_t i = places.size(); i > 1; --i) std::swap(places[i - 1], places[random() % i]);
}

class Chosen {
 public:
  bool add(const std::string& group, const Place& place) {
    const Mutant mutant{static_cast<int>(mutants.size()) + 1, group, place};
    for (const Mutant& other : mutants) {
      if (key_of(other) == key_of(mutant)) return false;
      const Place& at = other.place;
      if (at.file == place.file && at.begin < place.end && place.begin < at.end) return false;
    }
    mutants.push_back(mutant);
    return true;
  }
  std::vector<Mutant> mutants;
};

// Lines of the list by hand: file, kind, what stands there, what takes its place, with tabs
// between.
void add_by_hand(const std::string& root, const std::string& list, Chosen& chosen) {
  for (const auto& column : read_columns(list)) {
    if (column[0].starts_with("#")) continue;
    if (column.size() < 4) throw std::runtime_error(list + ": four columns a line, parted by tabs");
    const std::string text = read_text((fs::path(root) / column[0]).string());
    const std::size_t at = text.find(column[2]);
    if (at == std::string::npos || text.find(column[2], at + 1) != std::string::npos) {
      throw std::runtime_error(
          fmt::format("{}: \"{}\" must stand once in {}", list, column[2], column[0]));
    }
    const int line = static_cast<int>(std::count(
                         text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\n')) +
                     1;
    Place place{column[0], line, line, column[1], column[2], column[3], at, at + column[2].size(),
                {}};
    const bool statement = column[2].ends_with(';');
    place.text = statement
                     ? fmt::format("{{ if (viscera::mutated(@)) {{ {} }} else {{ {} }} }}",
                                   column[3], column[2])
                     : fmt::format("(viscera::mutated(@) ? ({}) : ({}))", column[3], column[2]);
    chosen.add(group_of(column[0]), place);
  }
}

// One kind after the other, and within a kind the file that has the fewest so far.
void add_spread(const Group& group, const std::vector<Place>& places, Chosen& chosen) {
  std::map<std::string, std::vector<Place>> by_kind;
  for (const Place& place : places) by_kind[place.kind].push_back(place);
  std::map<std::string, int> of_file;
  std::size_t count = 0;
  for (bool more = true; more && count < group.count;) {
    more = false;
    for (auto& [kind, left] : by_kind) {
      while (!left.empty() && count < group.count) {
        const auto next =
            std::ranges::min_element(left, {}, [&](const Place& p) { return of_file[p.file]; });
        const Place place = *next;
        left.erase(next);
        if (!chosen.add(group.name, place)) continue;
        ++of_file[place.file], ++count;
        more = true;
        break;
      }
    }
  }
}

void write_if_new(const fs::path& file, const std::string& text) {
  if (fs::exists(file) && read_text(file.string()) == text) return;
  fs::create_directories(file.parent_path());
  if (FILE* out = std::fopen(file.c_str(), "wb")) {
    std::fwrite(text.data(), 1, text.size(), out);
    std::fclose(out);
  }
}

// The tests of the command line find its programs through the environment (switch.hpp).
std::string with_movable_programs(std::string text) {
  const std::string fixed = "VISCERA_BIN=\"${CMAKE_RUNTIME_OUTPUT_DIRECTORY}\"";
  const auto at = text.find(fixed);
  return at == std::string::npos ? text
                                 : text.replace(at, fixed.size(), "VISCERA_BIN_FROM_ENVIRONMENT");
}

}  // namespace

std::vector<Mutant> choose(const std::string& root, const std::string& by_hand) {
  Chosen chosen;
  add_by_hand(root, by_hand, chosen);
  for (const Group& group : groups) {
    std::vector<std::string> files;
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(root) / group.name)) {
      const fs::path file = fs::relative(entry.path(), root);
      if (belongs(group, file)) files.push_back(file.string());
    }
    std::ranges::sort(files);
    std::vector<Place> places;
    for (const std::string& file : files) {
      const auto found = places_of(file, read_text((fs::path(root) / file).string()));
      places.insert(places.end(), found.begin(), found.end());
    }
    std::mt19937 random(group.seed);
    shuffle(places, random);
    add_spread(group, places, chosen);
  }
  return chosen.mutants;
}

void write_copy(const std::string& root, const std::string& copy,
                const std::vector<Mutant>& mutants) {
  std::map<std::string, std::vector<Mutant>> by_file;
  for (const Mutant& mutant : mutants) by_file[mutant.place.file].push_back(mutant);
  std::vector<fs::path> files = {"CMakeLists.txt"};
  // Programs hold the tables of docs/results.
  for (const char* room : {"docs/results", "pipeline", "sim", "stages", "sample_data", "tests"}) {
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(root) / room)) {
      if (entry.is_regular_file()) files.push_back(fs::relative(entry.path(), root));
    }
  }
  for (const fs::path& file : files) {
    std::string text = read_text((fs::path(root) / file).string());
    auto& own = by_file[file.string()];
    std::ranges::sort(own, std::greater{}, [](const Mutant& m) { return m.place.begin; });
    for (const Mutant& mutant : own) {
      std::string with = mutant.place.text;
      for (auto at = with.find("mutated(@)"); at != std::string::npos;
           at = with.find("mutated(@)")) {
        with.replace(at + 8, 1, std::to_string(mutant.number));
      }
      text.replace(mutant.place.begin, mutant.place.end - mutant.place.begin, with);
    }
    write_if_new(fs::path(copy) / file,
                 file == "tests/cli/CMakeLists.txt" ? with_movable_programs(text) : text);
  }
}

std::vector<int> blamed(const std::string& build_log, const std::vector<Mutant>& mutants) {
  std::set<int> found;
  for (const Mutant& mutant : mutants) {
    const Place& at = mutant.place;
    for (int line = at.line; line <= at.last_line; ++line) {
      const std::string where = fmt::format("{}:{}:", at.file, line);
      for (auto hit = build_log.find(where); hit != std::string::npos;
           hit = build_log.find(where, hit + 1)) {
        const auto end = build_log.find('\n', hit);
        if (build_log.substr(hit, end - hit).find(" error: ") != std::string::npos)
          found.insert(mutant.number);
      }
    }
  }
  return {found.begin(), found.end()};
}

}  // namespace viscera::mutate
