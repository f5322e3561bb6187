// The streaming kernels for 16-bit and float images of one channel: which settings they serve.
#pragma once

#include "fused.hpp"

namespace stereopsis {

inline bool deep_fits(CostKind cost, const Range& range, const Window& window) {
  if (cost == CostKind::zsad || !doubles_fit(range, window)) return false;
  // NCC alone depends on where pixels are counted from: what has been left out of its sums is added in doubles too.
  const int64_t above = int64_t{range.most} + 1, below = 1 - int64_t{range.least}, furthest = above > below ? above : below;
  return cost != CostKind::ncc || (furthest < 1 << 23 && window.area() * furthest * furthest <= int64_t{1} << 53);
}

// Whether the largest sum of absolute or squared differences that is possible fits 31 bits.
inline bool words_hold(CostKind cost, const Range& range, const Window& window) {
  const int64_t apart = int64_t{range.most} - range.least;
  return window.area() * (cost == CostKind::ssd ? apart * apart : apart) < INT32_MAX;
}

}  // namespace stereopsis
