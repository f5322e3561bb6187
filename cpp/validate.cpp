#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <type_traits>
#include <utility>
#include <vector>

#if defined(_MSC_VER) && !defined(__clang__)
#include <intrin.h>
#endif

#include "parallel.hpp"
#include "rows.hpp"
#include "scratch.hpp"
#include "stages.hpp"
#include "winners.hpp"

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

void left_right_maps(const float* left, const float* right, int height, int width, int least, int most, double tolerance,
                     uint8_t* flags, const Workers& workers) {
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<int> changes(static_cast<size_t>(width) + 1);  // of the number of claims, from pixel to pixel
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const size_t row = static_cast<size_t>(y) * width;
      std::fill(changes.begin(), changes.end(), 0);
      // A right pixel claims what lies within the tolerance of its match, as far as the range permits.
      for (int u = 0; u < width; ++u) {
        const double match = u + static_cast<double>(right[row + u]);
        if (!std::isfinite(match)) continue;
        const double low = std::ceil(std::max(match - tolerance, 0.0)), high = std::floor(std::min(match + tolerance, width - 1.0));
        const int first = std::max(static_cast<int>(std::min<double>(low, width)), u + least);
        const int last = std::min(static_cast<int>(std::max(high, -1.0)), u + most);
        if (first > last) continue;
        ++changes[first];
        --changes[last + 1];
      }
      int claims = 0;
      for (int x = 0; x < width; ++x) {
        claims += changes[x];
        const float own = left[row + x];
        flags[row + x] = 0;
        if (!std::isfinite(own)) continue;
        const double there = std::nearbyint(x - static_cast<double>(own));
        if (there >= 0 && there < width && std::fabs(right[row + static_cast<int>(there)] - own) <= static_cast<float>(tolerance))
          continue;
        flags[row + x] = claims > 0 ? kMismatched : kOccluded;
      }
    }
  });
}

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
void each_bit(uint64_t bits, Visit visit) {
  for (; bits; bits &= bits - 1) visit(lowest_bit(bits));
}

// The regions of a map: runs of a row that hang together, joined with those of the row above. They form a forest, in which each
// run knows one before it, or itself. A band of rows numbers its runs from the number of its first pixel on, as it has no more
// runs than pixels: so bands can be searched at once.
class Regions {
 public:
  Regions(const float* disparity, int height, int width, float difference, const RowKernels& kernels)
      : disparity_(disparity),
        width_(width),
        words_((static_cast<size_t>(width) + 63) / 64),
        difference_(difference),
        kernels_(kernels),
        room_(static_cast<size_t>(height) * width),
        begin_(height),
        end_(height) {}

  // Finds the regions of a band, as if there were no other rows.
  void search(int begin, int end, const Cancel& cancel) {
    Bits here(words_), above(words_), meets(words_), has_value(words_);
    int count = begin * width_;
    for (int y = begin; y < end; ++y) {
      if (cancel.load(std::memory_order_relaxed)) return;
      std::swap(here, above);
      cut(y, here);
      kernels_.have_values(row(y), width_, has_value.data());
      int *first = first_.get() + count, *last = last_.get() + count;
      for (size_t w = 0; w < words_; ++w) {
        const int start = y * width_ + static_cast<int>(64 * w);
        const uint64_t next = w + 1 < words_ ? here[w + 1] << 63 : uint64_t{1} << 63;
        each_bit(has_value[w] & here[w], [&](int x) { *first++ = start + x; });
        each_bit(has_value[w] & (here[w] >> 1 | next), [&](int x) { *last++ = start + x; });
      }
      begin_[y] = count;
      for (const int stop = static_cast<int>(first - first_.get()); count < stop; ++count) parent_[count] = count;
      end_[y] = count;
      if (y > begin) join(y, here, above, meets, [](int, int) {});
    }
    // What a run knows comes before it, and so knows its own first one already.
    for (int run = begin * width_; run < count; ++run) {
      const int known = parent_[run] = parent_[parent_[run]], length = last_[run] + 1 - first_[run];
      pixels_[run] = length;
      if (known != run) pixels_[known] += length;
    }
  }

  // Joins the regions of a band that begins with this row with those of the one before.
  void join(int y) {
    Bits here(words_), above(words_), meets(words_);
    cut(y, here);
    cut(y - 1, above);
    join(y, here, above, meets, [&](int root, int other) { pixels_[root] += pixels_[other]; });
  }

  // Calls visit(first pixel, last pixel, region) for each run of a row, a region being told by its first run.
  template <class Visit>
  void each_run(int y, Visit visit) const {
    for (int run = begin_[y]; run < end_[y]; ++run) {
      int root = parent_[run];
      while (parent_[root] != root) root = parent_[root];
      visit(first_[run], last_[run], root);
    }
  }
  int pixels(int region) const { return pixels_[region]; }
  // Regions are told by numbers below this.
  int limit() const { return end_.back(); }

 private:
  using Bits = std::vector<uint64_t>;

  const float* row(int y) const { return disparity_ + static_cast<size_t>(y) * width_; }

  // The pixels that do not go on from the one before.
  void cut(int y, Bits& bits) const {
    bits.back() = 0;  // the last pixel, which may be alone in it, goes on into none
    kernels_.go_on(row(y), width_, difference_, bits.data());
    uint64_t before = 0;
    for (auto& word : bits) {
      const uint64_t own = word;
      word = ~(own << 1 | before);
      before = own >> 63;
    }
  }

  int root_of(int run) {
    while (parent_[run] != run) run = parent_[run] = parent_[parent_[run]];
    return run;
  }

  // Joins the runs of a row with those of the row above; told(root, other) of each two that become one.
  template <class Told>
  void join(int y, const Bits& here, const Bits& above, Bits& meets, Told told) {
    kernels_.meet(row(y), row(y - 1), width_, difference_, meets.data());
    int run = begin_[y], other = begin_[y - 1];
    uint64_t before = 0;
    for (size_t w = 0; w < words_; ++w) {
      // Of pixels side by side that meet those above in the same two runs the first one counts.
      const uint64_t all = meets[w], counting = all & (here[w] | above[w] | ~(all << 1 | before));
      before = all >> 63;
      const int start = y * width_ + static_cast<int>(64 * w);
      each_bit(counting, [&](int x) {
        while (last_[run] < start + x) ++run;
        while (last_[other] < start + x - width_) ++other;
        const int one = root_of(run), two = root_of(other);
        if (one == two) return;
        parent_[std::max(one, two)] = std::min(one, two);
        told(std::min(one, two), std::max(one, two));
      });
    }
  }

  const float* disparity_;
  int width_;
  size_t words_;
  float difference_;
  const RowKernels& kernels_;
  size_t room_;
  // Of each run: the pixels at its ends, one that it knows, and, of a region's first run, the pixels of all.
  Unset<int> first_{room_}, last_{room_}, parent_{room_}, pixels_{room_};
  std::vector<int> begin_, end_;  // of each row, the runs
};

// Calls visit(first pixel, pixels) for each run of a row that belongs to a region of fewer than `area` pixels.
template <class Visit>
void each_speckle(const float* disparity, int height, int width, int area, float difference, const RowKernels& kernels,
                  const Workers& workers, Visit visit) {
  if (!width || !height) return;
  Regions regions(disparity, height, width, difference, kernels);
  std::vector<uint8_t> band_begins(height);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    band_begins[begin] = 1;
    regions.search(begin, end, cancel);
  });
  for (int y = 1; y < height; ++y)
    if (band_begins[y]) regions.join(y);
  parallel_bands(height, 16, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      regions.each_run(y, [&](int first, int last, int region) {
        if (regions.pixels(region) < area) visit(first, last + 1 - first);
      });
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

void cut_off(const float* disparity, int height, int width, int left, int area, float difference, float nearer,
             uint8_t* cut_off, const RowKernels& kernels, const Workers& workers) {
  if (!width || !height) return;
  std::memset(cut_off, 0, static_cast<size_t>(height) * width);
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    Regions regions(disparity, height, width, difference, kernels);
    regions.search(0, height, cancel);
    if (cancel.load(std::memory_order_relaxed)) return;
    std::vector<uint8_t> cut(regions.limit());
    // What is cut off no longer stands between what is left of it and what is right of it.
    for (bool more = true; more && !cancel.load(std::memory_order_relaxed);) {
      std::vector<int> ends(cut.size()), hidden(cut.size());
      for (int y = 0; y < height; ++y) {
        int end = -1, own = -1;  // of the answers before
        regions.each_run(y, [&](int first, int last, int region) {
          if (cut[region]) return;
          if (own >= 0 && own != region) {
            const float beside = disparity[first];
            ++ends[own];
            hidden[own] += beside > disparity[end] + nearer && beside > static_cast<float>(left + end % width);
          }
          end = last;
          own = region;
        });
      }
      more = false;
      for (int k = 0; k < regions.limit(); ++k)
        if (hidden[k] && 2 * hidden[k] >= ends[k] && regions.pixels(k) < area) cut[k] = more = true;
    }
    for (int y = 0; y < height; ++y)
      regions.each_run(y, [&](int first, int last, int region) {
        if (cut[region]) std::memset(cut_off + first, 1, last + 1 - first);
      });
  });
}

}  // namespace stereopsis
