// `make bench-pipeline`: what the engine costs by itself, over six stages that do next to nothing:
// a run with nothing to do, and what it adds to each stage that it starts over starting it by hand;
// then cohorts of five stages with nothing to do, beside Snakemake on as many files. What is
// compared is measured in turn, so that a busy machine slows both; shown are the least and the
// median.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <functional>
#include <thread>

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

std::string chain(int length, const std::string& params) {
  std::string text = "stages:\n  s1: {in: {volume: volume.txt}" + params + "}\n";
  for (int s = 2; s <= length; ++s) text += fmt::format("  s{}: {{}}\n", s);
  return text;
}

// Makes a cohort's results and waits until its files are old enough to be remembered.
void make_cohort(const Workplace& work, int cases) {
  std::string table = "case,words\n";
  for (int c = 0; c < cases; ++c) table += fmt::format("c{0},of case {0}\n", c);
  work.write(fmt::format("c{}.csv", cases), table);
  work.write(fmt::format("c{}.yaml", cases), "viscera: 1\nvars: {words: x}\n" +
                                                 chain(5, ", text: \"${words}\"") +
                                                 fmt::format("cases: c{}.csv\n", cases));
  const std::string spec = fmt::format("c{}.yaml", cases);
  check(work.viscera({"run", spec, "--quiet", "--jobs", "2"}));
  std::this_thread::sleep_for(std::chrono::seconds(3));
  check(work.viscera({"run", spec, "--quiet"}));
}

// The same graph for Snakemake: five rules, a wildcard for the case, every file made in its order.
void make_snakemake(const Workplace& work, int cases) {
  std::string rules =
      fmt::format("rule all:\n    input: [f\"plain/c{{c}}/s5.txt\" for c in range({})]\n", cases);
  for (int s = 1; s <= 5; ++s) {
    const std::string input = s == 1 ? "volume.txt" : fmt::format("plain/{{case}}/s{}.txt", s - 1);
    rules += fmt::format(
        "rule s{0}:\n    input: \"{1}\"\n    output: \"plain/{{case}}/s{0}.txt\"\n"
        "    shell: \"cp {{input}} {{output}}\"\n",
        s, input);
    for (int c = 0; c < cases; ++c) {
      std::filesystem::create_directories(work.path(fmt::format("plain/c{}", c)));
      work.write(fmt::format("plain/c{}/s{}.txt", c, s), "voxels\n");
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  work.write("Snakefile", rules);
}

void bench_cohorts(const Workplace& work) {
  constexpr int many = 1000, some = 100, turns = 5;
  make_cohort(work, many);
  make_cohort(work, some);
  std::vector<double> large, small, snakemake;
  const bool beside = std::filesystem::exists("/usr/bin/snakemake");
  if (beside) {
    make_snakemake(work, some);
    std::filesystem::create_symlink("/usr/bin/snakemake", work.path("bin/snakemake"));
  }
  for (int t = 0; t < turns; ++t) {
    const auto run = [&work](int cases) {
      check(work.viscera({"run", fmt::format("c{}.yaml", cases), "--quiet"}));
    };
    large.push_back(milliseconds([&] { run(many); }));
    small.push_back(milliseconds([&] { run(some); }));
    if (!beside) continue;
    snakemake.push_back(milliseconds([&] {
      check(work.finish(work.start_program("bin/snakemake", {"--cores", "1", "--quiet", "all"})));
    }));
  }
  fmt::print("nothing to do, {} cases x 5 stages: least {:.2f} s, median {:.2f} s (goal 3 s)\n",
             many, spread(large).least / 1e3, spread(large).median / 1e3);
  fmt::print("nothing to do, {} cases x 5 stages: least {:.0f} ms, median {:.0f} ms\n", some,
             spread(small).least, spread(small).median);
  if (!beside) return fmt::print("snakemake is not installed: nothing to compare with\n");
  fmt::print(
      "snakemake on the same: least {:.0f} ms, median {:.0f} ms; {:.1f} and {:.1f} times as "
      "long (goal 10)\n",
      spread(snakemake).least, spread(snakemake).median,
      spread(snakemake).least / spread(small).least,
      spread(snakemake).median / spread(small).median);
}

}  // namespace

int main() {
  const Workplace work;
  work.write("six.yaml", "viscera: 1\n" + chain(stages, ""));
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
  bench_cohorts(work);
}
