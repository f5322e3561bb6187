// The streaming kernel for windows weighted by a Gaussian, 8-bit images, compiled once per instruction set.
//
// Vertically, pixels are gathered in exact integers: the terms of two rows (products, or absolute differences, of pixels
// about 128) are 16-bit pairs, which one multiply-add weighs and sums. From there on sums are doubles, on few knots, so that
// subtracting the product of the means, which may be far larger than what is left, costs no accuracy; what is left is spread
// over the pixels as floats. The moments of each image alone go through the same three filters, those of the right image once
// for each place of a pixel between its knots: so a correlation stays one of true weighted moments.
//
// `static` and unnamed for the reason given in fused_narrow.hpp.
#pragma once

#include <cstring>
#include <optional>

#include "arena.hpp"
#include "gaussian.hpp"
#include "score.hpp"
#include "simd.hpp"
#include "winners.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

// Weights of a cubic B-spline, that is of four boxes one after the other, `stride` pixels each.
struct Spline {
  int weights[4 * kLargestStride - 3];
  explicit Spline(int stride) {
    int length = 1;
    weights[0] = 1;
    for (int pass = 0; pass < 4; ++pass) {
      int sum[4 * kLargestStride - 3] = {};
      for (int k = 0; k < length; ++k)
        for (int j = 0; j < stride; ++j) sum[k + j] += weights[k];
      length += stride - 1;
      std::memcpy(weights, sum, length * sizeof *sum);
    }
  }
};

// ---- plain loops over pointers that do not overlap ------------------------------------------------------------------

// One filter for all: the middle tap times what is here, and each further tap times the sum of what lies its number of
// steps to the one side and to the other. `at(j)` says where that is, for -reach <= j <= reach.
template <int Vectors, class At>
static STEREOPSIS_INLINE void symmetric(const At& at, const double* taps, int reach, double scale, double* out) {
  constexpr int half = Simd::lanes / 2;
  Simd::D sum[Vectors];
  const double* here = at(0);
  const Simd::D middle = Simd::set(taps[0]);
  unrolled<Vectors>([&](auto v) STEREOPSIS_INLINE_LAMBDA { sum[v] = Simd::mul(middle, Simd::load(here + v * half)); });
  for (int j = 1; j <= reach; ++j) {
    const Simd::D tap = Simd::set(taps[j]);
    const double *before = at(-j), *after = at(j);
    unrolled<Vectors>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      sum[v] = Simd::add(sum[v], Simd::mul(tap, Simd::add(Simd::load(before + v * half), Simd::load(after + v * half))));
    });
  }
  const Simd::D by = Simd::set(scale);
  unrolled<Vectors>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(out + v * half, Simd::mul(by, sum[v])); });
}

// Four rows, each with its weight. `count` is whole vectors of 16.
static STEREOPSIS_INLINE void mix(const double* const* rows, const double* weights, int count, double* to) {
  using D = Simd::D;
  const double *a = rows[0], *b = rows[1], *c = rows[2], *d = rows[3];
  const D wa = Simd::set(weights[0]), wb = Simd::set(weights[1]), wc = Simd::set(weights[2]), wd = Simd::set(weights[3]);
  for (int i = 0; i < count; i += Simd::lanes / 2)
    Simd::store(to + i, Simd::add(Simd::add(Simd::mul(wa, Simd::load(a + i)), Simd::mul(wb, Simd::load(b + i))),
                                  Simd::add(Simd::mul(wc, Simd::load(c + i)), Simd::mul(wd, Simd::load(d + i)))));
}

static void pair_up(const uint8_t* STEREOPSIS_RESTRICT above, const uint8_t* STEREOPSIS_RESTRICT below, int step, int count,
                    int32_t* STEREOPSIS_RESTRICT pairs) {
  for (int x = 0; x < count; ++x)
    pairs[x] = static_cast<int32_t>((static_cast<uint32_t>(above[x * step] - 128) & 0xFFFF) |
                                    static_cast<uint32_t>(below[x * step] - 128) << 16);
}

static void reversed(const int32_t* STEREOPSIS_RESTRICT from, int count, int32_t* STEREOPSIS_RESTRICT to) {
  for (int x = 0; x < count; ++x) to[x] = from[count - 1 - x];
}

// Adds the weighed values, and squares, of a pair of rows.
static void add_moments(const int32_t* STEREOPSIS_RESTRICT pairs, int32_t above, int32_t below, int count,
                        int32_t* STEREOPSIS_RESTRICT sum, int32_t* STEREOPSIS_RESTRICT square) {
  for (int x = 0; x < count; ++x) {
    const int32_t a = static_cast<int16_t>(pairs[x] & 0xFFFF), b = pairs[x] >> 16;
    sum[x] += above * a + below * b;
    square[x] += above * a * a + below * b * b;
  }
}

// ---- rows of knots --------------------------------------------------------------------------------------------------

template <bool Absolute, int C>
class KnotMaker {
  using I = Simd::I;
  static constexpr int lanes = Simd::lanes;
  static constexpr int kBlock = 8 * lanes;  // candidates at once

 public:
  KnotMaker(const Pair& pair, const GaussianGrid& grid, const GaussianFilter& filter, Arena& arena)
      : p_(pair), g_(grid), taps_(filter.taps), splines_(grid.stride) {
    const int span = rows_span();
    extended_ = g_.knots + 2 * g_.reach;
    first_column_ = g_.stride * (g_.first_knot - g_.reach) - g_.spline;
    columns_ = g_.stride * (extended_ - 1) + 2 * g_.spline + 1;
    slots_ = span + 2;  // pairs of rows that 2 span + 1 rows may touch, and one to spare
    mirrored_ = columns_ + g_.padded;
    moment_columns_ = g_.positions_padded + 2 * (g_.stride * g_.reach + g_.spline);
    tag_ = arena.take<int32_t>(slots_);
    left_ = arena.take<int32_t>(static_cast<size_t>(slots_) * C * columns_);
    right_ = arena.take<int32_t>(static_cast<size_t>(slots_) * C * mirrored_);
    plain_ = arena.take<int32_t>(static_cast<size_t>(slots_) * C * 2 * p_.width);
    weight_ = arena.take<int32_t>(slots_);
    left_of_ = arena.take<const int32_t*>(static_cast<size_t>(slots_) * C);
    right_of_ = arena.take<const int32_t*>(static_cast<size_t>(slots_) * C);
    row_weight_ = arena.take<int32_t>(2 * static_cast<size_t>(span) + 1);
    gathered_ = arena.take<int32_t>(static_cast<size_t>(columns_) * kBlock);
    coarse_ = arena.take<double>(static_cast<size_t>(extended_) * kBlock);
    sum_ = arena.take<int32_t>(p_.width);
    square_ = arena.take<int32_t>(p_.width);
    wide_ = arena.take<double>(moment_columns_ + 16);
    gathered_moments_ = arena.take<double>(moment_columns_ + 16);
  }

  // Before the first row; memory is zero.
  void start() {
    fill(INT32_MIN, slots_, tag_);
    for (int k = 0; k <= g_.spline; ++k) spline_taps_[k] = splines_.weights[g_.spline + k];
    const int span = rows_span();
    if (g_.stride > 1) {
      std::memcpy(row_weight_, splines_.weights, (2 * span + 1) * sizeof *row_weight_);
    } else {
      // The Gaussian in integers: what rounding leaves over goes to the middle tap.
      constexpr int one = 1 << 15;
      int left_over = one;
      for (int k = 1; k <= span; ++k) {
        const int weight = static_cast<int>(taps_[k] * one + 0.5);
        row_weight_[span + k] = row_weight_[span - k] = weight;
        left_over -= 2 * weight;
      }
      // A window of one row: twice half of it, for the weight is to fit 16 bits.
      row_weight_[span] = left_over < one ? left_over : one - 1;
    }
    double total = 0;
    for (int k = 0; k <= 2 * span; ++k) total += row_weight_[k];
    const double side = g_.stride;
    scale_ = 1 / (total * (side * side * side * side));
  }

  void make(int row, double* record) {
    const int span = rows_span(), from = g_.stride * row - span, to = g_.stride * row + span;
    first_pair_ = half(from);
    pairs_ = half(to) - first_pair_ + 1;
    for (int q = 0; q < pairs_; ++q) {
      load_pair(first_pair_ + q);
      const int k = 2 * (first_pair_ + q) - from;
      const uint32_t above = k >= 0 ? row_weight_[k] : 0, below = k + 1 <= 2 * span ? row_weight_[k + 1] : 0;
      weight_[q] = static_cast<int32_t>(above | below << 16);
    }
    int at = 0;
    for (; at + kBlock <= g_.padded; at += kBlock) candidates<kBlock>(at, record);
    for (; at < g_.padded; at += 16) candidates<16>(at, record);
    if (g_.maps > 0) moments(record + static_cast<size_t>(g_.knots) * g_.padded);
  }

 private:
  // Rows gathered to either side: with a stride of 1, as far as the Gaussian reaches.
  int rows_span() const { return g_.stride > 1 ? g_.spline : g_.reach; }
  static int half(int v) { return v >= 0 ? v / 2 : -((1 - v) / 2); }
  int slot(int pair) const { return ((pair % slots_) + slots_) % slots_; }
  int inside_row(int y) const { return y < 0 ? 0 : y < p_.height ? y : p_.height - 1; }

  int32_t* left(int slot, int c) const { return left_ + (static_cast<size_t>(slot) * C + c) * columns_; }
  int32_t* right(int slot, int c) const { return right_ + (static_cast<size_t>(slot) * C + c) * mirrored_; }
  int32_t* plain(int slot, int c, int side) const {
    return plain_ + ((static_cast<size_t>(slot) * C + c) * 2 + side) * p_.width;
  }

  // Rows 2 pair and 2 pair + 1, as pairs of 16 bits, edge pixels repeated; the right one mirrored, so that candidate i of
  // gathered column n meets entry columns - 1 - n + i.
  void load_pair(int pair) {
    const int s = slot(pair), W = p_.width;
    if (tag_[s] == pair) return;
    tag_[s] = pair;
    const size_t pitch = static_cast<size_t>(W) * C;
    const size_t above = inside_row(2 * pair) * pitch, below = inside_row(2 * pair + 1) * pitch;
    for (int c = 0; c < C; ++c) {
      const uint8_t* images[2] = {static_cast<const uint8_t*>(p_.left) + c, static_cast<const uint8_t*>(p_.right) + c};
      for (int side = 0; side < 2; ++side)
        pair_up(images[side] + above, images[side] + below, C, W, plain(s, c, side));
      const int before = -first_column_;
      int32_t* l = left(s, c);
      fill(plain(s, c, 0)[0], before, l);
      std::memcpy(l + before, plain(s, c, 0), W * sizeof *l);
      fill(plain(s, c, 0)[W - 1], columns_ - before - W, l + before + W);
      const int last = first_column_ + columns_ - 1 - p_.first;  // right column of entry 0
      const int in = clamp_to(last - (W - 1), 0, mirrored_), out = clamp_to(last + 1, in, mirrored_);
      int32_t* r = right(s, c);
      fill(plain(s, c, 1)[W - 1], in, r);
      if (out > in) reversed(plain(s, c, 1) + (last - out + 1), out - in, r + in);
      fill(plain(s, c, 1)[0], mirrored_ - out, r + out);
    }
  }

  static int clamp_to(int v, int lo, int hi) { return v < lo ? lo : v > hi ? hi : v; }

  template <int Count>
  STEREOPSIS_NOINLINE void candidates(int at, double* record) {
    gather_rows<Count>(at);
    for (int e = 0; e < extended_; ++e)
      gather_columns<Count>(gathered_ + static_cast<size_t>(g_.stride) * e * Count, coarse_ + static_cast<size_t>(e) * Count);
    constexpr int piece = 8;  // vectors at once
    constexpr int vectors = Count / (lanes / 2), several = vectors < piece ? vectors : piece;
    for (int k = 0; k < g_.knots; ++k) {
      const double* here = coarse_ + static_cast<size_t>(g_.reach + k) * Count;
      double* out = record + static_cast<size_t>(k) * g_.padded + at;
      for (int i = 0; i < Count; i += several * (lanes / 2))
        symmetric<several>([&](int j) { return here + i + j * Count; }, taps_, g_.reach, scale_, out + i);
    }
  }

  template <int Count>
  STEREOPSIS_INLINE void gather_rows(int at) {
    constexpr int N = Count / lanes;
    const int columns = columns_, pairs = pairs_;
    const int32_t **l = left_of_, **r = right_of_;
    for (int q = 0; q < pairs; ++q)
      for (int c = 0; c < C; ++c) {
        l[q * C + c] = left(slot(first_pair_ + q), c);
        r[q * C + c] = right(slot(first_pair_ + q), c) + at + columns - 1;
      }
    for (int n = 0; n < columns; ++n) {
      I sum[N];
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { sum[v] = Simd::set(0); });
      for (int q = 0; q < pairs; ++q) {
        const I weight = Simd::set(weight_[q]);
        unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
          const I a = Simd::set(l[q * C + c][n]);
          const int32_t* b = r[q * C + c] - n;
          unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
            const I other = Simd::load(b + v * lanes);
            const I term = Absolute ? Simd::abs_diff16(a, other) : Simd::mul16(a, other);
            sum[v] = Simd::dot16(sum[v], term, weight);
          });
        });
      }
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        Simd::store(gathered_ + static_cast<size_t>(n) * Count + v * lanes, sum[v]);
      });
    }
  }

  // The B-spline along a row. Sums of two still fit 32 bits.
  template <int Count>
  STEREOPSIS_INLINE void gather_columns(const int32_t* from, double* to) const {
    constexpr int half = lanes / 2, several = Count < 64 ? Count / lanes : 64 / lanes;
    for (int at = 0; at < Count; at += several * lanes) {
      Simd::D sum[2 * several];
      const Simd::D middle = Simd::set(spline_taps_[0]);
      const int32_t* here = from + g_.spline * Count + at;
      unrolled<several>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        const I value = Simd::load(here + v * lanes);
        sum[2 * v] = Simd::mul(middle, Simd::lower(value));
        sum[2 * v + 1] = Simd::mul(middle, Simd::upper(value));
      });
      for (int k = 1; k <= g_.spline; ++k) {
        const Simd::D weight = Simd::set(spline_taps_[k]);
        const int32_t *before = here - k * Count, *after = here + k * Count;
        unrolled<several>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
          const I value = Simd::add(Simd::load(before + v * lanes), Simd::load(after + v * lanes));
          sum[2 * v] = Simd::add(sum[2 * v], Simd::mul(weight, Simd::lower(value)));
          sum[2 * v + 1] = Simd::add(sum[2 * v + 1], Simd::mul(weight, Simd::upper(value)));
        });
      }
      unrolled<2 * several>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Simd::store(to + at + v * half, sum[v]); });
    }
  }

  // The maps of both images: rows gathered, columns gathered and filtered at every position.
  STEREOPSIS_NOINLINE void moments(double* maps) {
    for (int c = 0; c < C; ++c)
      for (int side = 0; side < 2; ++side) {
        std::memset(sum_, 0, p_.width * sizeof *sum_);
        std::memset(square_, 0, p_.width * sizeof *square_);
        for (int q = 0; q < pairs_; ++q)
          add_moments(plain(slot(first_pair_ + q), c, side), weight_[q] & 0xFFFF, weight_[q] >> 16, p_.width, sum_, square_);
        double* out = maps + static_cast<size_t>(4 * c + 2 * side) * g_.positions_padded;
        spread_moment(sum_, out);
        spread_moment(square_, out + g_.positions_padded);
      }
  }

  void spread_moment(const int32_t* sums, double* out) {
    const int W = p_.width, before = g_.margin + g_.stride * g_.reach + g_.spline;
    for (int k = 0; k < moment_columns_; ++k) wide_[k] = sums[clamp_to(k - before, 0, W - 1)];
    for (int x = 0; x < moment_columns_ - 2 * g_.spline; x += 16)
      symmetric<32 / lanes>([&](int j) { return wide_ + g_.spline + x + j; }, spline_taps_, g_.spline, 1.0,
                            gathered_moments_ + x);
    const double* here = gathered_moments_ + static_cast<size_t>(g_.stride) * g_.reach;
    for (int x = 0; x < g_.positions_padded; x += 16)
      symmetric<32 / lanes>([&](int j) { return here + x + j * g_.stride; }, taps_, g_.reach, scale_, out + x);
  }

  const Pair& p_;
  const GaussianGrid& g_;
  const double* taps_;
  Spline splines_;
  int extended_, first_column_, columns_, slots_, mirrored_, moment_columns_, first_pair_ = 0, pairs_ = 0;
  double scale_ = 0, spline_taps_[2 * kLargestStride - 1] = {};
  int32_t *tag_, *left_, *right_, *plain_, *weight_, *row_weight_, *gathered_, *sum_, *square_;
  const int32_t **left_of_, **right_of_;
  double *coarse_, *wide_, *gathered_moments_;
};

// ---- rows of pixels -------------------------------------------------------------------------------------------------

// A norm that is rounding alone counts as none.
static void inverse_norms(const float* STEREOPSIS_RESTRICT norm, int count, float* STEREOPSIS_RESTRICT scale) {
  for (int i = 0; i < count; ++i) scale[i] = inverse_root(norm[i], 1e-6f);
}

template <CostKind Kind, int C>
class GaussianRows {
  using I = Simd::I;
  using F = Simd::F;
  static constexpr int lanes = Simd::lanes;
  static constexpr bool correlation = Kind == CostKind::ncc || Kind == CostKind::zncc;
  static constexpr bool centred = Kind == CostKind::zssd || Kind == CostKind::zncc;
  static constexpr bool squared = Kind == CostKind::ssd || Kind == CostKind::zssd;
  static constexpr double factor = Kind == CostKind::sad ? 1 : squared ? -2 : -1;  // of the blurred terms in the cost
  static constexpr int kSlots = 16;   // pixels whose costs are kept until their winners are taken
  static constexpr int kGroup = 8;    // vectors that the spare bits of a cost tell apart
  static constexpr float worst = worst_cost<float>();

 public:
  GaussianRows(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, void* memory)
      : p_(pair), s_(settings), g_(pair, settings.cost, filter), arena_{static_cast<char*>(memory)} {
    if (g_.stride == 1) knots_.emplace(p_, g_, filter, arena_);
    const int W = p_.width, s = g_.stride;
    vectors_ = g_.padded / lanes;
    groups_ = (vectors_ + kGroup - 1) / kGroup;
    stats_ = W + g_.padded;
    // Positions of the right image that a knot or a pixel may ask for, mirrored.
    const int last_knot = s * (g_.first_knot + g_.knots - 1), first_knot = s * g_.first_knot;
    mirror_first_ = last_knot - p_.first > W - 1 + 2 * s ? last_knot - p_.first : W - 1 + 2 * s;
    const int least = first_knot - p_.first - g_.padded < -2 * s ? first_knot - p_.first - g_.padded : -2 * s;
    mirror_ = mirror_first_ - least + 1;
    row_ = arena_.take<double>(s > 1 ? g_.maps_size() : g_.record());
    for (int c = 0; c < C; ++c) knot_mean_[c] = arena_.take<float>(4 * static_cast<size_t>(g_.padded));
    for (int k = 0; k < 2 * C; ++k) mirrored_[k] = arena_.take<double>(mirror_);
    for (int c = 0; c < C; ++c) left_slope_[c] = arena_.take<float>(W);
    left_offset_ = arena_.take<float>(W);
    left_scale_ = arena_.take<float>(W);
    norm_ = arena_.take<float>(stats_);
    for (int c = 0; c < C; ++c) right_mean_[c] = arena_.take<float>(static_cast<size_t>(s) * stats_);
    right_offset_ = arena_.take<float>(static_cast<size_t>(s) * stats_);
    right_scale_ = arena_.take<float>(static_cast<size_t>(s) * stats_);
    spline_ = arena_.take<double>(4 * static_cast<size_t>(s));
    spline_float_ = arena_.take<float>(4 * static_cast<size_t>(s));
    knot_ = arena_.take<float>(4 * static_cast<size_t>(g_.padded));
    index_ = arena_.take<int32_t>(g_.padded);
    costs_ = arena_.take<float>(kSlots * pitch());
    best_ = arena_.take<float>(kSlots * best_pitch());
    right_best_ = arena_.take<float>(stats_);
    right_index_ = arena_.take<int32_t>(stats_);
    claims_ = arena_.take<int32_t>(2 * W + 1);
    winner_ = arena_.take<int32_t>(W);
    cost_ = arena_.take<float>(W);
    before_ = arena_.take<float>(W);
    after_ = arena_.take<float>(W);
    second_ = arena_.take<float>(W);
  }

  size_t bytes() const { return arena_.used; }

  void rows(const KnotRows& knots, const FusedOutput& out, int begin, int end, const Cancel& cancel) {
    std::memset(arena_.base, 0, arena_.used);
    start();
    for (int y = begin; y < end; ++y) {
      if (cancel.load(std::memory_order_relaxed)) return;
      blurred_row(knots, y);
      if (g_.maps > 0) {
        describe_left();
        describe_right();
      }
      match_row();
      finish(p_, s_, RowWinners<float>{winner_, cost_, before_, after_, second_, claims_, right_index_}, out, y);
    }
  }

 private:
  size_t pitch() const { return g_.padded + 32; }  // costs of a pixel, with room for a neighbour on both sides
  size_t best_pitch() const { return static_cast<size_t>(groups_) * lanes; }

  void start() {
    const int s = g_.stride;
    for (int i = 0; i < g_.padded; ++i) index_[i] = i;
    fill(worst, static_cast<int>(kSlots * pitch()), costs_);
    if (s == 1) {
      knots_->start();
      spline_[1] = 1;
    } else {
      const Spline spline(s);
      const double whole = static_cast<double>(s) * s * s;
      for (int p = 0; p < s; ++p)
        for (int i = 0; i < 4; ++i) {
          const int away = p - s * (i - 1) + g_.spline;
          spline_[4 * p + i] = 0 <= away && away <= 2 * g_.spline ? spline.weights[away] / whole : 0;
        }
    }
    for (int k = 0; k < 4 * s; ++k) spline_float_[k] = static_cast<float>(spline_[k]);
  }

  // The maps at row y, and what its knots are made of.
  void blurred_row(const KnotRows& knots, int y) {
    if (g_.stride == 1) {
      knots_->make(y, row_);
      maps_ = row_ + g_.maps_at();
      return;
    }
    const int k = y / g_.stride;
    vertical_ = spline_ + 4 * (y - k * g_.stride);
    const double* rows[4];
    for (int i = 0; i < 4; ++i) {
      rows_[i] = knots.at(k - 1 + i);
      rows[i] = rows_[i] + g_.maps_at();
    }
    mix(rows, vertical_, static_cast<int>(g_.maps_size()), row_);
    maps_ = row_;
  }

  // ---- moments of each image alone ----------------------------------------------------------------------------------

  const double* map(int c, int side, int power) const {
    return maps_ + static_cast<size_t>(4 * c + 2 * side + power) * g_.positions_padded +
           g_.margin;
  }

  // Squares about 0 from moments about 128.
  static STEREOPSIS_INLINE double about_zero(double mean, double square) { return square + 256.0 * mean + 16384.0; }

  // What a pixel's formula starts from, by channel: the mean that is subtracted from its knots, and so not from its pixels.
  double reference(int knot, int c) const {
    return centred ? map(c, 0, 0)[knot * g_.stride] : Kind == CostKind::ncc ? -128.0 : 0.0;
  }

  STEREOPSIS_NOINLINE void describe_left() {
    for (int knot = 0, x = 0; x < p_.width; ++knot)
      for (int p = 0; p < g_.stride && x < p_.width; ++p, ++x) describe_left(x, knot, spline_ + 4 * p);
    if (correlation) inverse_norms(norm_, p_.width, left_scale_);
  }

  STEREOPSIS_INLINE void describe_left(int x, int knot, const double* w) {
    const int s = g_.stride;
    double norm = 0, offset = 0;
    for (int c = 0; c < C; ++c) {
      double moment[2];
      for (int power = 0; power < 2; ++power) {
        const double* m = map(c, 0, power) + knot * s;
        moment[power] = s == 1 ? m[0] : (w[0] * m[-s] + w[1] * m[0]) + (w[2] * m[s] + w[3] * m[2 * s]);
      }
      const double mean = moment[0], square = moment[1];
      if (Kind == CostKind::ncc) {
        norm += about_zero(mean, square);
        offset -= 128.0 * (mean + 128.0);
      } else {
        norm += centred ? square - mean * mean : square;
      }
      if (centred) left_slope_[c][x] = static_cast<float>(-factor * (mean - reference(knot, c)));
    }
    norm_[x] = static_cast<float>(norm);
    left_offset_[x] = static_cast<float>(squared ? norm : offset);
  }

  // For each place of a pixel between its knots, mirrored: pixel x - d of candidate i at [width - 1 - x + i].
  STEREOPSIS_NOINLINE void describe_right() {
    const int W = p_.width, s = g_.stride;
    for (int c = 0; c < C; ++c)
      for (int power = 0; power < 2; ++power) {
        double* to = mirrored_[2 * c + power];
        const double* from = map(c, 1, power);
        for (int k = 0; k < mirror_; ++k) {
          const int at = mirror_first_ - k, most = W + g_.margin - 1;
          to[k] = from[at < -g_.margin ? -g_.margin : at > most ? most : at];
        }
      }
    const int begin = p_.first < 0 ? -p_.first : 0, end = W - p_.first < stats_ ? W - p_.first : stats_;
    if (begin >= end) return;
    for (int p = 0; p < s; ++p) {
      const double* w = spline_ + 4 * p;
      float* offset = right_offset_ + static_cast<size_t>(p) * stats_;
      for (int c = 0; c < C; ++c) {
        // Knot i of a pixel lies (i - 1) stride - p to its right, and so that much earlier in the mirrored maps.
        const int base = mirror_first_ - (W - 1 - p_.first) + p;
        const double *mean = mirrored_[2 * c] + base, *square = mirrored_[2 * c + 1] + base;
        float* means = right_mean_[c] + static_cast<size_t>(p) * stats_;
        if (s == 1)
          right_moments<1>(mean, square, w, s, begin, end, c == 0, means, norm_);
        else
          right_moments<4>(mean, square, w, s, begin, end, c == 0, means, norm_);
      }
      if (correlation)
        inverse_norms(norm_ + begin, end - begin, right_scale_ + static_cast<size_t>(p) * stats_ + begin);
      else
        std::memcpy(offset + begin, norm_ + begin, (end - begin) * sizeof(float));
    }
  }

  template <int Knots>
  static STEREOPSIS_INLINE double between(const double* m, const double* w, int s) {
    return Knots == 1 ? m[0] : (w[0] * m[s] + w[1] * m[0]) + (w[2] * m[-s] + w[3] * m[-2 * s]);
  }

  template <int Knots>
  static void right_moments(const double* STEREOPSIS_RESTRICT mean, const double* STEREOPSIS_RESTRICT square,
                            const double* STEREOPSIS_RESTRICT w, int s, int begin, int end, bool first,
                            float* STEREOPSIS_RESTRICT means, float* STEREOPSIS_RESTRICT norm) {
    for (int j = begin; j < end; ++j) {
      const double m = between<Knots>(mean + j, w, s), q = between<Knots>(square + j, w, s);
      means[j] = static_cast<float>(m);
      const double of = Kind == CostKind::ncc ? about_zero(m, q) : centred ? q - m * m : q;
      norm[j] = (first ? 0.0f : norm[j]) + static_cast<float>(of);
    }
  }

  // ---- costs --------------------------------------------------------------------------------------------------------

  // Candidates [first_seen, end_seen) of pixel x are inside the right image.
  int first_seen(int x) const { return x - p_.first - (p_.width - 1) > 0 ? x - p_.first - (p_.width - 1) : 0; }
  int end_seen(int x) const { return x - p_.first + 1 < p_.count ? x - p_.first + 1 : p_.count; }

  void match_row() {
    if (s_.left_right) {
      fill(worst, stats_, right_best_);
      fill(-1, stats_, right_index_);
    }
    // As many whole stretches between knots as there is room for.
    const int s = g_.stride, chunk = kSlots / s * s;
    for (int begin = 0; begin < p_.width; begin += chunk) {
      const int end = begin + chunk < p_.width ? begin + chunk : p_.width;
      for (int x = begin; x < end; x += s) {
        const int past = x + s < end ? x + s : end;
        if (s == 1)
          match_between<1>(x, past, x - begin);
        else
          match_between<4>(x, past, x - begin);
      }
      take_winners(begin, end);
      if (s_.left_right)
        for (int x = begin; x < end; ++x) take_right_winners(x, x - begin);
      if (s_.uniqueness)
        for (int x = begin; x < end; ++x) take_second(x, x - begin);
    }
  }

  // Pixels [begin, end), which lie between the same knots.
  template <int Knots>
  void match_between(int begin, int end, int slot) {
    const int s = g_.stride, knot = begin / s;
    for (int k = Knots == 1 ? knot : begin == 0 ? -1 : knot + 2; k <= knot + (Knots == 1 ? 0 : 2); ++k) take_column<Knots>(k);
    if constexpr (centred)
      for (int i = 0; i < Knots; ++i)
        for (int c = 0; c < C; ++c)
          shift_[i][c] = static_cast<float>(factor * (reference(knot + i - (Knots > 1), c) - reference(knot, c)));
    constexpr int block = lanes == 16 ? 4 : 2;
    for (int v = 0; v < vectors_;) {
      const int at = v * lanes;
      if (vectors_ - v >= block) {
        constexpr int past = block * lanes;
        if (first_seen(end - 1) <= at && at + past <= end_seen(begin))
          match_block<Knots, block, true>(begin, end, slot, v);
        else
          match_block<Knots, block, false>(begin, end, slot, v);
        v += block;
      } else {
        match_block<Knots, 1, false>(begin, end, slot, v);
        ++v;
      }
    }
  }

  // Candidates of a knot at this row, less the product of the left reference and the right mean there.
  template <int Knots>
  STEREOPSIS_NOINLINE void take_column(int knot) {
    using D = Simd::D;
    const size_t at = static_cast<size_t>(knot - g_.first_knot) * g_.padded, to = static_cast<size_t>(knot & 3) * g_.padded;
    const double* rows[Knots];
    D weight[Knots], reference_of[C];
    for (int i = 0; i < Knots; ++i) {
      rows[i] = (Knots == 1 ? row_ : rows_[i]) + at;
      if (Knots > 1) weight[i] = Simd::set(vertical_[i]);
    }
    const double* right[C];
    for (int c = 0; c < C; ++c) {
      right[c] = mirrored_[2 * c] + (mirror_first_ - g_.stride * knot + p_.first);
      reference_of[c] = Simd::set(reference(knot, c));
    }
    const D by = Simd::set(factor);
    for (int i = 0; i < g_.padded; i += lanes / 2) {
      D sum = Simd::load(rows[0] + i);
      if constexpr (Knots == 4)
        sum = Simd::add(Simd::add(Simd::mul(weight[0], sum), Simd::mul(weight[1], Simd::load(rows[1] + i))),
                        Simd::add(Simd::mul(weight[2], Simd::load(rows[2] + i)), Simd::mul(weight[3], Simd::load(rows[3] + i))));
      if constexpr (centred || Kind == CostKind::ncc)
        unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
          const D mean = Simd::load(right[c] + i);
          sum = Simd::sub(sum, Simd::mul(reference_of[c], mean));
          if constexpr (centred) Simd::store(knot_mean_[c] + to + i, mean);
        });
      Simd::store(knot_ + to + i, Simd::mul(by, sum));
    }
  }

  template <int Knots, int N, bool All>
  STEREOPSIS_NOINLINE void match_block(const int begin, const int end, const int slot, const int first_vector) {
    const int at = first_vector * lanes, group = first_vector / kGroup;
    const size_t padded = g_.padded, stats = stats_;
    const I keep = Simd::set(~static_cast<int32_t>(kSpareBits));
    const F zero = Simd::set(0.0f);
    F knot[Knots][N];
    // All four about the reference of the one to the left of these pixels.
    const int own = begin / g_.stride;
    unrolled<Knots>([&](auto i) STEREOPSIS_INLINE_LAMBDA {
      const size_t from = static_cast<size_t>((own + i - (Knots > 1)) & 3) * padded + at;
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        knot[i][v] = Simd::load(knot_ + from + v * lanes);
        if constexpr (centred && Knots > 1 && i != 1)
          unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
            knot[i][v] = Simd::add(knot[i][v], Simd::mul(Simd::set(shift_[i][c]), Simd::load(knot_mean_[c] + from + v * lanes)));
          });
      });
    });
    const bool fresh = first_vector % kGroup == 0;
    const int p0 = begin % g_.stride;
    for (int x = begin; x < end; ++x) {
      const int p = p0 + x - begin, row = slot + x - begin;
      const float* w = spline_float_ + 4 * p;
      const size_t j = p * stats + (p_.width - 1 - x) + at;
      float* best = best_ + row * best_pitch() + group * lanes;
      float* costs = costs_of(row) + at;
      // `inside` counts round the end of the integers where a pixel sees nothing and its bounds have crossed.
      [[maybe_unused]] const int lo = first_seen(x), hi = end_seen(x) > lo ? end_seen(x) : lo;
      F b = fresh ? Simd::set(worst) : Simd::load(best);
      F weight[Knots], slope[C];
      unrolled<Knots>([&](auto i) STEREOPSIS_INLINE_LAMBDA { weight[i] = Simd::set(w[i]); });
      if constexpr (centred) unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA { slope[c] = Simd::set(left_slope_[c][x]); });
      const F offset = Simd::set(left_offset_[x]);
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        const size_t there = j + v * lanes;
        F value = knot[0][v];
        if constexpr (Knots == 4)
          value = Simd::add(Simd::add(Simd::mul(weight[0], knot[0][v]), Simd::mul(weight[1], knot[1][v])),
                            Simd::add(Simd::mul(weight[2], knot[2][v]), Simd::mul(weight[3], knot[3][v])));
        if constexpr (centred)
          unrolled<C>([&](auto c) STEREOPSIS_INLINE_LAMBDA {
            value = Simd::add(value, Simd::mul(slope[c], Simd::load(right_mean_[c] + there)));
          });
        if constexpr (Kind == CostKind::ncc || squared) value = Simd::add(value, offset);
        if constexpr (squared) value = Simd::add(value, Simd::load(right_offset_ + there));
        if constexpr (correlation) value = Simd::mul(value, Simd::load(right_scale_ + there));
        // The spare bits say which vector of its group a candidate is in. Of equal negative numbers those with more bits set
        // are less, of positive ones those with fewer: so the first vector wins.
        const int number = (first_vector + v) % kGroup;
        if constexpr (!correlation) value = Simd::select(Simd::less(value, zero), zero, value);
        value = Simd::mark(value, keep, Simd::set(correlation ? kGroup - 1 - number : number));
        if constexpr (!All)
          value = Simd::select(Simd::inside(Simd::load(index_ + at + v * lanes), lo, hi), value, Simd::set(worst));
        b = Simd::min(value, b);
        Simd::store(costs + v * lanes, value);
      });
      Simd::store(best, b);
    }
  }

  // ---- winners ------------------------------------------------------------------------------------------------------

  float* costs_of(int slot) const { return costs_ + slot * pitch() + 16; }

  // A stored candidate's cost.
  float plain(float stored, int x) const {
    if (!(stored < worst)) return stored;
    return correlation ? at_least(coarse(stored) * left_scale_[x], -1.0f) : coarse(stored);
  }
  static float at_least(float v, float least) { return v < least ? least : v; }

  STEREOPSIS_NOINLINE void take_winners(int begin, int end) {
    float least[kSlots];
    for (int group = 0; group < groups_; ++group) {
      float keys[kSlots];
      Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return Simd::load(best_ + group * lanes + slot * best_pitch()); }, keys);
      for (int slot = 0; slot < end - begin; ++slot) {
        if (group > 0 && !(coarse(keys[slot]) < coarse(least[slot]))) continue;
        if (!(keys[slot] < worst)) {
          least[slot] = worst;
          winner_[begin + slot] = -1;
          continue;
        }
        uint32_t bits;
        std::memcpy(&bits, keys + slot, sizeof bits);
        const int number = static_cast<int>(bits & kSpareBits);
        least[slot] = keys[slot];
        winner_[begin + slot] = (group * kGroup + (correlation ? kGroup - 1 - number : number)) * lanes +
                                Simd::first_equal(Simd::load(best_ + slot * best_pitch() + group * lanes), keys[slot]);
      }
    }
    for (int slot = 0; slot < end - begin; ++slot) {
      const int x = begin + slot;
      if (winner_[x] < 0) continue;
      // Where nothing correlates the spare bits put equal candidates in the wrong order.
      if (correlation && !(least[slot] < 0)) winner_[x] = first_least(x, costs_of(slot));
      const float* costs = costs_of(slot) + winner_[x];
      cost_[x] = plain(costs[0], x);
      before_[x] = plain(costs[-1], x);
      after_[x] = plain(costs[1], x);
    }
  }

  STEREOPSIS_NOINLINE int first_least(int x, const float* costs) const {
    int best = first_seen(x);
    if (left_scale_[x] == 0) return best;  // a left window without texture: all are equal
    for (int i = best + 1; i < end_seen(x); ++i)
      if (coarse(costs[i]) < coarse(costs[best])) best = i;
    return best;
  }

  // Right pixel x - first - i by mirrored column width - 1 - x + i.
  void take_right_winners(int x, int slot) {
    const float* STEREOPSIS_RESTRICT costs = costs_of(slot);
    float* best = right_best_ + (p_.width - 1 - x);
    int32_t* index = right_index_ + (p_.width - 1 - x);
    const I keep = Simd::set(~static_cast<int32_t>(kSpareBits));
    const F scale = Simd::set(correlation ? left_scale_[x] : 1.0f), all = Simd::set(worst);
    const int lo = first_seen(x) / lanes * lanes, hi = end_seen(x);
    for (int i = lo; i < hi; i += lanes) {
      const F stored = Simd::load(costs + i);
      const F value = Simd::select(Simd::less(stored, all), Simd::mul(Simd::mask(stored, keep), scale), all);
      const F b = Simd::load(best + i);
      const auto better = Simd::less(value, b);
      Simd::store(best + i, Simd::select(better, value, b));
      Simd::store(index + i, Simd::select(better, Simd::load(index_ + i), Simd::load(index + i)));
    }
  }

  // The least cost of the candidates that are not next to the winner. Strikes out the stored costs of those that are.
  void take_second(int x, int slot) {
    if (winner_[x] < 0) return;
    float* costs = costs_of(slot);
    for (int i = -1; i < 2; ++i) costs[winner_[x] + i] = worst;
    F least = Simd::set(worst);
    for (int i = first_seen(x) / lanes * lanes; i < end_seen(x); i += lanes) least = Simd::min(Simd::load(costs + i), least);
    second_[x] = plain(Simd::reduce_min(least), x);
  }

  const Pair& p_;
  const FusedSettings& s_;
  const GaussianGrid g_;
  Arena arena_;
  std::optional<KnotMaker<Kind == CostKind::sad, C>> knots_;  // where every row is one of knots
  int vectors_, groups_, stats_, mirror_first_, mirror_;
  float *knot_mean_[C], shift_[4][C] = {};
  double *row_, *mirrored_[2 * C], *spline_;
  const double *rows_[4] = {}, *vertical_ = nullptr, *maps_ = nullptr;
  float *left_slope_[C], *left_offset_, *left_scale_, *norm_, *right_mean_[C], *right_offset_, *right_scale_, *spline_float_;
  float *knot_, *costs_, *best_, *right_best_, *cost_, *before_, *after_, *second_;
  int32_t *index_, *right_index_, *claims_, *winner_;
};

// Rows of knots alone.
template <bool Absolute, int C>
class GaussianKnots {
 public:
  GaussianKnots(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, void* memory)
      : g_(pair, settings.cost, filter), arena_{static_cast<char*>(memory)}, maker_(pair, g_, filter, arena_) {}

  size_t bytes() const { return arena_.used; }

  // Pieces [begin, end) of rows [first, past), vertically filtered.
  static void filter(const GaussianFilter& filter, const KnotRows& knots, const KnotRows& filtered, int first, int past,
                     int begin, int end, const Cancel& cancel) {
    constexpr int step = 2 * Simd::lanes;
    for (int piece = begin; piece < end; ++piece) {
      if (cancel.load(std::memory_order_relaxed)) return;
      const size_t from = static_cast<size_t>(piece) * kPiece;
      const size_t to = from + kPiece < knots.record ? from + kPiece : knots.record;
      for (int row = first; row < past; ++row) {
        double* out = filtered.at(row);
        size_t at = from;
        for (; at + step <= to; at += step)
          symmetric<4>([&](int j) { return knots.at(row + j) + at; }, filter.taps, filter.reach, 1.0, out + at);
        for (; at < to; at += 16)
          symmetric<32 / Simd::lanes>([&](int j) { return knots.at(row + j) + at; }, filter.taps, filter.reach, 1.0, out + at);
      }
    }
  }

  void make(const KnotRows& rows, int begin, int end, const Cancel& cancel) {
    std::memset(arena_.base, 0, arena_.used);
    maker_.start();
    for (int row = begin; row < end; ++row) {
      if (cancel.load(std::memory_order_relaxed)) return;
      maker_.make(row, rows.at(row));
    }
  }

 private:
  const GaussianGrid g_;
  Arena arena_;
  KnotMaker<Absolute, C> maker_;
};

}  // namespace
}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
