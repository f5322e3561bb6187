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

// What a candidate out of view costs.
template <class T>
constexpr T worst_cost() {
  return std::numeric_limits<T>::is_integer ? std::numeric_limits<T>::max() : std::numeric_limits<T>::infinity();
}

// The integer nearest to sum / n. Any integer near the mean serves; that both paths take the same one is what counts.
inline int32_t nearest_mean(int32_t sum, float inverse_n) {
  const float mean = static_cast<float>(sum) * inverse_n;
  return static_cast<int32_t>(mean + (mean < 0 ? -0.5f : 0.5f));
}

// One over the root of v, or 0 where v is less than `least`: three Newton steps from a first guess by the exponent. Plain
// operations: a vector of them takes a fraction of the time of a root and a division.
inline float inverse_root(float v, float least) {
  uint32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  bits = 0x5F375A86u - (bits >> 1);
  float y;
  std::memcpy(&y, &bits, sizeof y);
  const float half = 0.5f * v;
  y = y * (1.5f - half * y * y);
  y = y * (1.5f - half * y * y);
  y = y * (1.5f - half * y * y);
  return v >= least ? y : 0.0f;
}

// a b + c, rounded once, on every machine. Without the instruction: the product is exact as a double, and their sum
// rounded to odd first leaves nothing to be rounded twice (Boldo, Melquiond 2008, doi:10.1109/TC.2007.70819).
inline float fused(float a, float b, float c) {
#if defined(__FMA__) || defined(__ARM_FEATURE_FMA)
  return std::fma(a, b, c);
#else
  const double product = static_cast<double>(a) * b, sum = product + c, back = sum - product;
  const double lost = (product - (sum - back)) + (c - back);
  int64_t bits;
  std::memcpy(&bits, &sum, sizeof bits);
  const int64_t towards = (lost > 0) == (sum > 0) ? 1 : -1;
  bits += lost != 0 && !(bits & 1) ? towards : 0;
  double odd;
  std::memcpy(&odd, &bits, sizeof odd);
  return static_cast<float>(odd);
#endif
}

// A mean in two parts: a product with the first, taken from a sum of the same size, leaves what the second can mend. One
// channel of several leaves the others' sums standing, so that their first part has to be whole for the rest to be exact.
//
// Of one channel the second is at most 2^-18, and it meets the right window's sum as if that were the left one's, `sum`: what it
// mends then is the same for all candidates. What stays, |low| |right sum - left sum| of the covariance, is nothing for
// windows of like brightness; and below half a correlation for the least texture that counts, black against white:
// 514 * 2^-18 * 254 * 514 / 513 while sums are exact, 64 * 2^-18 * 255 beyond; see `least_norm`.
struct SplitMean {
  float high, low;
  static SplitMean of(int32_t sum, double inverse_n, bool one_channel) {
    const double mean = sum * inverse_n;
    const float whole = static_cast<float>(static_cast<int32_t>(mean + (mean < 0 ? -0.5 : 0.5)));
    const float high = one_channel ? static_cast<float>(mean) : whole;
    return {high, static_cast<float>(mean - high)};
  }
  // The second part's share of a covariance with a window like its own, scaled as the covariance will be.
  static float mended(float low, int32_t sum, float scale) { return low * static_cast<float>(sum) * scale; }
};

// Sum of squared deviations from the mean; the square of a 24-bit sum is exact.
inline float window_deviation(int32_t square, int32_t sum, double inverse_n) {
  const double s = sum;
  return static_cast<float>(square - s * s * inverse_n);
}

// The least norm that counts as texture: any at all while window sums fit a float's 24 bits. Beyond, the variance must stand
// out from their rounding: at a 64th of a squared grey level it does, and correlations stay well below kCorrelationBase.
constexpr int32_t kExactPixels = (1 << 24) / (128 * 255);
inline float least_norm(CostKind cost, int32_t n, int channels) {
  if (cost == CostKind::ncc) return 1.0f;
  return n * channels <= kExactPixels ? 0.25f : static_cast<float>(n * channels) / 64.0f;
}
constexpr int32_t kCentre = 128;  // taken from the left image's bytes, so that they have a sign

// A correlation r is kept as kCorrelationBase - r: always positive, so that its bits are ordered like itself, and cut to 20
// significant bits. The others say, in the streaming kernel, where the candidate stands.
constexpr float kCorrelationBase = 1.5f;
constexpr uint32_t kSpareBits = 15;
constexpr float kWorstKept = 4096.0f;  // costs more than any correlation; its spare bits are 0
inline float coarse(float v) {
  uint32_t bits;
  std::memcpy(&bits, &v, sizeof bits);
  bits &= ~kSpareBits;
  std::memcpy(&v, &bits, sizeof bits);
  return v;
}
inline float correlation_cost(float kept) {
  const float cut = coarse(kept);
  return cut < 4 ? cut - kCorrelationBase : worst_cost<float>();
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
    return {m.sum, m.square, q, rest, static_cast<double>(about) - r * r * (1.0 / static_cast<double>(n))};
  }
};

// A correlation is rounded to a multiple of 2^-20, as it is where this is added: several times what the operations before err
// by, so that all perfect matches cost the same.
constexpr float kWideBase = 12.0f;

inline float inverse_norm(double squares) {
  const float v = static_cast<float>(squares);
  return v > 0 ? 1.0f / std::sqrt(v) : 0.0f;
}

// One over the norm of a window of `channels` whose statistics lie `stride` apart; 0 where the norm is.
template <CostKind Kind>
inline double wide_scale(const WindowStatistics* window, int64_t stride, int channels) {
  if (Kind != CostKind::ncc && Kind != CostKind::zncc) return 0;
  double norm = 0;
  for (int c = 0; c < channels; ++c) {
    const WindowStatistics& w = window[c * stride];
    norm += Kind == CostKind::ncc ? static_cast<double>(w.square) : w.deviation;
  }
  if (Kind == CostKind::zncc) return inverse_norm(norm);
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
      // Minus the sum of products about whole means: exact, and the same for pixels counted from anywhere.
      int64_t about = -sum;
      for (int c = 0; c < channels; ++c)
        about += left[c * stride].sum * right[c * stride].mean + left[c * stride].mean * right[c * stride].rest;
      float covariance = static_cast<float>(about);
      for (int c = 0; c < channels; ++c) {
        const float rest = static_cast<float>(left[c * stride].rest) * (1.0f / static_cast<float>(n));
        covariance = fused(rest, static_cast<float>(right[c * stride].rest), covariance);
      }
      return fused(covariance * static_cast<float>(left_scale), static_cast<float>(right_scale), kWideBase) - kWideBase;
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
