#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

void match(const Pair& pair, const FusedSettings& settings, bool narrow, const FusedKernel& kernel, const FusedOutput& out,
           const Workers& workers) {
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const Scratch scratch(kernel.scratch_bytes(pair, settings, narrow));
    kernel.rows(pair, settings, narrow, out, begin, end, scratch.memory, cancel);
  });
}

}  // namespace stereopsis
