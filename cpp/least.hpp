// The least of a stretch of costs.
#pragma once

#include <algorithm>

#include "score.hpp"

namespace stereopsis {

// The least of costs[lo] ... costs[hi - 1], or the worst: eight at a time, so that none waits for the one before.
template <class T>
T least(const T* costs, int lo, int hi) {
  T lanes[8];
  std::fill(lanes, lanes + 8, worst_cost<T>());
  int i = lo;
  for (; i + 8 <= hi; i += 8)
    for (int k = 0; k < 8; ++k) lanes[k] = costs[i + k] < lanes[k] ? costs[i + k] : lanes[k];
  T best = worst_cost<T>();
  for (; i < hi; ++i) best = std::min(best, costs[i]);
  for (const T lane : lanes) best = std::min(best, lane);
  return best;
}

}  // namespace stereopsis
