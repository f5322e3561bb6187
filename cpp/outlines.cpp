#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr float kJump = 4;                  // between neighbours: an outline
constexpr int kBeside = 2, kAround = 3;     // how far from an outline; and from a pixel the surfaces on either side
constexpr int kStride = 3, kStrides = 4;    // where votes are taken: every third row and column, up to 12 pixels off

// Whether the 3 x 3 pixels around each one of a row span more than kJump.
void mark_jumps(const float* disparity, int height, int width, int y, std::vector<float>& low, std::vector<float>& high, uint8_t* jumps) {
  constexpr float far = std::numeric_limits<float>::infinity();
  std::fill(low.begin(), low.end(), far);
  std::fill(high.begin(), high.end(), -far);
  for (int v = std::max(0, y - 1); v <= std::min(height - 1, y + 1); ++v) {
    const float* row = disparity + static_cast<size_t>(v) * width;
    for (int x = 0; x < width; ++x) {
      low[x + 1] = row[x] < low[x + 1] ? row[x] : low[x + 1];
      high[x + 1] = row[x] > high[x + 1] ? row[x] : high[x + 1];
    }
  }
  for (int x = 0; x < width; ++x) {
    const float least = std::min(low[x], std::min(low[x + 1], low[x + 2]));
    const float most = std::max(high[x], std::max(high[x + 1], high[x + 2]));
    jumps[x] = most - least > kJump;
  }
}

}  // namespace

void outlines(const float* disparity, const uint8_t* doubtful, const uint8_t* image, const int32_t* alike, int height, int width,
              float* moved, const Workers& workers) {
  const auto at = [width](int y, int x) { return static_cast<size_t>(y) * width + x; };
  std::vector<uint8_t> jumps(static_cast<size_t>(height) * width);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<float> low(width + 2), high(width + 2);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      mark_jumps(disparity, height, width, y, low, high, jumps.data() + at(y, 0));
  });
  const auto inside = [&](int y, int x, int reach, auto&& each) {
    for (int v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v)
      for (int u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) each(at(v, u));
  };
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      std::copy_n(disparity + at(y, 0), width, moved + at(y, 0));
      for (int x = 0; x < width; ++x) {
        if (!doubtful[at(y, x)]) continue;
        bool beside = false;
        inside(y, x, kBeside, [&](size_t q) { beside |= jumps[q] != 0; });
        if (!beside) continue;
        float farther = std::numeric_limits<float>::infinity(), nearer = -farther;
        inside(y, x, kAround, [&](size_t q) {
          farther = disparity[q] < farther ? disparity[q] : farther;
          nearer = disparity[q] > nearer ? disparity[q] : nearer;
        });
        const float apart = nearer - farther;
        int votes = 0;
        for (int dy = -kStride * kStrides; dy <= kStride * kStrides; dy += kStride) {
          if (y + dy < 0 || y + dy >= height) continue;
          for (int dx = -kStride * kStrides; dx <= kStride * kStrides; dx += kStride) {
            if (x + dx < 0 || x + dx >= width) continue;
            const size_t q = at(y + dy, x + dx);
            if (doubtful[q]) continue;
            const int weight = alike[std::abs(image[q] - image[at(y, x)])];
            if (3 * std::abs(disparity[q] - nearer) < apart) votes += weight;
            if (3 * std::abs(disparity[q] - farther) < apart) votes -= weight;
          }
        }
        if (votes > 0) moved[at(y, x)] = nearer;
      }
    }
  });
}

}  // namespace stereopsis
