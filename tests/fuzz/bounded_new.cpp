// AddressSanitizer's `new` ends the process where there is no memory. Here it throws instead, as it
// does where memory is limited: for readers that look in another process whether they get enough
// (trial_read.hpp). What a reader asks for afterwards ends the fuzzer all the same.
#include <cstdlib>
#include <new>

namespace {

constexpr std::size_t max_bytes = std::size_t{255} << 20;

}  // namespace

void* operator new(std::size_t bytes) {
  void* memory = bytes > max_bytes ? nullptr : std::malloc(bytes > 0 ? bytes : 1);
  if (memory == nullptr) throw std::bad_alloc();
  return memory;
}
void* operator new[](std::size_t bytes) {
  return operator new(bytes);
}
void* operator new(std::size_t bytes, const std::nothrow_t&) noexcept {
  return bytes > max_bytes ? nullptr : std::malloc(bytes > 0 ? bytes : 1);
}
void* operator new[](std::size_t bytes, const std::nothrow_t& tag) noexcept {
  return operator new(bytes, tag);
}
void operator delete(void* memory) noexcept {
  std::free(memory);
}
void operator delete(void* memory, std::size_t) noexcept {
  std::free(memory);
}
void operator delete[](void* memory) noexcept {
  std::free(memory);
}
void operator delete[](void* memory, std::size_t) noexcept {
  std::free(memory);
}
