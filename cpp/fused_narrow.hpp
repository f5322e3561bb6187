// The streaming kernel for 8-bit images, compiled once per instruction set.
//
// For every candidate i of every pixel x, `sums` holds minus the window's sum of (l - 128) r (or, for SAD, plus its
// sum of |l - r|). From one row to the next the window gains a row and loses one; what that changes slides along x in
// `slide`: one column in, one column out. Four bytes of the right image (new and old row, entering and leaving column)
// sit side by side, so that a single multiply-add of four bytes does all of it. The right image is kept mirrored, so
// that candidates are contiguous. Nothing but integers up to here: exact, and the same for any order of summation.
//
// Only `static` and unnamed things here: an inline function with linkage might be taken from this unit by another one
// that runs on a lesser machine.
#pragma once

#include <cstring>
#include <initializer_list>
#include <limits>

#include "arena.hpp"
#include "fused.hpp"
#include "score.hpp"
#include "simd.hpp"
#include "winners.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

using I = Simd::I;
using F = Simd::F;
using M = Simd::M;
constexpr int kLanes = Simd::lanes;
constexpr int kBlock = Simd::block;
constexpr int kSmallBlock = kBlock / 2;
constexpr int kChunk = 16;  // pixels whose costs are kept until their winners are taken
static_assert(kChunk >= kLanes && kChunk <= static_cast<int>(kSpareBits) + 1, "see take_right_winners");

static STEREOPSIS_INLINE int clamp(int v, int lo, int hi) { return v < lo ? lo : v > hi ? hi : v; }
static STEREOPSIS_INLINE int least(int a, int b) { return a < b ? a : b; }
static STEREOPSIS_INLINE int most(int a, int b) { return a > b ? a : b; }
static STEREOPSIS_INLINE int32_t pack16(int low, int high) {
  return static_cast<int32_t>((static_cast<uint32_t>(low) & 0xFFFF) | (static_cast<uint32_t>(high) << 16));
}
static STEREOPSIS_INLINE int32_t pack8(int a, int b, int c, int d) {
  return static_cast<int32_t>((static_cast<uint32_t>(a) & 255) | (static_cast<uint32_t>(b) & 255) << 8 |
                              (static_cast<uint32_t>(c) & 255) << 16 | (static_cast<uint32_t>(d) & 255) << 24);
}

// ---- row loops: plain, over pointers that do not overlap, so that every compiler vectorises them --------------------

// The row with its edge pixels repeated: `before` times to the left, up to `length` in all.
static void pad_row(const uint8_t* STEREOPSIS_RESTRICT row, int width, int before, int length,
                    uint8_t* STEREOPSIS_RESTRICT padded) {
  std::memset(padded, row[0], before);
  std::memcpy(padded + before, row, width);
  std::memset(padded + before + width, row[width - 1], length - before - width);
}

static void reverse_row(const uint8_t* STEREOPSIS_RESTRICT row, int count, uint8_t* STEREOPSIS_RESTRICT reversed) {
  for (int j = 0; j < count; ++j) reversed[j] = row[count - 1 - j];
}

static void interleave(const uint8_t* STEREOPSIS_RESTRICT entering, const uint8_t* STEREOPSIS_RESTRICT leaving, int apart,
                       int count, int32_t* STEREOPSIS_RESTRICT quad) {
  for (int j = 0; j + kLanes <= count; j += kLanes)
    Simd::store(quad + j, Simd::quads(entering + j, entering + j + apart, leaving + j, leaving + j + apart));
  for (int j = count / kLanes * kLanes; j < count; ++j)
    quad[j] = pack8(entering[j], entering[j + apart], leaving[j], leaving[j + apart]);
}

static void add_columns(const uint8_t* STEREOPSIS_RESTRICT entering, const uint8_t* STEREOPSIS_RESTRICT leaving, int we,
                        int wl, int count, int32_t* STEREOPSIS_RESTRICT column, int32_t* STEREOPSIS_RESTRICT square) {
  for (int x = 0; x < count; ++x) {
    const int a = entering[x], b = leaving[x];
    column[x] += we * a + wl * b;
    square[x] += we * a * a + wl * b * b;
  }
}

// The weights of one column's four bytes, for products: entering and leaving row, here and a window's width earlier.
static STEREOPSIS_INLINE void product_weights(int en, int tn, int el, int tl, int we, int wl, int older, int32_t* a,
                                              int32_t* b) {
  const int w0 = -we * (en - kCentre), w1 = older * we * (tn - kCentre);
  const int w2 = -wl * (el - kCentre), w3 = older * wl * (tl - kCentre);
  if (Simd::has_dot8) {
    // +128 does not fit a signed byte: the one too many goes into a second, rarely needed, multiply-add.
    *a = pack8(w0 - (w0 > 127), w1 - (w1 > 127), w2 - (w2 > 127), w3 - (w3 > 127));
    *b = pack8(w0 > 127, w1 > 127, w2 > 127, w3 > 127);
  } else {
    *a = pack16(w0, w2);
    *b = pack16(w1, w3);
  }
}

static void weigh_products(const uint8_t* STEREOPSIS_RESTRICT entering, const uint8_t* STEREOPSIS_RESTRICT leaving, int we,
                           int wl, int apart, int count, int32_t* STEREOPSIS_RESTRICT a, int32_t* STEREOPSIS_RESTRICT b) {
  for (int k = 0; k < least(apart, count); ++k)
    product_weights(entering[k], 0, leaving[k], 0, we, wl, 0, a + k, b + k);
  for (int k = apart; k < count; ++k)
    product_weights(entering[k], entering[k - apart], leaving[k], leaving[k - apart], we, wl, 1, a + k, b + k);
}

// For absolute differences: the left bytes, and the signs of the four differences.
static void weigh_differences(const uint8_t* STEREOPSIS_RESTRICT entering, const uint8_t* STEREOPSIS_RESTRICT leaving,
                              int we, int wl, int apart, int count, int32_t* STEREOPSIS_RESTRICT a,
                              int32_t* STEREOPSIS_RESTRICT b) {
  for (int k = 0; k < count; ++k) {
    const int older = k >= apart ? k - apart : 0, sign = k >= apart ? -1 : 0;
    a[k] = pack8(entering[k], entering[older], leaving[k], leaving[older]);
    b[k] = Simd::has_dot8 ? pack8(we, sign * we, wl, sign * wl) : pack16(sign * we, sign * wl);
  }
}

static void pad_columns(const int32_t* STEREOPSIS_RESTRICT column, int width, int before, int length, bool reversed,
                        int32_t* STEREOPSIS_RESTRICT padded) {
  if (reversed)
    for (int x = 0; x < width; ++x) padded[before + x] = column[width - 1 - x];
  else
    std::memcpy(padded + before, column, width * sizeof *column);
  for (int k = 0; k < before; ++k) padded[k] = padded[before];
  for (int k = before + width; k < length; ++k) padded[k] = padded[before + width - 1];
}

// Two window sums at once: each vector of them waits for the one before.
static void slide_sums(const int32_t* STEREOPSIS_RESTRICT a, const int32_t* STEREOPSIS_RESTRICT b, int window, int count,
                       int32_t* STEREOPSIS_RESTRICT sums_a, int32_t* STEREOPSIS_RESTRICT sums_b) {
  int32_t sum_a = 0, sum_b = 0;
  for (int k = 0; k < window; ++k) {
    sum_a += a[k];
    sum_b += b[k];
  }
  sums_a[0] = sum_a;
  sums_b[0] = sum_b;
  int x = 1;
  I before_a = Simd::set(sum_a), before_b = Simd::set(sum_b);
  for (; x + kLanes <= count; x += kLanes) {
    const auto next = [&](const int32_t* column, I before) STEREOPSIS_INLINE_LAMBDA {
      return Simd::add(before, Simd::running_sum(Simd::sub(Simd::load(column + x + window - 1), Simd::load(column + x - 1))));
    };
    const I new_a = next(a, before_a), new_b = next(b, before_b);
    Simd::store(sums_a + x, new_a);
    Simd::store(sums_b + x, new_b);
    before_a = Simd::last(new_a);
    before_b = Simd::last(new_b);
  }
  for (; x < count; ++x) {
    sums_a[x] = sums_a[x - 1] + a[x + window - 1] - a[x - 1];
    sums_b[x] = sums_b[x - 1] + b[x + window - 1] - b[x - 1];
  }
}

static void inverse_roots(const float* STEREOPSIS_RESTRICT norm, int count, float least_norm,
                          float* STEREOPSIS_RESTRICT scale) {
  for (int x = 0; x < count; ++x) scale[x] = inverse_root(norm[x], least_norm);
}

static void add_energy(const int32_t* STEREOPSIS_RESTRICT squares, int count, bool first, float* STEREOPSIS_RESTRICT norm) {
  for (int x = 0; x < count; ++x) norm[x] = (first ? 0.0f : norm[x]) + static_cast<float>(squares[x]);
}

static void add_offset(const int32_t* STEREOPSIS_RESTRICT sums, const int32_t* STEREOPSIS_RESTRICT squares, int count,
                       bool first, int of_sums, int of_squares, int32_t* STEREOPSIS_RESTRICT offset) {
  for (int x = 0; x < count; ++x)
    offset[x] = (first ? 0 : offset[x]) + of_sums * sums[x] + of_squares * squares[x];
}

// Means, what they leave over, and the squared deviations about them.
static void moments(const int32_t* STEREOPSIS_RESTRICT sums, const int32_t* STEREOPSIS_RESTRICT squares, int count,
                    int32_t n, float inverse_n, int32_t* STEREOPSIS_RESTRICT mean, int32_t* STEREOPSIS_RESTRICT rest,
                    int32_t* STEREOPSIS_RESTRICT about) {
  for (int x = 0; x < count; ++x) {
    const int32_t q = nearest_mean(sums[x], inverse_n), left_over = sums[x] - n * q;
    mean[x] = q;
    rest[x] = left_over;
    about[x] = squares[x] - q * (sums[x] + left_over);
  }
}

static void add_deviation(const int32_t* STEREOPSIS_RESTRICT sums, const int32_t* STEREOPSIS_RESTRICT squares, int count,
                          double inverse_n, bool first, float* STEREOPSIS_RESTRICT norm) {
  for (int x = 0; x < count; ++x) norm[x] = (first ? 0.0f : norm[x]) + window_deviation(squares[x], sums[x], inverse_n);
}

static void split_means(const int32_t* STEREOPSIS_RESTRICT sums, int count, int32_t centre, double inverse_n, bool one_channel,
                        float* STEREOPSIS_RESTRICT high, float* STEREOPSIS_RESTRICT low) {
  for (int x = 0; x < count; ++x) {
    const SplitMean mean = SplitMean::of(sums[x] - centre, inverse_n, one_channel);
    high[x] = mean.high;
    low[x] = mean.low;
  }
}

// For one channel: what the second part of its mean is worth, and where `cost` adds it.
static void mend_means(const int32_t* STEREOPSIS_RESTRICT sums, const float* STEREOPSIS_RESTRICT scale, int count,
                       float* STEREOPSIS_RESTRICT low) {
  for (int x = 0; x < count; ++x) low[x] = SplitMean::mended(low[x], sums[x], scale[x]);
}

static void centre_left(const int32_t* STEREOPSIS_RESTRICT mean, const int32_t* STEREOPSIS_RESTRICT rest, int count,
                        int32_t* STEREOPSIS_RESTRICT mean_weight, int32_t* STEREOPSIS_RESTRICT rest_weight,
                        float* STEREOPSIS_RESTRICT whole_rest) {
  for (int x = 0; x < count; ++x) {
    mean_weight[x] = pack16(mean[x] - kCentre, (mean[x] - kCentre) * 256);
    rest_weight[x] = pack16(rest[x], 0);
    whole_rest[x] = static_cast<float>(rest[x]);
  }
}

static void split_right(const int32_t* STEREOPSIS_RESTRICT sums, const int32_t* STEREOPSIS_RESTRICT mean, int count,
                        int32_t* STEREOPSIS_RESTRICT split, int32_t* STEREOPSIS_RESTRICT mean_pair) {
  for (int x = 0; x < count; ++x) {
    split[x] = pack16(sums[x] & 255, sums[x] >> 8);
    mean_pair[x] = pack16(mean[x], 0);
  }
}

static void to_floats(const int32_t* STEREOPSIS_RESTRICT from, int count, float* STEREOPSIS_RESTRICT to) {
  for (int x = 0; x < count; ++x) to[x] = static_cast<float>(from[x]);
}

template <class T>
static void fill(T value, int count, T* STEREOPSIS_RESTRICT values) {
  for (int x = 0; x < count; ++x) values[x] = value;
}

static void count_from(int first, int count, int32_t* STEREOPSIS_RESTRICT values) {
  for (int x = 0; x < count; ++x) values[x] += first + x;
}

// Which rows a pass adds to the sums (+1) and takes from them (-1); 0 leaves one out.
struct RowChange {
  int entering, entering_weight, leaving, leaving_weight;
};

template <class Scalar>
struct VectorOf {
  using type = I;
};
template <>
struct VectorOf<float> {
  using type = F;
};

template <CostKind Kind>
struct Traits {
  // A correlation's candidates carry their vector's number in their spare bits: one minimum finds cost and place.
  static constexpr bool keyed = Kind == CostKind::ncc || Kind == CostKind::zncc;
  static constexpr bool is_float = Kind == CostKind::zssd || Kind == CostKind::ncc || Kind == CostKind::zncc;
  static constexpr bool squares = Kind != CostKind::sad;
  static constexpr bool normalised = Kind == CostKind::ncc || Kind == CostKind::zncc;
  static constexpr bool centred = Kind == CostKind::zssd || Kind == CostKind::zncc;
  using Scalar = typename std::conditional<is_float, float, int32_t>::type;
  static constexpr Scalar worst = keyed ? static_cast<Scalar>(kWorstKept) : worst_cost<Scalar>();
};

template <CostKind Kind, int C>
class Narrow {
  using T = Traits<Kind>;
  using Scalar = typename T::Scalar;
  using Vector = typename VectorOf<Scalar>::type;

 public:
  Narrow(const Pair& pair, const FusedSettings& settings, void* memory)
      : p_(pair), s_(settings), arena_{static_cast<char*>(memory)} {
    const int w = s_.window.width;
    vectors_ = (p_.count + kLanes - 1) / kLanes;
    padded_ = vectors_ * kLanes;
    columns_ = p_.width + w - 1;
    quads_ = columns_ + padded_;
    stats_ = p_.width + padded_;
    n_ = static_cast<int32_t>(s_.window.area());
    inverse_n_ = 1.0f / static_cast<float>(n_);
    sums_ = arena_.template take<int32_t>(static_cast<size_t>(p_.width) * padded_);
    slide_ = arena_.template take<int32_t>(padded_);
    costs_ = arena_.template take<Scalar>(static_cast<size_t>(kChunk) * stride() + kChunk);
    best_ = arena_.template take<Scalar>(static_cast<size_t>(kChunk) * padded_);
    best_index_ = arena_.template take<int32_t>(kChunk * kLanes);
    index_ = arena_.template take<int32_t>(padded_);
    for (int c = 0; c < C; ++c) {
      quad_[c] = arena_.template take<int32_t>(quads_);
      weight_a_[c] = arena_.template take<int32_t>(columns_);
      weight_b_[c] = arena_.template take<int32_t>(columns_);
      left_column_[c] = arena_.template take<int32_t>(p_.width);
      left_square_[c] = arena_.template take<int32_t>(p_.width);
      right_column_[c] = arena_.template take<int32_t>(p_.width);
      right_square_[c] = arena_.template take<int32_t>(p_.width);
      left_mean_[c] = arena_.template take<int32_t>(p_.width);
      left_rest_[c] = arena_.template take<int32_t>(p_.width);
      left_high_[c] = arena_.template take<float>(p_.width);
      left_low_[c] = arena_.template take<float>(p_.width);
      right_split_[c] = arena_.template take<int32_t>(stats_);
      right_mean_[c] = arena_.template take<int32_t>(stats_);
      right_sum_[c] = arena_.template take<float>(stats_);
    }
    left_scale_ = arena_.template take<float>(p_.width);
    right_scale_ = arena_.template take<float>(stats_);
    left_offset_ = arena_.template take<int32_t>(p_.width);
    right_offset_ = arena_.template take<int32_t>(stats_);
    norm_ = arena_.template take<float>(p_.width);
    edge_ = arena_.template take<int32_t>(columns_);
    edge_square_ = arena_.template take<int32_t>(columns_);
    sum_ = arena_.template take<int32_t>(p_.width);
    square_ = arena_.template take<int32_t>(p_.width);
    mean_ = arena_.template take<int32_t>(p_.width);
    rest_ = arena_.template take<int32_t>(p_.width);
    about_ = arena_.template take<int32_t>(p_.width);
    padded_new_ = arena_.template take<uint8_t>(columns_);
    padded_old_ = arena_.template take<uint8_t>(columns_);
    mirrored_new_ = arena_.template take<uint8_t>(quads_ + w);
    mirrored_old_ = arena_.template take<uint8_t>(quads_ + w);
    plane_ = arena_.template take<uint8_t>(4 * static_cast<size_t>(p_.width));
    right_best_ = arena_.template take<Scalar>(stats_ + 2 * kChunk);
    right_index_ = arena_.template take<int32_t>(stats_ + 2 * kChunk);
    claims_ = arena_.template take<int32_t>(2 * p_.width + 1);
    winner_ = arena_.template take<int32_t>(p_.width + kChunk);  // these two chunk by chunk, beyond the width
    cost_ = arena_.template take<Scalar>(p_.width + kChunk);
    before_ = arena_.template take<Scalar>(p_.width);
    after_ = arena_.template take<Scalar>(p_.width);
    second_ = arena_.template take<Scalar>(p_.width);
  }

  size_t bytes() const { return arena_.used; }

  void rows(const FusedOutput& out, int begin, int end, const Cancel& cancel) {
    // All but the sums, which the first pass sets.
    char* const rest = reinterpret_cast<char*>(slide_);
    std::memset(rest, 0, arena_.used - (rest - arena_.base));
    for (int i = 0; i < padded_; ++i) index_[i] = i;
    for (size_t i = 0; i < kChunk * stride() + kChunk; ++i) costs_[i] = T::worst;
    // The sums of the row before the first one: its window's rows, two a pass.
    const int top = begin - 1 - s_.window.above();
    for (int y = top; y < top + s_.window.height; y += 2) {
      const bool two = y + 1 < top + s_.window.height;
      change_rows({inside(y), 1, inside(two ? y + 1 : y), two ? 1 : 0});
      accumulate(y == top);
      if (cancel.load(std::memory_order_relaxed)) return;
    }
    for (int y = begin; y < end; ++y) {
      if (cancel.load(std::memory_order_relaxed)) return;
      change_rows({inside(y + s_.window.below()), 1, inside(y - 1 - s_.window.above()), -1});
      window_statistics();
      volume_row_ = out.volume ? out.volume + static_cast<size_t>(y) * p_.width * p_.count : nullptr;
      match_row();
      finish_row(out, y);
    }
  }

 private:
  // Between the kept costs of two pixels: room on both sides for what is next to them. With the left-right check one less than whole
  // vectors, so that the candidates of a right pixel lie whole vectors apart; the rooms overlap then.
  size_t stride() const { return padded_ + 2 * kChunk - (s_.left_right ? 1 : 0); }
  int inside(int y) const { return clamp(y, 0, p_.height - 1); }

  // ---- what a pass over a row needs -------------------------------------------------------------------------------

  static const uint8_t* plane_of(const uint8_t* row, int width, int c, uint8_t* buffer) {
    if (C == 1) return row;
    for (int x = 0; x < width; ++x) buffer[x] = row[static_cast<size_t>(x) * C + c];
    return buffer;
  }

  STEREOPSIS_NOINLINE void change_rows(const RowChange& change) {
    const size_t pitch = static_cast<size_t>(p_.width) * C;
    const uint8_t* left = static_cast<const uint8_t*>(p_.left);
    const uint8_t* right = static_cast<const uint8_t*>(p_.right);
    const int W = p_.width, w = s_.window.width, we = change.entering_weight, wl = change.leaving_weight;
    sad_even_ = pack16(we, wl);
    for (int c = 0; c < C; ++c) {
      const uint8_t* ln = plane_of(left + change.entering * pitch, W, c, plane_);
      const uint8_t* lo = plane_of(left + change.leaving * pitch, W, c, plane_ + W);
      const uint8_t* rn = plane_of(right + change.entering * pitch, W, c, plane_ + 2 * W);
      const uint8_t* ro = plane_of(right + change.leaving * pitch, W, c, plane_ + 3 * W);
      if (T::squares) {
        add_columns(ln, lo, we, wl, W, left_column_[c], left_square_[c]);
        add_columns(rn, ro, we, wl, W, right_column_[c], right_square_[c]);
      }
      pad_row(ln, W, s_.window.left(), columns_, padded_new_);
      pad_row(lo, W, s_.window.left(), columns_, padded_old_);
      if (T::squares)
        weigh_products(padded_new_, padded_old_, we, wl, w, columns_, weight_a_[c], weight_b_[c]);
      else
        weigh_differences(padded_new_, padded_old_, we, wl, w, columns_, weight_a_[c], weight_b_[c]);
      mirror(rn, mirrored_new_);
      mirror(ro, mirrored_old_);
      interleave(mirrored_new_, mirrored_old_, w, quads_, quad_[c]);
    }
  }

  // mirrored[j] is the right pixel that candidate i of padded column k meets, where j = columns - 1 - k + i.
  void mirror(const uint8_t* row, uint8_t* mirrored) const {
    const int W = p_.width, length = quads_ + s_.window.width;
    const int last = W - 1 + s_.window.right() - p_.first;  // right column of j = 0
    const int in = clamp(last - (W - 1), 0, length), out = clamp(last + 1, in, length);
    std::memset(mirrored, row[W - 1], in);
    reverse_row(row + (last - out + 1), out - in, mirrored + in);
    std::memset(mirrored + out, row[0], length - out);
  }

  // ---- the sliding sums -------------------------------------------------------------------------------------------

  // What one column brings to, and takes from, the change of the sums.
  struct Column {
    const int32_t *quad[C], *weight_a[C], *weight_b[C];
    I a[C], b[C], even;

    STEREOPSIS_INLINE void load() {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        a[c] = Simd::set(*weight_a[c]);
        b[c] = Simd::set(*weight_b[c]);
      });
    }
    // Whether `advance` leaves something to `b`.
    STEREOPSIS_INLINE bool extra() const {
      int any = 0;
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA { any |= *weight_b[c]; });
      return any != 0;
    }
    STEREOPSIS_INLINE void step() {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        --quad[c];
        ++weight_a[c];
        ++weight_b[c];
      });
    }
  };

  STEREOPSIS_INLINE Column column(int k, int at = 0) const {
    Column col;
    col.even = Simd::set(sad_even_);
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      col.quad[c] = quad_[c] + (columns_ - 1 - k) + at;
      col.weight_a[c] = weight_a_[c] + k;
      col.weight_b[c] = weight_b_[c] + k;
    });
    return col;
  }

  static STEREOPSIS_INLINE I advance(I h, const Column& col, int at) {
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      const I v = Simd::load(col.quad[c] + at);
      if constexpr (T::squares) {
        h = multiply_add(h, v, col.a[c], col.b[c]);
      } else {
        const I d = Simd::abs_diff8(v, col.a[c]);
        if constexpr (Simd::has_dot8)
          h = multiply_add(h, d, col.b[c], col.b[c]);
        else
          h = multiply_add(h, d, col.even, col.b[c]);
      }
    });
    return h;
  }

  static STEREOPSIS_INLINE I multiply_add(I h, I v, I a, [[maybe_unused]] I b) {
#if STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx512vnni
    return Simd::dot8(h, v, a);
#else
    return Simd::dot16(Simd::dot16(h, Simd::even_bytes(v), a), Simd::odd_bytes(v), b);
#endif
  }

  // The part of a column's weights that did not fit `advance`; see `product_weights`.
  template <int N>
  static STEREOPSIS_INLINE void advance_extra([[maybe_unused]] I (&h)[N], [[maybe_unused]] const Column& col) {
#if STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx512vnni
    if (T::squares && col.extra())
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
          h[v] = Simd::dot8(h[v], Simd::load(col.quad[c] + v * kLanes), col.b[c]);
        });
      });
#endif
  }

  // Calls visit(a block's length, its first candidate): as many vectors as fit the registers, then fewer.
  template <class Visit>
  void each_block(Visit visit) const {
    for (int v = 0; v < vectors_; v += block_size(vectors_ - v)) {
      const int size = block_size(vectors_ - v), at = v * kLanes;
      if (size == kBlock)
        visit(Constant<kBlock>{}, at);
      else if (size == kSmallBlock)
        visit(Constant<kSmallBlock>{}, at);
      else
        visit(Constant<1>{}, at);
    }
  }

  // The columns before those that the first pixel's window brings in.
  void prime_slide() {
    each_block([&](auto size, int at) {
      I h[size];
      for (auto& v : h) v = Simd::set(0);
      slide_on<size>(h, 0, s_.window.width - 1, at, [](auto&) STEREOPSIS_INLINE_LAMBDA {});
    });
  }

  // Adds a row's change to the sums of all pixels, which are nothing before the first.
  void accumulate(bool first) {
    prime_slide();
    each_block([&](auto size, int at) {
      I h[size];
      unrolled<size>([&](auto v) STEREOPSIS_INLINE_LAMBDA { h[v] = Simd::load(slide_ + at + v * kLanes); });
      int32_t* sums = sums_ + at;
      slide_on<size>(h, s_.window.width - 1, p_.width, at, [&](auto& change) STEREOPSIS_INLINE_LAMBDA {
        unrolled<size>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
          int32_t* const sum = sums + v.value * kLanes;
          Simd::store(sum, first ? change[v] : Simd::add(Simd::load(sum), change[v]));
        });
        sums += padded_;
      });
    });
  }

  // Lets `count` columns in, from column k on, and visits what has changed after each.
  template <int N, class Visit>
  STEREOPSIS_INLINE void slide_on(I (&h)[N], int k, int count, int at, Visit visit) {
    Column col = column(k, at);
    for (int step = 0; step < count; ++step) {
      col.load();
      advance_extra(h, col);
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { h[v] = advance(h[v], col, v.value * kLanes); });
      visit(h);
      col.step();
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(slide_ + at + v * kLanes, h[v]); });
  }

  // ---- window statistics ------------------------------------------------------------------------------------------

  STEREOPSIS_NOINLINE void window_statistics() {
    if (!T::squares) return;
    // Right statistics lie mirrored: pixel x - d of candidate i at [width - 1 - x + i].
    const int from = most(0, p_.first), to = least(p_.width, stats_ + p_.first);
    for (int c = 0; c < C; ++c) {
      sum_windows(left_column_[c], left_square_[c], false);
      describe_left(c);
    }
    const float least = least_norm(Kind, n_, C);
    if (T::normalised) inverse_roots(norm_, p_.width, least, left_scale_);
    if (Kind == CostKind::zncc && C == 1) mend_means(sum_, left_scale_, p_.width, left_low_[0]);
    for (int c = 0; c < C; ++c) {
      sum_windows(right_column_[c], right_square_[c], true);
      describe_right(c, from, to - from, from - p_.first);
    }
    if (T::normalised) inverse_roots(norm_ + from, to - from, least, right_scale_ + from - p_.first);
  }

  void sum_windows(const int32_t* column, const int32_t* square, bool reversed) {
    const int W = p_.width, w = s_.window.width, before = reversed ? s_.window.right() : s_.window.left();
    pad_columns(column, W, before, columns_, reversed, edge_);
    pad_columns(square, W, before, columns_, reversed, edge_square_);
    slide_sums(edge_, edge_square_, w, W, sum_, square_);
    if (Kind == CostKind::zssd) moments(sum_, square_, W, n_, inverse_n_, mean_, rest_, about_);
  }

  void describe_left(int c) {
    const int W = p_.width;
    if (Kind == CostKind::ncc) add_energy(square_, W, c == 0, norm_);
    if (Kind == CostKind::ssd) add_offset(sum_, square_, W, c == 0, 0, 1, left_offset_);
    if (Kind == CostKind::zssd) add_offset(sum_, about_, W, c == 0, 0, 1, left_offset_);
    if (Kind == CostKind::zncc) {
      add_deviation(sum_, square_, W, 1.0 / n_, c == 0, norm_);
      split_means(sum_, W, kCentre * n_, 1.0 / n_, C == 1, left_high_[c], left_low_[c]);
    }
    if (Kind == CostKind::zssd) centre_left(mean_, rest_, W, left_mean_[c], left_rest_[c], left_low_[c]);
  }

  void describe_right(int c, int from, int count, int to) {
    if (Kind == CostKind::ncc) {
      add_energy(square_, p_.width, c == 0, norm_);
      add_offset(sum_ + from, square_ + from, count, c == 0, kCentre, 0, right_offset_ + to);
    }
    if (Kind == CostKind::ssd)
      add_offset(sum_ + from, square_ + from, count, c == 0, -2 * kCentre, 1, right_offset_ + to);
    if (Kind == CostKind::zssd) add_offset(sum_ + from, about_ + from, count, c == 0, 0, 1, right_offset_ + to);
    if (Kind == CostKind::zncc) add_deviation(sum_, square_, p_.width, 1.0 / n_, c == 0, norm_);
    if (Kind == CostKind::zssd) split_right(sum_ + from, mean_ + from, count, right_split_[c] + to, right_mean_[c] + to);
    if (T::centred) to_floats((T::normalised ? sum_ : rest_) + from, count, right_sum_[c] + to);
  }

  // ---- from sums to costs -----------------------------------------------------------------------------------------

  // Where the innermost loop reads and writes, held by value: members could be overwritten for all the compiler knows.
  struct Views {
    const int32_t *split[C], *mean[C], *offset, *index;
    const float *sum[C], *scale;
    int32_t* sums;
    Scalar* costs;

    STEREOPSIS_INLINE void step(int padded, size_t pitch) {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        --split[c];
        --mean[c];
        --sum[c];
      });
      --offset;
      --scale;
      sums += padded;
      costs += pitch;
    }
  };

  STEREOPSIS_INLINE Views views_at(int x, int slot, int at) const {
    const int mirrored = p_.width - 1 - x + at;
    Views v;
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      v.split[c] = right_split_[c] + mirrored;
      v.mean[c] = right_mean_[c] + mirrored;
      v.sum[c] = right_sum_[c] + mirrored;
    });
    v.offset = right_offset_ + mirrored;
    v.scale = right_scale_ + mirrored;
    v.index = index_ + at;
    v.sums = sums_ + static_cast<size_t>(x) * padded_ + at;
    v.costs = costs_of(slot) + at;
    return v;
  }

  // What the left window at x says to every candidate.
  struct Left {
    I mean[C], rest[C], offset;
    F high[C], low[C], scale, inverse_n;
  };

  STEREOPSIS_INLINE Left left_at(int x) const {
    Left l;
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      if (Kind == CostKind::zncc) l.high[c] = Simd::set(left_high_[c][x]);
      if (T::centred) l.low[c] = Simd::set(left_low_[c][x]);
      if (Kind == CostKind::zssd) l.mean[c] = Simd::set(left_mean_[c][x]);
      if (Kind == CostKind::zssd) l.rest[c] = Simd::set(left_rest_[c][x]);
    });
    if (T::normalised) l.scale = Simd::set(left_scale_[x]);
    if (Kind == CostKind::zssd) l.inverse_n = Simd::set(inverse_n_);
    if (Kind == CostKind::ssd || Kind == CostKind::zssd) l.offset = Simd::set(left_offset_[x]);
    return l;
  }

  static STEREOPSIS_INLINE Vector cost(I sums, [[maybe_unused]] const Left& l, [[maybe_unused]] const Views& v,
                                       [[maybe_unused]] int at) {
    if constexpr (Kind == CostKind::sad) {
      return sums;
    } else if constexpr (Kind == CostKind::ssd) {
      return Simd::add(Simd::add(Simd::add(sums, sums), Simd::load(v.offset + at)), l.offset);
    } else if constexpr (Kind == CostKind::ncc) {
      const F product = Simd::to_float(Simd::sub(sums, Simd::load(v.offset + at)));
      return Simd::fused(Simd::mul(product, l.scale), Simd::load(v.scale + at), Simd::set(kCorrelationBase));
    } else if constexpr (Kind == CostKind::zncc) {
      F covariance = Simd::to_float(sums), right[C];
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        right[c] = Simd::once(Simd::load(v.sum[c] + at));
        covariance = Simd::fused(l.high[c], right[c], covariance);
      });
      if constexpr (C == 1) {
        covariance = Simd::fused(covariance, l.scale, l.low[0]);
      } else {
        unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA { covariance = Simd::fused(l.low[c], right[c], covariance); });
        covariance = Simd::mul(covariance, l.scale);
      }
      return Simd::fused(covariance, Simd::load(v.scale + at), Simd::set(kCorrelationBase));
    } else {
      F excess;
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        sums = Simd::dot16(sums, Simd::load(v.split[c] + at), l.mean[c]);
        sums = Simd::dot16(sums, Simd::load(v.mean[c] + at), l.rest[c]);
        const F rest = Simd::sub(l.low[c], Simd::load(v.sum[c] + at));
        const F square = Simd::mul(Simd::mul(rest, rest), l.inverse_n);
        excess = c == 0 ? square : Simd::add(excess, square);
      });
      const I whole = Simd::add(Simd::add(Simd::add(sums, sums), Simd::load(v.offset + at)), l.offset);
      return Simd::sub(Simd::to_float(whole), excess);
    }
  }

  // ---- winners ----------------------------------------------------------------------------------------------------

  enum class Sight { none, some, all };  // how many of a block's candidates lie inside the right image

  // Candidates [first_seen, end_seen) of pixel x are inside the right image.
  int first_seen(int x) const { return most(0, x - p_.first - (p_.width - 1)); }
  int end_seen(int x) const { return least(p_.count, x - p_.first + 1); }

  static int block_size(int rest) { return rest >= kBlock ? kBlock : rest >= kSmallBlock ? kSmallBlock : 1; }

  void match_row() {
    if (s_.left_right) {
      fill(T::keyed ? static_cast<Scalar>(coarse(T::worst)) : T::worst, stats_ + 2 * kChunk, right_best_);
      fill(-1, stats_ + 2 * kChunk, right_index_);
    }
    prime_slide();
    for (int x = 0; x < p_.width; x += kChunk) {
      const int end = least(x + kChunk, p_.width);
      each_block([&](auto size, int at) { match_block<size>(x, end, at); });
      if constexpr (T::is_float)
        if (volume_row_) hand_out_costs(x, end);
      take_winners(x, end);
      if (s_.left_right) take_right_winners(x, end);
      if (s_.uniqueness) take_second(x, end);
    }
    if (s_.left_right) count_from(1 - p_.width, stats_, right_index_ + kChunk);  // from columns to candidates
  }

  Sight sight(int x, int at, int past) const {
    const int lo = first_seen(x), hi = end_seen(x);
    if (hi <= lo || at >= hi || past <= lo) return Sight::none;
    return lo <= at && past <= hi ? Sight::all : Sight::some;
  }

  template <int N>
  void match_block(int begin, int end, int at) {
    const int past = at + N * kLanes;
    // Pixels that see all candidates of a block lie side by side: mostly the whole chunk does.
    if (sight(begin, at, past) == Sight::all && sight(end - 1, at, past) == Sight::all)
      return match_run<N, Sight::all>(begin, end, 0, at);
    for (int x = begin; x < end;) {
      const Sight see = sight(x, at, past);
      int run = x + 1;
      while (run < end && sight(run, at, past) == see) ++run;
      switch (see) {
        case Sight::none:
          match_run<N, Sight::none>(x, run, x - begin, at);
          break;
        case Sight::some:
          match_run<N, Sight::some>(x, run, x - begin, at);
          break;
        case Sight::all:
          match_run<N, Sight::all>(x, run, x - begin, at);
          break;
      }
      x = run;
    }
  }

  template <int N, Sight See>
  STEREOPSIS_NOINLINE void match_run(const int begin, const int end, const int slot, const int at) {
    const int padded = padded_;
    const size_t pitch = stride();
    const I keep = Simd::set(~static_cast<int32_t>(kSpareBits));
    I h[N];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { h[v] = Simd::load(slide_ + at + v * kLanes); });
    Column col = column(begin + s_.window.width - 1, at);
    Views views = views_at(begin, slot, at);
    Scalar* best = best_of(at) + slot * kLanes;
    int32_t* best_index = best_index_ + slot * kLanes;
    for (int x = begin; x < end; ++x) {
      col.load();
      advance_extra(h, col);
      [[maybe_unused]] const Left left = left_at(x);
      [[maybe_unused]] const int lo = first_seen(x), hi = end_seen(x);
      const bool fresh = T::keyed || at == 0;
      Vector b = fresh ? Simd::set(T::worst) : Simd::load(best);
      I bi = fresh ? Simd::set(-1) : Simd::load(best_index);
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        constexpr int j = v.value * kLanes;
        h[v] = advance(h[v], col, j);
        Vector value = Simd::set(T::worst);
        if constexpr (See != Sight::none) {
          // A candidate that its pixel does not see in this row, it sees in none: nobody needs its sum.
          if (See == Sight::all || (at + j < hi && at + j + kLanes > lo)) {
            const I s = Simd::add(Simd::load(views.sums + j), h[v]);
            Simd::store(views.sums + j, s);
            value = cost(s, left, views, j);
            if constexpr (T::keyed) {
              value = Simd::mark(value, keep, Simd::set(v.value));
              if (See == Sight::some && (at + j < lo || at + j + kLanes > hi))
                value = Simd::select(Simd::inside(Simd::load(views.index + j), lo, hi), value,
                                     Simd::set(T::worst));
              b = Simd::min(value, b);
            } else {
              const I index = Simd::load(views.index + j);
              if constexpr (See == Sight::some)
                value = Simd::select(Simd::inside(index, lo, hi), value, Simd::set(T::worst));
              const M better = Simd::less(value, b);
              b = Simd::select(better, value, b);
              bi = Simd::select(better, index, bi);
            }
          }
        }
        Simd::store(views.costs + j, value);
      });
      Simd::store(best, b);
      if (!T::keyed) Simd::store(best_index, bi);
      col.step();
      views.step(padded, pitch);
      best += kLanes;
      best_index += kLanes;
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(slide_ + at + v * kLanes, h[v]); });
  }

  void take_winners(int begin, int end) {
    if constexpr (T::keyed) {
      take_keyed_winners(winner_ + begin, cost_ + begin);
    } else {
      for (int x = begin; x < end; ++x) {
        winner_[x] = indexed_winner(x - begin);
        cost_[x] = costs_of(x - begin)[winner_[x]];
      }
    }
    for (int x = begin; x < end; ++x) {
      const Scalar* costs = costs_of(x - begin) + winner_[x];
      before_[x] = costs[-1];
      after_[x] = costs[1];
    }
  }

  void hand_out_costs(int begin, int end) const {
    for (int x = begin; x < end; ++x) {
      float* STEREOPSIS_RESTRICT out = volume_row_ + static_cast<size_t>(x) * p_.count;
      const Scalar* STEREOPSIS_RESTRICT costs = costs_of(x - begin);
      for (int i = 0; i < p_.count; ++i) out[i] = T::keyed ? correlation_cost(costs[i]) : costs[i];
    }
  }

  Scalar* costs_of(int slot) const { return costs_ + slot * stride() + kChunk; }

  // The least costs of a chunk's pixels so far, lane by lane; of each block by itself where they are keyed.
  Scalar* best_of(int at) const { return best_ + (T::keyed ? static_cast<size_t>(at) * kChunk : 0); }

  template <class Unused = void>
  int indexed_winner(int slot) const {
    const Vector b = Simd::load(best_ + slot * kLanes);
    const I bi = Simd::load(best_index_ + slot * kLanes);
    const I at_least = Simd::select(Simd::equal(b, splat(Simd::reduce_min(b))), bi, Simd::set(INT32_MAX));
    return Simd::reduce_min(at_least);
  }

  // Of a whole chunk, whatever its end: loops of known length.
  STEREOPSIS_NOINLINE void take_keyed_winners(int32_t* STEREOPSIS_RESTRICT winner, Scalar* STEREOPSIS_RESTRICT least) {
    for (int v = 0; v < vectors_; v += block_size(vectors_ - v)) {
      const Scalar* best = best_of(v * kLanes);
      Scalar keys[kChunk];
      int32_t found[kChunk];
      Simd::row_minima(best, kLanes, keys);
      for (int slot = 0; slot < kChunk; ++slot)
        found[slot] = Simd::first_equal(Simd::load(best + slot * kLanes), keys[slot]);
      for (int slot = 0; slot < kChunk; ++slot) {
        uint32_t bits;
        std::memcpy(&bits, keys + slot, sizeof bits);
        found[slot] += (v + static_cast<int>(bits & kSpareBits)) * kLanes;
        const bool better = v == 0 || coarse(keys[slot]) < coarse(least[slot]);
        winner[slot] = better ? found[slot] : winner[slot];
        least[slot] = better ? keys[slot] : least[slot];
      }
    }
  }

  static STEREOPSIS_INLINE Vector splat(Scalar v) { return Simd::set(v); }

  // The right view's winners so far, with the costs of pixels [begin, end): right pixel by right pixel, that is by mirrored
  // column, where candidate i of pixel x stands at width - 1 - x + i. In the kept costs that is a diagonal, whose steps
  // `stride` makes whole vectors. Costs out of view are the worst, and so is what lies around the candidates.
  STEREOPSIS_NOINLINE void take_right_winners(int begin, int end) {
    constexpr int abreast = kBlock + 1;  // all of 128 candidates at once; many, to hide the latency of minima
    int i = -kChunk;
    for (; i + abreast * kLanes <= padded_; i += abreast * kLanes) take_right_block<abreast>(begin, end, i);
    for (; i < padded_; i += kLanes) take_right_block<1>(begin, end, i);
  }

  // N vectors of right pixels, whose candidate of pixel `begin` in the first lane is i; one more a pixel.
  template <int N>
  STEREOPSIS_INLINE void take_right_block(const int begin, const int end, const int i) {
    const size_t step = stride() + 1;
    const Scalar* STEREOPSIS_RESTRICT costs = costs_of(0) + i;
    Scalar* STEREOPSIS_RESTRICT best = right_best_ + kChunk + (p_.width - 1 - begin) + i;
    int32_t* STEREOPSIS_RESTRICT index = right_index_ + kChunk + (p_.width - 1 - begin) + i;
    Vector b[N];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { b[v] = splat(T::worst); });
    if constexpr (T::keyed) {
      const I cut = Simd::set(~static_cast<int32_t>(kSpareBits)), one = Simd::set(1);
      I slot = Simd::set(0);
      for (int x = begin; x < end; ++x, costs += step) {
        unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
          b[v] = Simd::min(Simd::mark(Simd::load(costs + v.value * kLanes), cut, slot), b[v]);
        });
        slot = Simd::add(slot, one);
      }
      // A chunk begins at a multiple of its length: its column and the slot share no bits.
      const I spare = Simd::set(static_cast<int32_t>(kSpareBits)), column = Simd::set(begin);
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        const M better = Simd::less(b[v], Simd::load(best + v * kLanes));
        Simd::store(best + v * kLanes, better, Simd::mask(b[v], cut));
        Simd::store(index + v * kLanes, better, Simd::bits(Simd::mark(b[v], spare, column)));
      });
    } else {
      I column[N];
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { column[v] = Simd::set(begin); });
      for (int x = begin; x < end; ++x, costs += step) {
        const I here = Simd::set(x);
        unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
          const Vector value = Simd::load(costs + v.value * kLanes);
          column[v] = Simd::select(Simd::less(value, b[v]), here, column[v]);
          b[v] = Simd::min(value, b[v]);
        });
      }
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        const M better = Simd::less(b[v], Simd::load(best + v * kLanes));
        Simd::store(best + v * kLanes, better, b[v]);
        Simd::store(index + v * kLanes, better, column[v]);
      });
    }
  }

  // The least cost of the candidates that are not next to the winner. Strikes out the stored costs of those that are.
  STEREOPSIS_NOINLINE void take_second(int begin, int end) {
    for (int x = begin; x < end; ++x) {
      Scalar* costs = costs_of(x - begin) + winner_[x];
      costs[-1] = costs[0] = costs[1] = T::worst;
    }
    constexpr int abreast = 4;  // as many minima as hide each other's latency
    // Whole vectors from one at or before the first candidate; what lies around the candidates is the worst.
    const int before = s_.left_right ? kChunk : 0, count = padded_ + before;
    const size_t pitch = stride() + (s_.left_right ? 1 : 0);
    for (int slot = 0; slot < kChunk; slot += abreast) {
      const Scalar* STEREOPSIS_RESTRICT costs = costs_of(0) - before + slot * pitch;
      Vector m[abreast];
      unrolled<abreast>([&](auto k) STEREOPSIS_INLINE_LAMBDA { m[k] = splat(T::worst); });
      for (int i = 0; i < count; i += kLanes)
        unrolled<abreast>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
          m[k] = Simd::min(m[k], Simd::load(costs + k.value * pitch + i));
        });
      unrolled<abreast>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
        Simd::store(best_ + (slot + k.value) * kLanes, m[k]);
      });
    }
    Scalar least[kChunk];
    Simd::row_minima(best_, kLanes, least);
    for (int x = begin; x < end; ++x) second_[x] = least[x - begin];
  }

  static void show_correlations(int count, float* STEREOPSIS_RESTRICT kept) {
    for (int x = 0; x < count; ++x) kept[x] = correlation_cost(kept[x]);
  }

  void finish_row(const FusedOutput& out, int y) {
    if constexpr (T::keyed) {
      // A row at once: right after they were stored, one by one, their vectors would have to wait.
      for (Scalar* kept : {cost_, before_, after_}) show_correlations(p_.width, kept);
      if (s_.uniqueness) show_correlations(p_.width, second_);
    }
    RowWinners<Scalar> row{winner_, cost_, before_, after_, second_, claims_, right_index_ + kChunk};
    finish(p_, s_, row, out, y);
  }

  const Pair& p_;
  const FusedSettings& s_;
  Arena arena_;
  int vectors_, padded_, columns_, quads_, stats_;
  int32_t n_;
  float inverse_n_;
  int32_t sad_even_ = 0;
  float* volume_row_ = nullptr;
  int32_t *sums_, *slide_, *best_index_, *index_;
  Scalar *costs_, *best_, *right_best_;
  int32_t *quad_[C], *weight_a_[C], *weight_b_[C];
  int32_t *left_column_[C], *left_square_[C], *right_column_[C], *right_square_[C];
  int32_t *left_mean_[C], *left_rest_[C], *right_split_[C], *right_mean_[C];
  float *left_high_[C], *left_low_[C], *right_sum_[C];
  float *left_scale_, *right_scale_, *norm_;
  int32_t *left_offset_, *right_offset_, *edge_, *edge_square_, *sum_, *square_, *mean_, *rest_, *about_;
  uint8_t *padded_new_, *padded_old_, *mirrored_new_, *mirrored_old_, *plane_;
  int32_t *right_index_, *winner_, *claims_;
  Scalar *cost_, *before_, *after_, *second_;
};

}  // namespace
}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
