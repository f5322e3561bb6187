#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

void box(const int64_t* terms, int height, int width, int count, const Window& window, int64_t* sums, const Workers& workers) {
  const size_t columns = static_cast<size_t>(width) + window.width - 1, D = count;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<int64_t> column(columns * D), sum(D);
    const auto add_row = [&](int y, int64_t sign) {
      const int64_t* row = terms + static_cast<size_t>(y) * columns * D;
      for (size_t k = 0; k < columns * D; ++k) column[k] += sign * row[k];
    };
    for (int r = 0; r < window.height - 1; ++r) add_row(begin + r, 1);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      add_row(y + window.height - 1, 1);
      std::fill(sum.begin(), sum.end(), 0);
      for (int k = 0; k < window.width - 1; ++k)
        for (size_t i = 0; i < D; ++i) sum[i] += column[k * D + i];
      for (int x = 0; x < width; ++x) {
        int64_t* out = sums + (static_cast<size_t>(y) * width + x) * D;
        for (size_t i = 0; i < D; ++i) out[i] = sum[i] += column[(x + window.width - 1) * D + i];
        for (size_t i = 0; i < D; ++i) sum[i] -= column[x * D + i];
      }
      add_row(y, -1);
    }
  });
}

}  // namespace stereopsis
