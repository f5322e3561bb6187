// One build of the loops over rows, for the instruction set that STEREOPSIS_ISA names: plain loops, `static` and unnamed for
// the reason given in fused_narrow.hpp. Every float operation is a single one in a fixed order, so that all give the same bits.
#include "rows.hpp"

#include <cmath>
#include <cstring>
#include <limits>

#include "simd.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

// ---- images ---------------------------------------------------------------------------------------------------------------

#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
// Of eight pixels, four from each address, as whole numbers: compilers take many more steps to part bytes that lie by threes.
static STEREOPSIS_INLINE __m256i grey_of_eight(const uint8_t* low, const uint8_t* high) {
  const __m256i rgb = _mm256_inserti128_si256(_mm256_castsi128_si256(_mm_loadu_si128(reinterpret_cast<const __m128i*>(low))),
                                              _mm_loadu_si128(reinterpret_cast<const __m128i*>(high)), 1);
  // Red and green side by side; blue beside a 1 that brings the half to round by.
  const __m256i red_green = _mm256_shuffle_epi8(
      rgb, _mm256_broadcastsi128_si256(_mm_setr_epi8(0, -1, 1, -1, 3, -1, 4, -1, 6, -1, 7, -1, 9, -1, 10, -1)));
  const __m256i blue = _mm256_shuffle_epi8(
      rgb, _mm256_broadcastsi128_si256(_mm_setr_epi8(2, -1, -1, -1, 5, -1, -1, -1, 8, -1, -1, -1, 11, -1, -1, -1)));
  const __m256i sum = _mm256_add_epi32(_mm256_madd_epi16(red_green, _mm256_set1_epi32(19235 << 16 | 9798)),
                                       _mm256_madd_epi16(_mm256_or_si256(blue, _mm256_set1_epi32(1 << 16)),
                                                         _mm256_set1_epi32((1 << 14) << 16 | 3735)));
  return _mm256_srli_epi32(sum, 15);
}
#endif

template <class Sum, class T>
static void grey(const T* STEREOPSIS_RESTRICT rgb, size_t count, T* STEREOPSIS_RESTRICT grey) {
  size_t k = 0;
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
  // Two more pixels have to follow, since 16 bytes are read for four.
  if constexpr (sizeof(T) == 1)
    for (; k + 34 <= count; k += 32) {
      const uint8_t* const from = rgb + 3 * k;
      // Packing works in halves of 128 bits: each gets 16 pixels in a row.
      const __m256i first = _mm256_packs_epi32(grey_of_eight(from, from + 48), grey_of_eight(from + 12, from + 60));
      const __m256i second = _mm256_packs_epi32(grey_of_eight(from + 24, from + 72), grey_of_eight(from + 36, from + 84));
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(grey + k), _mm256_packus_epi16(first, second));
    }
#endif
  for (; k < count; ++k) {
    const Sum sum = Sum{9798} * rgb[3 * k] + Sum{19235} * rgb[3 * k + 1] + Sum{3735} * rgb[3 * k + 2];
    grey[k] = static_cast<T>((sum + (1 << 14)) >> 15);
  }
}

static void halve(const uint8_t* STEREOPSIS_RESTRICT above, const uint8_t* STEREOPSIS_RESTRICT below, int count,
                  uint8_t* STEREOPSIS_RESTRICT means) {
  for (int x = 0; x < count; ++x)
    means[x] = static_cast<uint8_t>((above[2 * x] + above[2 * x + 1] + below[2 * x] + below[2 * x + 1] + 2) >> 2);
}

static void stretch(const int32_t* STEREOPSIS_RESTRICT row, size_t count, double low, double factor,
                    uint8_t* STEREOPSIS_RESTRICT bytes) {
  constexpr double whole = 4503599627370496.0;  // 2^52: from there on, doubles have no fractions
  for (size_t k = 0; k < count; ++k) {
    const double value = (row[k] - low) * factor, positive = value > 0 ? value : 0, within = positive < 255 ? positive : 255;
    bytes[k] = static_cast<uint8_t>(static_cast<int32_t>((within + whole) - whole));
  }
}

template <int C, class T>
static STEREOPSIS_INLINE void between_rows(const T* const* rows, double start, double slope, int begin, int end, T lowest,
                                           float range, T* STEREOPSIS_RESTRICT out) {
  const T *p0 = rows[0], *p1 = rows[1], *p2 = rows[2], *p3 = rows[3];
  for (int x = begin; x < end; ++x) {
    const float part = static_cast<float>(start + slope * x), some = part < 0.0f ? 0.0f : part, t = some > 1.0f ? 1.0f : some;
    const float w0 = t * (t * (2 - t) - 1) * 0.5f, w1 = (t * t * (3 * t - 5) + 2) * 0.5f;
    const float w2 = t * (t * (4 - 3 * t) + 1) * 0.5f, w3 = t * t * (t - 1) * 0.5f;
    for (int i = x * C; i < (x + 1) * C; ++i) {
      // Counted from the lowest value, pixels of up to 24 bits are exact as floats.
      const float a = static_cast<float>(p0[i] - lowest), b = static_cast<float>(p1[i] - lowest);
      const float c = static_cast<float>(p2[i] - lowest), d = static_cast<float>(p3[i] - lowest);
      const float value = w0 * a + w1 * b + w2 * c + w3 * d;
      const float positive = value < 0.0f ? 0.0f : value, kept = positive > range ? range : positive;
      out[i] = static_cast<T>(static_cast<int32_t>(kept + 0.5f) + lowest);
    }
  }
}

template <class T>
static void between(const T* const* rows, double start, double slope, int begin, int end, int channels, T lowest, float range,
                    T* out) {
  if (channels == 1)
    between_rows<1>(rows, start, slope, begin, end, lowest, range, out);
  else
    between_rows<3>(rows, start, slope, begin, end, lowest, range, out);
}

// ---- what the windows of an image hold of texture -------------------------------------------------------------------------

// The absolute difference of a pixel's neighbours in the row.
template <class T>
static STEREOPSIS_INLINE T gradient(T before, T after) {
  const T less = before < after ? before : after, more = before < after ? after : before;
  return static_cast<T>(more - less);
}

template <class T, class Sum>
static void change_gradients(const T* STEREOPSIS_RESTRICT added, const T* STEREOPSIS_RESTRICT removed, int width,
                             Sum* STEREOPSIS_RESTRICT columns) {
  if (width == 1) return;
  // Edge pixels are repeated.
  columns[0] = static_cast<Sum>(columns[0] + gradient(added[0], added[1]) - gradient(removed[0], removed[1]));
  for (int x = 1; x < width - 1; ++x) {
    const Sum more = gradient(added[x - 1], added[x + 1]), less = gradient(removed[x - 1], removed[x + 1]);
    columns[x] = static_cast<Sum>(columns[x] + more - less);
  }
  const int last = width - 1;
  columns[last] = static_cast<Sum>(columns[last] + gradient(added[last - 1], added[last]) - gradient(removed[last - 1], removed[last]));
}

template <class Sum>
static void sum_columns(const Sum* STEREOPSIS_RESTRICT columns, int width, int size, Sum* STEREOPSIS_RESTRICT sums) {
  for (int x = 0; x < width; x += kRowRoom) {
    Sum sum[kRowRoom] = {};
    for (int k = 0; k < size; ++k)
      for (int u = 0; u < kRowRoom; ++u) sum[u] = static_cast<Sum>(sum[u] + columns[x + k + u]);
    std::memcpy(sums + x, sum, sizeof(sum));
  }
}

template <class Sum>
static void refuse_low(const Sum* STEREOPSIS_RESTRICT sums, Sum most, int width, const RowRefusal& refused) {
  float *STEREOPSIS_RESTRICT disparity = refused.disparity, *STEREOPSIS_RESTRICT confidence = refused.confidence;
  uint8_t* STEREOPSIS_RESTRICT flags = refused.flags;
  const uint8_t bit = refused.bit;
  for (int x = 0; x < width; ++x) {
    disparity[x] = sums[x] <= most ? std::numeric_limits<float>::quiet_NaN() : disparity[x];
    confidence[x] = sums[x] <= most ? 0.0f : confidence[x];
  }
  for (int x = 0; x < width; ++x) flags[x] = static_cast<uint8_t>(flags[x] | (sums[x] <= most ? bit : 0));
}

// ---- runs of a map's rows -------------------------------------------------------------------------------------------------

// Which of 64 bytes, each 0 or 1, are set: the first in the lowest bit.
static STEREOPSIS_INLINE uint64_t pack(const uint8_t* bytes) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  const __m512i all = _mm512_loadu_si512(bytes);
  return _mm512_test_epi8_mask(all, all);
#elif STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx2
  const auto half = [&](int from) STEREOPSIS_INLINE_LAMBDA {
    const __m256i values = _mm256_loadu_si256(reinterpret_cast<const __m256i*>(bytes + from));
    return static_cast<uint32_t>(_mm256_movemask_epi8(_mm256_slli_epi16(values, 7)));
  };
  return half(0) | static_cast<uint64_t>(half(32)) << 32;
#else
  uint64_t bits = 0;
  for (int k = 63; k >= 0; --k) bits = bits << 1 | bytes[k];
  return bits;
#endif
}

// Bits [0, width) say what `holds` says of a pixel, those beyond in the last word nothing.
template <class Holds>
static STEREOPSIS_INLINE void each_pixel(int width, uint64_t* STEREOPSIS_RESTRICT bits, const Holds& holds) {
  uint8_t bytes[64];
  int x = 0;
  for (; x + 64 <= width; x += 64) {
    for (int u = 0; u < 64; ++u) bytes[u] = holds(x + u);
    bits[x / 64] = pack(bytes);
  }
  if (x == width) return;
  for (int u = 0; u < 64; ++u) bytes[u] = x + u < width && holds(x + u);
  bits[x / 64] = pack(bytes);
}

static STEREOPSIS_INLINE bool apart_by_at_most(float difference, float a, float b) {
  const float apart = a - b;
  return (apart < 0 ? -apart : apart) <= difference;
}

static void go_on(const float* row, int width, float difference, uint64_t* bits) {
  each_pixel(width - 1, bits, [&](int x) STEREOPSIS_INLINE_LAMBDA {
    const float here = row[x + 1], before = row[x];
    return apart_by_at_most(difference, here, before) | ((here != here) & (before != before));
  });
}

static void have_values(const float* row, int width, uint64_t* bits) {
  each_pixel(width, bits, [&](int x) STEREOPSIS_INLINE_LAMBDA { return row[x] == row[x]; });
}

static void meet(const float* row, const float* above, int width, float difference, uint64_t* bits) {
  each_pixel(width, bits, [&](int x) STEREOPSIS_INLINE_LAMBDA { return apart_by_at_most(difference, row[x], above[x]); });
}

// ---- medians --------------------------------------------------------------------------------------------------------------

// By minima and maxima alone, which vectorise: in order, what has no value coming last, the median is the mean of places
// (n - 1) / 2 and n / 2.
static void median_of_nine(const float* STEREOPSIS_RESTRICT above, const float* STEREOPSIS_RESTRICT here,
                           const float* STEREOPSIS_RESTRICT below, int width, float* STEREOPSIS_RESTRICT filtered) {
  constexpr float last = std::numeric_limits<float>::infinity();
  for (int x = 0; x < width; ++x) {
    float v[9] = {above[x], above[x + 1], above[x + 2], here[x], here[x + 1], here[x + 2], below[x], below[x + 1], below[x + 2]};
    float n = 0;
    for (float& value : v) {
      n += value == value ? 1.0f : 0.0f;
      value = value == value ? value : last;
    }
    const auto order = [&](int i, int k) STEREOPSIS_INLINE_LAMBDA {
      const float a = v[i], b = v[k];
      v[i] = a < b ? a : b;
      v[k] = a < b ? b : a;
    };
    // Floyd's network, whose 25 exchanges sort nine.
    order(0, 1), order(3, 4), order(6, 7), order(1, 2), order(4, 5), order(7, 8), order(0, 1), order(3, 4), order(6, 7);
    order(0, 3), order(3, 6), order(0, 3), order(1, 4), order(4, 7), order(1, 4), order(2, 5), order(5, 8), order(2, 5);
    order(1, 3), order(5, 7), order(2, 6), order(4, 6), order(2, 4), order(2, 3), order(5, 6);
    float lower = v[4], upper = v[4];
    for (int k = 3; k >= 0; --k) {
      lower = n < static_cast<float>(2 * k + 3) ? v[k] : lower;
      upper = n < static_cast<float>(2 * k + 2) ? v[k] : upper;
    }
    const float middle = here[x + 1], median = lower == upper ? lower : 0.5f * (lower + upper);
    filtered[x] = middle == middle ? median : middle;
  }
}

// The lower and the higher one.
static STEREOPSIS_INLINE void order(float& low, float& high) {
  const float a = low, b = high;
  low = a < b ? a : b;
  high = a < b ? b : a;
}

// A knock-out: of so many values the least is the first, from `v` on, or the greatest the last, up to `v`.
template <int Count, int Step = 1, int At = 0>
static STEREOPSIS_INLINE void least_first(float* v) {
  if constexpr (At + Step < Count) {
    order(v[At], v[At + Step]);
    least_first<Count, Step, At + 2 * Step>(v);
  } else if constexpr (Step < Count) {
    least_first<Count, 2 * Step>(v);
  }
}

template <int Count, int Step = 1, int At = 0>
static STEREOPSIS_INLINE void greatest_last(float* v) {
  if constexpr (At + Step < Count) {
    order(v[-At - Step], v[-At]);
    greatest_last<Count, Step, At + 2 * Step>(v);
  } else if constexpr (Step < Count) {
    greatest_last<Count, 2 * Step>(v);
  }
}

// The lower ones of Count values in front.
template <int Count, int At = 0>
static STEREOPSIS_INLINE void halve(float* v) {
  if constexpr (At < Count / 2) {
    order(v[At], v[Count - 1 - At]);
    halve<Count, At + 1>(v);
  }
}

constexpr int kOf25 = 14;  // more than half: their least and greatest are not the median of 25

template <int At = 0, class Value>
static STEREOPSIS_INLINE void collect(float* v, const Value& value) {
  if constexpr (At < kOf25) {
    v[At] = value(At);
    collect<At + 1>(v, value);
  }
}

// The median of 25: of 14 the least and the greatest cannot be it, nor of the 13 that the next one makes of the others, and so on.
template <int Count = kOf25, class Value>
static STEREOPSIS_INLINE float forget(float* v, const Value& value) {
  halve<Count>(v);
  least_first<(Count + 1) / 2>(v);
  greatest_last<(Count + 1) / 2>(v + Count - 1);
  if constexpr (Count == 3) {
    return v[1];
  } else {
    v[0] = value(2 * kOf25 - Count);
    return forget<Count - 1>(v, value);
  }
}

// Columns at once: where one of them lacks a value all take the longer way.
constexpr int kMedians = 32;

static void median_of_25(const float* const* rows, int width, float* STEREOPSIS_RESTRICT filtered) {
  constexpr float far = std::numeric_limits<float>::infinity();
  const float *const r0 = rows[0], *const r1 = rows[1], *const r2 = rows[2], *const r3 = rows[3], *const r4 = rows[4];
  for (int x = 0; x < width; x += kMedians) {
    int holes = 0;
    for (const float* row : {r0, r1, r2, r3, r4})
      for (int u = 0; u < kMedians + 4; ++u) holes += row[x + u] == row[x + u] ? 0 : 1;
    float median[kMedians];
    const auto at = [&](int u, int k) STEREOPSIS_INLINE_LAMBDA {
      const float* const row = k / 5 == 0 ? r0 : k / 5 == 1 ? r1 : k / 5 == 2 ? r2 : k / 5 == 3 ? r3 : r4;
      return row[x + u + k % 5];
    };
    if (holes == 0) {
      for (int u = 0; u < kMedians; ++u) {
        const auto value = [&](int k) STEREOPSIS_INLINE_LAMBDA { return at(u, k); };
        float v[kOf25];
        collect(v, value);
        median[u] = forget(v, value);
      }
    } else {
      for (int u = 0; u < kMedians; ++u) {
        // What has no value stands below all and above all in turn. Of an odd number of these the last one stands once below, once
        // above: the two middle ones of what there is.
        float turn = -far;
        const auto value = [&](int k) STEREOPSIS_INLINE_LAMBDA {
          const float given = at(u, k), end = turn;
          turn = given == given ? end : -end;
          return given == given ? given : end;
        };
        float v[kOf25];
        collect(v, value);
        const float lower = forget(v, value);
        turn = far;
        collect(v, value);
        const float upper = forget(v, value), both = lower == upper ? lower : 0.5f * (lower + upper);
        const float middle = r2[x + u + 2];
        median[u] = middle == middle ? both : middle;
      }
    }
    memcpy(filtered + x, median, (width - x < kMedians ? width - x : kMedians) * sizeof *median);
  }
}

// ---- an image's relief ------------------------------------------------------------------------------------------------------

static void blur(const float* STEREOPSIS_RESTRICT above, const float* STEREOPSIS_RESTRICT here,
                 const float* STEREOPSIS_RESTRICT below, int width, float* STEREOPSIS_RESTRICT line,
                 float* STEREOPSIS_RESTRICT blurred) {
  for (int x = 0; x < width; ++x) line[x + 1] = (above[x] + 2 * here[x] + below[x]) / 4;
  line[0] = line[1];
  line[width + 1] = line[width];
  for (int x = 0; x < width; ++x) blurred[x] = (line[x] + 2 * line[x + 1] + line[x + 2]) / 4;
}

static void steepen(const float* STEREOPSIS_RESTRICT above, const float* STEREOPSIS_RESTRICT here,
                    const float* STEREOPSIS_RESTRICT below, int width, float* STEREOPSIS_RESTRICT line,
                    float* STEREOPSIS_RESTRICT steepest) {
  memcpy(line + 1, here, width * sizeof *line);
  line[0] = line[1];
  line[width + 1] = line[width];
  for (int x = 0; x < width; ++x) {
    const float down = std::fabs(below[x] - above[x]) / 2, across = std::fabs(line[x + 2] - line[x]) / 2;
    const float steeper = down > across ? down : across;
    steepest[x] = steeper > steepest[x] ? steeper : steepest[x];
  }
}

static void quantise(const float* STEREOPSIS_RESTRICT steepest, float calm, float unit, int width,
                     uint8_t* STEREOPSIS_RESTRICT relief) {
  constexpr float whole = 12582912;  // 1.5 2^23: added, it leaves no fraction, and what is half goes to the even one
  for (int x = 0; x < width; ++x) {
    const float level = (steepest[x] - calm) / unit, above = level > 0 ? level : 0, within = above < 255 ? above : 255;
    relief[x] = static_cast<uint8_t>(static_cast<int32_t>(within + whole - whole));
  }
}

// ---- tracked windows: kWide columns side by side, of which the last few count for nothing ---------------------------------

constexpr int kWide = 16;
constexpr double kStill = 0.01;  // pixels: a point that moves less has arrived

// So many bytes of an image from a place on; beyond its end, nothing.
struct Bytes {
  const uint8_t* at;
  uint8_t copy[kWide + 1];

  // `room` says whether all of them are inside the image.
  STEREOPSIS_INLINE Bytes(const uint8_t* from, const uint8_t* end, bool room) : at(from) {
    if (room) return;
    const ptrdiff_t left = end - from;
    for (int u = 0; u <= kWide; ++u) copy[u] = u < left ? from[u] : 0;
    at = copy;
  }
};

static double cornerness(const Windows& windows, int x, int y) {
  const int stride = windows.width, reach = kTrackedColumns / 2, above = windows.rows / 2;
  const uint8_t* const end = windows.left + static_cast<size_t>(windows.height) * stride;
  alignas(64) int16_t counts[kWide];
  for (int u = 0; u < kWide; ++u) counts[u] = u < kTrackedColumns ? -1 : 0;
  int32_t xx = 0, xy = 0, yy = 0;  // at most 15 rows of 13 products of 255 x 255
  for (int v = y - above; v <= y + above; ++v) {
    const uint8_t* const row = windows.left + static_cast<size_t>(v) * stride + x - reach;
    const bool room = end - (row + stride) > kWide;
    const Bytes before(row - 1, end, room), after(row + 1, end, room), higher(row - stride, end, room), lower(row + stride, end, room);
    for (int u = 0; u < kWide; ++u) {
      const int16_t gx = static_cast<int16_t>((after.at[u] - before.at[u]) & counts[u]);
      const int16_t gy = static_cast<int16_t>((lower.at[u] - higher.at[u]) & counts[u]);
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
    }
  }
  const double half = 0.5 * (xx - yy), mixed = xy;
  return 0.5 * (static_cast<double>(xx) + yy) - std::sqrt(half * half + mixed * mixed);
}

// What a step needs of a right window w: its variance times its pixels, and its products with the template and the gradients.
struct Products {
  double squares, value, x, y;
};

// A window of the left image about its mean, and its gradients about theirs.
struct Template {
  int rows;
  float mean;
  double squares, x_value, y_value, xx, xy, yy;
  float value[kMostTrackedRows][kWide], gx[kMostTrackedRows][kWide], gy[kMostTrackedRows][kWide];
};

// kWide numbers side by side.
struct Wide {
  static constexpr int parts = kWide / Simd::lanes;
  Simd::F part[parts];

  static STEREOPSIS_INLINE Wide all(float value) {
    Wide r;
    for (int k = 0; k < parts; ++k) r.part[k] = Simd::set(value);
    return r;
  }
  static STEREOPSIS_INLINE Wide load(const float* from) {
    Wide r;
    for (int k = 0; k < parts; ++k) r.part[k] = Simd::load(from + k * Simd::lanes);
    return r;
  }
  static STEREOPSIS_INLINE Wide load(const uint8_t* from) {
    Wide r;
    for (int k = 0; k < parts; ++k) {
      const uint8_t* const at = from + k * Simd::lanes;
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
      r.part[k] = Simd::to_float(_mm512_cvtepu8_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(at))));
#elif STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx2
      r.part[k] = Simd::to_float(_mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(at))));
#else
      for (int i = 0; i < Simd::lanes; ++i) r.part[k].v[i] = static_cast<float>(at[i]);
#endif
    }
    return r;
  }
  STEREOPSIS_INLINE void store(float* to) const {
    for (int k = 0; k < parts; ++k) Simd::store(to + k * Simd::lanes, part[k]);
  }
  STEREOPSIS_INLINE Wide operator+(const Wide& other) const {
    Wide r;
    for (int k = 0; k < parts; ++k) r.part[k] = Simd::add(part[k], other.part[k]);
    return r;
  }
  STEREOPSIS_INLINE Wide operator-(const Wide& other) const {
    Wide r;
    for (int k = 0; k < parts; ++k) r.part[k] = Simd::sub(part[k], other.part[k]);
    return r;
  }
  STEREOPSIS_INLINE Wide operator*(const Wide& other) const {
    Wide r;
    for (int k = 0; k < parts; ++k) r.part[k] = Simd::mul(part[k], other.part[k]);
    return r;
  }
  // Of the window's columns: halves are laid upon each other until one is left, in all builds alike.
  STEREOPSIS_INLINE double total() const {
    float column[kWide];
    store(column);
    float eight[8], four[4];
    for (int u = 0; u < 8; ++u) eight[u] = u + 8 < kTrackedColumns ? column[u] + column[u + 8] : column[u];
    for (int u = 0; u < 4; ++u) four[u] = eight[u] + eight[u + 4];
    return (four[0] + four[2]) + (four[1] + four[3]);
  }
};

static void take(const Windows& windows, int x, int y, Template& mine) {
  const int stride = windows.width, reach = kTrackedColumns / 2;
  const uint8_t* const end = windows.left + static_cast<size_t>(windows.height) * stride;
  const Wide zero = Wide::all(0), half = Wide::all(0.5f);
  Wide value = zero, gx = zero, gy = zero;
  mine.rows = windows.rows;
  for (int v = 0; v < mine.rows; ++v) {
    const uint8_t* const at = windows.left + static_cast<size_t>(y - mine.rows / 2 + v) * stride + x - reach;
    const bool room = end - (at + stride) > kWide;
    const Bytes here(at, end, room), before(at - 1, end, room), after(at + 1, end, room);
    const Bytes higher(at - stride, end, room), lower(at + stride, end, room);
    const Wide t = Wide::load(here.at);
    const Wide a = half * (Wide::load(after.at) - Wide::load(before.at)), b = half * (Wide::load(lower.at) - Wide::load(higher.at));
    t.store(mine.value[v]);
    a.store(mine.gx[v]);
    b.store(mine.gy[v]);
    value = value + t;
    gx = gx + a;
    gy = gy + b;
  }
  const double pixels = static_cast<double>(kTrackedColumns) * mine.rows;
  const auto mean = [&](const Wide& sums) STEREOPSIS_INLINE_LAMBDA { return static_cast<float>(sums.total() / pixels); };
  mine.mean = mean(value);
  const Wide mean_value = Wide::all(mine.mean), mean_x = Wide::all(mean(gx)), mean_y = Wide::all(mean(gy));
  Wide squares = zero, x_value = zero, y_value = zero, xx = zero, xy = zero, yy = zero;
  for (int v = 0; v < mine.rows; ++v) {
    const Wide t = Wide::load(mine.value[v]) - mean_value, a = Wide::load(mine.gx[v]) - mean_x, b = Wide::load(mine.gy[v]) - mean_y;
    t.store(mine.value[v]);
    a.store(mine.gx[v]);
    b.store(mine.gy[v]);
    squares = squares + t * t;
    x_value = x_value + a * t;
    y_value = y_value + b * t;
    xx = xx + a * a;
    xy = xy + a * b;
    yy = yy + b * b;
  }
  mine.squares = squares.total();
  mine.x_value = x_value.total();
  mine.y_value = y_value.total();
  mine.xx = xx.total();
  mine.xy = xy.total();
  mine.yy = yy.total();
}

// The right window at (x, y), straight lines between pixels; false where it leaves the image.
static bool compare(const Windows& windows, const Template& mine, double x, double y, Products& found) {
  const int reach = kTrackedColumns / 2, above = mine.rows / 2, width = windows.width, height = windows.height;
  if (!(x >= reach && x <= width - 1 - reach && y >= above && y <= height - 1 - above)) return false;
  const int last_left = width - 2 - reach, last_top = height - 2 - above;
  const int left = static_cast<int>(x) < last_left ? static_cast<int>(x) : last_left;
  const int top = static_cast<int>(y) < last_top ? static_cast<int>(y) : last_top;
  const float s = static_cast<float>(x - left), t = static_cast<float>(y - top);
  const Wide mean = Wide::all(mine.mean), w0 = Wide::all(1 - s), w1 = Wide::all(s), h0 = Wide::all(1 - t), h1 = Wide::all(t);
  const uint8_t* const end = windows.right + static_cast<size_t>(height) * width;
  // The columns of a row of pixels, moved; a row's lower neighbour is the next row's upper one.
  const auto row = [&](int v) STEREOPSIS_INLINE_LAMBDA {
    const uint8_t* const at = windows.right + static_cast<size_t>(top - above + v) * width + left - reach;
    const Bytes here(at, end, end - at > kWide);
    return w0 * Wide::load(here.at) + w1 * Wide::load(here.at + 1);
  };
  const Wide zero = Wide::all(0);
  Wide sum = zero, squares = zero, by_value = zero, by_x = zero, by_y = zero, upper = row(0);
  for (int v = 0; v < mine.rows; ++v) {
    const Wide lower = row(v + 1), w = h0 * upper + h1 * lower - mean;
    sum = sum + w;
    squares = squares + w * w;
    by_value = by_value + w * Wide::load(mine.value[v]);
    by_x = by_x + w * Wide::load(mine.gx[v]);
    by_y = by_y + w * Wide::load(mine.gy[v]);
    upper = lower;
  }
  const double all = sum.total();
  found = {squares.total() - all * all / (static_cast<double>(kTrackedColumns) * mine.rows), by_value.total(), by_x.total(),
           by_y.total()};
  return true;
}

static STEREOPSIS_INLINE double at_most_one(double step) {
  const double least = step < -1.0 ? -1.0 : step;
  return least > 1.0 ? 1.0 : least;
}

static void track(const Windows& windows, int x, int y, int iterations, double* motion, double* correlation) {
  Template mine;
  take(windows, x, y, mine);
  const double determinant = mine.xx * mine.yy - mine.xy * mine.xy;
  if (!(determinant > 1e-9 * mine.xx * mine.yy)) return;
  double u = motion[0], v = motion[1], moved = 1;
  for (int step = 0; step <= iterations; ++step) {
    Products seen;
    if (!compare(windows, mine, x + u, y + v, seen) || !(seen.squares > 0)) break;
    if (step == iterations || moved < kStill) {
      *correlation = seen.value / std::sqrt(seen.squares * mine.squares);
      break;
    }
    const double gain = seen.value / seen.squares, ex = mine.x_value - gain * seen.x, ey = mine.y_value - gain * seen.y;
    const double du = at_most_one((mine.yy * ex - mine.xy * ey) / determinant);
    const double dv = at_most_one((mine.xx * ey - mine.xy * ex) / determinant);
    moved = std::fabs(du) < std::fabs(dv) ? std::fabs(dv) : std::fabs(du);
    u += du;
    v += dv;
  }
  motion[0] = u;
  motion[1] = v;
}

}  // namespace

extern const RowKernels rows;
const RowKernels rows = {grey<int32_t, uint8_t>,
                         grey<int64_t, int32_t>,
                         halve,
                         stretch,
                         between<uint8_t>,
                         between<int32_t>,
                         {change_gradients, sum_columns, refuse_low},
                         {change_gradients, sum_columns, refuse_low},
                         go_on,
                         have_values,
                         meet,
                         median_of_nine,
                         median_of_25,
                         blur,
                         steepen,
                         quantise,
                         cornerness,
                         track};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
