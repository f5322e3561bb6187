#include "smooth.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "parallel.hpp"

namespace stereopsis {

namespace {

constexpr int kCell = 4;    // side of the cells in which slopes are smoothed
// Of what no data speak; small, but its smoothed traces stay far from denormal numbers.
constexpr float kUnknown = 1e-6f, kNoRise = 1e-12f;
constexpr float kSteepest = 1.5f, kSlopeStrength = 300.0f;

void smooth_lines(const std::vector<Weighed>& fields, const float* slopes, int height, int width, const float* edges, bool rows,
                  float strength, SmoothKernel kernel, const Workers& workers) {
  const int count = rows ? height : width, n = rows ? width : height;
  parallel_rows((count + kLines - 1) / kLines, workers.threads, workers.interrupted,
                [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> memory(6 * static_cast<size_t>(n) * kLines);
    for (int strip = begin; strip < end && !cancel.load(std::memory_order_relaxed); ++strip)
      kernel({height, width, strip * kLines, rows, fields.data(), static_cast<int>(fields.size()), slopes, edges, strength}, memory.data());
  });
}

// Cells' sums of the differences over gaps along rows, or along columns, and of their weights.
void gap_slopes(const float* disparity, int height, int width, bool rows, int cells_wide, float* rises, float* weights,
                const Workers& workers) {
  const int lines = rows ? height : width, n = rows ? width : height;
  const size_t along = rows ? 1 : width, across = rows ? width : 1;
  parallel_rows((lines + kCell - 1) / kCell, workers.threads, workers.interrupted,
                [&](int begin, int end, const Cancel& cancel) {
    for (int line = begin * kCell; line < std::min(lines, end * kCell) && !cancel.load(std::memory_order_relaxed); ++line) {
      const float* values = disparity + across * line;
      const auto cell = [&](int i) {
        return rows ? static_cast<size_t>(line / kCell) * cells_wide + i / kCell
                    : static_cast<size_t>(i / kCell) * cells_wide + line / kCell;
      };
      int last = -1;
      for (int i = 0; i < n; ++i) {
        const float value = values[along * i];
        if (std::isnan(value)) continue;
        if (last >= 0) {
          const int gap = i - last;
          const float rise = value - values[along * last];
          if (std::fabs(rise) <= 1.5f + 0.5f * gap)
            for (int j = last; j < i; ++j) {
              rises[cell(j)] += rise / gap;
              weights[cell(j)] += 1;
            }
        }
        last = i;
      }
    }
  });
}

}  // namespace

EdgeWeights edge_weights(const int32_t* guide, int height, int width, int channels, const float* table, int length,
                         const Workers& workers) {
  EdgeWeights edges{std::vector<float>(static_cast<size_t>(height) * width), std::vector<float>(static_cast<size_t>(height) * width)};
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; ++x) {
        const size_t at = static_cast<size_t>(y) * width + x;
        const auto weight = [&](size_t other) {
          int64_t most = 0;
          for (int c = 0; c < channels; ++c)
            most = std::max(most, std::abs(static_cast<int64_t>(guide[at * channels + c]) - guide[other * channels + c]));
          return table[std::min<int64_t>(most, length - 1)];
        };
        if (x + 1 < width) edges.right[at] = weight(at + 1);
        if (y + 1 < height) edges.down[at] = weight(at + width);
      }
  });
  return edges;
}

void smooth(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const EdgeWeights& edges,
            float strength, int iterations, SmoothKernel kernel, const Workers& workers) {
  for (int t = 0; t < iterations; ++t) {
    const float share = static_cast<float>(1.5 * std::pow(4.0, iterations - 1 - t) / (std::pow(4.0, iterations) - 1)) * strength;
    smooth_lines(fields, slopes ? slopes->right : nullptr, height, width, edges.right.data(), true, share, kernel, workers);
    smooth_lines(fields, slopes ? slopes->down : nullptr, height, width, edges.down.data(), false, share, kernel, workers);
  }
}

SlopeMaps surface_slopes(const float* disparity, const int32_t* guide, int height, int width, int channels, const float* table,
                         int length, SmoothKernel kernel, const Workers& workers) {
  const int high = (height + kCell - 1) / kCell, wide = (width + kCell - 1) / kCell;
  const size_t cells = static_cast<size_t>(high) * wide;
  std::vector<int32_t> mean(cells * channels);
  for (int y = 0; y < high; ++y)
    for (int x = 0; x < wide; ++x)
      for (int c = 0; c < channels; ++c) {
        int64_t sum = 0, count = 0;
        for (int v = y * kCell; v < std::min(height, (y + 1) * kCell); ++v)
          for (int u = x * kCell; u < std::min(width, (x + 1) * kCell); ++u, ++count)
            sum += guide[(static_cast<size_t>(v) * width + u) * channels + c];
        mean[(static_cast<size_t>(y) * wide + x) * channels + c] = static_cast<int32_t>(sum / count);
      }
  std::vector<float> rise[2], weight[2];
  for (int axis = 0; axis < 2; ++axis) {
    rise[axis].resize(cells);
    weight[axis].resize(cells);
    gap_slopes(disparity, height, width, axis == 0, wide, rise[axis].data(), weight[axis].data(), workers);
    for (size_t k = 0; k < cells; ++k) {
      rise[axis][k] = weight[axis][k] > 0 ? rise[axis][k] / weight[axis][k] : kNoRise;
      weight[axis][k] = std::max(weight[axis][k], kUnknown);
    }
  }
  const EdgeWeights edges = edge_weights(mean.data(), high, wide, channels, table, length, workers);
  smooth({{rise[0].data(), weight[0].data()}, {rise[1].data(), weight[1].data()}}, nullptr, high, wide, edges, kSlopeStrength, 2,
         kernel, workers);
  SlopeMaps slopes{std::vector<float>(static_cast<size_t>(height) * width), std::vector<float>(static_cast<size_t>(height) * width)};
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const size_t at = static_cast<size_t>(y) * width + x, cell = static_cast<size_t>(y / kCell) * wide + x / kCell;
      slopes.right[at] = std::min(std::max(rise[0][cell], -kSteepest), kSteepest);
      slopes.down[at] = std::min(std::max(rise[1][cell], -kSteepest), kSteepest);
    }
  return slopes;
}

}  // namespace stereopsis
