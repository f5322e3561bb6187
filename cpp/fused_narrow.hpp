// The streaming kernel for 8-bit images, compiled once per instruction set.
//
// For every candidate i of every pixel x, `sums` holds minus the window's sum of (l - 128) r (or, for SAD, plus its
// sum of |l - r|). From one row to the next the window gains a row and loses one; what that changes slides along x in
// `slide`: one column in, one column out. Four bytes of the right image (new and old row, entering and leaving column)
// sit side by side, so that a single multiply-add of four bytes does all of it. Nothing but integers up to here: exact, and the
// same for any order of summation.
//
// Of V vectors of candidates, candidate i stands in lane i / V of vector i % V. One pixel on, the same right pixels meet the next
// candidates: the next vector's. So what a vector takes of the right image, mirrored for candidates to go on with it, is a comb
// of every V-th column, and from pixel to pixel every comb but one is there already.
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
constexpr int kSmallBlock = kBlock > 1 ? kBlock / 2 : 1;
constexpr int kLeastBlock = kSmallBlock > 1 ? kSmallBlock / 2 : 1;
constexpr int kChunk = 16;                 // pixels whose costs are kept until their winners are taken
constexpr int kStretch = 2 * kChunk;       // pixels whose combs are made at once
constexpr int kSpare = static_cast<int>(kSpareBits), kSpareWidth = 4;
constexpr int32_t kNeverLess = 0x7FC00000;  // put into any float's bits: not a number
constexpr int kGroup = kSpare + 1;  // vectors
static_assert(kGroup % kBlock == 0, "a vector's number within its block, and within its group, goes into the spare bits");
static_assert(kSpare + 1 == 1 << kSpareWidth && kLanes <= kSpare + 1 && kChunk == 16, "see by_lane, row_minima");

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

// Of one column, the bytes of the entering and the leaving row.
[[maybe_unused]] static void interleave(const uint8_t* STEREOPSIS_RESTRICT entering,
                                        const uint8_t* STEREOPSIS_RESTRICT leaving, int count,
                                        int32_t* STEREOPSIS_RESTRICT pair) {
  for (int j = 0; j + kLanes <= count; j += kLanes) Simd::store(pair + j, Simd::pairs(entering + j, leaving + j));
  for (int j = count / kLanes * kLanes; j < count; ++j) pair[j] = pack16(entering[j], leaving[j]);
}

// The same of two columns, byte by byte.
static void interleave(const uint8_t* STEREOPSIS_RESTRICT entering, const uint8_t* STEREOPSIS_RESTRICT leaving, int apart,
                       int count, int32_t* STEREOPSIS_RESTRICT quad) {
  for (int j = 0; j + kLanes <= count; j += kLanes)
    Simd::store(quad + j, Simd::add(Simd::pairs(entering + j, leaving + j),
                                    Simd::times_256(Simd::pairs(entering + j + apart, leaving + j + apart))));
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

// Of `vectors` vectors in order: the same with element l * vectors + m in lane l of vector m.
template <class T>
static void comb(const T* STEREOPSIS_RESTRICT row, int vectors, T* STEREOPSIS_RESTRICT combs) {
  for (int m = 0; m < vectors; ++m)
    for (int l = 0; l < kLanes; ++l) combs[m * kLanes + l] = row[l * vectors + m];
}

// Of what blocks of candidates kept apart, the best so far, where `all` of what comes is better; of equal ones the first candidate,
// by lane, then by vector.
static void join_keys(const int32_t* STEREOPSIS_RESTRICT keys, int count, int first, int vectors, bool all,
                      int32_t* STEREOPSIS_RESTRICT best, int32_t* STEREOPSIS_RESTRICT index) {
  for (int p = 0; p < count; ++p) {
    const bool better = all || keys[p] >> kSpareWidth < best[p] >> kSpareWidth;
    index[p] = better ? (keys[p] >> kSpareWidth & kSpare) * vectors + first + (keys[p] & kSpare) : index[p];
    best[p] = better ? keys[p] : best[p];
  }
}

template <class T>
static void join_costs(const T* STEREOPSIS_RESTRICT costs, const int32_t* STEREOPSIS_RESTRICT indices, int count, bool all,
                       T* STEREOPSIS_RESTRICT best, int32_t* STEREOPSIS_RESTRICT index) {
  for (int p = 0; p < count; ++p) {
    const bool better = all || costs[p] < best[p] || (costs[p] == best[p] && indices[p] < index[p]);
    index[p] = better ? indices[p] : index[p];
    best[p] = better ? costs[p] : best[p];
  }
}

template <class T>
static void drop_unmet(const T* STEREOPSIS_RESTRICT best, int count, T none, int32_t* STEREOPSIS_RESTRICT index) {
  for (int p = 0; p < count; ++p) index[p] = best[p] < none ? index[p] : -1;
}

// Keeps a compiler from adding up anew, for every access, what it was the sum of.
template <class T>
static STEREOPSIS_INLINE T* in_register(T* p) {
#if defined(__GNUC__)
  __asm__("" : "+r"(p));
#endif
  return p;
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
  // What right pixels have met: a key where costs have one, else a cost, whose candidate stands apart.
  using Met = typename std::conditional<T::keyed, int32_t, Scalar>::type;
  static constexpr Met nothing_met = worst_cost<Met>();
  static constexpr bool has_offset = T::squares && Kind != CostKind::zncc;
  static constexpr bool split_bytes = T::squares && !Simd::has_dot8;  // into pairs of int16, once for all that meet them

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
    primed_ = arena_.template take<int32_t>(padded_);
    costs_ = arena_.template take<Scalar>(kChunk * stride());
    best_ = arena_.template take<Scalar>(static_cast<size_t>(kChunk) * kLanes * ((vectors_ + kGroup - 1) / kGroup));
    lane_bits_ = arena_.template take<int32_t>(kLanes);
    best_index_ = arena_.template take<int32_t>(kChunk * kLanes);
    index_ = arena_.template take<int32_t>(padded_);
    put_ = arena_.template take<int32_t>(padded_);
    place_ = arena_.template take<int32_t>(padded_ + 2) + 1;
    for (int c = 0; c < C; ++c) {
      right_.quad[c] = take_combed<int32_t>(quads_);
      if (split_bytes) right_.older[c] = take_combed<int32_t>(quads_);
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
      if (Kind == CostKind::zssd) right_.split[c] = take_combed<int32_t>(stats_);
      if (Kind == CostKind::zssd) right_.mean[c] = take_combed<int32_t>(stats_);
      if (T::centred) right_.sum[c] = take_combed<float>(stats_);
    }
    if (has_offset) right_.offset = take_combed<int32_t>(stats_);
    if (T::normalised) right_.scale = take_combed<float>(stats_);
    left_scale_ = arena_.template take<float>(p_.width);
    left_offset_ = arena_.template take<int32_t>(p_.width);
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
    volume_costs_ = arena_.template take<Scalar>(T::is_float ? padded_ : 0);
    passing_ = arena_.template take<Scalar>(padded_);
    each_block([&](auto, int) { ++blocks_; });
    met_ = arena_.template take<Met>(static_cast<size_t>(blocks_) * padded_);
    right_met_ = arena_.template take<Met>(static_cast<size_t>(blocks_) * stats_);
    if (!T::keyed) {
      passing_index_ = arena_.template take<int32_t>(padded_);
      met_index_ = arena_.template take<int32_t>(static_cast<size_t>(blocks_) * padded_);
      right_met_index_ = arena_.template take<int32_t>(static_cast<size_t>(blocks_) * stats_);
    }
    right_best_ = arena_.template take<Met>(stats_);
    right_index_ = arena_.template take<int32_t>(stats_);
    claims_ = arena_.template take<int32_t>(2 * p_.width + 1);
    winner_ = arena_.template take<int32_t>(p_.width + kChunk);  // these, and `second_`, chunk by chunk, beyond the width
    cost_ = arena_.template take<Scalar>(p_.width + kChunk);
    before_ = arena_.template take<Scalar>(p_.width);
    after_ = arena_.template take<Scalar>(p_.width);
    second_ = arena_.template take<Scalar>(p_.width + kChunk);
  }

  size_t bytes() const { return arena_.used; }

  void rows(const FusedOutput& out, RowsToTake& rows, const Cancel& cancel) {
    // All but the sums, which the first pass sets.
    char* const rest = reinterpret_cast<char*>(slide_);
    std::memset(rest, 0, arena_.used - (rest - arena_.base));
    for (int l = 0; l < kLanes; ++l) lane_bits_[l] = l << kSpareWidth;
    place_[-1] = place_[padded_] = padded_;
    for (int i = 0; i < padded_; ++i) {
      place_[i] = i % vectors_ * kLanes + i / vectors_;
      index_[place_[i]] = i;
    }
    for (size_t i = 0; i < kChunk * stride(); ++i) costs_[i] = T::worst;
    each_block([&](auto size, int at) {
      for (int j = 0; j < size * kLanes; ++j) put_[at + j] = index_[at + j] < p_.count ? j / kLanes : kNeverLess;
    });
    fill(nothing_met, blocks_ * stats_, right_met_);
    if (T::normalised) fill(std::numeric_limits<float>::quiet_NaN(), stats_ + kStretch, right_.scale.row - kStretch);
    // The sums of the row before the first one: its window's rows, two a pass.
    const int step = rows.step(), top = rows.first() - step - s_.window.above();
    for (int y = top; y < top + s_.window.height; y += 2) {
      const bool two = y + 1 < top + s_.window.height;
      change_rows({inside(y), 1, inside(two ? y + 1 : y), two ? 1 : 0});
      accumulate(y == top);
      if (cancel.load(std::memory_order_relaxed)) return;
    }
    for (int y = rows.first(); rows.take(); y += step) {
      if (cancel.load(std::memory_order_relaxed)) return;
      change_rows({inside(y + s_.window.ahead(step)), 1, inside(y - step + s_.window.ahead(-step)), -1});
      window_statistics();
      volume_row_ = out.volume ? out.volume + static_cast<size_t>(y) * p_.width * p_.count : nullptr;
      match_row();
      finish_row(out, y);
    }
  }

 private:
  // Between the kept costs of two pixels. The last vector stays the worst: what is next to the first and the last candidate.
  size_t stride() const { return padded_ + kLanes; }
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
      if constexpr (split_bytes) {
        interleave(mirrored_new_, mirrored_old_, quads_, right_.quad[c].row);
        interleave(mirrored_new_ + w, mirrored_old_ + w, quads_, right_.older[c].row);
      } else {
        interleave(mirrored_new_, mirrored_old_, w, quads_, right_.quad[c].row);
      }
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

  // A row of the right image or its windows, mirrored, and the combs of it that a stretch of pixels meets.
  template <class U>
  struct Combed {
    U *row, *combs;
  };
  struct Rights {
    Combed<int32_t> quad[C], older[C], split[C], mean[C], offset;
    Combed<float> sum[C], scale;

    template <class Visit>
    STEREOPSIS_INLINE void each(Visit visit) {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        visit(quad[c]);
        if constexpr (split_bytes) visit(older[c]);
        if constexpr (Kind == CostKind::zssd) visit(split[c]);
        if constexpr (Kind == CostKind::zssd) visit(mean[c]);
        if constexpr (T::centred) visit(sum[c]);
      });
      if constexpr (has_offset) visit(offset);
      if constexpr (T::normalised) visit(scale);
    }
  };

  // Up to kStretch elements before the row are looked at.
  template <class U>
  Combed<U> take_combed(int length) {
    U* const row = arena_.template take<U>(kStretch + length) + kStretch;
    return {row, arena_.template take<U>(static_cast<size_t>(padded_ + kStretch * kLanes))};
  }

  // The combs that the pixels before the first would meet; `next_combs` follow.
  void first_combs() {
    right_.each([&](auto& one) STEREOPSIS_INLINE_LAMBDA { comb(one.row + p_.width, vectors_, one.combs); });
  }

  // Those of kStretch pixels from x on: what those before began with, and before it, each moved on by a lane, what stands
  // `vectors_` further on.
  STEREOPSIS_NOINLINE void next_combs(int x) {
    right_.each([&](auto& one) STEREOPSIS_INLINE_LAMBDA {
      const auto* row = one.row + (p_.width - x - kStretch);
      auto* const combs = one.combs;
      for (int m = vectors_ - 1; m >= 0; --m)
        Simd::store(combs + (m + kStretch) * kLanes, Simd::load(combs + m * kLanes));
      if (vectors_ <= kBlock)
        move_on<kBlock>(row, combs);
      else
        for (int m = kStretch - 1; m >= 0; --m)
          Simd::store(combs + m * kLanes, Simd::shift_in(row[m], Simd::load(combs + (m + vectors_) * kLanes)));
    });
  }

  // The same for N vectors, in registers: of few of them, one would have to wait for another to reach memory.
  template <int N, class U>
  STEREOPSIS_INLINE void move_on(const U* row, U* combs) const {
    if constexpr (N > 1)
      if (vectors_ < N) return move_on<N - 1>(row, combs);
    decltype(Simd::load(combs)) last[N];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { last[v] = Simd::load(combs + (kStretch + v) * kLanes); });
    int m = kStretch - N;
    const auto move = [&](auto v) STEREOPSIS_INLINE_LAMBDA {
      last[v] = Simd::shift_in(row[m + v], last[v]);
      Simd::store(combs + (m + v) * kLanes, last[v]);
    };
    for (; m >= 0; m -= N) unrolled<N>(move);
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      if (m + v >= 0) move(v);
    });
  }

  // Where pixel x finds its combs.
  static int first_comb(int x) { return (kStretch - 1 - x % kStretch) * kLanes; }

  // ---- the sliding sums -------------------------------------------------------------------------------------------

  // What one column brings to, and takes from, the change of the sums.
  struct Column {
    const int32_t *quad[C], *older[C], *weight_a[C], *weight_b[C];
    I a[C], b[C], even;

    STEREOPSIS_INLINE void load() {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        a[c] = Simd::set(*weight_a[c]);
        b[c] = Simd::set(*weight_b[c]);
      });
    }
    // Whether `advance` leaves something of the next columns to `b`.
    STEREOPSIS_INLINE bool extra(int columns) const {
      int any = 0;
      if constexpr (T::squares && Simd::has_dot8)
        unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
          for (int k = 0; k < columns; ++k) any |= weight_b[c][k];
        });
      return any != 0;
    }
    STEREOPSIS_INLINE void step(int back, int columns) {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        quad[c] -= back;
        if (split_bytes) older[c] -= back;
        weight_a[c] += columns;
        weight_b[c] += columns;
      });
    }
  };

  STEREOPSIS_INLINE Column column(int k) const {
    Column col;
    col.even = Simd::set(sad_even_);
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      col.quad[c] = right_.quad[c].row + (columns_ - 1 - k);
      if (split_bytes) col.older[c] = right_.older[c].row + (columns_ - 1 - k);
      col.weight_a[c] = weight_a_[c] + k;
      col.weight_b[c] = weight_b_[c] + k;
    });
    return col;
  }

  // The last one of pixel x's window, by combs.
  STEREOPSIS_INLINE Column combed_column(int x, int at) const {
    Column col = column(x + s_.window.width - 1);
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      col.quad[c] = right_.quad[c].combs + first_comb(x) + at;
      if (split_bytes) col.older[c] = right_.older[c].combs + first_comb(x) + at;
    });
    return col;
  }

  // Of all channels, the right bytes that a column meets.
  struct Bytes {
    I of[C], older[C];
  };
  static STEREOPSIS_INLINE Bytes bytes_at(const Column& col, int at) {
    Bytes bytes;
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      bytes.of[c] = Simd::load(col.quad[c] + at);
      if constexpr (split_bytes) bytes.older[c] = Simd::load(col.older[c] + at);
    });
    return bytes;
  }

  static STEREOPSIS_INLINE I advance(I h, const Column& col, const Bytes& bytes) {
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      const I v = bytes.of[c];
      if constexpr (split_bytes) {
        h = Simd::dot16(Simd::dot16(h, v, col.a[c]), bytes.older[c], col.b[c]);
      } else if constexpr (T::squares) {
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
    if (col.extra(1))
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
      else if (size == kLeastBlock)
        visit(Constant<kLeastBlock>{}, at);
      else
        visit(Constant<1>{}, at);
    }
  }

  // What the columns before those that the first pixel's window brings in change, for all candidates.
  STEREOPSIS_NOINLINE void prime_slide() {
    each_block([&](auto size, int at) {
      I h[size];
      for (auto& v : h) v = Simd::set(0);
      Column col = column(0);
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        col.quad[c] += at;
        if (split_bytes) col.older[c] += at;
      });
      slide_on<size, 1>(h, col, s_.window.width - 1, [](auto&) STEREOPSIS_INLINE_LAMBDA {});
      unrolled<size>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(primed_ + at + v * kLanes, h[v]); });
    });
    comb(primed_, vectors_, slide_);
  }

  // Adds a row's change to the sums of all pixels, which are nothing before the first.
  void accumulate(bool first) {
    prime_slide();
    first_combs();
    for (int x = 0; x < p_.width; x += kStretch) {
      next_combs(x);
      each_block([&](auto size, int at) {
        I h[size];
        unrolled<size>([&](auto v) STEREOPSIS_INLINE_LAMBDA { h[v] = Simd::load(slide_ + at + v * kLanes); });
        int32_t* sums = sums_ + static_cast<size_t>(x) * padded_ + at;
        slide_on<size, kLanes>(h, combed_column(x, at), least(kStretch, p_.width - x),
                               [&](auto& change) STEREOPSIS_INLINE_LAMBDA {
          unrolled<size>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
            int32_t* const sum = sums + v.value * kLanes;
            Simd::store(sum, first ? change[v] : Simd::add(Simd::load(sum), change[v]));
          });
          sums += padded_;
        });
        unrolled<size>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(slide_ + at + v * kLanes, h[v]); });
      });
    }
  }

  // Lets `count` columns in and visits what has changed after each.
  template <int N, int Apart, class Visit>
  STEREOPSIS_INLINE void slide_on(I (&h)[N], Column col, int count, Visit visit) {
    for (int step = 0; step < count; ++step) {
      col.load();
      advance_extra(h, col);
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { h[v] = advance(h[v], col, bytes_at(col, v.value * kLanes)); });
      visit(h);
      col.step(Apart, 1);
    }
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
    if (T::normalised) inverse_roots(norm_ + from, to - from, least, right_.scale.row + from - p_.first);
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
      add_offset(sum_ + from, square_ + from, count, c == 0, kCentre, 0, right_.offset.row + to);
    }
    if (Kind == CostKind::ssd)
      add_offset(sum_ + from, square_ + from, count, c == 0, -2 * kCentre, 1, right_.offset.row + to);
    if (Kind == CostKind::zssd) add_offset(sum_ + from, about_ + from, count, c == 0, 0, 1, right_.offset.row + to);
    if (Kind == CostKind::zncc) add_deviation(sum_, square_, p_.width, 1.0 / n_, c == 0, norm_);
    if (Kind == CostKind::zssd) split_right(sum_ + from, mean_ + from, count, right_.split[c].row + to, right_.mean[c].row + to);
    if (T::centred) to_floats((T::normalised ? sum_ : rest_) + from, count, right_.sum[c].row + to);
  }

  // ---- from sums to costs -----------------------------------------------------------------------------------------

  // Where the innermost loop reads and writes, held by value: members could be overwritten for all the compiler knows.
  struct Views {
    const int32_t *split[C], *mean[C], *offset, *index, *put;
    const float *sum[C], *scale;
    int32_t* sums;
    Scalar* costs;

    STEREOPSIS_INLINE void step(int pixels, int padded, size_t pitch) {
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        if (Kind == CostKind::zssd) split[c] -= pixels * kLanes;
        if (Kind == CostKind::zssd) mean[c] -= pixels * kLanes;
        if (T::centred) sum[c] -= pixels * kLanes;
      });
      if (has_offset) offset -= pixels * kLanes;
      if (T::normalised) scale -= pixels * kLanes;
      sums += pixels * padded;
      costs += pixels * pitch;
    }
  };

  STEREOPSIS_INLINE Views views_at(int x, int at) const {
    const int first = first_comb(x) + at;
    Views v;
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      if (Kind == CostKind::zssd) v.split[c] = right_.split[c].combs + first;
      if (Kind == CostKind::zssd) v.mean[c] = right_.mean[c].combs + first;
      if (T::centred) v.sum[c] = right_.sum[c].combs + first;
    });
    if (has_offset) v.offset = right_.offset.combs + first;
    if (T::normalised) v.scale = right_.scale.combs + first;
    v.put = put_ + at;
    v.index = index_ + at;
    v.sums = sums_ + static_cast<size_t>(x) * padded_ + at;
    v.costs = costs_of(x) + at;
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

  // What a comb of right windows says to every pixel that meets it.
  struct Right {
    I split[C], mean[C], offset;
    F sum[C], scale;
  };

  static STEREOPSIS_INLINE Right right_at(const Views& v, int at) {
    Right r;
    unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
      if (Kind == CostKind::zssd) r.split[c] = Simd::load(v.split[c] + at);
      if (Kind == CostKind::zssd) r.mean[c] = Simd::load(v.mean[c] + at);
      if (T::centred) r.sum[c] = Simd::load(v.sum[c] + at);
    });
    if (has_offset) r.offset = Simd::load(v.offset + at);
    if (T::normalised) r.scale = Simd::load(v.scale + at);
    return r;
  }

  static STEREOPSIS_INLINE Vector cost(I sums, [[maybe_unused]] const Left& l, [[maybe_unused]] const Right& r) {
    if constexpr (Kind == CostKind::sad) {
      return sums;
    } else if constexpr (Kind == CostKind::ssd) {
      return Simd::add(Simd::add(Simd::add(sums, sums), r.offset), l.offset);
    } else if constexpr (Kind == CostKind::ncc) {
      const F product = Simd::to_float(Simd::sub(sums, r.offset));
      return Simd::fused(Simd::mul(product, l.scale), r.scale, Simd::set(kCorrelationBase));
    } else if constexpr (Kind == CostKind::zncc) {
      F covariance = Simd::to_float(sums);
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA { covariance = Simd::fused(l.high[c], r.sum[c], covariance); });
      if constexpr (C == 1) {
        covariance = Simd::fused(covariance, l.scale, l.low[0]);
      } else {
        unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA { covariance = Simd::fused(l.low[c], r.sum[c], covariance); });
        covariance = Simd::mul(covariance, l.scale);
      }
      return Simd::fused(covariance, r.scale, Simd::set(kCorrelationBase));
    } else {
      F excess;
      unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
        sums = Simd::dot16(sums, r.split[c], l.mean[c]);
        sums = Simd::dot16(sums, r.mean[c], l.rest[c]);
        const F rest = Simd::sub(l.low[c], r.sum[c]);
        const F square = Simd::mul(Simd::mul(rest, rest), l.inverse_n);
        excess = c == 0 ? square : Simd::add(excess, square);
      });
      const I whole = Simd::add(Simd::add(Simd::add(sums, sums), r.offset), l.offset);
      return Simd::sub(Simd::to_float(whole), excess);
    }
  }

  // ---- winners ----------------------------------------------------------------------------------------------------

  enum class Sight { none, some, all };  // how many of a pixel's candidates lie inside the right image

  // Candidates [first_seen, end_seen) of pixel x are inside the right image.
  int first_seen(int x) const { return most(0, x - p_.first - (p_.width - 1)); }
  int end_seen(int x) const { return least(p_.count, x - p_.first + 1); }

  static int block_size(int rest) { return rest >= kBlock ? kBlock : rest >= kSmallBlock ? kSmallBlock : rest >= kLeastBlock ? kLeastBlock : 1; }

  void match_row() {
    if (s_.left_right) {
      fill(T::worst, padded_, passing_);
      fill(nothing_met, blocks_ * padded_, met_);
      met_row_ = 0;
    }
    prime_slide();
    first_combs();
    for (int x = 0; x < p_.width; x += kChunk) {
      const int end = least(x + kChunk, p_.width);
      if (x % kStretch == 0) next_combs(x);
      each_block([&](auto size, int at) { match_block<size>(x, end, at); });
      if constexpr (T::is_float)
        if (volume_row_) hand_out_costs(x, end);
      if (s_.left_right) {
        int block = 0;
        each_block([&](auto size, int at) { take_right_block<size>(x, end, at, block++); });
        met_row_ -= kChunk % vectors_;
        met_row_ += met_row_ < 0 ? vectors_ : 0;
      }
      take_winners(x, end);
      if (s_.uniqueness) take_second(x);
    }
    if (s_.left_right) show_right_winners();
  }

  Sight sight(int x) const {
    const int lo = first_seen(x), hi = end_seen(x);
    return hi <= lo ? Sight::none : lo == 0 && hi == padded_ ? Sight::all : Sight::some;
  }

  template <int N>
  void match_block(int begin, int end, int at) {
    // Correlations out of view are no numbers by themselves; only lanes that hold no candidate are left.
    if constexpr (T::keyed)
      return p_.count == padded_ ? match_run<N, Sight::all>(begin, end, at) : match_run<N, Sight::some>(begin, end, at);
    // Pixels that see all lie side by side: mostly the whole chunk does.
    if (sight(begin) == Sight::all && sight(end - 1) == Sight::all) return match_run<N, Sight::all>(begin, end, at);
    for (int x = begin; x < end;) {
      const Sight see = sight(x);
      int run = x + 1;
      while (run < end && sight(run) == see) ++run;
      switch (see) {
        case Sight::none:
          match_run<N, Sight::none>(x, run, at);
          break;
        case Sight::some:
          match_run<N, Sight::some>(x, run, at);
          break;
        case Sight::all:
          match_run<N, Sight::all>(x, run, at);
          break;
      }
      x = run;
    }
  }

  template <int N, Sight See>
  STEREOPSIS_NOINLINE void match_run(const int begin, const int end, const int at) {
    const int slot = begin % kChunk;
    const int padded = padded_;
    const size_t pitch = stride();
    const I keep = Simd::set(~kSpare);
    I h[N];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { h[v] = Simd::load(slide_ + at + v * kLanes); });
    Column col = combed_column(begin, at);
    Views views = views_at(begin, at);
    const int number = T::keyed ? at / kLanes % kGroup : at;  // of the first vector among those that share a minimum
    Scalar* best = best_of(at) + slot * kLanes;
    int32_t* best_index = best_index_ + slot * kLanes;
    const auto match = [&](auto pixels, int x) STEREOPSIS_INLINE_LAMBDA {
      constexpr int P = pixels;
      Column cols[P];
      Left left[P];
      Vector b[P];
      I bi[P];
      int32_t* sums[P];
      Scalar* costs[P];
      unrolled<P>([&](auto p) STEREOPSIS_INLINE_LAMBDA {
        cols[p] = col;
        cols[p].step(0, p);
        cols[p].load();
        left[p] = left_at(x + p);
        sums[p] = in_register(views.sums + p * padded);
        costs[p] = in_register(views.costs + p * pitch);
        b[p] = Simd::set(T::worst);
        bi[p] = Simd::set(0);
      });
      if (P == 1) advance_extra(h, cols[0]);
      // The comb that a pixel's vector meets, the next one's next vector meets: from the last to the first, so that a sum's change
      // has seen the one before the other.
      unrolled<N + P - 1>([&](auto comb) STEREOPSIS_INLINE_LAMBDA {
        constexpr int from = N - 1 - comb.value;
        const Bytes bytes = bytes_at(col, from * kLanes);
        const Right right = right_at(views, from * kLanes);
        unrolled<P>([&](auto p) STEREOPSIS_INLINE_LAMBDA {
          constexpr int v = from + p.value, j = v * kLanes;
          if constexpr (v >= 0 && v < N) {
            h[v] = Simd::once(advance(h[v], cols[p], bytes));
            Vector value = Simd::set(T::worst);
            if constexpr (See != Sight::none) {
              const I s = Simd::add(Simd::load(sums[p] + j), h[v]);
              Simd::store(sums[p] + j, s);
              value = cost(s, left[p], right);
              if constexpr (T::keyed) {
                value = Simd::mark(value, keep, See == Sight::all ? Simd::set(v) : Simd::load(views.put + j));
                b[p] = lesser(value, b[p]);
              } else {
                if constexpr (See == Sight::some)
                  value = Simd::select(Simd::inside(Simd::load(views.index + j), first_seen(x + p), end_seen(x + p)), value,
                                       Simd::set(T::worst));
                const M better = Simd::less(b[p], value);
                b[p] = lesser(value, b[p]);
                bi[p] = Simd::select(better, bi[p], Simd::set(v));
              }
            }
            Simd::store(costs[p] + j, value);
          }
        });
      });
      unrolled<P>([&](auto p) STEREOPSIS_INLINE_LAMBDA {
        if constexpr (T::keyed) {
          if (number > 0)
            b[p] = lesser(Simd::mark(b[p], Simd::set(-1), Simd::set(number)), Simd::load(best + p * kLanes));
          Simd::store(best + p * kLanes, b[p]);
        } else {
          bi[p] = Simd::add(bi[p], Simd::load(views.index));
          if (number > 0) {
            const Vector before = Simd::load(best + p * kLanes);
            const M better = Simd::less(b[p], before);
            b[p] = Simd::select(better, b[p], before);
            bi[p] = Simd::select(better, bi[p], Simd::load(best_index + p * kLanes));
          }
          Simd::store(best + p * kLanes, b[p]);
          Simd::store(best_index + p * kLanes, bi[p]);
        }
      });
      col.step(P * kLanes, P);
      views.step(P, padded, pitch);
      best += P * kLanes;
      best_index += P * kLanes;
    };
    for (int x = begin; x < end;) {
      if constexpr (Simd::pixels > 1)
        if (x + Simd::pixels <= end && !col.extra(Simd::pixels)) {
          match(Constant<Simd::pixels>{}, x);
          x += Simd::pixels;
          continue;
        }
      match(Constant<1>{}, x);
      ++x;
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(slide_ + at + v * kLanes, h[v]); });
  }

  STEREOPSIS_NOINLINE void take_winners(int begin, int end) {
    if constexpr (T::keyed)
      take_keyed_winners(winner_ + begin, cost_ + begin);
    else
      take_indexed_winners(winner_ + begin, cost_ + begin);
    s_.uniqueness ? take_neighbours<true>(begin, end) : take_neighbours<false>(begin, end);
  }

  // The costs next to the winner's. For the least of the others they are struck out, and so is that.
  template <bool Strike>
  void take_neighbours(int begin, int end) {
    for (int x = begin; x < end; ++x) {
      Scalar* costs = costs_of(x);
      const int32_t* place = place_ + winner_[x];
      const int before = place[-1], after = place[1];
      before_[x] = costs[before];
      after_[x] = costs[after];
      if (Strike) costs[before] = costs[place[0]] = costs[after] = T::worst;
    }
  }

  void hand_out_costs(int begin, int end) const {
    Scalar* STEREOPSIS_RESTRICT in_order = volume_costs_;
    for (int x = begin; x < end; ++x) {
      const Scalar* costs = costs_of(x);
      for (int i = 0; i < padded_; i += kLanes) Simd::store(in_order + i, Simd::gather(costs, Simd::load(place_ + i)));
      float* STEREOPSIS_RESTRICT out = volume_row_ + static_cast<size_t>(x) * p_.count;
      for (int i = 0; i < p_.count; ++i) out[i] = T::keyed ? correlation_cost(in_order[i]) : in_order[i];
    }
  }

  // What is kept of pixel x's costs, until those of the next chunk.
  Scalar* costs_of(int x) const { return costs_ + x % kChunk * stride(); }

  // The least costs of a chunk's pixels so far, lane by lane; of each group by itself where they are keyed.
  Scalar* best_of(int at) const { return best_ + (T::keyed ? static_cast<size_t>(at / kLanes / kGroup) * kLanes * kChunk : 0); }

  // These two of a whole chunk, whatever its end: loops of known length.
  STEREOPSIS_NOINLINE void take_indexed_winners(int32_t* STEREOPSIS_RESTRICT winner, Scalar* STEREOPSIS_RESTRICT least) {
    Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return Simd::load(best_ + slot * kLanes); }, least);
    // Of the lanes that have it, the first candidate.
    Simd::row_minima(
        [&](int slot) STEREOPSIS_INLINE_LAMBDA {
          const M here = Simd::equal(Simd::load(best_ + slot * kLanes), splat(least[slot]));
          return Simd::select(here, Simd::load(best_index_ + slot * kLanes), Simd::set(INT32_MAX));
        },
        winner);
  }

  STEREOPSIS_NOINLINE void take_keyed_winners(int32_t* STEREOPSIS_RESTRICT winner, Scalar* STEREOPSIS_RESTRICT least) {
    const I lane_bits = Simd::load(lane_bits_);
    for (int v = 0; v < vectors_; v += kGroup) {
      int32_t keys[kChunk];
      const Scalar* best = best_of(v * kLanes);
      Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return by_lane(Simd::load(best + slot * kLanes), lane_bits); },
                       keys);
      for (int slot = 0; slot < kChunk; ++slot) {
        const int32_t key = keys[slot];
        const int found = (key >> kSpareWidth & kSpare) * vectors_ + v + (key & kSpare);
        const Scalar cost = key_cost(key);
        const bool better = v == 0 || cost < least[slot] || (cost == least[slot] && found < winner[slot]);
        winner[slot] = better ? found : winner[slot];
        least[slot] = better ? cost : least[slot];
      }
    }
  }

  // A cost between 2^-15 and 2^15 without its spare bits, then its lane, then what the spare bits said, as an integer that is
  // ordered like these: of equal costs the least is the first candidate's.
  static STEREOPSIS_INLINE I by_lane(F cost, I lane_bits) {
    const I bits = Simd::bits(cost), low = Simd::mark(bits, Simd::set(kSpare), lane_bits);
    return Simd::mark(Simd::times_16(bits), Simd::set(-(1 << 2 * kSpareWidth)), low);
  }
  static int32_t worst_key() {
    uint32_t bits;
    std::memcpy(&bits, &kWorstKept, sizeof bits);
    return static_cast<int32_t>(bits << kSpareWidth);
  }
  static float key_cost(int32_t key) {
    // The exponent's first bit and the next three tell 2^-15 ... 2 from 2 ... 2^15: now the sign does.
    const int32_t bits = ((key >> 2 * kSpareWidth) * (1 << kSpareWidth)) + 0x40000000;
    float cost;
    std::memcpy(&cost, &bits, sizeof cost);
    return cost;
  }

  static STEREOPSIS_INLINE Vector splat(Scalar v) { return Simd::set(v); }

  // Of two costs, b where a is not a number.
  static STEREOPSIS_INLINE Vector lesser(Vector a, Vector b) {
    if constexpr (T::keyed)
      return Simd::min_positive(a, b);
    else
      return Simd::min(a, b);
  }

  // The right view's winners so far, with the costs of pixels [begin, end). Right pixels go by mirrored column, where
  // candidate i of pixel x stands at width - 1 - x + i: from one pixel to the next a comb of them goes from one vector to the next,
  // and from the last to the first, one lane on. A block keeps the best of what a comb has met in passing its vectors, each time
  // anew; right pixels leave by the last lane, having met all that the block has for them.
  template <int N>
  STEREOPSIS_NOINLINE void take_right_block(const int begin, const int end, const int at, const int block) {
    Vector b[N + 1];
    I index[N + 1];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      b[v] = Simd::load(passing_ + at + v * kLanes);
      if constexpr (!T::keyed) index[v] = Simd::load(passing_index_ + at + v * kLanes);
    });
    const Scalar* costs = costs_of(begin) + at;
    const size_t pitch = stride();
    const auto pass = [&]() STEREOPSIS_INLINE_LAMBDA {
      unrolled<N>([&](auto w) STEREOPSIS_INLINE_LAMBDA {
        constexpr int v = N - 1 - w.value;
        const Vector value = Simd::load(costs + v * kLanes);
        if constexpr (!T::keyed)
          index[v + 1] = Simd::select(Simd::less(value, b[v]), Simd::set(v), index[v]);
        b[v + 1] = lesser(value, b[v]);
      });
      b[0] = splat(T::worst);
      if constexpr (!T::keyed) index[0] = Simd::set(0);
      costs += pitch;
    };
    const int comb = p_.width - 1 - begin + at / kLanes + N - 1;  // that passes the last vector
    const int row = met_row_ + at / kLanes + N - 1;
    Passed passed(*this, block, at, comb, row < vectors_ ? row : row - vectors_);
    if (T::keyed && vectors_ == N && end - begin == kChunk)
      passed.template keep_chunk<N>([&]() STEREOPSIS_INLINE_LAMBDA {
        pass();
        return b[N];
      });
    else
      for (int x = begin; x < end; ++x) {
        pass();
        passed.keep(b[N], index[N]);
      }
    if (end < p_.width) {
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        Simd::store(passing_ + at + v * kLanes, b[v]);
        if constexpr (!T::keyed) Simd::store(passing_index_ + at + v * kLanes, index[v]);
      });
    } else {
      unrolled<N - 1>([&](auto w) STEREOPSIS_INLINE_LAMBDA {
        constexpr int v = N - 1 - w.value;
        passed.keep(b[v], index[v]);
      });
      // Who has not left by the last lane has moved on by one.
      size_t to = static_cast<size_t>(block) * stats_ + at / kLanes;
      const int first = (at / kLanes + (p_.width - 1) * (vectors_ - 1)) % vectors_;
      for (int l = 1; l < kLanes; ++l)
        for (int m = 0, from = first; m < vectors_; ++m, ++to, from = from + 1 < vectors_ ? from + 1 : 0) {
          const size_t met = static_cast<size_t>(block) * padded_ + from * kLanes + l;
          right_met_[to] = met_[met];
          if constexpr (!T::keyed) right_met_index_[to] = met_index_[met];
        }
    }
  }

  // Where a block keeps what combs have met, one after another. Held by value, as `Views` are.
  class Passed {
   public:
    STEREOPSIS_INLINE Passed(const Narrow& n, int block, int at, int comb, int row)
        : vectors_(n.vectors_), row_(row), lanes_(Simd::load(T::keyed ? n.lane_bits_ : n.index_ + at)) {
      const size_t leaving = static_cast<size_t>(block) * n.stats_ + comb + (kLanes - 1) * (n.vectors_ - 1);
      met_ = n.met_ + static_cast<size_t>(block) * n.padded_;
      leaving_ = n.right_met_ + leaving;
      if constexpr (!T::keyed) {
        index_ = n.met_index_ + static_cast<size_t>(block) * n.padded_;
        leaving_index_ = n.right_met_index_ + leaving;
      }
    }
    STEREOPSIS_INLINE void keep(Vector cost, [[maybe_unused]] I index) {
      Met* const here = met_ + row_ * kLanes;
      if constexpr (T::keyed) {
        const I met = Simd::min(by_lane(cost, lanes_), Simd::load(here));
        Simd::store_last(leaving_--, met);
        Simd::store(here, Simd::shift_in(nothing_met, met));
      } else {
        int32_t* const index_here = index_ + row_ * kLanes;
        const Vector before = Simd::load(here);
        const M better = Simd::less(cost, before);
        const Vector met = Simd::select(better, cost, before);
        index = Simd::select(better, Simd::add(index, lanes_), Simd::load(index_here));
        Simd::store_last(leaving_--, met);
        Simd::store_last(leaving_index_--, index);
        Simd::store(here, Simd::shift_in(nothing_met, met));
        Simd::store(index_here, Simd::shift_in(0, index));
      }
      row_ = row_ > 0 ? row_ - 1 : vectors_ - 1;
    }
    // Of a chunk, whose combs come back within it, from N - 1 on.
    template <int N, class Next>
    STEREOPSIS_INLINE void keep_chunk(const Next& next) {
      if constexpr (T::keyed) {
        static_assert(kChunk % N == 0, "the next chunk starts where this did");
        I met[N];
        unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { met[v] = Simd::load(met_ + v * kLanes); });
        unrolled<kChunk>([&](auto p) STEREOPSIS_INLINE_LAMBDA {
          constexpr int v = N - 1 - p.value % N;
          const I now = Simd::min(by_lane(next(), lanes_), met[v]);
          Simd::store_last(leaving_ - p.value, now);
          met[v] = Simd::shift_in(nothing_met, now);
        });
        unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(met_ + v * kLanes, met[v]); });
        leaving_ -= kChunk;
      }
    }

   private:
    int vectors_, row_;
    I lanes_;  // what tells them apart in a key, or their candidates in the block's first vector
    Met *met_, *leaving_;
    int32_t *index_, *leaving_index_;
  };

  STEREOPSIS_NOINLINE void show_right_winners() {
    int block = 0;
    each_block([&](auto, int at) {
      const size_t met = static_cast<size_t>(block) * stats_;
      if constexpr (T::keyed)
        join_keys(right_met_ + met, stats_, at / kLanes, vectors_, block == 0, right_best_, right_index_);
      else
        join_costs(right_met_ + met, right_met_index_ + met, stats_, block == 0, right_best_, right_index_);
      ++block;
    });
    drop_unmet(right_best_, stats_, T::keyed ? worst_key() : nothing_met, right_index_);
  }

  // The least costs that a chunk keeps: its pixels' second best, their winners being struck out.
  STEREOPSIS_NOINLINE void take_second(int begin) {
    alignas(64) Scalar seconds[kChunk * kLanes];
    constexpr int abreast = kBlock;  // as many minima as hide each other's latency
    const size_t pitch = stride();
    for (int slot = 0; slot < kChunk; slot += abreast) {
      const Scalar* STEREOPSIS_RESTRICT costs = costs_of(begin + slot);
      Vector m[abreast];
      unrolled<abreast>([&](auto k) STEREOPSIS_INLINE_LAMBDA { m[k] = splat(T::worst); });
      for (int i = 0; i < padded_; i += kLanes)
        unrolled<abreast>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
          m[k] = lesser(Simd::load(costs + k.value * pitch + i), m[k]);
        });
      unrolled<abreast>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
        Simd::store(seconds + (slot + k.value) * kLanes, m[k]);
      });
    }
    Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return Simd::load(seconds + slot * kLanes); }, second_ + begin);
  }

  static void show_correlations(int count, float* STEREOPSIS_RESTRICT kept) {
    for (int x = 0; x < count; ++x) kept[x] = correlation_cost(kept[x]);
  }

  STEREOPSIS_NOINLINE void finish_row(const FusedOutput& out, int y) {
    if constexpr (T::keyed) {
      // A row at once: right after they were stored, one by one, their vectors would have to wait.
      for (Scalar* kept : {cost_, before_, after_}) show_correlations(p_.width, kept);
      if (s_.uniqueness) show_correlations(p_.width, second_);
    }
    RowWinners<Scalar> row{winner_, cost_, before_, after_, second_, claims_, right_index_};
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
  int32_t *sums_, *slide_, *primed_, *best_index_, *index_, *put_, *place_, *lane_bits_;
  Rights right_;
  Scalar *costs_, *best_, *passing_, *volume_costs_;
  Met *met_, *right_met_, *right_best_;
  int32_t *passing_index_, *met_index_, *right_met_index_;
  int blocks_ = 0;
  int met_row_ = 0;  // where `met_` has the comb that passes the first vector next: first 0, the last vector's N - 1
  int32_t *weight_a_[C], *weight_b_[C];
  int32_t *left_column_[C], *left_square_[C], *right_column_[C], *right_square_[C];
  int32_t *left_mean_[C], *left_rest_[C];
  float *left_high_[C], *left_low_[C];
  float *left_scale_, *norm_;
  int32_t *left_offset_, *edge_, *edge_square_, *sum_, *square_, *mean_, *rest_, *about_;
  uint8_t *padded_new_, *padded_old_, *mirrored_new_, *mirrored_old_, *plane_;
  int32_t *right_index_, *winner_, *claims_;
  Scalar *cost_, *before_, *after_, *second_;
};

}  // namespace
}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
