// One build of what is summed over windows of grey levels, for the instruction set that STEREOPSIS_ISA names: plain loops,
// `static` and unnamed for the reason given in fused_narrow.hpp. All sums are whole numbers, and exact in any order.
#include "photometric.hpp"
#include "simd.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

constexpr int kUnit = kPhotometricUnit;
constexpr int kOutlier = 20 * kUnit;             // so far from the window's mean a difference does not count
constexpr int kLeast = kPhotometricArea / 3;     // pixels that a window has to have
constexpr double kNoise = 5 * kPhotometricArea;  // added to the squares of the levels: what noise alone would show
// The difference may grow with the left grey level: of two views one is at most twice as bright.
constexpr double kLeastGain = -kUnit, kMostGain = kUnit / 2;
constexpr double kFarthest = 0.5;
static_assert(int64_t{kPhotometricArea} * 255 * kUnit * 255 < int64_t{1} << 31, "sums of products fit");

static void describe(const int16_t* STEREOPSIS_RESTRICT counts, const int16_t* STEREOPSIS_RESTRICT brighter,
                     const uint8_t* STEREOPSIS_RESTRICT left, int width, int16_t* STEREOPSIS_RESTRICT counted,
                     int16_t* STEREOPSIS_RESTRICT slope, int16_t* STEREOPSIS_RESTRICT level) {
  for (int x = 0; x < width; ++x) counted[x] = static_cast<int16_t>(counts[x] * brighter[x]);
  for (int x = 0; x < width; ++x) level[x] = static_cast<int16_t>(counts[x] * (left[x] - 128));
  slope[0] = slope[width - 1] = 0;
  for (int x = 1; x < width - 1; ++x) slope[x] = static_cast<int16_t>(counts[x] * (left[x + 1] - left[x - 1]));
}

static void change(const int16_t* STEREOPSIS_RESTRICT a, const int16_t* STEREOPSIS_RESTRICT b, const int16_t* STEREOPSIS_RESTRICT old_a,
                   const int16_t* STEREOPSIS_RESTRICT old_b, int width, int32_t* STEREOPSIS_RESTRICT columns) {
  for (int x = 0; x < width; ++x) columns[x] += a[x] * b[x] - old_a[x] * old_b[x];
}

static void sum(const int32_t* STEREOPSIS_RESTRICT columns, int width, int32_t* STEREOPSIS_RESTRICT threes,
                int32_t* STEREOPSIS_RESTRICT sums) {
  static_assert(kPhotometricAlong == 7, "five times three");
  const int32_t* const first = columns - kPhotometricAlong;
  for (int x = 0; x < width + 12; ++x) threes[x] = first[x] + first[x + 1] + first[x + 2];
  for (int x = 0; x < width; ++x) sums[x] = threes[x] + threes[x + 3] + threes[x + 6] + threes[x + 9] + threes[x + 12];
}

static void keep(const int16_t* STEREOPSIS_RESTRICT seen, const int16_t* STEREOPSIS_RESTRICT brighter,
                 const int32_t* STEREOPSIS_RESTRICT count, const int32_t* STEREOPSIS_RESTRICT sum, int width,
                 int16_t* STEREOPSIS_RESTRICT counts) {
  for (int x = 0; x < width; ++x) {
    const int32_t off = brighter[x] * count[x] - sum[x], most = kOutlier * count[x];
    counts[x] = static_cast<int16_t>(seen[x] & (off < most) & (-off < most));
  }
}

static void move(const int32_t* const* sums, const float* STEREOPSIS_RESTRICT disparity, const uint8_t* STEREOPSIS_RESTRICT doubtful,
                 int width, float least, float most, float* STEREOPSIS_RESTRICT moved) {
  const int32_t *const counts = sums[0], *const brighter = sums[1], *const slope = sums[2], *const level = sums[3];
  const int32_t *const by_slope = sums[4], *const by_level = sums[5];
  const int32_t *const slopes = sums[6], *const slope_by_level = sums[7], *const levels = sums[8];
  for (int x = 0; x < width; ++x) {
    const double n = counts[x], e = brighter[x], g = slope[x], l = level[x];
    const double eg = by_slope[x] * n - e * g, el = by_level[x] * n - e * l;
    const double gg = slopes[x] * n - g * g + 4 * kNoise * n, gl = slope_by_level[x] * n - g * l;
    const double ll = levels[x] * n - l * l + kNoise * n;
    double gain = el / ll;
    gain = gain < kLeastGain ? kLeastGain : gain;
    gain = gain > kMostGain ? kMostGain : gain;
    // The slope is the left view's, which the right one's is but for the gain.
    double by = 2 * (gain * gl - eg) / ((kUnit - gain) * (gg - gl * gl / ll));
    by = by < -kFarthest ? -kFarthest : by;
    by = by > kFarthest ? kFarthest : by;
    moved[x] = static_cast<float>(by);
  }
  for (int x = 0; x < width; ++x) {
    float found = disparity[x] + moved[x];
    found = found < least ? least : found;
    found = found > most ? most : found;
    moved[x] = (counts[x] < kLeast) | (doubtful[x] != 0) ? disparity[x] : found;
  }
}

}  // namespace

extern const PhotometricKernel photometric;
const PhotometricKernel photometric = {describe, change, sum, keep, move};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
