#include <algorithm>
#include <vector>

#include "parallel.hpp"
#include "score.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

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

// What surrounds the candidate that `choose(costs, lo, hi, at)` picks of those in view, lo ... hi - 1.
template <class T, class Choose>
void select(const T* volume, int height, const Lattice& lattice, int count, int first, const Winners<T>& winners,
            const Workers& workers, Choose choose) {
  const int columns = sampled(lattice.width, lattice.step), apart = lattice.disparity_step;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int column = 0; column < columns; ++column) {
        const size_t at = static_cast<size_t>(y) * columns + column;
        const T* costs = volume + at * count;
        const int highest = column * lattice.step - first, lowest = highest - (lattice.width - 1);
        const int lo = lowest <= 0 ? 0 : (lowest + apart - 1) / apart;
        const int hi = highest < 0 ? 0 : std::min(count, highest / apart + 1);
        const int best = hi > lo ? choose(costs, lo, hi, at) : -1;
        winners.index[at] = best;
        winners.cost[at] = winners.before[at] = winners.after[at] = winners.second[at] = worst_cost<T>();
        if (best < 0) continue;
        winners.cost[at] = costs[best];
        if (best > lo) winners.before[at] = costs[best - 1];
        if (best + 1 < hi) winners.after[at] = costs[best + 1];
        winners.second[at] = std::min(least(costs, lo, best - 1), least(costs, best + 2, hi));
      }
  });
}

}  // namespace

template <class T>
void select_left(const T* volume, int height, const Lattice& lattice, int count, int first, const Winners<T>& winners,
                 const Workers& workers) {
  select(volume, height, lattice, count, first, winners, workers, [](const T* costs, int lo, int hi, size_t) {
    const T* found = std::find(costs + lo, costs + hi, least(costs, lo, hi));
    return found == costs + hi ? lo : static_cast<int>(found - costs);
  });
}

template <class T>
void select_at(const T* volume, int height, int width, int count, int first, const Winners<T>& winners, const Workers& workers) {
  select(volume, height, Lattice{width, 1, 1}, count, first, winners, workers, [&](const T*, int lo, int hi, size_t at) {
    return lo <= winners.index[at] && winners.index[at] < hi ? winners.index[at] : -1;
  });
}

namespace {

// Of every column and candidate, in the order of the volume: a pixel of the right view meets its candidates in theirs.
template <class T>
void select_right(const T* volume, int height, int width, int count, int first, int32_t* index, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    // By the distance from the last column, so that the candidates of a left pixel follow each other.
    std::vector<T> least(width);
    std::vector<int32_t> best(width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      for (int t = 0; t < width; ++t) {
        // The first candidate that the left image shows stands until a better one comes.
        const int earliest = std::max(0, t + 1 - width - first);
        best[t] = earliest < count && width - 1 - t + first + earliest < width ? earliest : -1;
        least[t] = worst_cost<T>();
      }
      for (int x = 0; x < width; ++x) {
        const int shift = width - 1 - x + first, lo = std::max(0, -shift), hi = std::min(count, width - shift);
        const T* __restrict costs = volume + (static_cast<size_t>(y) * width + x) * count;
        T* __restrict so_far = least.data();
        int32_t* __restrict found = best.data();
        for (int i = lo; i < hi; ++i) {
          const bool better = costs[i] < so_far[shift + i];
          so_far[shift + i] = better ? costs[i] : so_far[shift + i];
          found[shift + i] = better ? i : found[shift + i];
        }
      }
      int32_t* to = index + static_cast<size_t>(y) * width;
      for (int t = 0; t < width; ++t) to[width - 1 - t] = best[t];
    }
  });
}

}  // namespace

template <class T>
void select_right(const T* volume, int height, const Lattice& lattice, int count, int first, int32_t* index,
                  const Workers& workers) {
  if (lattice.step == 1 && lattice.disparity_step == 1)
    return select_right(volume, height, lattice.width, count, first, index, workers);
  const int width = lattice.width, columns = sampled(width, lattice.step);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int xr = 0; xr < width; ++xr) {
        int best = -1;
        T least = worst_cost<T>();
        for (int i = 0; i < count; ++i) {
          const int x = xr + first + i * lattice.disparity_step;
          if (x < 0 || x >= width || x % lattice.step != 0) continue;
          const T cost = volume[(static_cast<size_t>(y) * columns + x / lattice.step) * count + i];
          if (best < 0 || cost < least) {
            best = i;
            least = cost;
          }
        }
        index[static_cast<size_t>(y) * width + xr] = best;
      }
  });
}

template void select_left(const int64_t*, int, const Lattice&, int, int, const Winners<int64_t>&, const Workers&);
template void select_left(const uint16_t*, int, const Lattice&, int, int, const Winners<uint16_t>&, const Workers&);
template void select_left(const float*, int, const Lattice&, int, int, const Winners<float>&, const Workers&);
template void select_right(const int64_t*, int, const Lattice&, int, int, int32_t*, const Workers&);
template void select_right(const uint16_t*, int, const Lattice&, int, int, int32_t*, const Workers&);
template void select_right(const float*, int, const Lattice&, int, int, int32_t*, const Workers&);
template void select_at(const int64_t*, int, int, int, int, const Winners<int64_t>&, const Workers&);
template void select_at(const uint16_t*, int, int, int, int, const Winners<uint16_t>&, const Workers&);
template void select_at(const float*, int, int, int, int, const Winners<float>&, const Workers&);

}  // namespace stereopsis
