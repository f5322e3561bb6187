#include "pixelwise.hpp"

#include <algorithm>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

template <class T>
void census(const T* image, int height, int width, const CensusPoint* points, int count, uint64_t* strings,
            const PixelwiseKernels& kernels, const Workers& workers) {
  int reach_x = 0, reach_y = 0;
  for (int k = 0; k < 2 * count; ++k) {
    reach_x = std::max(reach_x, std::abs(points[k].dx));
    reach_y = std::max(reach_y, std::abs(points[k].dy));
  }
  // The image with its edge pixels repeated, so that no comparison has to ask where it is.
  const ptrdiff_t stride = width + 2 * ptrdiff_t{reach_x};
  std::vector<T> wide(static_cast<size_t>(stride) * (height + 2 * reach_y) + kCensusStretch);
  for (int y = -reach_y; y < height + reach_y; ++y) {
    const T* from = image + static_cast<size_t>(std::clamp(y, 0, height - 1)) * width;
    T* to = wide.data() + (y + reach_y) * stride;
    std::fill_n(to, reach_x, from[0]);
    std::copy_n(from, width, to + reach_x);
    std::fill_n(to + reach_x + width, reach_x, from[width - 1]);
  }
  std::vector<Comparison> comparisons;
  for (int k = 0; k < count; ++k)
    comparisons.push_back({points[2 * k].dy * stride + points[2 * k].dx, points[2 * k + 1].dy * stride + points[2 * k + 1].dx});
  const CensusJob job{wide.data() + reach_y * stride + reach_x, sizeof(T) == 1, stride, height, width, comparisons.data(), count,
                      strings};
  parallel_rows(height, workers.threads, workers.interrupted,
                [&](int begin, int end, const Cancel& cancel) { kernels.census_rows(job, begin, end, cancel); });
}
template void census(const uint8_t*, int, int, const CensusPoint*, int, uint64_t*, const PixelwiseKernels&, const Workers&);
template void census(const int32_t*, int, int, const CensusPoint*, int, uint64_t*, const PixelwiseKernels&, const Workers&);

void combine(uint16_t* costs, const uint16_t* other, int rows, size_t in_row, uint32_t factor, uint32_t other_factor,
             const Workers& workers) {
  parallel_rows(rows, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      uint16_t* __restrict to = costs + y * in_row;
      const uint16_t* __restrict from = other + y * in_row;
      for (size_t i = 0; i < in_row; ++i) {
        const uint32_t sum = (to[i] * factor + from[i] * other_factor + (1u << 15)) >> 16;
        to[i] = to[i] == worst_cost<uint16_t>() ? to[i] : static_cast<uint16_t>(sum);
      }
    }
  });
}

void pixel_costs(const PixelJob& job, const PixelwiseKernels& kernels, const Workers& workers) {
  parallel_rows(job.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const Scratch scratch(kernels.scratch_bytes(job));
    kernels.rows(job, begin, end, scratch.memory, cancel);
  });
}

}  // namespace stereopsis
