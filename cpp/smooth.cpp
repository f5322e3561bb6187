#include "smooth.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "parallel.hpp"
#include "simd.hpp"

namespace stereopsis {

namespace {

// Of what no data speak; small, but its smoothed traces stay far from denormal numbers.
constexpr float kUnknown = 1e-6f, kNoRise = 1e-12f;
constexpr float kSteepest = 1.5f, kSlopeStrength = 300.0f;

void smooth_lines(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const float* edges, bool rows,
                  float strength, SmoothKernel kernel, const Workers& workers) {
  const int count = rows ? height : width, n = rows ? width : height;
  parallel_rows((count + kLines - 1) / kLines, workers.threads, workers.interrupted,
                [&](int begin, int end, const Cancel& cancel) {
    const Unset<float> memory(5 * static_cast<size_t>(n) * kLines);
    const float* const cells = !slopes ? nullptr : rows ? slopes->right.data() : slopes->down.data();
    for (int strip = begin; strip < end && !cancel.load(std::memory_order_relaxed); ++strip)
      kernel({height, width, strip * kLines, rows, fields.data(), static_cast<int>(fields.size()), cells, slopes ? slopes->wide : 0, edges,
              strength},
             memory.get());
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

namespace {

// Of a row, each pixel with the one `apart` further on: the weight of the largest difference of a channel.
template <int C>
void weigh_row(const int32_t* STEREOPSIS_RESTRICT guide, size_t apart, int count, int channels, const float* STEREOPSIS_RESTRICT table,
               int length, float* STEREOPSIS_RESTRICT weights) {
  const int of_each = C ? C : channels;
  for (int x = 0; x < count; ++x) {
    int64_t most = 0;
    for (int c = 0; c < of_each; ++c) {
      const size_t at = static_cast<size_t>(x) * of_each + c;
      most = std::max(most, std::abs(static_cast<int64_t>(guide[at + apart * of_each]) - guide[at]));
    }
    weights[x] = table[std::min<int64_t>(most, length - 1)];
  }
}

}  // namespace

EdgeWeights edge_weights(const int32_t* guide, int height, int width, int channels, const float* table, int length,
                         const Workers& workers) {
  const size_t size = static_cast<size_t>(height) * width;
  EdgeWeights edges{Unset<float>(size), Unset<float>(size)};
  const auto weigh = channels == 1 ? &weigh_row<1> : &weigh_row<0>;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t at = static_cast<size_t>(y) * width;
      const int32_t* const row = guide + at * channels;
      weigh(row, 1, width - 1, channels, table, length, edges.right.get() + at);
      edges.right[at + width - 1] = 0;
      if (y + 1 < height)
        weigh(row, width, width, channels, table, length, edges.down.get() + at);
      else
        std::fill_n(edges.down.get() + at, width, 0.0f);
    }
  });
  return edges;
}

void smooth(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const EdgeWeights& edges,
            float strength, int iterations, SmoothKernel kernel, const Workers& workers) {
  for (int t = 0; t < iterations; ++t) {
    const float share = static_cast<float>(1.5 * std::pow(4.0, iterations - 1 - t) / (std::pow(4.0, iterations) - 1)) * strength;
    smooth_lines(fields, slopes, height, width, edges.right.get(), true, share, kernel, workers);
    smooth_lines(fields, slopes, height, width, edges.down.get(), false, share, kernel, workers);
  }
}

Slopes surface_slopes(const float* disparity, const int32_t* guide, int height, int width, int channels, const float* table,
                         int length, SmoothKernel kernel, const Workers& workers) {
  const int high = (height + kCell - 1) / kCell, wide = (width + kCell - 1) / kCell;
  const size_t cells = static_cast<size_t>(high) * wide;
  std::vector<int32_t> mean(cells * channels);
  parallel_rows(high, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<int64_t> sums(static_cast<size_t>(wide) * channels);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const int top = y * kCell, bottom = std::min(height, top + kCell);
      std::fill(sums.begin(), sums.end(), 0);
      for (int v = top; v < bottom; ++v) {
        const int32_t* pixel = guide + static_cast<size_t>(v) * width * channels;
        for (int u = 0; u < width; ++u)
          for (int c = 0; c < channels; ++c) sums[static_cast<size_t>(u / kCell) * channels + c] += *pixel++;
      }
      for (int x = 0; x < wide; ++x)
        for (int c = 0; c < channels; ++c) {
          const size_t at = static_cast<size_t>(x) * channels + c;
          const int64_t count = (bottom - top) * (std::min(width, (x + 1) * kCell) - x * kCell);
          mean[static_cast<size_t>(y) * wide * channels + at] = static_cast<int32_t>(sums[at] / count);
        }
    }
  });
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
  for (auto& rises : rise)
    for (float& value : rises) value = std::min(std::max(value, -kSteepest), kSteepest);
  return {wide, std::move(rise[0]), std::move(rise[1])};
}

}  // namespace stereopsis
