// `make bench-pipeline`: what the engine costs by itself, over six stages that do next to nothing:
// a run with nothing to do, and what it adds to each stage that it starts over starting it by hand.
// Both are measured in turn, so that a busy machine slows both; shown are the least and the median.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <functional>

#include "tests/cli/workplace.hpp"

namespace {

using viscera::test::Workplace;

constexpr int stages = 6, repeats = 40;

double milliseconds(const std::function<void()>& work) {
  const auto begin = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin)
      .count();
}

struct Spread {
  double least, median;
};

Spread spread(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return {values.front(), values[values.size() / 2]};
}

void check(const viscera::test::CommandResult& result) {
  if (result.exit == 0) return;
  fmt::print(stderr, "{}", result.errors);
  std::exit(1);
}

std::string text_of(int round) {
  return fmt::format("round {}", round);
}

void run_with_engine(const Workplace& work, const std::string& text) {
  std::vector<std::string> arguments = {"run", "six.yaml", "--quiet"};
  if (!text.empty()) arguments.insert(arguments.end(), {"--set", "s1.text=" + text});
  check(work.viscera(arguments));
}

void run_by_hand(const Workplace& work, const std::string& text) {
  std::string input = "volume=volume.txt";
  for (int s = 1; s <= stages; ++s) {
    const std::string out = fmt::format("hand/s{}", s);
    check(work.finish(work.start_program(
        fmt::format("bin/viscera-s{}", s),
        {"run", "--log", "json", "--in", input, "--set", "text=" + text, "--out", out})));
    input = fmt::format("r{}={}/s{}.txt", s, out, s);
  }
}

}  // namespace

int main() {
  const Workplace work;
  std::string spec = "viscera: 1\nstages:\n  s1: {in: {volume: volume.txt}}\n";
  for (int s = 2; s <= stages; ++s) spec += fmt::format("  s{}: {{}}\n", s);
  work.write("six.yaml", spec);
  run_with_engine(work, "");
  std::vector<double> nothing, engine, hand;
  for (int r = 0; r < repeats; ++r) {
    engine.push_back(milliseconds([&] { run_with_engine(work, text_of(r)); }));
    hand.push_back(milliseconds([&] { run_by_hand(work, text_of(r)); }));
    nothing.push_back(milliseconds([&] { run_with_engine(work, text_of(r)); }));
  }
  const Spread idle = spread(nothing), whole = spread(engine), alone = spread(hand);
  fmt::print("nothing to do, {} stages: least {:.1f} ms, median {:.1f} ms (goal 50 ms)\n", stages,
             idle.least, idle.median);
  fmt::print("{} stages started: by the engine {:.1f} ms, by hand {:.1f} ms (medians)\n", stages,
             whole.median, alone.median);
  fmt::print("engine's share per stage started: least {:.1f} ms, median {:.1f} ms (goal 20 ms)\n",
             (whole.least - alone.least) / stages, (whole.median - alone.median) / stages);
}
