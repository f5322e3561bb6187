#include "smooth.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <utility>

#include "parallel.hpp"
#include "simd.hpp"

namespace stereopsis {

namespace {

constexpr int kLines = 16;  // lines solved side by side: a cache line of floats
// Of what no data speak; small, but its smoothed traces stay far from denormal numbers.
constexpr float kUnknown = 1e-6f, kNoRise = 1e-12f;
constexpr float kSteepest = 1.5f, kSlopeStrength = 300.0f;

// Lines k to k + kLines - 1, sample by sample: rows of the image, or its columns.
struct Strip {
  int height, width, first;
  bool rows;
  int length() const { return rows ? width : height; }
  int lines() const { return std::min(kLines, (rows ? height : width) - first); }
  // Rows are turned square by square, which the nearest cache holds.
  void load(const float* STEREOPSIS_RESTRICT plane, float* STEREOPSIS_RESTRICT samples) const {
    const int n = length(), m = lines();
    for (int from = 0; rows && from < n; from += kLines)
      for (int k = 0; k < kLines; ++k) {
        const float* line = plane + static_cast<size_t>(first + std::min(k, m - 1)) * width;
        for (int i = from; i < std::min(from + kLines, n); ++i) samples[i * kLines + k] = line[i];
      }
    for (int i = 0; !rows && i < n; ++i) {
      const float* line = plane + static_cast<size_t>(i) * width + first;
      if (m == kLines)
        for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = line[k];
      else
        for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = line[std::min(k, m - 1)];
    }
  }
  // How high the surface with these slopes stands above its first sample.
  void load_heights(const Slopes& slopes, float* STEREOPSIS_RESTRICT samples) const {
    const float* const cells = rows ? slopes.right.data() : slopes.down.data();
    const int n = length(), m = lines();
    float heights[kLines] = {}, steps[kLines];
    for (int i = 0; i < n; ++i) {
      if (i % kCell == 0)
        for (int k = 0; k < kLines; ++k) {
          const int line = first + std::min(k, m - 1);
          steps[k] = cells[rows ? slopes.cell(line, i) : slopes.cell(i, line)];
        }
      for (int k = 0; k < kLines; ++k) {
        samples[i * kLines + k] = heights[k];
        heights[k] += steps[k];
      }
    }
  }
  void store(const float* STEREOPSIS_RESTRICT samples, float* STEREOPSIS_RESTRICT plane) const {
    const int n = length(), m = lines();
    for (int from = 0; rows && from < n; from += kLines)
      for (int k = 0; k < m; ++k) {
        float* line = plane + static_cast<size_t>(first + k) * width;
        for (int i = from; i < std::min(from + kLines, n); ++i) line[i] = samples[i * kLines + k];
      }
    for (int i = 0; !rows && i < n; ++i) std::copy_n(samples + i * kLines, m, plane + static_cast<size_t>(i) * width + first);
  }
};

// Elimination, from the first sample on: of the matrix it leaves the factors of the way back. Values, counted from `rise`, are
// weighted on the way. Only sums of positive terms.
void eliminate(const float* STEREOPSIS_RESTRICT edges, const float* STEREOPSIS_RESTRICT rise, int n, float strength,
               float* STEREOPSIS_RESTRICT value, float* STEREOPSIS_RESTRICT weight, float* STEREOPSIS_RESTRICT back) {
  float left[kLines] = {}, before[kLines] = {}, value_before[kLines] = {}, weight_before[kLines] = {};
  for (int i = 0; i < n; ++i, edges += kLines, value += kLines, weight += kLines, back += kLines) {
    const float on = i + 1 < n ? strength : 0.0f;
    for (int k = 0; k < kLines; ++k) {
      const float next = on * edges[k], kept = 1 + left[k], pivot = 1 / (kept + next);
      const float w = weight[k], v = (rise ? value[k] - rise[k] : value[k]) * w;
      back[k] = next * pivot;
      left[k] = next * (kept * pivot);
      value_before[k] = value[k] = (v + before[k] * value_before[k]) * pivot;
      weight_before[k] = weight[k] = (w + before[k] * weight_before[k]) * pivot;
      before[k] = next;
    }
    if (rise) rise += kLines;
  }
}

// The way back, from the last sample; then values are divided by their weights.
void substitute(const float* STEREOPSIS_RESTRICT rise, const float* STEREOPSIS_RESTRICT back, int n, float* STEREOPSIS_RESTRICT value,
                float* STEREOPSIS_RESTRICT weight) {
  float v[kLines] = {}, w[kLines] = {};
  for (int at = (n - 1) * kLines; at >= 0; at -= kLines)
    for (int k = 0; k < kLines; ++k) {
      v[k] = value[at + k] + back[at + k] * v[k];
      w[k] = weight[at + k] + back[at + k] * w[k];
      weight[at + k] = w[k];
      value[at + k] = rise ? v[k] / w[k] + rise[at + k] : v[k] / w[k];
    }
}

void smooth_lines(const std::vector<Weighed>& fields, const Slopes* slopes, int height, int width, const float* edges, bool rows,
                  float strength, const Workers& workers) {
  const int count = rows ? height : width, n = rows ? width : height;
  parallel_rows((count + kLines - 1) / kLines, workers.threads, workers.interrupted,
                [&](int begin, int end, const Cancel& cancel) {
    const size_t size = static_cast<size_t>(n) * kLines;
    std::vector<float> memory(5 * size);
    float *edge = memory.data(), *back = edge + size, *value = back + size, *weight = value + size;
    float* const rise = slopes ? weight + size : nullptr;
    for (int strip = begin; strip < end && !cancel.load(std::memory_order_relaxed); ++strip) {
      const Strip lines{height, width, strip * kLines, rows};
      lines.load(edges, edge);
      if (slopes) lines.load_heights(*slopes, rise);
      for (const Weighed& field : fields) {
        lines.load(field.value, value);
        lines.load(field.weight, weight);
        eliminate(edge, rise, n, strength, value, weight, back);
        substitute(rise, back, n, value, weight);
        lines.store(value, field.value);
        lines.store(weight, field.weight);
      }
    }
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
            float strength, int iterations, const Workers& workers) {
  for (int t = 0; t < iterations; ++t) {
    const float share = static_cast<float>(1.5 * std::pow(4.0, iterations - 1 - t) / (std::pow(4.0, iterations) - 1)) * strength;
    smooth_lines(fields, slopes, height, width, edges.right.get(), true, share, workers);
    smooth_lines(fields, slopes, height, width, edges.down.get(), false, share, workers);
  }
}

Slopes surface_slopes(const float* disparity, const int32_t* guide, int height, int width, int channels, const float* table,
                         int length, const Workers& workers) {
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
         workers);
  for (auto& rises : rise)
    for (float& value : rises) value = std::min(std::max(value, -kSteepest), kSteepest);
  return {wide, std::move(rise[0]), std::move(rise[1])};
}

}  // namespace stereopsis
