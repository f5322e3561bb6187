#include <new>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

struct Scratch {
  static constexpr std::align_val_t alignment{64};
  explicit Scratch(size_t bytes) : memory(::operator new(bytes, alignment)) {}
  ~Scratch() { ::operator delete(memory, alignment); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
  void* memory;
};

}  // namespace

void match(const Pair& pair, const FusedSettings& settings, bool narrow, const FusedKernel& kernel, const FusedOutput& out,
           const Workers& workers) {
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const Scratch scratch(kernel.scratch_bytes(pair, settings, narrow));
    kernel.rows(pair, settings, narrow, out, begin, end, scratch.memory, cancel);
  });
}

}  // namespace stereopsis
