// What the kernel for 16-bit and float images, deep_isa.cpp, sums for each cost and makes of the sums.
//
// Pixels are counted from the middle of the images' range, which changes nothing in what WideCost asks for but for NCC. All sums are
// exact; what follows gives the bits of WideCost.
#pragma once

#include <cmath>
#include <type_traits>

#include "arena.hpp"
#include "fused.hpp"
#include "score.hpp"
#include "simd.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

using I = Simd::I;
using F = Simd::F;
using D = Simd::D;
constexpr int kLanes = Simd::lanes;

// ---- vectors of as many numbers as there are lanes -------------------------------------------------------------------------

struct Doubles {
  D lower, upper;
};

template <class T>
struct Numbers {
  using Vector = decltype(Simd::set(T{}));
  static STEREOPSIS_INLINE Vector load(const T* p) { return Simd::load(p); }
  static STEREOPSIS_INLINE void store(T* p, Vector v) { Simd::store(p, v); }
  static STEREOPSIS_INLINE Vector set(T v) { return Simd::set(v); }
  static STEREOPSIS_INLINE Vector add(Vector a, Vector b) { return Simd::add(a, b); }
  static STEREOPSIS_INLINE Vector sub(Vector a, Vector b) { return Simd::sub(a, b); }
  static STEREOPSIS_INLINE Vector min(Vector a, Vector b) { return Simd::min(a, b); }
  // `yes` where a < b, else `no`.
  static STEREOPSIS_INLINE Vector where_less(Vector a, Vector b, Vector yes, Vector no) { return Simd::select(Simd::less(a, b), yes, no); }
  static STEREOPSIS_INLINE T least(Vector v) { return Simd::reduce_min(v); }
  // Of 16 vectors that follow each other.
  static STEREOPSIS_INLINE void minima(const T* rows, T* minima) {
    Simd::row_minima([&](int slot) STEREOPSIS_INLINE_LAMBDA { return Simd::load(rows + slot * kLanes); }, minima);
  }
};

template <>
struct Numbers<double> {
  using Vector = Doubles;
  static constexpr int half = kLanes / 2;
  static STEREOPSIS_INLINE Vector load(const double* p) { return {Simd::load(p), Simd::load(p + half)}; }
  static STEREOPSIS_INLINE void store(double* p, Vector v) {
    Simd::store(p, v.lower);
    Simd::store(p + half, v.upper);
  }
  static STEREOPSIS_INLINE Vector set(double v) { return {Simd::set(v), Simd::set(v)}; }
  static STEREOPSIS_INLINE Vector add(Vector a, Vector b) { return {Simd::add(a.lower, b.lower), Simd::add(a.upper, b.upper)}; }
  static STEREOPSIS_INLINE Vector sub(Vector a, Vector b) { return {Simd::sub(a.lower, b.lower), Simd::sub(a.upper, b.upper)}; }
  static STEREOPSIS_INLINE Vector mul(Vector a, Vector b) { return {Simd::mul(a.lower, b.lower), Simd::mul(a.upper, b.upper)}; }
  static STEREOPSIS_INLINE Vector min(Vector a, Vector b) { return {Simd::min(a.lower, b.lower), Simd::min(a.upper, b.upper)}; }
  static STEREOPSIS_INLINE Vector add_product(Vector sum, Vector a, Vector b) {
    return {Simd::add_product(sum.lower, a.lower, b.lower), Simd::add_product(sum.upper, a.upper, b.upper)};
  }
  static STEREOPSIS_INLINE Vector where_at_most(Vector a, Vector b, Vector v) {
    return {Simd::where_at_most(a.lower, b.lower, v.lower), Simd::where_at_most(a.upper, b.upper, v.upper)};
  }
  static STEREOPSIS_INLINE Vector where_less(Vector a, Vector b, Vector yes, Vector no) {
    return {where_less(a.lower, b.lower, yes.lower, no.lower), where_less(a.upper, b.upper, yes.upper, no.upper)};
  }
  static STEREOPSIS_INLINE double least(Vector v) {
    double lanes[half];
    Simd::store(lanes, Simd::min(v.lower, v.upper));
    double found = lanes[0];
    for (int i = 1; i < half; ++i) found = lanes[i] < found ? lanes[i] : found;
    return found;
  }
  static STEREOPSIS_INLINE void minima(const double* rows, double* minima) {
    for (int r = 0; r < 16; ++r) minima[r] = least(load(rows + r * kLanes));
  }

 private:
  static STEREOPSIS_INLINE D where_less(D a, D b, D yes, D no) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
    return _mm512_mask_mov_pd(no, _mm512_cmp_pd_mask(a, b, _CMP_LT_OQ), yes);
#elif STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
    return _mm256_blendv_pd(no, yes, _mm256_cmp_pd(a, b, _CMP_LT_OQ));
#else
    for (int i = 0; i < half; ++i) no.v[i] = a.v[i] < b.v[i] ? yes.v[i] : no.v[i];
    return no;
#endif
  }
};

static STEREOPSIS_INLINE Doubles to_doubles(I v) { return {Simd::lower(v), Simd::upper(v)}; }
static STEREOPSIS_INLINE Doubles to_doubles(Doubles v) { return v; }
static STEREOPSIS_INLINE F to_floats(I v) { return Simd::to_float(v); }
static STEREOPSIS_INLINE F to_floats(Doubles v) { return Simd::to_float(v.lower, v.upper); }

// ---- what is summed over the window ----------------------------------------------------------------------------------------

// Rows of a channel about to enter and to leave the window: left ones of `columns` with their edge pixels repeated, right ones mirrored, of
// `reach` and another window's width.
struct DeepRows {
  const int32_t *left_in, *left_out, *right_in, *right_out;
  int window, columns, reach;
  // The pixel of the column that leaves the window as column k enters it.
  int32_t older(const int32_t* left, int k, int32_t none = 0) const { return k < window ? none : left[k - window]; }
};

// Minus the products where `deep_words_fit`: of two 16-bit numbers at a time, of the column that enters and of the one that leaves.
struct WordProducts {
  using Number = int32_t;
  int32_t *in, *out, *weight_in, *weight_out;

  void take(Arena& arena, int columns, int reach, int) {
    in = arena.take<int32_t>(reach);
    out = arena.take<int32_t>(reach);
    weight_in = arena.take<int32_t>(columns);
    weight_out = arena.take<int32_t>(columns);
  }
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
  static STEREOPSIS_INLINE I advance(I sum, const Column& column, int at) {
    sum = Simd::dot16(sum, Simd::load(column.in + at), column.weight_in);
    return Simd::dot16(sum, Simd::load(column.out + at), column.weight_out);
  }
};

// Of each column four pixels: of the row that enters and of the one that leaves, of the column that enters the window and of the one that
// leaves it.
template <class T>
struct FourPixels {
  using Number = T;
  using Vector = Numbers<T>;
  T *in, *out, *lefts;
  int window;

  void take(Arena& arena, int columns, int reach, int window_width) {
    window = window_width;
    in = arena.take<T>(reach + window);
    out = arena.take<T>(reach + window);
    lefts = arena.take<T>(4 * static_cast<size_t>(columns));
  }
  // Left ones times their signs; `none` stands for what has not entered.
  void keep(const DeepRows& rows, int32_t none, const int (&sign)[4]) {
    for (int j = 0; j < rows.reach + window; ++j) in[j] = static_cast<T>(rows.right_in[j]);
    for (int j = 0; j < rows.reach + window; ++j) out[j] = static_cast<T>(rows.right_out[j]);
    for (int k = 0; k < rows.columns; ++k) {
      lefts[4 * k] = static_cast<T>(sign[0] * rows.left_in[k]);
      lefts[4 * k + 1] = static_cast<T>(sign[1] * rows.older(rows.left_in, k, none));
      lefts[4 * k + 2] = static_cast<T>(sign[2] * rows.left_out[k]);
      lefts[4 * k + 3] = static_cast<T>(sign[3] * rows.older(rows.left_out, k, none));
    }
  }

  struct Column {
    typename Vector::Vector in_new, in_old, out_new, out_old;
    const T *in, *out, *in_older, *out_older;
  };
  STEREOPSIS_INLINE Column column(int k, int j) const {
    const T* const l = lefts + 4 * static_cast<size_t>(k);
    return {Vector::set(l[0]), Vector::set(l[1]), Vector::set(l[2]), Vector::set(l[3]), in + j, out + j, in + j + window, out + j + window};
  }
};

// Minus the products where `deep_doubles_fit`: doubles are exact, whether products are rounded before they are added or not.
struct DoubleProducts : FourPixels<double> {
  void change(const DeepRows& rows) { keep(rows, 0, {-1, 1, 1, -1}); }
  static STEREOPSIS_INLINE Doubles advance(Doubles sum, const Column& column, int at) {
    sum = Vector::add_product(sum, column.in_new, Vector::load(column.in + at));
    sum = Vector::add_product(sum, column.in_old, Vector::load(column.in_older + at));
    sum = Vector::add_product(sum, column.out_new, Vector::load(column.out + at));
    return Vector::add_product(sum, column.out_old, Vector::load(column.out_older + at));
  }
};

// The lesser of both pixels, since |l - r| = l + r - 2 min(l, r): of 32 bits, that may wrap, or doubles.
template <class T>
struct Lesser : FourPixels<T> {
  using Vector = Numbers<T>;
  using Column = typename FourPixels<T>::Column;
  static constexpr int32_t none = INT32_MIN / 2;  // below every pixel; what has not entered enters and leaves as this

  void change(const DeepRows& rows) { this->keep(rows, none, {1, 1, 1, 1}); }
  static STEREOPSIS_INLINE auto advance(typename Vector::Vector sum, const Column& column, int at) {
    const auto entered = Vector::sub(Vector::min(column.in_new, Vector::load(column.in + at)),
                                     Vector::min(column.in_old, Vector::load(column.in_older + at)));
    const auto left = Vector::sub(Vector::min(column.out_new, Vector::load(column.out + at)),
                                  Vector::min(column.out_old, Vector::load(column.out_older + at)));
    return Vector::add(sum, Vector::sub(entered, left));
  }
};

// ---- window statistics, of whole numbers in doubles ----------------------------------------------------------------------

// A row of windows' sums and squares, of the left and of the right image, channel by channel.
template <int C>
struct DeepWindows {
  const double* sums[2][C];
  const double* squares[2][C];
  int width;
  // What is kept of right window x lies at [last - x], for the x from `begin` to `end` that some candidate meets: so that the window
  // of candidate i of pixel x lies at [width - 1 - x + i].
  int last, begin, end;
  template <class Keep>
  STEREOPSIS_INLINE void mirror(const Keep& keep) const {
    for (int x = begin; x < end; ++x) keep(x, last - x);
  }
  static STEREOPSIS_INLINE double total(const double* const* channels, int x) {
    double sum = channels[0][x];
    for (int c = 1; c < C; ++c) sum += channels[c][x];
    return sum;
  }
};

// As WindowStatistics has them: mean and rest, and the sum of squares about the mean.
struct Means {
  double *mean[2], *rest[2], *about[2];

  void take(Arena& arena, int width) {
    for (int side = 0; side < 2; ++side)
      for (double** row : {mean + side, rest + side, about + side}) *row = arena.take<double>(width);
  }
  template <int C>
  void describe(const DeepWindows<C>& windows, int c, double n) const {
    for (int side = 0; side < 2; ++side)
      describe(windows.sums[side][c], windows.squares[side][c], windows.width, n, mean[side], rest[side], about[side]);
  }

 private:
  static void describe(const double* STEREOPSIS_RESTRICT sums, const double* STEREOPSIS_RESTRICT squares, int count, double n,
                       double* STEREOPSIS_RESTRICT mean, double* STEREOPSIS_RESTRICT rest, double* STEREOPSIS_RESTRICT about) {
    constexpr double whole = 6755399441055744.0;  // 1.5 * 2^52: doubles about it are whole numbers
    const double inverse = 1.0 / n;
    for (int x = 0; x < count; ++x) {
      const double near = (sums[x] * inverse + whole) - whole, over = sums[x] - near * n;
      const double q = over < 0 ? near - 1 : near, r = over < 0 ? over + n : over;
      mean[x] = q;
      rest[x] = r;
      about[x] = squares[x] - q * (sums[x] + r);
    }
  }
};

// From minus a sum of products that about both windows' whole means; what it adds of one channel.
template <class Sums>
struct AboutMeans;

template <>
struct AboutMeans<WordProducts> {
  int32_t* right;

  void take(Arena& arena, int stats) { right = arena.take<int32_t>(stats); }
  STEREOPSIS_INLINE void keep(int j, double mean, double rest) const { right[j] = pack16(static_cast<int>(mean), static_cast<int>(rest)); }
  struct Left {
    I low, high;  // of the window's sum, beside the mean
  };
  static STEREOPSIS_INLINE Left left(double sum, double mean) {
    const int whole = static_cast<int>(sum);
    return {Simd::set(pack16(whole & 255, static_cast<int>(mean))), Simd::set(pack16(whole >> 8, 0))};
  }
  STEREOPSIS_INLINE I of(I sum, const Left& left, int j) const {
    const I parts = Simd::load(right + j);
    return Simd::add(Simd::dot16(sum, parts, left.low), Simd::times_256(Simd::dot16(Simd::set(0), parts, left.high)));
  }
};

template <>
struct AboutMeans<DoubleProducts> {
  using Vector = Numbers<double>;
  double *mean, *rest;

  void take(Arena& arena, int stats) {
    mean = arena.take<double>(stats);
    rest = arena.take<double>(stats);
  }
  STEREOPSIS_INLINE void keep(int j, double mean_there, double rest_there) const {
    mean[j] = mean_there;
    rest[j] = rest_there;
  }
  struct Left {
    Doubles sum, mean;
  };
  static STEREOPSIS_INLINE Left left(double sum, double mean) { return {Vector::set(sum), Vector::set(mean)}; }
  STEREOPSIS_INLINE Doubles of(Doubles sum, const Left& left, int j) const {
    return Vector::add_product(Vector::add_product(sum, left.sum, Vector::load(mean + j)), left.mean, Vector::load(rest + j));
  }
};

// ---- costs -----------------------------------------------------------------------------------------------------------------
//
// Of C channels. Each has the number that its costs are, what is kept with every one added (`base`), what it keeps of a row's
// windows, and the value of a vector of candidates of pixel x, the first of which meets the right window at [j].

// What ZNCC and ZSSD share: the products about whole means.
template <class Sums, int C>
struct Centred {
  double n;
  Means means[C];
  AboutMeans<Sums> about[C];
  const double* sums[C] = {};  // of left windows

  void take(Arena& arena, const FusedSettings& settings, int width, int stats) {
    n = static_cast<double>(settings.window.area());
    for (int c = 0; c < C; ++c) {
      means[c].take(arena, width);
      about[c].take(arena, stats);
    }
  }
  void describe(const DeepWindows<C>& windows) {
    for (int c = 0; c < C; ++c) {
      const Means& found = means[c];
      found.describe(windows, c, n);
      sums[c] = windows.sums[0][c];
      windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA { about[c].keep(j, found.mean[1][x], found.rest[1][x]); });
    }
  }
  struct Left {
    typename AboutMeans<Sums>::Left of[C];
  };
  STEREOPSIS_INLINE Left left(int x) const {
    Left left;
    for (int c = 0; c < C; ++c) left.of[c] = AboutMeans<Sums>::left(sums[c][x], means[c].mean[0][x]);
    return left;
  }
  template <class Sum>
  STEREOPSIS_INLINE Sum products(Sum sum, const Left& left, int j) const {
    for (int c = 0; c < C; ++c) sum = about[c].of(sum, left.of[c], j);
    return sum;
  }
};

template <class Of, int C>
struct ZnccCost {
  using Sums = Of;
  using Number = float;
  static constexpr int channels = C;
  static constexpr float base = kWideBase;

  void take(Arena& arena, const FusedSettings& settings, int width, int stats) {
    centred_.take(arena, settings, width, stats);
    for (int c = 0; c < C; ++c) {
      left_rest_[c] = arena.take<float>(width);
      right_rest_[c] = arena.take<float>(stats);
    }
    for (float** row : {&left_scale_, &scale_}) *row = arena.take<float>(width);
    right_scale_ = arena.take<float>(stats);
  }
  void describe(const DeepWindows<C>& windows) {
    centred_.describe(windows);
    const float inverse = 1.0f / static_cast<float>(centred_.n);
    for (int c = 0; c < C; ++c) {
      const auto& rest = centred_.means[c].rest;
      for (int x = 0; x < windows.width; ++x) left_rest_[c][x] = static_cast<float>(rest[0][x]) * inverse;
      windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA { right_rest_[c][j] = static_cast<float>(rest[1][x]); });
    }
    scale(0, windows.width, left_scale_);
    scale(1, windows.width, scale_);
    windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA { right_scale_[j] = scale_[x]; });
  }

  struct Left {
    typename Centred<Sums, C>::Left centred;
    F rest[C], scale;
  };
  STEREOPSIS_INLINE Left left(int x) const {
    Left left;
    left.centred = centred_.left(x);
    for (int c = 0; c < C; ++c) left.rest[c] = Simd::set(left_rest_[c][x]);
    left.scale = Simd::set(left_scale_[x]);
    return left;
  }
  template <class Sum>
  STEREOPSIS_INLINE F value(Sum sum, const Left& left, int j) const {
    F covariance = to_floats(centred_.products(sum, left.centred, j));
    for (int c = 0; c < C; ++c) covariance = Simd::fused(left.rest[c], Simd::load(right_rest_[c] + j), covariance);
    return Simd::fused(Simd::mul(covariance, left.scale), Simd::load(right_scale_ + j), Simd::set(base));
  }

 private:
  void scale(int side, int width, float* STEREOPSIS_RESTRICT scales) const {
    const double inverse = 1.0 / centred_.n;
    const double *STEREOPSIS_RESTRICT rest[C], *STEREOPSIS_RESTRICT about[C];
    for (int c = 0; c < C; ++c) {
      rest[c] = centred_.means[c].rest[side];
      about[c] = centred_.means[c].about[side];
    }
    for (int x = 0; x < width; ++x) {
      double norm = 0;
      for (int c = 0; c < C; ++c) norm += about[c][x] - rest[c][x] * rest[c][x] * inverse;
      scales[x] = inverse_norm(norm);
    }
  }

  Centred<Sums, C> centred_;
  float *left_rest_[C], *right_rest_[C], *left_scale_, *right_scale_, *scale_;
};

template <class Of, int C>
struct NccCost {
  using Sums = Of;
  using Number = float;
  using Vector = Numbers<double>;
  static constexpr int channels = C;
  static constexpr float base = 0;

  void take(Arena& arena, const FusedSettings& settings, int width, int stats) {
    n_ = static_cast<double>(settings.window.area() * C);
    middle_ = settings.range.middle();
    for (double** row : {&left_more_, &left_scale_, &scale_}) *row = arena.take<double>(width);
    for (double** row : {&right_more_, &right_scale_}) *row = arena.take<double>(stats);
  }
  void describe(const DeepWindows<C>& windows) {
    // Of pixels counted from 0: (l + m) (r + m) = l r + m (l + m) + m r.
    for (int x = 0; x < windows.width; ++x) left_more_[x] = middle_ * (windows.total(windows.sums[0], x) + n_ * middle_);
    scale(windows, 0, -1, left_scale_);
    scale(windows, 1, 1, scale_);
    windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA {
      right_more_[j] = middle_ * windows.total(windows.sums[1], x);
      right_scale_[j] = scale_[x];
    });
  }

  struct Left {
    Doubles more, scale;
  };
  STEREOPSIS_INLINE Left left(int x) const { return {Vector::set(left_more_[x]), Vector::set(left_scale_[x])}; }
  template <class Sum>
  STEREOPSIS_INLINE F value(Sum sum, const Left& left, int j) const {
    const Doubles products = Vector::add(Vector::sub(left.more, to_doubles(sum)), Vector::load(right_more_ + j));
    return to_floats(Vector::mul(products, Vector::mul(left.scale, Vector::load(right_scale_ + j))));
  }

 private:
  void scale(const DeepWindows<C>& windows, int side, double sign, double* STEREOPSIS_RESTRICT scales) const {
    for (int x = 0; x < windows.width; ++x) {
      const double sum = windows.total(windows.sums[side], x);
      const double square = windows.total(windows.squares[side], x) + middle_ * (2 * sum + n_ * middle_);
      scales[x] = sign * (square > 0 ? 1.0 / std::sqrt(square) : 0.0);
    }
  }

  double n_, middle_;
  double *left_more_, *right_more_, *left_scale_, *right_scale_, *scale_;
};

// What SSD and SAD share: a total of each window, over channels, to which twice a sum over both is added.
template <class Of, class T, int C>
class WithTotals {
 public:
  using Sums = Of;
  using Number = T;
  using Vector = Numbers<T>;
  using Left = typename Vector::Vector;
  static constexpr int channels = C;
  static constexpr T base = 0;

  void take(Arena& arena, const FusedSettings&, int width, int stats) {
    left_ = arena.take<T>(width);
    right_ = arena.take<T>(stats);
  }
  STEREOPSIS_INLINE Left left(int x) const { return Vector::set(left_[x]); }

 protected:
  void keep(const DeepWindows<C>& windows, const double* const (&rows)[2][C]) {
    for (int x = 0; x < windows.width; ++x) left_[x] = static_cast<T>(windows.total(rows[0], x));
    windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA { right_[j] = static_cast<T>(windows.total(rows[1], x)); });
  }
  STEREOPSIS_INLINE Left both(const Left& left, int j) const { return Vector::add(left, Vector::load(right_ + j)); }

 private:
  T *left_, *right_;
};

template <class Of, class T, int C>
struct SsdCost : WithTotals<Of, T, C> {
  using Vector = Numbers<T>;
  using Left = typename Vector::Vector;

  void describe(const DeepWindows<C>& windows) { this->keep(windows, windows.squares); }
  template <class Sum>
  STEREOPSIS_INLINE Left value(Sum sum, const Left& left, int j) const {
    const auto products = as_numbers(sum);
    return Vector::add(this->both(left, j), Vector::add(products, products));
  }

 private:
  template <class Sum>
  static STEREOPSIS_INLINE auto as_numbers(Sum sum) {
    if constexpr (std::is_same<T, double>::value)
      return to_doubles(sum);
    else
      return sum;
  }
};

template <class Of, int C>
struct ZssdCost {
  using Sums = Of;
  using Number = float;
  using Vector = Numbers<double>;
  static constexpr int channels = C;
  static constexpr float base = 0;

  void take(Arena& arena, const FusedSettings& settings, int width, int stats) {
    centred_.take(arena, settings, width, stats);
    for (double*& row : right_rest_) row = arena.take<double>(stats);
    left_squares_ = arena.take<double>(width);
    right_squares_ = arena.take<double>(stats);
  }
  void describe(const DeepWindows<C>& windows) {
    centred_.describe(windows);
    const double* about[2][C];
    for (int c = 0; c < C; ++c) {
      const Means& means = centred_.means[c];
      for (int side = 0; side < 2; ++side) about[side][c] = means.about[side];
      windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA { right_rest_[c][j] = means.rest[1][x]; });
    }
    for (int x = 0; x < windows.width; ++x) left_squares_[x] = windows.total(about[0], x);
    windows.mirror([&](int x, int j) STEREOPSIS_INLINE_LAMBDA { right_squares_[j] = windows.total(about[1], x); });
  }

  struct Left {
    typename Centred<Sums, C>::Left centred;
    Doubles rest[C], squares;
  };
  STEREOPSIS_INLINE Left left(int x) const {
    Left left;
    left.centred = centred_.left(x);
    for (int c = 0; c < C; ++c) left.rest[c] = Vector::set(centred_.means[c].rest[0][x]);
    left.squares = Vector::set(left_squares_[x]);
    return left;
  }
  // About the difference of both whole means; where the left rest is the lesser one, the floor of the differences' mean is one less.
  template <class Sum>
  STEREOPSIS_INLINE F value(Sum sum, const Left& left, int j) const {
    const Doubles products = to_doubles(centred_.products(sum, left.centred, j));
    Doubles squares = Vector::add(Vector::add(left.squares, Vector::load(right_squares_ + j)), Vector::add(products, products));
    Doubles rests = Vector::set(0);
    for (int c = 0; c < C; ++c) {
      const Doubles over = Vector::sub(left.rest[c], Vector::load(right_rest_[c] + j));
      const Doubles rest = Vector::add(over, Vector::where_at_most(over, Vector::set(-1), Vector::set(centred_.n)));
      squares = Vector::add(squares, Vector::where_at_most(over, Vector::set(-1), Vector::add(over, rest)));
      rests = Vector::add_product(rests, rest, rest);
    }
    return to_floats(Vector::sub(squares, share(rests)));
  }

 private:
  STEREOPSIS_INLINE Doubles share(Doubles rests) const {
    const double inverse = 1.0 / centred_.n;
    return {share(rests.lower, centred_.n, inverse), share(rests.upper, centred_.n, inverse)};
  }
  // v / n of whole numbers, v < 2^34 and n < 2^16, rounded once. A division takes five times as long as multiply-adds that are fused:
  // what v exceeds n `near` by is exact, so the sum errs by 2^-51 of its last place before it is rounded, and such a quotient is a
  // double or lies at least 2^-17 of that place off the middle between two.
  static STEREOPSIS_INLINE D share(D v, double n, double inverse) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
    const D near = Simd::mul(v, Simd::set(inverse));
    return Simd::add_product(near, Simd::add_product(v, near, Simd::set(-n)), Simd::set(inverse));
#else
    (void)inverse;
    for (double& lane : v.v) lane /= n;
    return v;
#endif
  }

  Centred<Sums, C> centred_;
  double *right_rest_[C], *left_squares_, *right_squares_;  // squares about the mean
};

template <class T, int C>
struct SadCost : WithTotals<Lesser<T>, T, C> {
  using Vector = Numbers<T>;
  using Left = typename Vector::Vector;

  void describe(const DeepWindows<C>& windows) { this->keep(windows, windows.sums); }
  STEREOPSIS_INLINE Left value(Left sum, const Left& left, int j) const {
    return Vector::sub(this->both(left, j), Vector::add(sum, sum));
  }
};

}  // namespace
}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
