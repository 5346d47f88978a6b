// How a vertex's displacement travels from one thread block to another, on the same device or not,
// without a barrier.
#pragma once

#include <cuda_runtime.h>

#include "sim/base/math.hpp"

namespace viscera::sim {

// A vertex's displacement on its way to other blocks. A word is written and read at once (PTX ISA
// 8.3: b128 accesses of sm_70 and later are single), so a number that belongs to the exchange tells
// that the rest of its word does.
struct alignas(16) Word {
  unsigned long long low, high;

  __device__ static void store(Word* to, Word word) {
    asm volatile(
        "{ .reg .b128 w; mov.b128 w, {%1, %2}; st.relaxed.sys.global.b128 [%0], w; }" ::"l"(to),
        "l"(word.low), "l"(word.high)
        : "memory");
  }
  __device__ static Word load(const Word* from) {
    Word word;
    asm volatile("{ .reg .b128 w; ld.relaxed.sys.global.b128 w, [%2]; mov.b128 {%0, %1}, w; }"
                 : "=l"(word.low), "=l"(word.high)
                 : "l"(from)
                 : "memory");
    return word;
  }
};

template <class T>
struct Message;
template <>
struct Message<float> {
  Word word;
  __device__ static void send(Message* to, const Vec3<float>& d, unsigned exchange) {
    const auto bits = [](float a) { return static_cast<unsigned long long>(__float_as_uint(a)); };
    Word::store(&to->word, {bits(d.x) | bits(d.y) << 32,
                            bits(d.z) | static_cast<unsigned long long>(exchange) << 32});
  }
  __device__ static Message look(const Message* at) { return {Word::load(&at->word)}; }
  __device__ bool arrived(unsigned exchange) const { return word.high >> 32 == exchange; }
  __device__ Vec3<float> content() const {
    return {__uint_as_float(static_cast<unsigned>(word.low)),
            __uint_as_float(static_cast<unsigned>(word.low >> 32)),
            __uint_as_float(static_cast<unsigned>(word.high))};
  }
};
template <>
struct Message<double> {
  Word word[3];
  __device__ static void send(Message* to, const Vec3<double>& d, unsigned exchange) {
    const double content[3] = {d.x, d.y, d.z};
    for (int k = 0; k < 3; ++k) {
      Word::store(&to->word[k],
                  {static_cast<unsigned long long>(__double_as_longlong(content[k])), exchange});
    }
  }
  __device__ static Message look(const Message* at) {
    return {Word::load(&at->word[0]), Word::load(&at->word[1]), Word::load(&at->word[2])};
  }
  __device__ bool arrived(unsigned exchange) const {
    return word[0].high == exchange && word[1].high == exchange && word[2].high == exchange;
  }
  __device__ Vec3<double> content() const {
    const auto number = [this](int k) {
      return __longlong_as_double(static_cast<long long>(word[k].low));
    };
    return {number(0), number(1), number(2)};
  }
};

}  // namespace viscera::sim
