// Invariants, and the values that break them: VISCERA_ASSERT(v < n, "vertex " << v << " of " << n).
// They are checked in builds with VISCERA_CHECKED (CMake: ON for sanitizers, mutants and Debug); in
// others nothing of it is evaluated. What a user's file can break is refused with an error instead.
// Device code checks none.
#pragma once

#if defined(VISCERA_CHECKED) && !defined(__CUDA_ARCH__)

#include <cstdlib>
#include <iostream>
#include <sstream>

namespace viscera {

[[noreturn]] inline void fail_assertion(const char* file, int line, const char* condition,
                                        const std::string& values) {
  std::cerr << file << ":" << line << ": does not hold: " << condition << ": " << values
            << std::endl;
  std::abort();
}

}  // namespace viscera

#define VISCERA_ASSERT(condition, values)                                            \
  do {                                                                               \
    if (!(condition)) {                                                              \
      std::ostringstream viscera_values;                                             \
      viscera_values << values;                                                      \
      viscera::fail_assertion(__FILE__, __LINE__, #condition, viscera_values.str()); \
    }                                                                                \
  } while (false)

#else

#define VISCERA_ASSERT(condition, values) static_cast<void>(0)

#endif
