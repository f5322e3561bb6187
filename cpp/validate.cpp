#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>
#include <vector>

#include "parallel.hpp"
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

template <class T>
void texture(const T* image, int height, int width, int channels, const Window& window, float* mean, const Workers& workers) {
  const auto clamp = [](int v, int last) { return std::min(std::max(v, 0), last); };
  const double divisor = 2.0 * static_cast<double>(window.area()) * channels;
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
      float* const out = mean + static_cast<size_t>(y) * width;
      for (int x = 0; x < width; ++x) out[x] = static_cast<float>(sums[x] / divisor);
      add_row(y + window.below() + 1, 1);
      add_row(y - window.above(), -1);
    }
  });
}
template void texture(const uint8_t*, int, int, int, const Window&, float*, const Workers&);
template void texture(const int32_t*, int, int, int, const Window&, float*, const Workers&);

namespace {

// Pixels in bytes: 1 where what is said of them holds, else 0; one more byte on the left, and whole words.
class Row {
 public:
  explicit Row(int width) : bytes_(static_cast<size_t>(width) + 16) {}
  uint8_t* at(int x) { return bytes_.data() + 8 + x; }
  // Calls visit(x) wherever it holds.
  template <class Visit>
  void each(int width, Visit visit) {
    for (int x = 0; x < width; x += 8) {
      uint64_t word;
      std::memcpy(&word, at(x), 8);
      if (!word) continue;
      for (int k = x; k < std::min(x + 8, width); ++k)
        if (*at(k)) visit(k);
    }
  }

 private:
  std::vector<uint8_t> bytes_;
};

// Where a pixel and the one before it belong to one run: they differ by no more than that, or neither has a value.
void begin_runs(const float* row, int width, float difference, uint8_t* __restrict begins) {
  begins[0] = 1;
  for (int x = 1; x < width; ++x) {
    const float here = row[x], before = row[x - 1];
    begins[x] = !((std::fabs(here - before) <= difference) | ((here != here) & (before != before)));
  }
}
// Where a pixel and the one above belong to one region, as their runs' pixels before them do not already.
void meet(const float* row, const float* above, const uint8_t* begins, const uint8_t* above_begins, int width, float difference,
          uint8_t* __restrict meets, uint8_t* __restrict anew) {
  for (int x = 0; x < width; ++x) meets[x] = std::fabs(row[x] - above[x]) <= difference;
  for (int x = 0; x < width; ++x) anew[x] = meets[x] & static_cast<uint8_t>(begins[x] | above_begins[x] | (meets[x - 1] ^ 1));
}

}  // namespace

void speckle(const float* disparity, int height, int width, int area, float difference, uint8_t* speckle,
             const Workers& workers) {
  // Runs of a row that hang together, joined with those of the row above: a forest, in which each run knows one before it.
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    if (!width) return;
    std::vector<int> run_of(static_cast<size_t>(height) * width), first, parent;
    Row begins(width), above_begins(width), meets(width), anew(width);
    const auto root = [&](int run) {
      while (parent[run] != run) run = parent[run] = parent[parent[run]];
      return run;
    };
    for (int y = 0; y < height && !cancel.load(std::memory_order_relaxed); ++y) {
      const float* row = disparity + static_cast<size_t>(y) * width;
      begin_runs(row, width, difference, begins.at(0));
      int* const run = run_of.data() + static_cast<size_t>(y) * width;
      int last = static_cast<int>(parent.size()) - 1;
      for (int x = 0; x < width; ++x) run[x] = last += *begins.at(x);
      begins.each(width, [&](int x) {
        parent.push_back(run[x]);
        first.push_back(y * width + x);
      });
      if (y > 0) {
        meet(row, row - width, begins.at(0), above_begins.at(0), width, difference, meets.at(0), anew.at(0));
        anew.each(width, [&](int x) {
          const int one = root(run[x]), other = root(run[x - width]);
          parent[std::max(one, other)] = std::min(one, other);
        });
      }
      std::swap(begins, above_begins);
    }
    if (cancel.load(std::memory_order_relaxed)) return;
    // The runs lie one after the other, and what a run knows comes before it.
    first.push_back(height * width);
    std::vector<int> pixels(parent.size());
    for (size_t k = 0; k < parent.size(); ++k) pixels[k] = first[k + 1] - first[k];
    for (size_t k = parent.size(); k-- > 0;) pixels[parent[k]] += parent[k] == static_cast<int>(k) ? 0 : pixels[k];
    for (size_t k = 0; k < parent.size(); ++k) pixels[k] = pixels[parent[k]];
    // A run has a value throughout, or nowhere.
    for (size_t k = 0; k < parent.size(); ++k)
      std::memset(speckle + first[k], !std::isnan(disparity[first[k]]) && pixels[k] < area, first[k + 1] - first[k]);
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
