// One build of the streaming kernel for ZNCC of 16-bit and float images of one channel, for the instruction set that
// STEREOPSIS_ISA names; `Sums` says in what numbers products are summed.
//
// Pixels are counted from the middle of the images' range, which changes nothing in what WideCost asks for. As in
// fused_narrow.hpp `sums` holds minus the window's sum of l r, what rows and columns change slides along x in `slide`, and the
// right image is kept mirrored, so that candidates are contiguous. `static` and unnamed for the reason given there.
#include <cmath>
#include <cstring>
#include <initializer_list>

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
constexpr int kChunk = 16;  // pixels whose costs are kept until their winners are taken

static STEREOPSIS_INLINE int clamp(int v, int lo, int hi) { return v < lo ? lo : v > hi ? hi : v; }
static STEREOPSIS_INLINE int least(int a, int b) { return a < b ? a : b; }
static STEREOPSIS_INLINE int most(int a, int b) { return a > b ? a : b; }
static STEREOPSIS_INLINE int32_t pack16(int low, int high) {
  return static_cast<int32_t>((static_cast<uint32_t>(low) & 0xFFFF) | (static_cast<uint32_t>(high) << 16));
}
template <class T>
static void fill(T value, int count, T* STEREOPSIS_RESTRICT values) {
  for (int x = 0; x < count; ++x) values[x] = value;
}

// Rows about to enter and to leave the window: left ones of `columns` with their edge pixels repeated, right ones mirrored, of
// `reach` and another window's width.
struct DeepRows {
  const int32_t *left_in, *left_out, *right_in, *right_out;
  int window, columns, reach;
  // The pixel of the column that leaves the window as column k enters it.
  int32_t older(const int32_t* left, int k) const { return k < window ? 0 : left[k - window]; }
};

// Where `words_fit`: products of two 16-bit numbers at a time, of the column that enters and of the one that leaves.
struct WordSums {
  using Stored = int32_t;
  using Sum = I;
  int32_t *in, *out, *weight_in, *weight_out, *right;

  void take(Arena& arena, int columns, int reach, int stats) {
    in = arena.take<int32_t>(reach);
    out = arena.take<int32_t>(reach);
    weight_in = arena.take<int32_t>(columns);
    weight_out = arena.take<int32_t>(columns);
    right = arena.take<int32_t>(stats);
  }
  static STEREOPSIS_INLINE Sum load(const Stored* p) { return Simd::load(p); }
  static STEREOPSIS_INLINE void store(Stored* p, Sum v) { Simd::store(p, v); }
  static STEREOPSIS_INLINE Sum add(Sum a, Sum b) { return Simd::add(a, b); }

  void change(const DeepRows& rows) {
    pair_up(rows.right_in, rows.window, rows.reach, in);
    pair_up(rows.right_out, rows.window, rows.reach, out);
    for (int k = 0; k < rows.columns; ++k) {
      weight_in[k] = pack16(-rows.left_in[k], rows.older(rows.left_in, k));
      weight_out[k] = pack16(rows.left_out[k], -rows.older(rows.left_out, k));
    }
  }
  static void pair_up(const int32_t* STEREOPSIS_RESTRICT row, int apart, int count, int32_t* STEREOPSIS_RESTRICT pairs) {
    for (int j = 0; j < count; ++j) pairs[j] = pack16(row[j], row[j + apart]);
  }

  // What column k changes; its first candidate meets entry j.
  struct Column {
    I weight_in, weight_out;
    const int32_t *in, *out;
  };
  STEREOPSIS_INLINE Column column(int k, int j) const { return {Simd::set(weight_in[k]), Simd::set(weight_out[k]), in + j, out + j}; }
  static STEREOPSIS_INLINE Sum advance(Sum sum, const Column& column, int at) {
    sum = Simd::dot16(sum, Simd::load(column.in + at), column.weight_in);
    return Simd::dot16(sum, Simd::load(column.out + at), column.weight_out);
  }

  void keep_right(int j, double mean, double rest) const { right[j] = pack16(static_cast<int>(mean), static_cast<int>(rest)); }
  struct Left {
    I low, high;  // of the window's sum, beside the mean
  };
  static STEREOPSIS_INLINE Left left(double sum, double mean) {
    const int whole = static_cast<int>(sum);
    return {Simd::set(pack16(whole & 255, static_cast<int>(mean))), Simd::set(pack16(whole >> 8, 0))};
  }
  STEREOPSIS_INLINE F about_means(Sum sum, const Left& left, int j) const {
    const I parts = Simd::load(right + j);
    return Simd::to_float(Simd::add(Simd::dot16(sum, parts, left.low), Simd::times_256(Simd::dot16(Simd::set(0), parts, left.high))));
  }
};

// Where `doubles_fit`: they are exact, whether products are rounded before they are added or not.
struct DoubleSums {
  static constexpr int half = kLanes / 2;
  using Stored = double;
  struct Sum {
    Simd::D lower, upper;
  };
  double *in, *out, *weights, *mean, *rest;
  int window = 0;

  void take(Arena& arena, int columns, int reach, int stats) {
    in = arena.take<double>(reach);
    out = arena.take<double>(reach);
    weights = arena.take<double>(4 * static_cast<size_t>(columns));
    mean = arena.take<double>(stats);
    rest = arena.take<double>(stats);
  }
  static STEREOPSIS_INLINE Sum load(const Stored* p) { return {Simd::load(p), Simd::load(p + half)}; }
  static STEREOPSIS_INLINE void store(Stored* p, Sum v) {
    Simd::store(p, v.lower);
    Simd::store(p + half, v.upper);
  }
  static STEREOPSIS_INLINE Sum add(Sum a, Sum b) { return {Simd::add(a.lower, b.lower), Simd::add(a.upper, b.upper)}; }
  static STEREOPSIS_INLINE Sum add_products(Sum sum, Simd::D a, const double* b) {
    return {Simd::add_product(sum.lower, a, Simd::load(b)), Simd::add_product(sum.upper, a, Simd::load(b + half))};
  }

  void change(const DeepRows& rows) {
    window = rows.window;
    to_doubles(rows.right_in, rows.reach + window, in);
    to_doubles(rows.right_out, rows.reach + window, out);
    for (int k = 0; k < rows.columns; ++k) {
      weights[4 * k] = -rows.left_in[k];
      weights[4 * k + 1] = rows.older(rows.left_in, k);
      weights[4 * k + 2] = rows.left_out[k];
      weights[4 * k + 3] = -rows.older(rows.left_out, k);
    }
  }
  static void to_doubles(const int32_t* STEREOPSIS_RESTRICT from, int count, double* STEREOPSIS_RESTRICT to) {
    for (int j = 0; j < count; ++j) to[j] = from[j];
  }

  struct Column {
    Simd::D in_new, in_old, out_new, out_old;
    const double *in, *out, *in_older, *out_older;
  };
  STEREOPSIS_INLINE Column column(int k, int j) const {
    const double* const w = weights + 4 * static_cast<size_t>(k);
    return {Simd::set(w[0]), Simd::set(w[1]), Simd::set(w[2]), Simd::set(w[3]), in + j, out + j, in + j + window, out + j + window};
  }
  static STEREOPSIS_INLINE Sum advance(Sum sum, const Column& column, int at) {
    sum = add_products(sum, column.in_new, column.in + at);
    sum = add_products(sum, column.in_old, column.in_older + at);
    sum = add_products(sum, column.out_new, column.out + at);
    return add_products(sum, column.out_old, column.out_older + at);
  }

  void keep_right(int j, double mean_there, double rest_there) const {
    mean[j] = mean_there;
    rest[j] = rest_there;
  }
  struct Left {
    Simd::D sum, mean;
  };
  static STEREOPSIS_INLINE Left left(double sum, double mean) { return {Simd::set(sum), Simd::set(mean)}; }
  STEREOPSIS_INLINE F about_means(Sum sum, const Left& left, int j) const {
    sum = add_products(add_products(sum, left.sum, mean + j), left.mean, rest + j);
    return Simd::to_float(sum.lower, sum.upper);
  }
};

// ---- window statistics, of whole numbers in doubles ---------------------------------------------------------------------

static void change_columns(const int32_t* STEREOPSIS_RESTRICT in, const int32_t* STEREOPSIS_RESTRICT out, int count,
                           double* STEREOPSIS_RESTRICT sums, double* STEREOPSIS_RESTRICT squares) {
  for (int x = 0; x < count; ++x) {
    const double a = in[x], b = out[x];
    sums[x] += a - b;
    squares[x] += a * a - b * b;
  }
}

// The sum of `size` columns from each on: several rows at once, since each sum waits for the one before.
template <int N>
static void slide_windows(const double* const* columns, int size, int count, double* const* windows) {
  double sum[N] = {};
  for (int k = 0; k < size; ++k)
    for (int r = 0; r < N; ++r) sum[r] += columns[r][k];
  for (int x = 0; x < count; ++x)
    for (int r = 0; r < N; ++r) {
      windows[r][x] = sum[r];
      sum[r] += columns[r][x + size] - columns[r][x];
    }
}

// As WindowStatistics and wide_scale have them; the sums are left as they are.
static void describe_windows(const double* STEREOPSIS_RESTRICT sums, const double* STEREOPSIS_RESTRICT squares, int count, double n,
                             double* STEREOPSIS_RESTRICT mean, double* STEREOPSIS_RESTRICT rest, float* STEREOPSIS_RESTRICT scale) {
  constexpr double whole = 6755399441055744.0;  // 1.5 * 2^52: doubles about it are whole numbers
  const double inverse = 1.0 / n;
  for (int x = 0; x < count; ++x) {
    const double near = (sums[x] * inverse + whole) - whole, over = sums[x] - near * n;
    const double q = over < 0 ? near - 1 : near, r = over < 0 ? over + n : over;
    const double about = squares[x] - q * (sums[x] + r), norm = about - r * r * inverse;
    mean[x] = q;
    rest[x] = r;
    scale[x] = inverse_norm(norm);
  }
}

template <class Sums>
class Deep {
  using Stored = typename Sums::Stored;
  static constexpr float worst = worst_cost<float>();

 public:
  Deep(const Pair& pair, const FusedSettings& settings, void* memory)
      : p_(pair), s_(settings), arena_{static_cast<char*>(memory)} {
    const int W = p_.width, w = s_.window.width;
    vectors_ = (p_.count + kLanes - 1) / kLanes;
    padded_ = vectors_ * kLanes;
    columns_ = W + w - 1;
    reach_ = columns_ + padded_;
    stats_ = W + padded_;
    middle_ = settings.range.middle();
    inverse_n_ = 1.0f / static_cast<float>(s_.window.area());
    kept_.take(arena_, columns_, reach_, stats_);
    sums_ = arena_.take<Stored>(static_cast<size_t>(W) * padded_);
    slide_ = arena_.take<Stored>(padded_);
    costs_ = arena_.take<float>(kChunk * stride() + kChunk);
    best_ = arena_.take<float>(kChunk * kLanes);
    place_ = arena_.take<float>(kChunk * kLanes);
    index_ = arena_.take<int32_t>(padded_);
    for (int32_t** row : {&row_in_, &row_out_}) *row = arena_.take<int32_t>(W);
    for (int32_t** row : {&left_in_, &left_out_}) *row = arena_.take<int32_t>(columns_);
    for (int32_t** row : {&right_in_, &right_out_}) *row = arena_.take<int32_t>(reach_ + w);
    for (int r = 0; r < kRows; ++r) {
      column_[r] = arena_.take<double>(columns_ + 1);
      window_[r] = arena_.take<double>(W);
    }
    for (int side = 0; side < 2; ++side) {
      mean_[side] = arena_.take<double>(W);
      rest_[side] = arena_.take<double>(W);
      scale_[side] = arena_.take<float>(W);
    }
    right_rest_ = arena_.take<float>(stats_);
    right_scale_ = arena_.take<float>(stats_);
    right_best_ = arena_.take<float>(stats_ + 2 * kChunk);
    right_index_ = arena_.take<int32_t>(stats_ + 2 * kChunk);
    claims_ = arena_.take<int32_t>(2 * W + 1);
    winner_ = arena_.take<int32_t>(W);
    for (float** row : {&cost_, &before_, &after_, &second_}) *row = arena_.take<float>(W);
  }

  size_t bytes() const { return arena_.used; }

  void rows(const FusedOutput& out, int begin, int end, const Cancel& cancel) {
    std::memset(arena_.base, 0, arena_.used);
    for (int i = 0; i < padded_; ++i) index_[i] = i;
    fill(worst, static_cast<int>(kChunk * stride() + kChunk), costs_);
    // The sums of the row before the first one.
    const int top = begin - 1 - s_.window.above();
    for (int y = top; y < top + s_.window.height; ++y) {
      change_rows(y, nullptr);
      accumulate();
      if (cancel.load(std::memory_order_relaxed)) return;
    }
    for (int y = begin; y < end; ++y) {
      if (cancel.load(std::memory_order_relaxed)) return;
      const int leaving = y - 1 - s_.window.above();
      change_rows(y + s_.window.below(), &leaving);
      window_statistics();
      match_row();
      for (float* kept : {cost_, before_, after_, second_})
        for (int x = 0; x < p_.width; ++x) kept[x] -= kWideBase;
      finish(p_, s_, RowWinners<float>{winner_, cost_, before_, after_, second_, claims_, right_index_ + kChunk}, out, y);
    }
  }

 private:
  static constexpr int kRows = 4;  // of statistics: sums and squares of the left image, then of the right one
  // Costs are kept with kWideBase added. Between those of two pixels there is room on both sides for what is next to them, and
  // one less than whole vectors, so that the candidates of a right pixel lie whole vectors apart; the rooms overlap then.
  size_t stride() const { return padded_ + 2 * kChunk - 1; }
  float* costs_of(int slot) const { return costs_ + slot * stride() + kChunk; }

  // ---- rows that enter and leave ------------------------------------------------------------------------------------------

  void change_rows(int entering, const int* leaving) {
    const int W = p_.width, before = s_.window.left();
    for (int side = 0; side < 2; ++side) {
      const void* image = side ? p_.right : p_.left;
      take_row(image, entering, row_in_);
      if (leaving) take_row(image, *leaving, row_out_);
      change_columns(row_in_, row_out_, W, column_[2 * side] + before, column_[2 * side + 1] + before);
      if (side) {
        mirror(row_in_, right_in_);
        mirror(row_out_, right_out_);
      } else {
        pad(row_in_, left_in_);
        pad(row_out_, left_out_);
      }
    }
    kept_.change({left_in_, left_out_, right_in_, right_out_, s_.window.width, columns_, reach_});
  }

  void take_row(const void* image, int y, int32_t* STEREOPSIS_RESTRICT row) const {
    const int32_t* STEREOPSIS_RESTRICT from = static_cast<const int32_t*>(image) + static_cast<size_t>(clamp(y, 0, p_.height - 1)) * p_.width;
    for (int x = 0; x < p_.width; ++x) row[x] = from[x] - middle_;
  }

  template <class T>
  void pad(const T* row, T* padded) const {
    const int before = s_.window.left(), end = before + p_.width;
    const T first = row[0], last = row[p_.width - 1];
    if (row != padded + before) std::memcpy(padded + before, row, p_.width * sizeof *row);
    fill(first, before, padded);
    fill(last, columns_ - end, padded + end);
  }

  // mirrored[j] is the right pixel that candidate i of padded column k meets, where j = columns - 1 - k + i.
  void mirror(const int32_t* STEREOPSIS_RESTRICT row, int32_t* STEREOPSIS_RESTRICT mirrored) const {
    const int W = p_.width, length = reach_ + s_.window.width;
    const int last = W - 1 + s_.window.right() - p_.first;  // right column of j = 0
    const int in = clamp(last - (W - 1), 0, length), out = clamp(last + 1, in, length);
    fill(row[W - 1], in, mirrored);
    for (int j = in; j < out; ++j) mirrored[j] = row[last - j];
    fill(row[0], length - out, mirrored + out);
  }

  // ---- the sliding sums ---------------------------------------------------------------------------------------------------

  void advance_slide(int k) {
    const auto column = kept_.column(k, columns_ - 1 - k);
    for (int at = 0; at < padded_; at += kLanes) Sums::store(slide_ + at, Sums::advance(Sums::load(slide_ + at), column, at));
  }

  void prime_slide() {
    std::memset(slide_, 0, padded_ * sizeof *slide_);
    for (int k = 0; k < s_.window.width - 1; ++k) advance_slide(k);
  }

  void accumulate() {
    prime_slide();
    for (int x = 0; x < p_.width; ++x) {
      advance_slide(x + s_.window.width - 1);
      Stored* sums = sums_ + static_cast<size_t>(x) * padded_;
      for (int at = 0; at < padded_; at += kLanes) Sums::store(sums + at, Sums::add(Sums::load(sums + at), Sums::load(slide_ + at)));
    }
  }

  // ---- window statistics --------------------------------------------------------------------------------------------------

  void window_statistics() {
    const int W = p_.width;
    for (double* column : column_) pad(column + s_.window.left(), column);
    slide_windows<kRows>(column_, s_.window.width, W, window_);
    for (int side = 0; side < 2; ++side)
      describe_windows(window_[2 * side], window_[2 * side + 1], W, static_cast<double>(s_.window.area()), mean_[side], rest_[side],
                       scale_[side]);
    // Right statistics lie mirrored: pixel x - d of candidate i at [width - 1 - x + i].
    const int last = W - 1 - p_.first, begin = most(0, last - (stats_ - 1)), end = least(W, last + 1);
    for (int x = begin; x < end; ++x) {
      kept_.keep_right(last - x, mean_[1][x], rest_[1][x]);
      right_rest_[last - x] = static_cast<float>(rest_[1][x]);
      right_scale_[last - x] = scale_[1][x];
    }
  }

  // ---- winners ------------------------------------------------------------------------------------------------------------

  void match_row() {
    if (s_.left_right) {
      fill(worst, stats_ + 2 * kChunk, right_best_);
      fill(-1, stats_ + 2 * kChunk, right_index_);
    }
    prime_slide();
    for (int begin = 0; begin < p_.width; begin += kChunk) {
      const int end = least(begin + kChunk, p_.width);
      match_chunk(begin, end);
      take_winners(begin, end);
      if (s_.left_right) take_right_winners(begin, end);
      if (s_.uniqueness)
        for (int x = begin; x < end; ++x) take_second(x, x - begin);
    }
    if (s_.left_right)  // from columns to candidates
      for (int j = 0; j < stats_; ++j) right_index_[kChunk + j] += 1 - p_.width + j;
  }

  // The vectors of candidates are taken in blocks: as many as fit the registers, then one by one.
  void match_chunk(int begin, int end) {
    int at = 0;
    for (; at + kBlock * kLanes <= padded_; at += kBlock * kLanes) match_block<kBlock>(begin, end, at);
    for (; at < padded_; at += kLanes) match_block<1>(begin, end, at);
  }

  template <int N>
  STEREOPSIS_NOINLINE void match_block(const int begin, const int end, const int at) {
    const Sums kept = kept_;
    typename Sums::Sum change[N];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { change[v] = Sums::load(slide_ + at + v * kLanes); });
    for (int x = begin; x < end; ++x) {
      const int lo = most(0, x - p_.first - (p_.width - 1)), hi = most(lo, least(p_.count, x - p_.first + 1));
      if (lo <= at && at + N * kLanes <= hi)
        match_pixel<N, true>(kept, x, x - begin, at, lo, hi, change);
      else
        match_pixel<N, false>(kept, x, x - begin, at, lo, hi, change);
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Sums::store(slide_ + at + v * kLanes, change[v]); });
  }

  // Of pixel x, which sees candidates [lo, hi), those of N vectors from `at` on; `Whole` says that it sees all of them.
  template <int N, bool Whole>
  STEREOPSIS_INLINE void match_pixel(const Sums& kept, int x, int slot, int at, int lo, int hi, typename Sums::Sum* change) {
    const int k = x + s_.window.width - 1, mirrored = p_.width - 1 - x + at;
    const auto column = kept.column(k, columns_ - 1 - k + at);
    const auto left = Sums::left(window_[0][x], mean_[0][x]);
    const F rest = Simd::set(static_cast<float>(rest_[0][x]) * inverse_n_), scale = Simd::set(scale_[0][x]);
    Stored* const sums = sums_ + static_cast<size_t>(x) * padded_ + at;
    const float *const right_rest = right_rest_ + mirrored, *const right_scale = right_scale_ + mirrored;
    const int32_t* const indices = index_ + at;
    float* const costs = costs_of(slot) + at;
    F best = at == 0 ? Simd::set(worst) : Simd::load(best_ + slot * kLanes);
    F place = at == 0 ? Simd::set(-1.0f) : Simd::load(place_ + slot * kLanes);
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      constexpr int j = v.value * kLanes;
      change[v] = Sums::advance(change[v], column, j);
      F value = Simd::set(worst);
      // A candidate that its pixel does not see in this row, it sees in none: nobody needs its sum.
      if (Whole || (at + j < hi && at + j + kLanes > lo)) {
        const auto sum = Sums::add(Sums::load(sums + j), change[v]);
        Sums::store(sums + j, sum);
        value = kept.about_means(sum, left, mirrored + j);
        value = Simd::fused(rest, Simd::load(right_rest + j), value);
        value = Simd::fused(Simd::mul(value, scale), Simd::load(right_scale + j), Simd::set(kWideBase));
        const I index = Simd::load(indices + j);
        if (!Whole) value = Simd::select(Simd::inside(index, lo, hi), value, Simd::set(worst));
        const M better = Simd::less(value, best);
        best = Simd::select(better, value, best);
        place = Simd::select(better, Simd::to_float(index), place);
      }
      Simd::store(costs + j, value);
    });
    Simd::store(best_ + slot * kLanes, best);
    Simd::store(place_ + slot * kLanes, place);
  }

  // Of each pixel's lanes the least cost, and the least candidate that has it; candidates are exact as floats.
  STEREOPSIS_NOINLINE void take_winners(int begin, int end) {
    float least[kChunk], first[kChunk];
    Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return Simd::load(best_ + slot * kLanes); }, least);
    for (int slot = 0; slot < kChunk; ++slot) {
      float* const place = place_ + slot * kLanes;
      const M equal = Simd::equal(Simd::load(best_ + slot * kLanes), Simd::set(least[slot]));
      Simd::store(place, Simd::select(equal, Simd::load(place), Simd::set(worst)));
    }
    Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return Simd::load(place_ + slot * kLanes); }, first);
    for (int x = begin; x < end; ++x) {
      winner_[x] = static_cast<int32_t>(first[x - begin]);
      const float* costs = costs_of(x - begin) + winner_[x];
      cost_[x] = costs[0];
      before_[x] = costs[-1];
      after_[x] = costs[1];
    }
  }

  // The right view's winners so far, with the costs of pixels [begin, end): right pixel by right pixel, that is by mirrored
  // column, where candidate i of pixel x stands at width - 1 - x + i. In the kept costs that is a diagonal.
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
    const float* STEREOPSIS_RESTRICT costs = costs_of(0) + i;
    F best[N];
    I column[N], here = Simd::set(begin);
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      best[v] = Simd::set(worst);
      column[v] = Simd::set(begin);
    });
    for (int x = begin; x < end; ++x) {
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        const F value = Simd::load(costs + v.value * kLanes);
        column[v] = Simd::select(Simd::less(value, best[v]), here, column[v]);
        best[v] = Simd::min(value, best[v]);
      });
      here = Simd::add(here, Simd::set(1));
      costs += step;
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      const int j = kChunk + (p_.width - 1 - begin) + i + v.value * kLanes;
      const F before = Simd::load(right_best_ + j);
      const M better = Simd::less(best[v], before);
      Simd::store(right_best_ + j, Simd::select(better, best[v], before));
      Simd::store(right_index_ + j, Simd::select(better, column[v], Simd::load(right_index_ + j)));
    });
  }

  // The least cost of the candidates that are not next to the winner. Strikes out the stored costs of those that are.
  void take_second(int x, int slot) {
    float* costs = costs_of(slot);
    for (int i = winner_[x] - 1; i <= winner_[x] + 1; ++i) costs[i] = worst;
    F least = Simd::set(worst);
    for (int at = 0; at < padded_; at += kLanes) least = Simd::min(Simd::load(costs + at), least);
    second_[x] = Simd::reduce_min(least);
  }

  const Pair& p_;
  const FusedSettings& s_;
  Arena arena_;
  Sums kept_;
  int vectors_, padded_, columns_, reach_, stats_;
  int32_t middle_;
  float inverse_n_;
  Stored *sums_, *slide_;
  int32_t *row_in_, *row_out_, *left_in_, *left_out_, *right_in_, *right_out_;
  double *column_[kRows], *window_[kRows], *mean_[2], *rest_[2];
  float *scale_[2], *right_rest_, *right_scale_, *costs_, *best_, *place_, *right_best_;
  float *cost_, *before_, *after_, *second_;
  int32_t *index_, *right_index_, *winner_, *claims_;
};

template <class Visit>
void with_sums(const Pair& pair, const FusedSettings& settings, void* memory, Visit visit) {
  if (words_fit(settings.range, settings.window))
    visit(Deep<WordSums>(pair, settings, memory));
  else
    visit(Deep<DoubleSums>(pair, settings, memory));
}

size_t scratch_bytes(const Pair& pair, const FusedSettings& settings) {
  size_t bytes = 0;
  with_sums(pair, settings, nullptr, [&](const auto& kernel) { bytes = kernel.bytes(); });
  return bytes;
}

void rows(const Pair& pair, const FusedSettings& settings, const FusedOutput& out, int begin, int end, void* scratch,
          const Cancel& cancel) {
  with_sums(pair, settings, scratch, [&](auto&& kernel) { kernel.rows(out, begin, end, cancel); });
}

}  // namespace

extern const DeepKernel deep;
const DeepKernel deep = {scratch_bytes, rows};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
