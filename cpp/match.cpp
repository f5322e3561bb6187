#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

Range range_of(const Pair& pair) {
  const size_t size = static_cast<size_t>(pair.height) * pair.width * pair.channels;
  Range range{INT32_MAX, INT32_MIN};
  for (const void* image : {pair.left, pair.right}) {
    const auto* pixels = static_cast<const int32_t*>(image);
    for (size_t k = 0; k < size; ++k) {
      range.least = pixels[k] < range.least ? pixels[k] : range.least;
      range.most = pixels[k] > range.most ? pixels[k] : range.most;
    }
  }
  return range;
}

void match(const Pair& pair, const FusedSettings& given, bool narrow, const FusedKernel& kernel, const FusedOutput& out,
           const Workers& workers) {
  FusedSettings settings = given;
  if (!narrow) settings.range = range_of(pair);
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const Scratch scratch(kernel.scratch_bytes(pair, settings, narrow));
    kernel.rows(pair, settings, narrow, out, begin, end, scratch.memory, cancel);
  });
}

}  // namespace stereopsis
