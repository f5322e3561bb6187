#include <algorithm>
#include <vector>

#include "parallel.hpp"
#include "rows.hpp"
#include "score.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

int clamp(int v, int lo, int hi) { return std::min(std::max(v, lo), hi); }

bool in_view(const Pair& pair, int x, int i) {
  const int right = x - pair.first - i;
  return 0 <= right && right < pair.width;
}

// Sums and squares over every window of one image, (H, W, C), the edge pixels repeated.
std::vector<Moments> window_moments(const Pair& pair, const void* image, const Window& window) {
  const int H = pair.height, W = pair.width, C = pair.channels;
  const auto* pixels = static_cast<const int32_t*>(image);
  std::vector<Moments> columns(static_cast<size_t>(W) * C), result(static_cast<size_t>(H) * W * C);
  const auto add_row = [&](int y, int sign) {
    const int32_t* row = pixels + static_cast<size_t>(clamp(y, 0, H - 1)) * W * C;
    for (int k = 0; k < W * C; ++k) columns[k].add(row[k], sign);
  };
  for (int y = -window.above(); y <= window.below(); ++y) add_row(y, 1);
  for (int y = 0; y < H; ++y) {
    for (int c = 0; c < C; ++c) {
      const auto column = [&](int x) -> const Moments& { return columns[static_cast<size_t>(clamp(x, 0, W - 1)) * C + c]; };
      Moments sum{};
      for (int x = -window.left(); x <= window.right(); ++x) sum.join(column(x), 1);
      for (int x = 0; x < W; ++x) {
        result[(static_cast<size_t>(y) * W + x) * C + c] = sum;
        sum.join(column(x + window.right() + 1), 1);
        sum.join(column(x - window.left()), -1);
      }
    }
    add_row(y + window.below() + 1, 1);
    add_row(y - window.above(), -1);
  }
  return result;
}

// What the 32-bit arithmetic knows of a window in one channel.
struct NarrowStatistics {
  int32_t sum, square, mean, rest, about;
};

NarrowStatistics narrow_statistics(const Moments& m, int32_t n, float inverse_n) {
  NarrowStatistics s{};
  s.sum = static_cast<int32_t>(m.sum);
  s.square = static_cast<int32_t>(m.square);
  s.mean = nearest_mean(s.sum, inverse_n);
  s.rest = s.sum - n * s.mean;
  s.about = static_cast<int32_t>(m.square - static_cast<int64_t>(s.mean) * (s.sum + s.rest));
  return s;
}

float narrow_scale(CostKind cost, const NarrowStatistics* s, int channels, int32_t n) {
  float norm = 0;
  for (int c = 0; c < channels; ++c)
    norm = norm + (cost == CostKind::ncc ? static_cast<float>(s[c].square) : window_deviation(s[c].square, s[c].sum, 1.0 / n));
  return inverse_root(norm, least_norm(cost, n, channels));
}

float narrow_cost(CostKind cost, int64_t sum, const NarrowStatistics* l, const NarrowStatistics* r, int channels,
                  float left_scale, float right_scale, int32_t n) {
  if (cost == CostKind::ncc)
    return correlation_cost(fused(static_cast<float>(static_cast<int32_t>(-sum)) * left_scale, right_scale, kCorrelationBase));
  if (cost == CostKind::zncc) {
    int64_t negative = -sum;
    for (int c = 0; c < channels; ++c) negative += static_cast<int64_t>(kCentre) * r[c].sum;
    float v = static_cast<float>(static_cast<int32_t>(negative));
    const auto mean = [&](int c) { return SplitMean::of(l[c].sum - kCentre * n, 1.0 / n, channels == 1); };
    for (int c = 0; c < channels; ++c) v = fused(mean(c).high, static_cast<float>(r[c].sum), v);
    if (channels == 1) {
      v = fused(v, left_scale, SplitMean::mended(mean(0).low, l->sum, left_scale));
    } else {
      for (int c = 0; c < channels; ++c) v = fused(mean(c).low, static_cast<float>(r[c].sum), v);
      v = v * left_scale;
    }
    return correlation_cost(fused(v, right_scale, kCorrelationBase));
  }
  const float inverse_n = 1.0f / static_cast<float>(n);
  int64_t covariance = -sum, whole = 0;
  float excess = 0;
  for (int c = 0; c < channels; ++c) {
    covariance += static_cast<int64_t>(l[c].mean) * r[c].sum + static_cast<int64_t>(l[c].rest) * r[c].mean;
    whole += static_cast<int64_t>(l[c].about) + r[c].about;
    const float rest = static_cast<float>(l[c].rest) - static_cast<float>(r[c].rest);
    excess = excess + rest * rest * inverse_n;
  }
  return static_cast<float>(static_cast<int32_t>(whole + 2 * covariance)) - excess;
}

template <class T, class Cost>
void fill_volume(const Pair& pair, T* costs, const Workers& workers, Cost cost) {
  const int W = pair.width, D = pair.count;
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < W && !cancel.load(std::memory_order_relaxed); ++x) {
        const size_t at = (static_cast<size_t>(y) * W + x) * D;
        for (int i = 0; i < D; ++i) costs[at + i] = in_view(pair, x, i) ? cost(y, x, i, at + i) : worst_cost<T>();
      }
  });
}

template <CostKind Kind, class T>
void wide_score(const Pair& pair, const Window& window, const int64_t* sums, T* costs, const Workers& workers) {
  const int W = pair.width, C = pair.channels;
  const int64_t n = window.area();
  const auto describe = [&](const void* image) {
    std::vector<WindowStatistics> statistics;
    for (const Moments& m : window_moments(pair, image, window)) statistics.push_back(WindowStatistics::of(m, n));
    return statistics;
  };
  const auto left = describe(pair.left), right = describe(pair.right);
  fill_volume(pair, costs, workers, [&](int y, int x, int i, size_t at) -> T {
    const WindowStatistics* l = left.data() + (static_cast<size_t>(y) * W + x) * C;
    const WindowStatistics* r = right.data() + (static_cast<size_t>(y) * W + x - pair.first - i) * C;
    return static_cast<T>(
        WideCost<Kind>::of(sums[at], l, r, 1, C, n, wide_scale<Kind>(l, 1, C), wide_scale<Kind>(r, 1, C)));
  });
}

void narrow_score(const Pair& pair, const Window& window, CostKind cost, const int64_t* sums, float* costs,
                  const Workers& workers) {
  const int W = pair.width, C = pair.channels;
  const auto n = static_cast<int32_t>(window.area());
  const float inverse_n = 1.0f / static_cast<float>(n);
  const auto describe = [&](const void* image) {
    std::vector<NarrowStatistics> statistics;
    for (const Moments& m : window_moments(pair, image, window)) statistics.push_back(narrow_statistics(m, n, inverse_n));
    return statistics;
  };
  const auto left = describe(pair.left), right = describe(pair.right);
  const bool scaled = is_correlation(cost);
  fill_volume(pair, costs, workers, [&](int y, int x, int i, size_t at) {
    const NarrowStatistics* l = left.data() + (static_cast<size_t>(y) * W + x) * C;
    const NarrowStatistics* r = right.data() + (static_cast<size_t>(y) * W + x - pair.first - i) * C;
    return narrow_cost(cost, sums[at], l, r, C, scaled ? narrow_scale(cost, l, C, n) : 0,
                       scaled ? narrow_scale(cost, r, C, n) : 0, n);
  });
}

}  // namespace

template <class T>
void grey(const T* rgb, int height, int width, T* grey, const RowKernels& kernels, const Workers& workers) {
  const int64_t pixels = static_cast<int64_t>(height) * width;
  quick_bands(height, pixels, 1 << 19, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t at = static_cast<size_t>(y) * width;
      if constexpr (sizeof(T) == 1)
        kernels.grey_bytes(rgb + 3 * at, width, grey + at);
      else
        kernels.grey_words(rgb + 3 * at, width, grey + at);
    }
  });
}
template void grey(const uint8_t*, int, int, uint8_t*, const RowKernels&, const Workers&);
template void grey(const int32_t*, int, int, int32_t*, const RowKernels&, const Workers&);

void terms(const Pair& pair, const Window& window, Term term, int64_t* terms, const Workers& workers) {
  const int H = pair.height, W = pair.width, C = pair.channels, D = pair.count;
  const int rows = H + window.height - 1, columns = W + window.width - 1;
  const auto* left = static_cast<const int32_t*>(pair.left);
  const auto* right = static_cast<const int32_t*>(pair.right);
  parallel_rows(rows, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int r = begin; r < end && !cancel.load(std::memory_order_relaxed); ++r) {
      const size_t row = static_cast<size_t>(clamp(r - window.above(), 0, H - 1)) * W;
      for (int k = 0; k < columns; ++k) {
        const int x = k - window.left();
        int64_t* out = terms + (static_cast<size_t>(r) * columns + k) * D;
        for (int i = 0; i < D; ++i) {
          const int32_t* a = left + (row + clamp(x, 0, W - 1)) * C;
          const int32_t* b = right + (row + clamp(x - pair.first - i, 0, W - 1)) * C;
          int64_t sum = 0;
          for (int c = 0; c < C; ++c)
            sum += term == Term::product ? static_cast<int64_t>(a[c]) * b[c] : std::abs(static_cast<int64_t>(a[c]) - b[c]);
          out[i] = sum;
        }
      }
    }
  });
}

void score(const Pair& pair, const Window& window, CostKind cost, bool, const int64_t* sums, int64_t* costs,
           const Workers& workers) {
  if (cost == CostKind::sad)
    wide_score<CostKind::sad>(pair, window, sums, costs, workers);
  else
    wide_score<CostKind::ssd>(pair, window, sums, costs, workers);
}

void score(const Pair& pair, const Window& window, CostKind cost, bool narrow, const int64_t* sums, float* costs,
           const Workers& workers) {
  if (narrow) return narrow_score(pair, window, cost, sums, costs, workers);
  if (cost == CostKind::zssd) return wide_score<CostKind::zssd>(pair, window, sums, costs, workers);
  if (cost == CostKind::ncc) return wide_score<CostKind::ncc>(pair, window, sums, costs, workers);
  return wide_score<CostKind::zncc>(pair, window, sums, costs, workers);
}

void score_zsad(const Pair& pair, const Window& window, float* costs, const Workers& workers) {
  const int H = pair.height, W = pair.width, C = pair.channels;
  const int64_t n = window.area();
  const auto* left = static_cast<const int32_t*>(pair.left);
  const auto* right = static_cast<const int32_t*>(pair.right);
  fill_volume(pair, costs, workers, [&](int y, int x, int i, size_t) {
    const int xr = x - pair.first - i;
    float cost = 0;
    for (int c = 0; c < C; ++c) {
      const auto each = [&](auto visit) {
        for (int dy = -window.above(); dy <= window.below(); ++dy)
          for (int dx = -window.left(); dx <= window.right(); ++dx) {
            const size_t row = static_cast<size_t>(clamp(y + dy, 0, H - 1)) * W;
            // The right window's columns follow the left one's: both images go on past their own edges.
            visit(static_cast<int64_t>(left[(row + clamp(x + dx, 0, W - 1)) * C + c]) -
                  right[(row + clamp(xr + dx, 0, W - 1)) * C + c]);
          }
      };
      int64_t total = 0, above = 0, count = 0;
      each([&](int64_t a) { total += a; });
      const int64_t mean = floor_mean(total, n);
      each([&](int64_t a) {
        above += a > mean ? a - mean : 0;
        count += a > mean;
      });
      cost += zsad_cost(above, count, mean, total, n);
    }
    return cost;
  });
}

}  // namespace stereopsis
