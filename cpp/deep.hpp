// The streaming kernels for 16-bit and float images: which settings they serve, and in what numbers.
#pragma once

#include "fused.hpp"

namespace stereopsis {

// `words_fit` and `doubles_fit` bound what is summed of one channel; of three their products and squares are added.
inline bool deep_words_fit(const Range& range, const Window& window, int channels) {
  const int64_t reach = range.reach();
  return words_fit(range, window) && window.area() * channels * (reach * reach + 1) < int64_t{1} << 31;
}
inline bool deep_doubles_fit(const Range& range, const Window& window, int channels) {
  const int64_t reach = range.reach();
  return doubles_fit(range, window) && window.area() * channels * (reach * reach + 1) <= int64_t{1} << 51;
}

inline bool deep_fits(CostKind cost, const Range& range, const Window& window, int channels) {
  if (cost == CostKind::zsad || !deep_doubles_fit(range, window, channels)) return false;
  // NCC alone depends on where pixels are counted from: what has been left out of its sums is added in doubles too.
  const int64_t above = int64_t{range.most} + 1, below = 1 - int64_t{range.least}, furthest = above > below ? above : below;
  return cost != CostKind::ncc || (furthest < 1 << 23 && window.area() * channels * furthest * furthest <= int64_t{1} << 53);
}

// Whether the largest sum of absolute or squared differences that is possible fits 31 bits.
inline bool deep_words_hold(CostKind cost, const Range& range, const Window& window, int channels) {
  const int64_t apart = int64_t{range.most} - range.least;
  return window.area() * channels * (cost == CostKind::ssd ? apart * apart : apart) < INT32_MAX;
}

}  // namespace stereopsis
