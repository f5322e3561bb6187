// The memory that kernels work in. A block is aligned to cache lines, and given back when it goes out of scope.
#pragma once

#include <cstddef>
#include <memory>
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

// An array that is written before it is read: to set it to 0 first would take as long as many a pass over it.
template <class T>
class Unset {
 public:
  explicit Unset(size_t size) : values_(new T[size]) {}
  T& operator[](size_t at) const { return values_[at]; }
  T* get() const { return values_.get(); }

 private:
  std::unique_ptr<T[]> values_;
};

}  // namespace stereopsis
