#include "gaussian.hpp"

#include <algorithm>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Rows of knots kept at once, about; and worked on at once, at least.
constexpr size_t kKnotsBytes = size_t{4} << 20;
constexpr int kFewestRows = 8;

}  // namespace

void match_gaussian(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, const FusedKernel& kernel,
                    const FusedOutput& out, const Workers& workers) {
  const GaussianKernel& gaussian = *kernel.gaussian;
  const GaussianGrid grid(pair, settings.cost, filter);
  KnotRows knots{nullptr, grid.record(), grid.top, grid.bottom, 1}, filtered = knots;
  const auto match_rows = [&](int from, int to) {
    parallel_rows(to - from, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
      const Scratch scratch(gaussian.rows_bytes(pair, settings, filter));
      gaussian.rows(pair, settings, filter, filtered, out, from + begin, from + end, scratch.memory, cancel);
    });
  };
  if (grid.stride == 1) return match_rows(0, pair.height);

  // Pixels between knots k and k + 1 ask for the rows of knots from k - 1 - reach to k + 2 + reach.
  const int around = 2 * grid.reach + 3, rows = (pair.height - 1) / grid.stride + 1, all = grid.bottom - grid.top + 1;
  const size_t room = kKnotsBytes / (knots.record * sizeof(double));
  const int at_once = std::max(kFewestRows, static_cast<int>(std::min<size_t>(room, all)) - around);
  knots.capacity = std::min(at_once + around, all);
  const Scratch memory(knots.capacity * knots.record * sizeof(double));
  knots.base = static_cast<double*>(memory.memory);
  filtered.top = -1;
  filtered.bottom = rows + 1;
  filtered.capacity = std::min(at_once, rows) + 3;
  const Scratch more_memory(filtered.capacity * filtered.record * sizeof(double));
  filtered.base = static_cast<double*>(more_memory.memory);
  const int pieces = static_cast<int>((knots.record + kPiece - 1) / kPiece);
  int made = grid.top, finished = filtered.top;
  for (int row = 0; row < rows; row += at_once) {
    const int past = std::min(row + at_once, rows), needed = std::min(past + 2 + grid.reach, grid.bottom + 1);
    if (needed > made) {
      parallel_rows(needed - made, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
        const Scratch scratch(gaussian.knots_bytes(pair, settings, filter));
        gaussian.knots(pair, settings, filter, knots, made + begin, made + end, scratch.memory, cancel);
      });
      made = needed;
    }
    parallel_rows(pieces, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
      gaussian.filter(filter, knots, filtered, finished, past + 2, begin, end, cancel);
    });
    finished = past + 2;
    match_rows(row * grid.stride, std::min(past * grid.stride, pair.height));
  }
}

}  // namespace stereopsis
