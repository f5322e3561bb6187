#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "parallel.hpp"
#include "smooth.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr int kBlock = 16;  // pixels side by side

// What the windows read, widened by their reach: values in whole steps, whether there is one, and the guide's channels.
struct Padded {
  Padded(int height, int width, int channels, int reach)
      : stride(width + 2 * reach + kBlock), value(static_cast<size_t>(height + 2 * reach) * stride), there(value.size()),
        guide(channels, std::vector<int16_t>(value.size())) {}
  int stride;
  std::vector<int16_t> value;   // 0 where there is none
  std::vector<uint16_t> there;  // all bits, or none
  std::vector<std::vector<int16_t>> guide;
};

// Weight of the pixel `apart` cells on: ((255 - slope difference / 16)+)^2 / 256, at least 1; 0 where it has no value. From a
// difference of `enough` on nothing is left; so all of it fits 16 bits.
void weigh(const Padded& padded, size_t at, ptrdiff_t apart, uint16_t slope, int16_t enough, uint16_t* __restrict weights) {
  int16_t most[kBlock] = {};
  for (const auto& channel : padded.guide) {
    const int16_t *here = channel.data() + at, *there = here + apart;
    for (int i = 0; i < kBlock; ++i) {
      const int16_t difference = static_cast<int16_t>(std::max(here[i], there[i]) - std::min(here[i], there[i]));
      most[i] = std::max(most[i], difference);
    }
  }
  const uint16_t* valid = padded.there.data() + at + apart;
  for (int i = 0; i < kBlock; ++i) {
    const uint16_t difference = static_cast<uint16_t>(std::min(most[i], enough));
    const int16_t less = static_cast<int16_t>(static_cast<uint16_t>(difference * slope) >> 4);
    const uint16_t left = static_cast<uint16_t>(255 - std::min(less, int16_t{255}));
    const int16_t weight = static_cast<int16_t>(static_cast<uint16_t>(left * left) >> 8);
    weights[i] = static_cast<uint16_t>(std::max(weight, int16_t{1})) & valid[i];
  }
}

}  // namespace

void weighted_median(const float* disparity, const uint8_t* guide, int height, int width, int channels, int size, int slope,
                     float* filtered, const Workers& workers) {
  const int reach = size / 2, count = size * size;
  const int16_t enough = static_cast<int16_t>(slope > 0 ? std::min(255, 4080 / slope + 1) : 0);
  float largest = 0;
  for (size_t at = 0; at < static_cast<size_t>(height) * width; ++at)
    if (!std::isnan(disparity[at])) largest = std::max(largest, std::fabs(disparity[at]));
  // The finest power of two in which the map fits 15 bits.
  const float scale = std::ldexp(1.0f, largest > 0 ? 13 - std::ilogb(largest) : 0);
  Padded padded(height, width, channels, reach);
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const size_t at = static_cast<size_t>(y) * width + x, to = static_cast<size_t>(y + reach) * padded.stride + x + reach;
      const bool there = !std::isnan(disparity[at]);
      padded.value[to] = there ? static_cast<int16_t>(std::lrintf(disparity[at] * scale)) : int16_t{0};
      padded.there[to] = there ? 0xffff : 0;
      for (int c = 0; c < channels; ++c) padded.guide[c][to] = guide[at * channels + c];
    }
  parallel_rows(height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    std::vector<uint16_t> weights(static_cast<size_t>(count) * kBlock);
    std::vector<ptrdiff_t> offsets;
    for (int v = -reach; v <= reach; ++v)
      for (int u = -reach; u <= reach; ++u) offsets.push_back(static_cast<ptrdiff_t>(v) * padded.stride + u);
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x = 0; x < width; x += kBlock) {
        const size_t at = static_cast<size_t>(y + reach) * padded.stride + x + reach;
        // The median lies in (low, high]: the weights up to `low` are less than half of the whole, those up to `high` not.
        int16_t low[kBlock], high[kBlock], middle[kBlock];
        uint16_t half[kBlock] = {}, sum[kBlock];
        std::fill(low, low + kBlock, int16_t{32767});
        std::fill(high, high + kBlock, int16_t{-32768});
        for (int k = 0; k < count; ++k) {
          uint16_t* weight = weights.data() + static_cast<size_t>(k) * kBlock;
          weigh(padded, at, offsets[k], static_cast<uint16_t>(slope), enough, weight);
          const int16_t* value = padded.value.data() + at + offsets[k];
          for (int i = 0; i < kBlock; ++i) {
            const int16_t here = value[i], missing = weight[i] ? 0 : -1;
            const int16_t above = static_cast<int16_t>(here | (missing & 0x7fff));
            const int16_t below = static_cast<int16_t>(here - (missing & 0x7fff));
            half[i] = static_cast<uint16_t>(half[i] + weight[i]);
            low[i] = std::min(low[i], above);
            high[i] = std::max(high[i], below);
          }
        }
        for (int i = 0; i < kBlock; ++i) {
          half[i] = static_cast<uint16_t>((half[i] + 1) >> 1);
          low[i] = static_cast<int16_t>(low[i] - 1);
        }
        for (;;) {
          int widest = 0;
          for (int i = 0; i < kBlock; ++i) {
            const int apart = half[i] ? high[i] - low[i] : 0;
            widest = std::max(widest, apart);
            middle[i] = static_cast<int16_t>((low[i] + high[i]) >> 1);
            sum[i] = 0;
          }
          if (widest <= 1) break;
          for (int k = 0; k < count; ++k) {
            const uint16_t* weight = weights.data() + static_cast<size_t>(k) * kBlock;
            const int16_t* value = padded.value.data() + at + offsets[k];
            for (int i = 0; i < kBlock; ++i) {
              const uint16_t counts = value[i] <= middle[i] ? 0xffff : 0;
              sum[i] = static_cast<uint16_t>(sum[i] + (weight[i] & counts));
            }
          }
          for (int i = 0; i < kBlock; ++i) {
            const bool reached = sum[i] >= half[i];
            high[i] = reached ? middle[i] : high[i];
            low[i] = reached ? low[i] : middle[i];
          }
        }
        for (int i = 0; i < std::min(kBlock, width - x); ++i) {
          const size_t here = static_cast<size_t>(y) * width + x + i;
          filtered[here] = disparity[here];
          if (std::isnan(disparity[here]) || padded.value[at + i] == high[i]) continue;
          const uint16_t* weight = weights.data() + i;
          for (int k = 0; k < count; ++k)
            if (padded.value[at + i + offsets[k]] == high[i] && weight[static_cast<size_t>(k) * kBlock]) {
              filtered[here] = disparity[static_cast<size_t>(y + k / size - reach) * width + x + i + k % size - reach];
              break;
            }
        }
      }
  });
}

void edge_aware(const float* disparity, const SurfaceGuide& guide, int height, int width, int iterations, float* smoothed,
                const Workers& workers) {
  const size_t size = static_cast<size_t>(height) * width;
  const Slopes slopes = surface_slopes(disparity, guide.image, height, width, guide.channels, guide.coarse, guide.length, workers);
  const EdgeWeights edges = edge_weights(guide.image, height, width, guide.channels, guide.fine, guide.length, workers);
  std::vector<float> value(size), weight(size);
  for (size_t at = 0; at < size; ++at) {
    const bool answered = !std::isnan(disparity[at]);
    value[at] = answered ? disparity[at] : 0;
    weight[at] = answered ? 1.0f : 1e-6f;
  }
  smooth({{value.data(), weight.data()}}, &slopes, height, width, edges, guide.strength, iterations, workers);
  for (size_t at = 0; at < size; ++at) smoothed[at] = std::isnan(disparity[at]) ? disparity[at] : value[at];
}

}  // namespace stereopsis
