#include "planar.hpp"

#include <algorithm>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

Samples samples(int size, int most) {
  const int reach = (size - 1) / 2, step = std::max(1, (2 * reach + most - 2) / (most - 1));
  return {reach / step * step, step};
}

}  // namespace

void planar(const float* disparity, int height, int width, const Window& window, float tolerance, int iterations, float* smooth,
            const PlanarKernel& kernel, const Workers& workers) {
  const Samples columns = samples(window.width, kPlanarColumns), rows = samples(window.height, kPlanarRows);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    const int above = begin - rows.reach, below = end + rows.reach;
    const ptrdiff_t stride = width + 2 * columns.reach + kPlanarBlock;
    std::vector<float> around((below - above) * stride, std::numeric_limits<float>::quiet_NaN()), out(width + kPlanarBlock);
    for (int y = std::max(0, above); y < std::min(height, below); ++y)
      std::copy_n(disparity + static_cast<size_t>(y) * width, width, around.data() + (y - above) * stride + columns.reach);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const float* here = around.data() + (y - above) * stride + columns.reach;
      kernel.row({here, stride, width, columns, rows, tolerance, iterations, here, out.data()});
      std::copy_n(out.data(), width, smooth + static_cast<size_t>(y) * width);
    }
  });
}

}  // namespace stereopsis
