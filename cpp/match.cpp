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
  // Two threads share a band, the odd one has its own.
  const int threads = std::max(1, std::min(workers.threads, pair.height)), bands = (threads + 1) / 2;
  const auto edge = [&](int band) {
    return static_cast<int>(static_cast<int64_t>(pair.height) * std::min(2 * band, threads) / threads);
  };
  std::vector<std::atomic<int>> left(bands);
  for (int band = 0; band < bands; ++band) left[band] = edge(band + 1) - edge(band);
  parallel_rows(threads, threads, workers.interrupted, [&](int thread, int, const Cancel& cancel) {
    const int band = thread / 2;
    RowsToTake rows(edge(band), edge(band + 1), left[band], thread % 2 == 1);
    const Scratch scratch(kernel.scratch_bytes(pair, settings, narrow));
    kernel.rows(pair, settings, narrow, out, rows, scratch.memory, cancel);
  });
}

}  // namespace stereopsis
