#include <algorithm>
#include <type_traits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// 1, 4, 6, 4, 1 along a line.
template <class Sum>
Sum binomial(Sum a, Sum b, Sum c, Sum d, Sum e) {
  return a + e + 4 * (b + d) + 6 * c;
}

}  // namespace

template <class T>
void sharpen(const T* image, int height, int width, int channels, int amount, T* sharp, const Workers& workers) {
  using Sum = std::conditional_t<sizeof(T) == 1, int32_t, int64_t>;
  const int stride = width * channels, edge = 2 * channels;
  const int64_t pixels = static_cast<int64_t>(height) * stride;
  quick_bands(height, pixels, 1 << 17, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    // Sums down the columns, edge columns repeated.
    std::vector<Sum> columns(static_cast<size_t>(stride) + 2 * edge);
    Sum* const inner = columns.data() + edge;
    const auto row = [&](int y) { return image + static_cast<size_t>(std::clamp(y, 0, height - 1)) * stride; };
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      const T *const a = row(y - 2), *const b = row(y - 1), *const c = row(y), *const d = row(y + 1), *const e = row(y + 2);
      for (int x = 0; x < stride; ++x) inner[x] = binomial<Sum>(a[x], b[x], c[x], d[x], e[x]);
      for (int k = 0; k < edge; ++k) {
        columns[k] = inner[k % channels];
        inner[stride + k] = inner[stride - channels + k % channels];
      }
      T* const out = sharp + static_cast<size_t>(y) * stride;
      for (int x = 0; x < stride; ++x) {
        const Sum* const at = inner + x;
        const Sum around = binomial<Sum>(at[-edge], at[-channels], at[0], at[channels], at[edge]), own = 256 * Sum{c[x]};
        // In 256 * 64ths, rounded; shifted, negative ones round down as well.
        const Sum value = (64 * own + amount * (own - around) + (1 << 13)) >> 14;
        if constexpr (sizeof(T) == 1)
          out[x] = static_cast<T>(std::clamp<Sum>(value, 0, 255));
        else
          out[x] = static_cast<T>(value);
      }
    }
  });
}
template void sharpen(const uint8_t*, int, int, int, int, uint8_t*, const Workers&);
template void sharpen(const int32_t*, int, int, int, int, int32_t*, const Workers&);

}  // namespace stereopsis
