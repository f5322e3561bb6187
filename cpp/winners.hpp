// From a row's winners to its disparities: the checks, the sub-pixel fit, the flags and the confidence.
#pragma once

#include <cstdlib>
#include <limits>

#include "fused.hpp"
#include "score.hpp"

namespace stereopsis {
namespace {

enum FlagBit : uint8_t { kOccluded = 1, kMismatched = 2, kAmbiguous = 4, kOutOfView = 32 };

// Which left columns the right view's winners chose: by column the least and the greatest of their candidates.
struct Claims {
  int32_t *least, *most;  // most is -1 where nobody chose the column
};

template <class Scalar>
struct RowWinners {
  const int32_t* winner;  // index of the winning candidate, or -1 where none is in view
  const Scalar *cost, *before, *after;
  const Scalar* second;        // least cost apart from the winner and its neighbours; with uniqueness alone
  Claims claims;               // scratch of that check, a row long each
  const int32_t* right_index;  // winner of right pixel x - first - i at [width - 1 - x + i]; with the left-right check alone
};

inline void collect_claims(const Pair& pair, const int32_t* right_index, const Claims& claims) {
  const int W = pair.width;
  for (int x = 0; x < W; ++x) {
    claims.least[x] = pair.count;
    claims.most[x] = -1;
  }
  // Right pixel W - 1 - first - j for those j that a candidate can have.
  const int begin = pair.first < 0 ? -pair.first : 0;
  const int end = W - pair.first < W - 1 + pair.count ? W - pair.first : W - 1 + pair.count;
  for (int j = begin; j < end; ++j) {
    const int i = right_index[j];
    if (i < 0) continue;
    const int x = W - 1 - j + i;
    if (i < claims.least[x]) claims.least[x] = i;
    if (i > claims.most[x]) claims.most[x] = i;
  }
}

// Whether the right view's winner at the match of pixel x, candidate i, agrees with it within `tolerance` columns; if not,
// whether any candidate of x would have been agreed with: then the match is wrong, else the pixel is hidden in the right
// view (Hirschmueller 2008, doi:10.1109/TPAMI.2007.1166).
inline uint8_t check_left_right(const int32_t* right, const Claims& claims, int width, int x, int i, int lo, int hi,
                                int tolerance) {
  if (std::abs(right[i] - i) <= tolerance) return 0;
  for (int other = x - tolerance > 0 ? x - tolerance : 0; other < width && other <= x + tolerance; ++other) {
    // A right pixel that chose candidate k of column `other` is met by candidate k + x - other of column x. Only one end of
    // the range can cut it off, so the claim that lies farthest from that end decides.
    const int shift = x - other, k = shift <= 0 ? claims.most[other] : claims.least[other];
    if (claims.most[other] >= 0 && k + shift >= lo && k + shift < hi) return kMismatched;
  }
  return kOccluded;
}

// Disparity and confidence of pixels [begin, end), all of which see a candidate, as if no check were on.
template <Subpixel Kind, class Scalar>
inline void fit(const Pair& pair, float perfect, const RowWinners<Scalar>& row, int begin, int end,
                float* __restrict disparity, float* __restrict confidence) {
  const int32_t* __restrict winner = row.winner;
  const Scalar* __restrict costs = row.cost;
  const Scalar* __restrict costs_before = row.before;
  const Scalar* __restrict costs_after = row.after;
  const int first = pair.first, count = pair.count, beyond = pair.first + pair.width - 1;
  for (int x = begin; x < end; ++x) {
    const int lo = x > beyond ? x - beyond : 0;
    const int hi = x - first + 1 < count ? x - first + 1 : count;
    const int i = winner[x];
    const bool has_before = i > lo, has_after = i + 1 < hi;
    const Scalar cost = costs[x], cost_before = costs_before[x], cost_after = costs_after[x];
    // At an end of the range the one neighbour stands for both.
    const Scalar lone = has_after ? cost_after : cost;
    const Scalar before = has_before ? cost_before : lone;
    const Scalar after = has_after ? cost_after : before;
    const float offset = subpixel_offset<Kind>(before, cost, after);
    disparity[x] = static_cast<float>(first + i) + (has_before & has_after ? offset : 0.0f);
    confidence[x] =
        depth_confidence(perfect, static_cast<float>(before), static_cast<float>(cost), static_cast<float>(after));
  }
}

template <class Scalar>
inline void finish(const Pair& pair, const FusedSettings& settings, const RowWinners<Scalar>& row, const FusedOutput& out,
                   int y) {
  const int W = pair.width;
  float* disparity = out.disparity + static_cast<size_t>(y) * W;
  float* confidence = out.confidence + static_cast<size_t>(y) * W;
  uint8_t* flags = out.flags + static_cast<size_t>(y) * W;
  const float perfect = is_correlation(settings.cost) ? -1.0f : 0.0f;
  const int begin = pair.first > 0 ? (pair.first < W ? pair.first : W) : 0;
  const int seen = pair.first + pair.count + W - 1;
  const int end = seen < W ? (seen > begin ? seen : begin) : W;
  const auto refuse = [&](int x, uint8_t flag) {
    flags[x] = flag;
    if (!flag || (out.cost && flag != kOutOfView)) return;
    disparity[x] = std::numeric_limits<float>::quiet_NaN();
    confidence[x] = 0;
  };
  for (int x = 0; x < begin; ++x) refuse(x, kOutOfView);
  for (int x = end; x < W; ++x) refuse(x, kOutOfView);
  if (out.cost) {
    float* cost = out.cost + static_cast<size_t>(y) * W;
    for (int x = 0; x < W; ++x)
      cost[x] = x >= begin && x < end ? static_cast<float>(row.cost[x]) : std::numeric_limits<float>::infinity();
  }
  switch (settings.subpixel) {
    case Subpixel::none:
      fit<Subpixel::none>(pair, perfect, row, begin, end, disparity, confidence);
      break;
    case Subpixel::parabola:
      fit<Subpixel::parabola>(pair, perfect, row, begin, end, disparity, confidence);
      break;
    case Subpixel::equiangular:
      fit<Subpixel::equiangular>(pair, perfect, row, begin, end, disparity, confidence);
      break;
  }
  if (!settings.uniqueness && !settings.left_right) {
    for (int x = begin; x < end; ++x) flags[x] = 0;
    return;
  }
  if (settings.left_right) collect_claims(pair, row.right_index, row.claims);
  // Candidates are whole, so what a tolerance has beyond whole pixels makes no difference.
  const int tolerance = settings.tolerance < 2.0 * W ? static_cast<int>(settings.tolerance) : 2 * W;
  for (int x = begin; x < end; ++x) {
    uint8_t flag = 0;
    if (settings.uniqueness && row.second[x] < worst_cost<Scalar>() &&
        static_cast<double>(row.second[x]) - perfect <= (static_cast<double>(row.cost[x]) - perfect) * settings.ratio)
      flag |= kAmbiguous;
    if (settings.left_right) {
      const int beyond = x - pair.first - (W - 1), reach = x - pair.first + 1;
      flag |= check_left_right(row.right_index + (W - 1 - x), row.claims, W, x, row.winner[x], beyond > 0 ? beyond : 0,
                               reach < pair.count ? reach : pair.count, tolerance);
    }
    refuse(x, flag);
  }
}

}  // namespace
}  // namespace stereopsis
