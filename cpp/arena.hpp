// One block of memory, handed out in aligned pieces.
#pragma once

#include <cstddef>

namespace stereopsis {
namespace {

// Hands out 64-byte aligned pieces of one block; with no block it only counts.
struct Arena {
  char* base;
  size_t used = 0;
  template <class T>
  T* take(size_t count) {
    T* piece = base ? reinterpret_cast<T*>(base + used) : nullptr;
    used += (count * sizeof(T) + 63) / 64 * 64;
    return piece;
  }
};

}  // namespace
}  // namespace stereopsis
