#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <vector>

#if defined(_MSC_VER) && !defined(__clang__)
#include <intrin.h>
#endif

#include "parallel.hpp"
#include "rows.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// Adds, or takes away, the absolute differences of each pixel's neighbours on the row, over the channels.
template <class T, class Sum>
void add_gradients(const T* __restrict row, int width, int channels, Sum sign, Sum* __restrict column) {
  const auto add = [&](int x, int last, int next) {
    for (int c = 0; c < channels; ++c)
      column[x] += sign * std::abs(static_cast<Sum>(row[next * channels + c]) - static_cast<Sum>(row[last * channels + c]));
  };
  add(0, 0, std::min(1, width - 1));
  if (channels == 1)
    for (int x = 1; x < width - 1; ++x) column[x] += sign * std::abs(static_cast<Sum>(row[x + 1]) - static_cast<Sum>(row[x - 1]));
  else
    for (int x = 1; x < width - 1; ++x) add(x, x - 1, x + 1);
  if (width > 1) add(width - 1, width - 2, width - 1);
}

}  // namespace

namespace {

int clamp(int v, int last) { return std::min(std::max(v, 0), last); }

// Calls visit(y, sums) for each row: what each pixel's window sums of absolute differences, over the channels.
template <class T, class Visit>
void sum_gradients(const T* image, int height, int width, int channels, const Window& window, const Workers& workers, Visit visit) {
  using Sum = std::conditional_t<sizeof(T) == 1, int32_t, int64_t>;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<Sum> column(width);
    std::vector<double> sums(width);  // of whole numbers, and so exact
    const auto add_row = [&](int y, Sum sign) {
      const T* row = image + static_cast<size_t>(clamp(y, height - 1)) * width * channels;
      add_gradients<T, Sum>(row, width, channels, sign, column.data());
    };
    for (int y = begin - window.above(); y <= begin + window.below(); ++y) add_row(y, 1);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      int64_t sum = 0;
      for (int x = -window.left(); x <= window.right(); ++x) sum += column[clamp(x, width - 1)];
      for (int x = 0; x < width; ++x) {
        sums[x] = static_cast<double>(sum);
        sum += column[clamp(x + window.right() + 1, width - 1)] - column[clamp(x - window.left(), width - 1)];
      }
      visit(y, sums.data());
      add_row(y + window.below() + 1, 1);
      add_row(y - window.above(), -1);
    }
  });
}

double texture_divisor(const Window& window, int channels) { return 2.0 * static_cast<double>(window.area()) * channels; }

// The map's row, as kernels refuse pixels of it.
RowRefusal row_of(const Refusal& refused, int y, int width) {
  const size_t at = static_cast<size_t>(y) * width;
  return {refused.disparity + at, refused.confidence + at, refused.flags + at, refused.bit};
}

// Windows of one channel whose sums fit a `Sum`: where they are at most that.
template <class T, class Sum>
void refuse_low(const T* image, int height, int width, const Window& window, Sum most, const Refusal& refused,
                const GradientKernels<T, Sum>& kernels, const Workers& workers) {
  const int64_t pixels = static_cast<int64_t>(height) * width;
  quick_rows(height, pixels, 1 << 17, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    // Columns from `left` before the first on, edge columns repeated.
    const int left = window.left();
    std::vector<Sum> columns(static_cast<size_t>(width) + window.width + kRowRoom), sums(static_cast<size_t>(width) + kRowRoom);
    const std::vector<T> none(sums.size());
    const auto row = [&](int y) { return image + static_cast<size_t>(clamp(y, height - 1)) * width; };
    for (int y = begin - window.above() - 1; y < begin + window.below(); ++y)
      kernels.change(row(y), none.data(), width, columns.data() + left);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      kernels.change(row(y + window.below()), row(y - window.above() - 1), width, columns.data() + left);
      std::fill_n(columns.begin(), left, columns[left]);
      std::fill_n(columns.begin() + left + width, window.right(), columns[left + width - 1]);
      kernels.sum_columns(columns.data(), width, window.width, sums.data());
      kernels.refuse_low(sums.data(), most, width, row_of(refused, y, width));
    }
  });
}

}  // namespace

template <class T>
void texture(const T* image, int height, int width, int channels, const Window& window, float* mean, const Workers& workers) {
  const double divisor = texture_divisor(window, channels);
  sum_gradients(image, height, width, channels, window, workers, [&](int y, const double* sums) {
    float* const out = mean + static_cast<size_t>(y) * width;
    for (int x = 0; x < width; ++x) out[x] = static_cast<float>(sums[x] / divisor);
  });
}
template void texture(const uint8_t*, int, int, int, const Window&, float*, const Workers&);
template void texture(const int32_t*, int, int, int, const Window&, float*, const Workers&);

template <class T>
void refuse_dull(const T* image, int height, int width, int channels, const Window& window, float least, const Refusal& refused,
                 const RowKernels& kernels, const Workers& workers) {
  const double divisor = texture_divisor(window, channels);
  const auto dull = [&](double sum) { return static_cast<float>(sum / divisor) < least; };
  const auto small = [&](int64_t largest, const auto& gradients, auto sum) {
    using Sum = decltype(sum);
    const int64_t most = largest * window.area();
    if (most > std::numeric_limits<Sum>::max()) return false;
    // The first sum that is not dull, by halving.
    int64_t low = 0, high = most + 1;
    while (low < high) {
      const int64_t middle = (low + high) / 2;
      dull(static_cast<double>(middle)) ? low = middle + 1 : high = middle;
    }
    if (low > 0) refuse_low(image, height, width, window, static_cast<Sum>(low - 1), refused, gradients, workers);
    return true;
  };
  if (channels == 1) {
    if constexpr (sizeof(T) == 1) {
      if (small(255, kernels.gradients_of_bytes, uint16_t{})) return;
    } else {
      T least = image[0], most = image[0];
      for (size_t k = 0; k < static_cast<size_t>(height) * width; ++k) {
        least = std::min(least, image[k]);
        most = std::max(most, image[k]);
      }
      if (small(static_cast<int64_t>(most) - least, kernels.gradients_of_words, uint32_t{})) return;
    }
  }
  sum_gradients(image, height, width, channels, window, workers, [&](int y, const double* sums) {
    const RowRefusal row = row_of(refused, y, width);
    for (int x = 0; x < width; ++x)
      if (dull(sums[x])) {
        row.disparity[x] = std::numeric_limits<float>::quiet_NaN();
        row.confidence[x] = 0;
        row.flags[x] |= row.bit;
      }
  });
}
template void refuse_dull(const uint8_t*, int, int, int, const Window&, float, const Refusal&, const RowKernels&, const Workers&);
template void refuse_dull(const int32_t*, int, int, int, const Window&, float, const Refusal&, const RowKernels&, const Workers&);

namespace {

int lowest_bit(uint64_t bits) {
#if defined(_MSC_VER) && !defined(__clang__)
  unsigned long at;
  _BitScanForward64(&at, bits);
  return static_cast<int>(at);
#else
  return __builtin_ctzll(bits);
#endif
}

// Calls visit(x) for each bit that is set.
template <class Visit>
void each_bit(const std::vector<uint64_t>& bits, Visit visit) {
  for (size_t w = 0; w < bits.size(); ++w)
    for (uint64_t left = bits[w]; left; left &= left - 1) visit(static_cast<int>(64 * w) + lowest_bit(left));
}
// Appends `start` + x for each of these.
void append(const std::vector<uint64_t>& bits, int start, std::vector<int>& places) {
  const size_t before = places.size();
  places.resize(before + 64 * bits.size());
  int* to = places.data() + before;
  each_bit(bits, [&](int x) { *to++ = start + x; });
  places.resize(to - places.data());
}

// Calls visit(first pixel, pixels) for each run of a row that belongs to a region of fewer than `area` pixels.
template <class Visit>
void each_speckle(const float* disparity, int height, int width, int area, float difference, const RowKernels& kernels,
                  const Cancel& cancel, Visit visit) {
  // Runs of a row that hang together, joined with those of the row above: a forest, in which each run knows one before it.
  std::vector<int> first, last, parent;
  const size_t words = (static_cast<size_t>(width) + 63) / 64;
  std::vector<uint64_t> go_on(words), begins(words), above_begins(words), meets(words), starts(words), ends(words);
  const auto root = [&](int run) {
    while (parent[run] != run) run = parent[run] = parent[parent[run]];
    return run;
  };
  int above = 0, own = 0;  // the first runs of both rows
  for (int y = 0; y < height && !cancel.load(std::memory_order_relaxed); ++y) {
    const float* const row = disparity + static_cast<size_t>(y) * width;
    kernels.go_on(row, width, difference, go_on.data());
    kernels.have_values(row, width, ends.data());
    std::swap(begins, above_begins);
    uint64_t before = 0;
    for (size_t w = 0; w < words; ++w) {
      begins[w] = ~(go_on[w] << 1 | before);
      before = go_on[w] >> 63;
      starts[w] = ends[w] & begins[w];
      ends[w] &= ~go_on[w];
    }
    above = own;
    own = static_cast<int>(first.size());
    append(starts, y * width, first);
    append(ends, y * width, last);
    for (size_t k = own; k < first.size(); ++k) parent.push_back(static_cast<int>(k));
    if (y == 0) continue;
    kernels.meet(row, row - width, width, difference, meets.data());
    // Of pixels side by side that meet those above in the same two runs the first one counts.
    before = 0;
    for (size_t w = 0; w < words; ++w) {
      const uint64_t all = meets[w];
      meets[w] = all & (begins[w] | above_begins[w] | ~(all << 1 | before));
      before = all >> 63;
    }
    int run = own, other = above;
    each_bit(meets, [&](int x) {
      while (last[run] < y * width + x) ++run;
      while (last[other] < (y - 1) * width + x) ++other;
      const int one = root(run), two = root(other);
      parent[std::max(one, two)] = std::min(one, two);
    });
  }
  if (cancel.load(std::memory_order_relaxed)) return;
  // What a run knows comes before it, and so knows its own first one already.
  std::vector<int> pixels(parent.size());
  for (size_t k = 0; k < parent.size(); ++k) {
    parent[k] = parent[parent[k]];
    pixels[parent[k]] += last[k] + 1 - first[k];
  }
  for (size_t k = 0; k < parent.size(); ++k)
    if (pixels[parent[k]] < area) visit(first[k], last[k] + 1 - first[k]);
}

// On one thread: to join what bands have found takes as long as they save.
template <class Visit>
void each_speckle(const float* disparity, int height, int width, int area, float difference, const RowKernels& kernels,
                  const Workers& workers, Visit visit) {
  if (!width) return;
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    each_speckle(disparity, height, width, area, difference, kernels, cancel, visit);
  });
}

}  // namespace

void speckle(const float* disparity, int height, int width, int area, float difference, uint8_t* speckle,
             const RowKernels& kernels, const Workers& workers) {
  std::memset(speckle, 0, static_cast<size_t>(height) * width);
  each_speckle(disparity, height, width, area, difference, kernels, workers,
               [&](int first, int pixels) { std::memset(speckle + first, 1, pixels); });
}

void refuse_speckle(int height, int width, int area, float difference, const Refusal& refused, const RowKernels& kernels,
                    const Workers& workers) {
  each_speckle(refused.disparity, height, width, area, difference, kernels, workers, [&](int first, int pixels) {
    // One loop: runs are short, and each loop's end is a guess of the processor's that fails.
    for (int k = first; k < first + pixels; ++k) {
      refused.disparity[k] = std::numeric_limits<float>::quiet_NaN();
      refused.confidence[k] = 0;
      refused.flags[k] |= refused.bit;
    }
  });
}

void flood(const uint8_t* relief, int height, int width, uint8_t* level, const Workers& workers) {
  // The water rises a level at a time; `front[k]` holds the pixels that it reaches at level k, so that the whole is linear.
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    std::vector<uint8_t> reached(static_cast<size_t>(height) * width);
    std::vector<std::vector<int>> front(256);
    const auto reach = [&](int at, int water) {
      if (reached[at]) return;
      reached[at] = 1;
      level[at] = static_cast<uint8_t>(std::max<int>(relief[at], water));
      front[level[at]].push_back(at);
    };
    for (int x = 0; x < width && height > 0; ++x) reach(x, 0);
    for (int water = 0; water < 256; ++water) {
      // A level's own front grows while it is gone through.
      for (size_t k = 0; k < front[water].size(); ++k) {
        if (k % 4096 == 0 && cancel.load(std::memory_order_relaxed)) return;
        const int at = front[water][k], x = at % width;
        if (x > 0) reach(at - 1, water);
        if (x + 1 < width) reach(at + 1, water);
        if (at >= width) reach(at - width, water);
        if (at + width < height * width) reach(at + width, water);
      }
      std::vector<int>().swap(front[water]);
    }
  });
}

int label(const uint8_t* inside, int height, int width, int32_t* region, const Workers& workers) {
  int count = 0;
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    std::fill(region, region + static_cast<size_t>(height) * width, 0);
    std::vector<int> open;
    for (int start = 0; start < height * width; ++start) {
      if (start % width == 0 && cancel.load(std::memory_order_relaxed)) return;
      if (!inside[start] || region[start]) continue;
      const auto visit = [&](int at) {
        if (!inside[at] || region[at]) return;
        region[at] = count;
        open.push_back(at);
      };
      ++count;
      visit(start);
      while (!open.empty()) {
        const int at = open.back(), x = at % width;
        open.pop_back();
        if (x > 0) visit(at - 1);
        if (x + 1 < width) visit(at + 1);
        if (at >= width) visit(at - width);
        if (at + width < height * width) visit(at + width);
      }
    }
  });
  return count;
}

}  // namespace stereopsis
