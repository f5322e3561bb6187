// The arithmetic that both paths share, one pixel or one candidate at a time: window statistics to costs, costs to
// sub-pixel offsets and confidence. Every float operation is a single IEEE one, in a fixed order.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <type_traits>

#include "fused.hpp"

namespace stereopsis {
namespace {

// What a candidate out of view costs. Infinity times a norm of 0 is not a number, and less than nothing: it never wins.
template <class T>
constexpr T worst_cost() {
  return std::numeric_limits<T>::is_integer ? std::numeric_limits<T>::max() : std::numeric_limits<T>::infinity();
}

// The integer nearest to sum / n. Any integer near the mean serves; that both paths take the same one is what counts.
inline int32_t nearest_mean(int32_t sum, float inverse_n) {
  const float mean = static_cast<float>(sum) * inverse_n;
  return static_cast<int32_t>(mean + (mean < 0 ? -0.5f : 0.5f));
}

// Sum of squared deviations from the mean, from that about the integer q, where rest = sum - n q.
inline float deviation(int32_t squares_about_q, int32_t rest, float inverse_n) {
  const float r = static_cast<float>(rest);
  return static_cast<float>(squares_about_q) - r * r * inverse_n;
}

inline float inverse_root(float v) {
  const float inverse = 1.0f / std::sqrt(v > 0 ? v : 1.0f);
  return v > 0 ? inverse : 0.0f;
}

// A correlation before the left window's norm is put in, kept to 21 significant bits. Then its product with any such norm
// keeps the order and the ties of candidates, so that the winner is known without that product; and the three bits that
// are left say, in the streaming kernel, where the candidate stands.
constexpr uint32_t kSpareBits = 7;
inline float coarse(float v) {
  uint32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  bits &= ~kSpareBits;
  std::memcpy(&v, &bits, sizeof bits);
  return v;
}

// How a cost says "perfect": correlations run from -1, differences from 0.
inline bool is_correlation(CostKind cost) { return cost == CostKind::ncc || cost == CostKind::zncc; }

// Offset in [-0.5, 0.5] of the extremum of the fit through the winner's cost and its two neighbours'.
template <Subpixel Kind, class T>
inline float subpixel_offset(T before, T winner, T after) {
  if (Kind == Subpixel::none) return 0;
  const float rise_before = static_cast<float>(before - winner);
  const float rise_after = static_cast<float>(after - winner);
  const float steeper = rise_before > rise_after ? rise_before : rise_after;
  const float reach = Kind == Subpixel::parabola ? rise_before + rise_after : steeper;
  // A flat fit has no extremum of its own; dividing by 1 instead keeps the loop free of branches.
  return 0.5f * (rise_before - rise_after) / (reach > 0 ? reach : 1.0f);
}

// How far the winner stands below the mean of its neighbours, as a fraction of the way down to a perfect match.
inline float depth_confidence(float perfect, float before, float winner, float after) {
  const float around = 0.5f * (before + after);
  const float reach = around - perfect;
  const float depth = around - winner;
  const float c = depth / (reach > 0 ? reach : 1.0f);
  return reach > 0 ? (c < 0 ? 0.0f : c > 1 ? 1.0f : c) : 0.0f;
}

// ---- 64-bit sums: 16-bit and float images, the largest windows, ZSAD ------------------------------------------------
//
// Pixels are integers of at most 21 bits and a sign (float images) or 16 bits. Over 255 * 255 pixels in 3 channels,
// squared differences sum to at most 65025 * 3 * 2^44 < 2^62.

struct Moments {
  int64_t sum, square;
  void add(int64_t value, int sign) {
    sum += sign * value;
    square += sign * value * value;
  }
  void join(const Moments& other, int sign) {
    sum += sign * other.sum;
    square += sign * other.square;
  }
};

inline int64_t floor_mean(int64_t sum, int64_t n) {
  const int64_t q = sum / n;
  return q - (q * n > sum);
}

struct WindowStatistics {
  int64_t sum, square, mean, rest;  // sum = n * mean + rest
  double deviation;                 // sum of squared deviations from the mean; exactly 0 for a constant window
  static WindowStatistics of(const Moments& m, int64_t n) {
    const int64_t q = floor_mean(m.sum, n), rest = m.sum - n * q;
    const int64_t about = m.square - q * (m.sum + rest);
    const double r = static_cast<double>(rest);
    return {m.sum, m.square, q, rest, static_cast<double>(about) - r * r / static_cast<double>(n)};
  }
};

// One over the norm of a window of `channels` whose statistics lie `stride` apart; 0 where the norm is.
template <CostKind Kind>
inline double wide_scale(const WindowStatistics* window, int64_t stride, int channels) {
  if (Kind != CostKind::ncc && Kind != CostKind::zncc) return 0;
  double norm = 0;
  for (int c = 0; c < channels; ++c) {
    const WindowStatistics& w = window[c * stride];
    norm += Kind == CostKind::ncc ? static_cast<double>(w.square) : w.deviation;
  }
  return norm > 0 ? 1.0 / std::sqrt(norm) : 0.0;
}

template <CostKind Kind>
struct WideCost {
  static constexpr bool whole = Kind == CostKind::sad || Kind == CostKind::ssd;
  using Scalar = typename std::conditional<whole, int64_t, float>::type;
  static constexpr Scalar worst = worst_cost<Scalar>();

  // From the window's sum of products (absolute differences for SAD) and both windows' statistics.
  static Scalar of(int64_t sum, const WindowStatistics* left, const WindowStatistics* right, int64_t stride, int channels,
                   int64_t n, double left_scale, double right_scale) {
    if constexpr (Kind == CostKind::sad || Kind == CostKind::zsad) {
      return static_cast<Scalar>(sum);
    } else if constexpr (Kind == CostKind::ncc) {
      return static_cast<Scalar>(-(static_cast<double>(sum) * (left_scale * right_scale)));
    } else if constexpr (Kind == CostKind::zncc) {
      double rests = 0;
      for (int c = 0; c < channels; ++c) {
        sum -= left[c * stride].mean * right[c * stride].sum;
        rests += static_cast<double>(left[c * stride].rest) * static_cast<double>(right[c * stride].sum);
      }
      const double covariance = static_cast<double>(sum) - rests / static_cast<double>(n);
      return static_cast<Scalar>(-(covariance * (left_scale * right_scale)));
    } else {
      int64_t squares = -2 * sum;
      double rests = 0;
      for (int c = 0; c < channels; ++c) {
        squares += left[c * stride].square + right[c * stride].square;
        if constexpr (Kind == CostKind::zssd) {
          // About the whole part of the differences' mean first: exact, whatever the offset between the images.
          const int64_t total = left[c * stride].sum - right[c * stride].sum;
          const int64_t mean = floor_mean(total, n), rest = total - n * mean;
          squares -= mean * (total + rest);
          rests += static_cast<double>(rest) * static_cast<double>(rest);
        }
      }
      if constexpr (Kind == CostKind::ssd)
        return squares;
      else
        return static_cast<Scalar>(static_cast<double>(squares) - rests / static_cast<double>(n));
    }
  }
};

// Sum over a window of |a - mean of a|, for a = l - r whose sum is `total`, from the sum and the number of what exceeds
// the floor of the mean: the parts above and below the mean are equal.
inline float zsad_cost(int64_t above, int64_t count, int64_t floor_of_mean, int64_t total, int64_t n) {
  const int64_t scaled = 2 * (n * (above + count * floor_of_mean) - total * count);
  return static_cast<float>(static_cast<double>(scaled) / static_cast<double>(n));
}

}  // namespace
}  // namespace stereopsis
