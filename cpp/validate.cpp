#include <algorithm>
#include <cmath>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

void texture(const int32_t* image, int height, int width, int channels, const Window& window, float* mean,
             const Workers& workers) {
  const auto clamp = [](int v, int last) { return std::min(std::max(v, 0), last); };
  const double divisor = 2.0 * static_cast<double>(window.area()) * channels;
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<int64_t> column(width);
    const auto add_row = [&](int y, int64_t sign) {
      const int32_t* row = image + static_cast<size_t>(clamp(y, height - 1)) * width * channels;
      for (int x = 0; x < width; ++x) {
        const int32_t* next = row + static_cast<size_t>(clamp(x + 1, width - 1)) * channels;
        const int32_t* last = row + static_cast<size_t>(clamp(x - 1, width - 1)) * channels;
        for (int c = 0; c < channels; ++c) column[x] += sign * std::abs(next[c] - last[c]);
      }
    };
    for (int y = begin - window.above(); y <= begin + window.below(); ++y) add_row(y, 1);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      int64_t sum = 0;
      for (int x = -window.left(); x <= window.right(); ++x) sum += column[clamp(x, width - 1)];
      for (int x = 0; x < width; ++x) {
        mean[static_cast<size_t>(y) * width + x] = static_cast<float>(static_cast<double>(sum) / divisor);
        sum += column[clamp(x + window.right() + 1, width - 1)] - column[clamp(x - window.left(), width - 1)];
      }
      add_row(y + window.below() + 1, 1);
      add_row(y - window.above(), -1);
    }
  });
}

void speckle(const float* disparity, int height, int width, int area, float difference, uint8_t* speckle,
             const Workers& workers) {
  // One flood fill a region; `seen` holds every pixel once, so the whole is linear in the pixels.
  parallel_rows(1, 1, workers.interrupted, [&](int, int, const Cancel& cancel) {
    std::vector<uint8_t> seen(static_cast<size_t>(height) * width);
    std::vector<int> region;
    for (int start = 0; start < height * width; ++start) {
      if (start % width == 0 && cancel.load(std::memory_order_relaxed)) return;
      if (seen[start] || std::isnan(disparity[start])) continue;
      region.assign(1, start);
      seen[start] = 1;
      for (size_t k = 0; k < region.size(); ++k) {
        const int at = region[k], x = at % width;
        const auto visit = [&](int next) {
          if (seen[next] || !(std::fabs(disparity[next] - disparity[at]) <= difference)) return;
          seen[next] = 1;
          region.push_back(next);
        };
        if (x > 0) visit(at - 1);
        if (x + 1 < width) visit(at + 1);
        if (at >= width) visit(at - width);
        if (at + width < height * width) visit(at + width);
      }
      if (region.size() < static_cast<size_t>(area))
        for (const int at : region) speckle[at] = 1;
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
