#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "simd.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr float kJump = 4;                  // between neighbours: an outline
constexpr int kBeside = 2, kAround = 3;     // how far from an outline; and from a pixel the surfaces on either side
constexpr int kStride = 4, kStrides = 3;    // where votes are taken: every fourth row and column, up to 12 pixels off

// Whether there is an outline within kBeside columns of each pixel of a row: whether its 3 x 3 pixels span more than kJump.
class Jumps {
 public:
  Jumps(const float* disparity, int height, int width)
      : disparity_(disparity), height_(height), width_(width), low_(width + 2), high_(width + 2), jumps_(width + 2 * kBeside) {}

  void mark(int y, uint8_t* STEREOPSIS_RESTRICT beside) {
    constexpr float far = std::numeric_limits<float>::infinity();
    std::fill(low_.begin(), low_.end(), far);
    std::fill(high_.begin(), high_.end(), -far);
    float *STEREOPSIS_RESTRICT const low = low_.data(), *STEREOPSIS_RESTRICT const high = high_.data();
    for (int v = std::max(0, y - 1); v <= std::min(height_ - 1, y + 1); ++v) {
      const float* STEREOPSIS_RESTRICT const row = disparity_ + static_cast<size_t>(v) * width_;
      for (int x = 0; x < width_; ++x) {
        low[x + 1] = row[x] < low[x + 1] ? row[x] : low[x + 1];
        high[x + 1] = row[x] > high[x + 1] ? row[x] : high[x + 1];
      }
    }
    uint8_t* STEREOPSIS_RESTRICT const jumps = jumps_.data();
    for (int x = 0; x < width_; ++x) {
      const float least = std::min(low[x], std::min(low[x + 1], low[x + 2]));
      const float most = std::max(high[x], std::max(high[x + 1], high[x + 2]));
      jumps[x + kBeside] = most - least > kJump;
    }
    for (int x = 0; x < width_; ++x) {
      uint8_t any = 0;
      for (int k = 0; k <= 2 * kBeside; ++k) any |= jumps[x + k];
      beside[x] = any;
    }
  }

 private:
  const float* disparity_;
  const int height_, width_;
  std::vector<float> low_, high_;
  std::vector<uint8_t> jumps_;
};

// The largest difference of the channels.
int apart(const uint8_t* one, const uint8_t* other, int channels) {
  int most = 0;
  for (int c = 0; c < channels; ++c) most = std::max(most, std::abs(one[c] - other[c]));
  return most;
}

void unite(const uint8_t* STEREOPSIS_RESTRICT one, int width, uint8_t* STEREOPSIS_RESTRICT all) {
  for (int x = 0; x < width; ++x) all[x] |= one[x];
}

}  // namespace

void outlines(const float* disparity, const uint8_t* doubtful, const uint8_t* image, int channels, const int32_t* alike, int height,
              int width, float* moved, const Workers& workers) {
  const auto at = [width](int y, int x) { return static_cast<size_t>(y) * width + x; };
  std::vector<uint8_t> columns(static_cast<size_t>(height) * width);
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Jumps jumps(disparity, height, width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) jumps.mark(y, columns.data() + at(y, 0));
  });
  const auto inside = [&](int y, int x, int reach, auto&& each) {
    for (int v = std::max(0, y - reach); v <= std::min(height - 1, y + reach); ++v)
      for (int u = std::max(0, x - reach); u <= std::min(width - 1, x + reach); ++u) each(at(v, u));
  };
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<uint8_t> beside(width);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      std::copy_n(disparity + at(y, 0), width, moved + at(y, 0));
      std::fill(beside.begin(), beside.end(), uint8_t{0});
      for (int v = std::max(0, y - kBeside); v <= std::min(height - 1, y + kBeside); ++v)
        unite(columns.data() + at(v, 0), width, beside.data());
      for (int x = 0; x < width; ++x) {
        if (!doubtful[at(y, x)] || !beside[x]) continue;
        float farther = std::numeric_limits<float>::infinity(), nearer = -farther;
        inside(y, x, kAround, [&](size_t q) {
          farther = disparity[q] < farther ? disparity[q] : farther;
          nearer = disparity[q] > nearer ? disparity[q] : nearer;
        });
        const float span = nearer - farther;
        int votes = 0;
        for (int dy = -kStride * kStrides; dy <= kStride * kStrides; dy += kStride) {
          if (y + dy < 0 || y + dy >= height) continue;
          for (int dx = -kStride * kStrides; dx <= kStride * kStrides; dx += kStride) {
            if (x + dx < 0 || x + dx >= width) continue;
            const size_t q = at(y + dy, x + dx);
            if (doubtful[q]) continue;
            const int weight = alike[apart(image + q * channels, image + at(y, x) * channels, channels)];
            if (3 * std::abs(disparity[q] - nearer) < span) votes += weight;
            if (3 * std::abs(disparity[q] - farther) < span) votes -= weight;
          }
        }
        if (votes > 0) moved[at(y, x)] = nearer;
      }
    }
  });
}

}  // namespace stereopsis
