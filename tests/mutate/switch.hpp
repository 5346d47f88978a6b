// Put in front of every unit of the mutated copy by the compiler's -include. `mutated(17)` is true
// in a process whose environment holds VISCERA_MUTANT=17; where that place is first reached, the
// file that VISCERA_MUTANT_REACHED names is made, which tells a mutant that no test runs from one
// that no test notices.
#pragma once

#include <cstdio>
#include <cstdlib>

// Where the programs lie that test_cli starts: the folder of tests may be moved to another machine.
#ifdef VISCERA_BIN_FROM_ENVIRONMENT
#define VISCERA_BIN std::getenv("VISCERA_MUTANT_BIN")
#endif

namespace viscera {

inline const int active_mutant = [] {
  const char* text = std::getenv("VISCERA_MUTANT");
  return text ? std::atoi(text) : 0;
}();

// Not shared between units: some are compiled for wider vectors than the machine may have.
[[gnu::noinline, gnu::cold, maybe_unused]] static void tell_reached() {
  static bool told = false;
  if (__atomic_exchange_n(&told, true, __ATOMIC_RELAXED)) return;
  const char* name = std::getenv("VISCERA_MUTANT_REACHED");
  if (!name) return;
  if (std::FILE* file = std::fopen(name, "w")) std::fclose(file);
}

/// Whether this process runs the mutant of that number.
[[gnu::always_inline]] inline bool mutated(int number) {
  if (active_mutant != number) [[likely]]
    return false;
  tell_reached();
  return true;
}

}  // namespace viscera
