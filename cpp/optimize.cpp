#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>
#include <vector>

#include "parallel.hpp"
#include "scratch.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr float kNever = std::numeric_limits<float>::infinity();

// Rows of costs, each with a margin of infinity on both sides, so that a shifted row can be read without a question.
class Rows {
 public:
  explicit Rows(int count) : count_(count), memory_(8 * size_t{3} * count, kNever), first(count), last(count), from(count + 1) {}
  float* row(int k) { return memory_.data() + (size_t{3} * k + 1) * count_; }

 private:
  int count_;
  std::vector<float> memory_;

 public:
  // The lower envelope: its parabolas, and where each begins.
  std::vector<int> first, last;
  std::vector<double> from;
};

// weight * min(|a|, truncation)^power, for |a| below the number of labels.
class Penalty {
 public:
  Penalty(const Smoothness& smoothness, int count) : power_(smoothness.power), count_(count), both_(2 * count - 1) {
    weight_ = static_cast<float>(smoothness.weight);
    for (int a = -count + 1; a < count; ++a) {
      const double step = std::min<double>(std::abs(a), smoothness.truncation);
      both_[a + count - 1] = static_cast<float>(smoothness.weight * (power_ == 2 ? step * step : step));
    }
    worst_ = both_[0];
    while (reach_ + 1 < count && (*this)(reach_ + 1) < worst_) ++reach_;
  }

  float operator()(int a) const { return both_[count_ - 1 + a]; }
  // Penalties of every label against this one.
  const float* against(int label) const { return both_.data() + (count_ - 1 - label); }

  // best[l] = min over k of h[k] + V(l - k), one label of h being possible at least. `h` is a row of `scratch`, other than
  // 0 and 1. Returns the least of h, which is that of `best` too.
  float transform(const float* h, float* best, Rows& scratch) const {
    float least = kNever;
    for (int l = 0; l < count_; ++l) least = h[l] < least ? h[l] : least;
    const float ceiling = least + worst_;
    const int reach = power_ == 1 ? reach_ : useful_reach(h, least);
    if (power_ == 1)
      cone(h, best, scratch);
    else if (reach <= 24)
      window(h, best, reach);
    else
      envelope(h, best, scratch);
    for (int l = 0; l < count_; ++l) best[l] = best[l] < ceiling ? best[l] : ceiling;
    return least;
  }

 private:
  // No label takes its value from one so far off that the penalty exceeds the spread of the costs.
  int useful_reach(const float* h, float least) const {
    float most = least;
    for (int l = 0; l < count_; ++l) most = most < h[l] ? h[l] : most;
    int reach = 0;
    while (reach < reach_ && reach <= 24 && (*this)(reach + 1) < most - least) ++reach;
    return reach;
  }

  // |a| as a sum of different powers of two: one pass a power, each over whole vectors.
  void cone(const float* h, float* best, Rows& scratch) const {
    const float* source = h;
    for (int step = 1, k = 0; step <= reach_; step *= 2, k ^= 1) {
      float* __restrict target = scratch.row(k);
      const float* __restrict here = source;
      const float rise = weight_ * static_cast<float>(step);
      for (int l = 0; l < count_; ++l) {
        const float below = here[l - step], above = here[l + step];
        const float side = (below < above ? below : above) + rise;
        target[l] = here[l] < side ? here[l] : side;
      }
      source = target;
    }
    std::copy_n(source, count_, best);
  }

  void window(const float* h, float* __restrict best, int reach) const {
    const float* __restrict here = h;
    std::copy_n(here, count_, best);
    for (int a = 1; a <= reach; ++a) {
      const float rise = (*this)(a);
      for (int l = 0; l < count_; ++l) {
        const float below = here[l - a], above = here[l + a];
        const float side = (below < above ? below : above) + rise;
        best[l] = best[l] < side ? best[l] : side;
      }
    }
  }

  // The lower envelope of the parabolas h[k] + weight (l - k)^2.
  void envelope(const float* h, float* best, Rows& scratch) const {
    int top = -1;
    const double weight = weight_;
    for (int k = 0; k < count_; ++k) {
      if (h[k] == kNever) continue;
      double start = -1;
      while (top >= 0) {
        const int before = scratch.first[top];
        start = ((h[k] + weight * k * k) - (h[before] + weight * before * before)) / (2 * weight * (k - before));
        if (start > scratch.from[top]) break;
        --top;
      }
      ++top;
      scratch.first[top] = k;
      scratch.from[top] = top == 0 ? -1 : start;
    }
    const int parabolas = top + 1;
    for (int l = 0, at = 0; l < count_; ++l) {
      while (at + 1 < parabolas && scratch.from[at + 1] < l) ++at;
      const float a = static_cast<float>(l - scratch.first[at]);
      best[l] = h[scratch.first[at]] + weight_ * a * a;
    }
  }

  int power_, count_, reach_ = 0;
  float weight_, worst_ = 0;
  std::vector<float> both_;
};

// `parallel_rows` asks only where it has to wait: what is done many times over in no time has to ask by itself.
void stop_if_asked(const Workers& workers) {
  if (workers.interrupted()) throw Interrupted();
}

// Zeros, set row by row by all threads: to take the memory of a large volume is a second's work of one, which nothing could stop.
Unset<float> zeros(int height, size_t row, const Workers& workers) {
  Unset<float> values(height * row);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) std::fill_n(values.get() + y * row, row, 0.0f);
  });
  return values;
}

int argmin(const float* costs, int count) { return static_cast<int>(std::min_element(costs, costs + count) - costs); }

void add(float* __restrict sum, const float* __restrict row, int count) {
  for (int l = 0; l < count; ++l) sum[l] += row[l];
}

// A message is set to the transform of `h`, counted from its least value, which is returned.
float send(const Penalty& penalty, const float* h, float* message, int count, Rows& scratch) {
  const float least = penalty.transform(h, message, scratch);
  for (int l = 0; l < count; ++l) message[l] -= least;
  return least;
}

double energy_of(const Grid& grid, const Penalty& penalty, const int32_t* labels, const Workers& workers) {
  const int W = grid.width, D = grid.count;
  std::vector<double> rows(grid.height, 0);
  parallel_rows(grid.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < W; ++x) {
        const size_t p = static_cast<size_t>(y) * W + x;
        if (labels[p] < 0) continue;
        rows[y] += grid.costs[p * D + labels[p]];
        if (x + 1 < W && labels[p + 1] >= 0) rows[y] += penalty(labels[p] - labels[p + 1]);
        if (y + 1 < grid.height && labels[p + W] >= 0) rows[y] += penalty(labels[p] - labels[p + W]);
      }
  });
  return std::accumulate(rows.begin(), rows.end(), 0.0);
}

// visit(y, x, scratch) for each pixel after those to its left and above it, or, backwards, to its right and below it: what
// a visit finds there does not depend on the number of threads. A thread takes every T-th row and follows the one before.
template <class Visit>
void wavefront(const Grid& grid, bool backward, const Workers& workers, Visit visit) {
  const int H = grid.height, W = grid.width, threads = std::max(1, std::min(workers.threads, H));
  std::vector<std::atomic<int>> done(H);
  parallel_rows(threads, threads, workers.interrupted, [&](int begin, int, const Cancel& cancel) {
    Rows scratch(grid.count);
    for (int k = begin; k < H; k += threads)
      for (int i = 0; i < W; ++i) {
        if (i % 16 == 0) {
          while (k > 0 && done[k - 1].load(std::memory_order_acquire) < std::min(W, i + 16)) {
            if (cancel.load(std::memory_order_relaxed)) return;
            std::this_thread::yield();
          }
          if (cancel.load(std::memory_order_relaxed)) return;
        }
        visit(backward ? H - 1 - k : k, backward ? W - 1 - i : i, scratch);
        done[k].store(i + 1, std::memory_order_release);
      }
  });
}

}  // namespace

template <class T>
void relative_costs(const T* volume, int height, int width, int count, float* costs, double* least, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (size_t p = static_cast<size_t>(y) * width; p < static_cast<size_t>(y + 1) * width; ++p) {
        const T* from = volume + p * count;
        float* to = costs + p * count;
        const T best = *std::min_element(from, from + count);
        const bool seen = best < worst_cost<T>();
        least[p] = seen ? static_cast<double>(best) : 0;
        for (int l = 0; l < count; ++l)
          to[l] = seen && from[l] < worst_cost<T>() ? static_cast<float>(from[l] - best) : kNever;
      }
  });
}

template <class T>
void right_volume(const T* left, int height, int width, int count, int first, T* right, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int xr = 0; xr < width; ++xr)
        for (int i = 0; i < count; ++i) {
          const int x = xr + first + i;
          const size_t row = static_cast<size_t>(y) * width;
          right[(row + xr) * count + i] = x < 0 || x >= width ? worst_cost<T>() : left[(row + x) * count + i];
        }
  });
}

namespace {

// Sum holds the penalties of a whole window.
template <class Sum, class T>
void add_penalties(const T* volume, int height, int width, int count, const int32_t* guide, const Window& window,
                   const int64_t* given, double scale, double weight, float* total, const Workers& workers) {
  const std::vector<Sum> penalties(given, given + 2 * static_cast<size_t>(count) - 1);
  const int left = window.width / 2, up = window.height / 2;
  const int columns = width + window.width - 1, slots = count + 1;  // the last slot counts the pixels with a label
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<Sum> column(static_cast<size_t>(columns) * slots), sum(slots), nothing(slots);
    const auto add_row = [&](int y, Sum sign) {
      const int32_t* row = guide + static_cast<size_t>(std::clamp(y - up, 0, height - 1)) * width;
      for (int x = 0; x < columns; ++x) {
        const int label = row[std::clamp(x - left, 0, width - 1)];
        if (label < 0) continue;
        Sum* __restrict to = column.data() + static_cast<size_t>(x) * slots;
        const Sum* __restrict from = penalties.data() + (count - 1 - label);
        for (int i = 0; i < count; ++i) to[i] += sign * from[i];
        to[count] += sign;
      }
    };
    for (int r = 0; r < window.height - 1; ++r) add_row(begin + r, 1);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      add_row(y + window.height - 1, 1);
      std::fill(sum.begin(), sum.end(), 0);
      for (int k = 0; k < window.width - 1; ++k)
        for (int i = 0; i < slots; ++i) sum[i] += column[static_cast<size_t>(k) * slots + i];
      for (int x = 0; x < width; ++x) {
        const Sum* entering = column.data() + static_cast<size_t>(x + window.width - 1) * slots;
        // What left when the window came here from the pixel before; nothing did at the first.
        const Sum* leaving = x > 0 ? column.data() + static_cast<size_t>(x - 1) * slots : nothing.data();
        sum[count] += entering[count] - leaving[count];
        const size_t at = (static_cast<size_t>(y) * width + x) * count;
        const double share = sum[count] > 0 ? weight / static_cast<double>(sum[count]) : 0;
        for (int i = 0; i < count; ++i) {
          sum[i] += entering[i] - leaving[i];
          const T cost = volume[at + i];
          const double energy = scale * static_cast<double>(cost) + share * static_cast<double>(sum[i]);
          total[at + i] = cost < worst_cost<T>() ? static_cast<float>(energy) : kNever;
        }
      }
      add_row(y, -1);
    }
  });
}

// Squared differences, in closed form: the sum over the window of (label - i)^2 is that of label^2, less 2 i times that of
// label, plus i^2 times the pixels with a label. As doubles below 2^53 these are whole numbers still.
template <class T>
void add_squares(const T* volume, int height, int width, int count, const int32_t* guide, const Window& window, double scale,
                 double weight, float* total, const Workers& workers) {
  struct Sums {
    int64_t pixels = 0, labels = 0, squares = 0;
    void add(const Sums& other, int64_t sign) {
      pixels += sign * other.pixels;
      labels += sign * other.labels;
      squares += sign * other.squares;
    }
  };
  const int left = window.width / 2, up = window.height / 2, columns = width + window.width - 1;
  std::vector<double> once(count), twice(count);
  for (int i = 0; i < count; ++i) once[i] = i, twice[i] = static_cast<double>(i) * i;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<Sums> column(columns);
    std::vector<T> here(count);  // apart from where the sums go, which may be the volume
    const auto add_row = [&](int y, int64_t sign) {
      const int32_t* row = guide + static_cast<size_t>(std::clamp(y - up, 0, height - 1)) * width;
      for (int x = 0; x < columns; ++x) {
        const int64_t label = row[std::clamp(x - left, 0, width - 1)];
        if (label >= 0) column[x].add({1, label, label * label}, sign);
      }
    };
    for (int r = 0; r < window.height - 1; ++r) add_row(begin + r, 1);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      add_row(y + window.height - 1, 1);
      Sums sum;
      for (int k = 0; k < window.width - 1; ++k) sum.add(column[k], 1);
      for (int x = 0; x < width; ++x) {
        sum.add(column[x + window.width - 1], 1);
        const double n = static_cast<double>(sum.pixels), labels = 2 * static_cast<double>(sum.labels);
        const double squares = static_cast<double>(sum.squares), share = sum.pixels > 0 ? weight / n : 0;
        std::copy_n(volume + (static_cast<size_t>(y) * width + x) * count, count, here.data());
        float* to = total + (static_cast<size_t>(y) * width + x) * count;
        for (int i = 0; i < count; ++i) {
          const double penalty = squares + (n * twice[i] - labels * once[i]);
          const T cost = here[i];
          const float energy = static_cast<float>(scale * static_cast<double>(cost) + share * penalty);
          to[i] = cost < worst_cost<T>() ? energy : kNever;
        }
        sum.add(column[x], -1);
      }
      add_row(y, -1);
    }
  });
}

}  // namespace

template <class T>
void second_pass(const T* volume, int height, int width, int count, const int32_t* guide, const Window& window,
                 const int64_t* penalties, double scale, double weight, float* total, const Workers& workers) {
  const int64_t most = *std::max_element(penalties, penalties + 2 * static_cast<size_t>(count) - 1);
  bool squared = most <= (int64_t{1} << 51) / window.area();
  for (int64_t a = 1 - count; a < count; ++a) squared = squared && penalties[count - 1 + a] == a * a;
  if (squared)
    add_squares(volume, height, width, count, guide, window, scale, weight, total, workers);
  else if (most <= INT32_MAX / window.area())
    add_penalties<int32_t>(volume, height, width, count, guide, window, penalties, scale, weight, total, workers);
  else
    add_penalties<int64_t>(volume, height, width, count, guide, window, penalties, scale, weight, total, workers);
}

void distance_transform(const float* h, int rows, int count, const Smoothness& smoothness, float* best) {
  const Penalty penalty(smoothness, count);
  Rows scratch(count);
  float* row = scratch.row(2);
  for (int y = 0; y < rows; ++y) {
    std::copy_n(h + static_cast<size_t>(y) * count, count, row);
    penalty.transform(row, best + static_cast<size_t>(y) * count, scratch);
  }
}

void iterated_conditional_modes(const Grid& grid, const Smoothness& smoothness, int iterations, int32_t* labels,
                                const Workers& workers) {
  const int H = grid.height, W = grid.width, D = grid.count;
  const Penalty penalty(smoothness, D);
  for (int iteration = 0; iteration < iterations; ++iteration) {
    stop_if_asked(workers);
    std::atomic<bool> changed{false};
    // Pixels of one colour of a chessboard have no neighbours among themselves: their order does not matter.
    for (int colour = 0; colour < 2; ++colour)
      parallel_rows(H, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
        std::vector<float> sum(D);
        for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
          for (int x = (y + colour) % 2; x < W; x += 2) {
            const size_t p = static_cast<size_t>(y) * W + x;
            if (labels[p] < 0) continue;
            std::copy_n(grid.costs + p * D, D, sum.data());
            const auto beside = [&](bool inside, size_t q) {
              if (inside && labels[q] >= 0) add(sum.data(), penalty.against(labels[q]), D);
            };
            beside(x > 0, p - 1);
            beside(x + 1 < W, p + 1);
            beside(y > 0, p - W);
            beside(y + 1 < H, p + W);
            const int best = argmin(sum.data(), D);
            if (sum[best] < sum[labels[p]]) {
              labels[p] = best;
              changed.store(true, std::memory_order_relaxed);
            }
          }
      });
    if (!changed.load()) return;
  }
}

double tree_reweighted(const Grid& grid, const Smoothness& smoothness, int iterations, int32_t* labels, const Workers& workers) {
  const int H = grid.height, W = grid.width, D = grid.count;
  const Penalty penalty(smoothness, D);
  const size_t pixels = static_cast<size_t>(H) * W;
  // One message an edge: to its second end after a forward pass, to its first end after a backward one.
  const size_t row = static_cast<size_t>(W) * D;
  const Unset<float> across = zeros(H, row, workers), down = zeros(H, row, workers);
  std::vector<int32_t> found(labels, labels + pixels);
  const auto there = [&](bool inside, size_t q) { return inside && labels[q] >= 0; };

  struct Ends {
    bool left, right, above, below;
    float share() const { return 1 / std::max(1.0f, std::max(static_cast<float>(left + above), static_cast<float>(right + below))); }
  };
  const auto ends = [&](int y, int x, size_t p) {
    return Ends{there(x > 0, p - 1), there(x + 1 < W, p + 1), there(y > 0, p - W), there(y + 1 < H, p + W)};
  };
  // What the pixel's neighbours and its own costs say of each label.
  const auto gather = [&](size_t p, const Ends& has, float* sum) {
    std::copy_n(grid.costs + p * D, D, sum);
    if (has.left) add(sum, across.get() + (p - 1) * D, D);
    if (has.right) add(sum, across.get() + p * D, D);
    if (has.above) add(sum, down.get() + (p - W) * D, D);
    if (has.below) add(sum, down.get() + p * D, D);
    const float least = *std::min_element(sum, sum + D);
    for (int l = 0; l < D; ++l) sum[l] -= least;
    return least;
  };
  const auto pass_on = [&](const float* sum, float share, float* message, Rows& scratch) {
    float* h = scratch.row(3);
    for (int l = 0; l < D; ++l) h[l] = share * sum[l] - message[l];
    return send(penalty, h, message, D, scratch);
  };
  // A label after those of the left and the upper neighbour, by the messages of the two others.
  const auto choose = [&](size_t p, const Ends& has, Rows& scratch) {
    float* sum = scratch.row(4);
    std::copy_n(grid.costs + p * D, D, sum);
    if (has.left) add(sum, penalty.against(found[p - 1]), D);
    if (has.above) add(sum, penalty.against(found[p - W]), D);
    if (has.right) add(sum, across.get() + p * D, D);
    if (has.below) add(sum, down.get() + p * D, D);
    found[p] = argmin(sum, D);
  };

  double bound = -std::numeric_limits<double>::infinity(), least_energy = std::numeric_limits<double>::infinity();
  std::vector<int32_t> best(labels, labels + pixels);
  for (int iteration = 0; iteration <= iterations; ++iteration) {
    stop_if_asked(workers);
    wavefront(grid, false, workers, [&](int y, int x, Rows& scratch) {
      const size_t p = static_cast<size_t>(y) * W + x;
      if (labels[p] < 0) return;
      const Ends has = ends(y, x, p);
      if (iteration > 0) choose(p, has, scratch);
      if (iteration == iterations) return;
      float* sum = scratch.row(2);
      gather(p, has, sum);
      if (has.right) pass_on(sum, has.share(), across.get() + p * D, scratch);
      if (has.below) pass_on(sum, has.share(), down.get() + p * D, scratch);
    });
    if (iteration > 0) {
      const double energy = energy_of(grid, penalty, found.data(), workers);
      if (energy < least_energy) {
        least_energy = energy;
        best = found;
      }
    }
    if (iteration == iterations) break;
    std::vector<double> rows(H, 0);
    wavefront(grid, true, workers, [&](int y, int x, Rows& scratch) {
      const size_t p = static_cast<size_t>(y) * W + x;
      if (labels[p] < 0) return;
      const Ends has = ends(y, x, p);
      float* sum = scratch.row(2);
      double taken = gather(p, has, sum);
      if (has.left) taken += pass_on(sum, has.share(), across.get() + (p - 1) * D, scratch);
      if (has.above) taken += pass_on(sum, has.share(), down.get() + (p - W) * D, scratch);
      rows[y] += taken;
    });
    bound = std::max(bound, std::accumulate(rows.begin(), rows.end(), 0.0));
  }
  std::copy(best.begin(), best.end(), labels);
  return bound;
}

namespace {

// One level of the pyramid of belief propagation: the messages that each pixel sends in the four directions.
struct Level {
  Grid grid;
  Unset<float> costs;  // those of the coarser levels
  std::vector<uint8_t> takes_part;
  std::vector<Unset<float>> sent;  // left, right, up, down
};

Level halved(const Level& fine, const Workers& workers) {
  const Grid& g = fine.grid;
  const int H = (g.height + 1) / 2, W = (g.width + 1) / 2;
  const size_t D = g.count;
  Level coarse{{nullptr, H, W, g.count}, zeros(H, W * D, workers), std::vector<uint8_t>(static_cast<size_t>(H) * W), {}};
  coarse.grid.costs = coarse.costs.get();
  parallel_rows(H, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int row = begin; row < end && !cancel.load(std::memory_order_relaxed); ++row) {
      const size_t first = static_cast<size_t>(row) * W;
      for (int y = 2 * row; y < std::min(2 * row + 2, g.height); ++y)
        for (int x = 0; x < g.width; ++x) {
          const size_t p = static_cast<size_t>(y) * g.width + x, q = first + x / 2;
          if (!fine.takes_part[p]) continue;
          add(coarse.costs.get() + q * D, g.costs + p * D, g.count);
          coarse.takes_part[q] = 1;
        }
      // A block in which no label suits all has nothing to say.
      for (size_t q = first; q < first + W; ++q)
        if (*std::min_element(coarse.grid.costs + q * D, coarse.grid.costs + (q + 1) * D) == kNever) coarse.takes_part[q] = 0;
    }
  });
  return coarse;
}

// costs + what the neighbours in all directions, but the one left out, send here.
void incoming(const Level& level, int y, int x, int leave_out, float* sum) {
  const int W = level.grid.width, H = level.grid.height, D = level.grid.count;
  const size_t p = static_cast<size_t>(y) * W + x;
  std::copy_n(level.grid.costs + p * D, D, sum);
  const auto from = [&](int direction, bool inside, size_t q, int sends) {
    if (direction != leave_out && inside && level.takes_part[q]) add(sum, level.sent[sends].get() + q * D, D);
  };
  from(0, x > 0, p - 1, 1);
  from(1, x + 1 < W, p + 1, 0);
  from(2, y > 0, p - W, 3);
  from(3, y + 1 < H, p + W, 2);
}

}  // namespace

void belief_propagation(const Grid& grid, const Smoothness& smoothness, int iterations, int levels, int32_t* labels,
                        const Workers& workers) {
  const int D = grid.count;
  const Penalty penalty(smoothness, D);
  std::vector<Level> pyramid;
  pyramid.push_back({grid, Unset<float>(0), std::vector<uint8_t>(static_cast<size_t>(grid.height) * grid.width), {}});
  for (size_t p = 0; p < pyramid[0].takes_part.size(); ++p) pyramid[0].takes_part[p] = labels[p] >= 0;
  while (static_cast<int>(pyramid.size()) < levels && std::max(pyramid.back().grid.height, pyramid.back().grid.width) > 1) {
    stop_if_asked(workers);
    pyramid.push_back(halved(pyramid.back(), workers));
  }

  for (int k = static_cast<int>(pyramid.size()) - 1; k >= 0; --k) {
    Level& level = pyramid[k];
    const int H = level.grid.height, W = level.grid.width;
    for (int direction = 0; direction < 4; ++direction) level.sent.push_back(zeros(H, static_cast<size_t>(W) * D, workers));
    if (k + 1 < static_cast<int>(pyramid.size())) {
      Level& coarse = pyramid[k + 1];
      parallel_rows(H, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
        for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
          for (int direction = 0; direction < 4; ++direction)
            for (int x = 0; x < W; ++x)
              std::copy_n(coarse.sent[direction].get() + (static_cast<size_t>(y / 2) * coarse.grid.width + x / 2) * D, D,
                          level.sent[direction].get() + (static_cast<size_t>(y) * W + x) * D);
      });
      pyramid.pop_back();
    }
    for (int half = 0; half < 2 * iterations; ++half) {
      stop_if_asked(workers);
      parallel_rows(H, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
        Rows scratch(D);
        for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
          for (int x = (y + half) % 2; x < W; x += 2) {
            const size_t p = static_cast<size_t>(y) * W + x;
            if (!level.takes_part[p]) continue;
            const bool inside[4] = {x > 0, x + 1 < W, y > 0, y + 1 < H};
            for (int direction = 0; direction < 4; ++direction) {
              if (!inside[direction]) continue;
              float* h = scratch.row(2);
              incoming(level, y, x, direction, h);
              send(penalty, h, level.sent[direction].get() + p * D, D, scratch);
            }
          }
      });
    }
  }
  const Level& finest = pyramid[0];
  parallel_rows(grid.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> belief(D);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < grid.width; ++x) {
        const size_t p = static_cast<size_t>(y) * grid.width + x;
        if (labels[p] < 0) continue;
        incoming(finest, y, x, -1, belief.data());
        labels[p] = argmin(belief.data(), D);
      }
  });
}

template void relative_costs(const int64_t*, int, int, int, float*, double*, const Workers&);
template void relative_costs(const uint16_t*, int, int, int, float*, double*, const Workers&);
template void relative_costs(const float*, int, int, int, float*, double*, const Workers&);
template void right_volume(const int64_t*, int, int, int, int, int64_t*, const Workers&);
template void right_volume(const uint16_t*, int, int, int, int, uint16_t*, const Workers&);
template void right_volume(const float*, int, int, int, int, float*, const Workers&);

template void second_pass(const int64_t*, int, int, int, const int32_t*, const Window&, const int64_t*, double, double, float*,
                          const Workers&);
template void second_pass(const uint16_t*, int, int, int, const int32_t*, const Window&, const int64_t*, double, double, float*,
                          const Workers&);
template void second_pass(const float*, int, int, int, const int32_t*, const Window&, const int64_t*, double, double, float*,
                          const Workers&);

}  // namespace stereopsis
