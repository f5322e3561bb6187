// The block of memory that a kernel works in: aligned to cache lines, given back when it goes out of scope.
#pragma once

#include <cstddef>
#include <new>

namespace stereopsis {

struct Scratch {
  static constexpr std::align_val_t alignment{64};
  explicit Scratch(size_t bytes) : memory(::operator new(bytes, alignment)) {}
  ~Scratch() { ::operator delete(memory, alignment); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  void* memory;
};

}  // namespace stereopsis
