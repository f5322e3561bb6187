// One build of the streaming kernels for 16-bit and float images, for the instruction set that STEREOPSIS_ISA names.
//
// As in fused_narrow.hpp what rows and columns change slides along x in `slide`, and the right image is kept mirrored, so that
// candidates are contiguous. `static` and unnamed for the reason given there.
#include <cstring>
#include <initializer_list>

#include "deep.hpp"
#include "deep_costs.hpp"
#include "winners.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

constexpr int kBlock = Simd::block < kLanes / 2 ? Simd::block : kLanes / 2;  // vectors at once
constexpr int kChunk = 16;  // pixels whose costs are kept until their winners are taken

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

template <class Cost>
class Deep {
  using Sums = typename Cost::Sums;
  using Stored = typename Sums::Number;
  using Summed = Numbers<Stored>;
  using Number = typename Cost::Number;
  using Vectors = Numbers<Number>;
  using Vector = typename Vectors::Vector;
  static constexpr Number worst = worst_cost<Number>();
  static constexpr int C = Cost::channels;

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
    for (Sums& kept : kept_) kept.take(arena_, columns_, reach_, w);
    cost_of_.take(arena_, s_, W, stats_);
    sums_ = arena_.take<Stored>(static_cast<size_t>(W) * padded_);
    slide_ = arena_.take<Stored>(padded_);
    costs_ = arena_.take<Number>(kChunk * stride() + kChunk);
    best_ = arena_.take<Number>(kChunk * kLanes);
    place_ = arena_.take<Number>(kChunk * kLanes);
    index_ = arena_.take<Number>(padded_);
    for (int32_t** row : {&row_in_, &row_out_}) *row = arena_.take<int32_t>(W);
    for (int32_t** row : {&left_in_, &left_out_}) *row = arena_.take<int32_t>(columns_);
    for (int32_t** row : {&right_in_, &right_out_}) *row = arena_.take<int32_t>(reach_ + w);
    for (int r = 0; r < kRows; ++r) {
      column_[r] = arena_.take<double>(columns_ + 1);
      window_[r] = arena_.take<double>(W);
    }
    right_best_ = arena_.take<Number>(stats_ + 2 * kChunk);
    right_column_ = arena_.take<Number>(stats_ + 2 * kChunk);
    right_index_ = arena_.take<int32_t>(stats_);
    claims_ = arena_.take<int32_t>(2 * W + 1);
    winner_ = arena_.take<int32_t>(W);
    for (Number** row : {&cost_, &before_, &after_, &second_}) *row = arena_.take<Number>(W);
  }

  size_t bytes() const { return arena_.used; }

  void rows(const FusedOutput& out, RowsToTake& rows, const Cancel& cancel) {
    std::memset(arena_.base, 0, arena_.used);
    for (int i = 0; i < padded_; ++i) index_[i] = static_cast<Number>(i);
    fill(worst, static_cast<int>(kChunk * stride() + kChunk), costs_);
    // The sums of the row before the first one.
    const int step = rows.step(), top = rows.first() - step - s_.window.above();
    for (int y = top; y < top + s_.window.height; ++y) {
      change_rows(y, nullptr);
      accumulate();
      if (cancel.load(std::memory_order_relaxed)) return;
    }
    for (int y = rows.first(); rows.take(); y += step) {
      if (cancel.load(std::memory_order_relaxed)) return;
      const int leaving = y - step + s_.window.ahead(-step);
      change_rows(y + s_.window.ahead(step), &leaving);
      window_statistics();
      match_row();
      if (Cost::base != 0)
        for (Number* kept : {cost_, before_, after_, second_})
          for (int x = 0; x < p_.width; ++x) kept[x] -= Cost::base;
      finish(p_, s_, RowWinners<Number>{winner_, cost_, before_, after_, second_, claims_, right_index_}, out, y);
    }
  }

 private:
  static constexpr int kRows = 4 * C;  // of statistics: a channel's sums and squares of the left image, then of the right one
  // Between the costs of two pixels there is room on both sides for what is next to them, and
  // one less than whole vectors, so that the candidates of a right pixel lie whole vectors apart; the rooms overlap then.
  size_t stride() const { return padded_ + 2 * kChunk - 1; }
  Number* costs_of(int slot) const { return costs_ + slot * stride() + kChunk; }

  // ---- rows that enter and leave ------------------------------------------------------------------------------------------

  void change_rows(int entering, const int* leaving) {
    const int W = p_.width, before = s_.window.left();
    for (int c = 0; c < C; ++c) {
      double** const columns = column_ + 4 * c;
      for (int side = 0; side < 2; ++side) {
        const void* image = side ? p_.right : p_.left;
        take_row(image, entering, c, row_in_);
        if (leaving) take_row(image, *leaving, c, row_out_);
        change_columns(row_in_, row_out_, W, columns[2 * side] + before, columns[2 * side + 1] + before);
        if (side) {
          mirror(row_in_, right_in_);
          mirror(row_out_, right_out_);
        } else {
          pad(row_in_, left_in_);
          pad(row_out_, left_out_);
        }
      }
      kept_[c].change({left_in_, left_out_, right_in_, right_out_, s_.window.width, columns_, reach_});
    }
  }

  void take_row(const void* image, int y, int c, int32_t* STEREOPSIS_RESTRICT row) const {
    const int32_t* STEREOPSIS_RESTRICT from =
        static_cast<const int32_t*>(image) + static_cast<size_t>(clamp(y, 0, p_.height - 1)) * p_.width * C + c;
    for (int x = 0; x < p_.width; ++x) row[x] = from[static_cast<size_t>(x) * C] - middle_;
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
    for (const Sums& kept : kept_) {
      const auto column = kept.column(k, columns_ - 1 - k);
      for (int at = 0; at < padded_; at += kLanes) Summed::store(slide_ + at, Sums::advance(Summed::load(slide_ + at), column, at));
    }
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
      for (int at = 0; at < padded_; at += kLanes) Summed::store(sums + at, Summed::add(Summed::load(sums + at), Summed::load(slide_ + at)));
    }
  }

  // ---- window statistics --------------------------------------------------------------------------------------------------

  void window_statistics() {
    const int W = p_.width;
    for (double* column : column_) pad(column + s_.window.left(), column);
    slide_windows<kRows>(column_, s_.window.width, W, window_);
    const int last = W - 1 - p_.first;
    DeepWindows<C> windows{{}, {}, W, last, most(0, last - (stats_ - 1)), least(W, last + 1)};
    for (int c = 0; c < C; ++c)
      for (int side = 0; side < 2; ++side) {
        windows.sums[side][c] = window_[4 * c + 2 * side];
        windows.squares[side][c] = window_[4 * c + 2 * side + 1];
      }
    cost_of_.describe(windows);
  }

  // ---- winners ------------------------------------------------------------------------------------------------------------

  void match_row() {
    if (s_.left_right) {
      fill(worst, stats_ + 2 * kChunk, right_best_);
      fill(Number{-1}, stats_ + 2 * kChunk, right_column_);
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
      for (int j = 0; j < stats_; ++j) right_index_[j] = static_cast<int32_t>(right_column_[kChunk + j]) + (1 - p_.width + j);
  }

  // The vectors of candidates are taken in blocks: as many as fit the registers, then one by one.
  void match_chunk(int begin, int end) {
    int at = 0;
    for (; at + kBlock * kLanes <= padded_; at += kBlock * kLanes) match_block<kBlock>(begin, end, at);
    for (; at < padded_; at += kLanes) match_block<1>(begin, end, at);
  }

  template <int N>
  STEREOPSIS_NOINLINE void match_block(const int begin, const int end, const int at) {
    Sums kept[C];
    for (int c = 0; c < C; ++c) kept[c] = kept_[c];
    const Cost cost_of = cost_of_;
    typename Summed::Vector change[N];
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { change[v] = Summed::load(slide_ + at + v * kLanes); });
    for (int x = begin; x < end; ++x) {
      const int lo = most(0, x - p_.first - (p_.width - 1)), hi = most(lo, least(p_.count, x - p_.first + 1));
      if (lo <= at && at + N * kLanes <= hi)
        match_pixel<N, true>(kept, cost_of, x, x - begin, at, lo, hi, change);
      else
        match_pixel<N, false>(kept, cost_of, x, x - begin, at, lo, hi, change);
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA { Summed::store(slide_ + at + v * kLanes, change[v]); });
  }

  // Of pixel x, which sees candidates [lo, hi), those of N vectors from `at` on; `Whole` says that it sees all of them.
  template <int N, bool Whole>
  STEREOPSIS_INLINE void match_pixel(const Sums* kept, const Cost& cost_of, int x, int slot, int at, int lo, int hi,
                                     typename Summed::Vector* change) {
    const int k = x + s_.window.width - 1, mirrored = p_.width - 1 - x + at;
    typename Sums::Column column[C];
    for (int c = 0; c < C; ++c) column[c] = kept[c].column(k, columns_ - 1 - k + at);
    const auto left = cost_of.left(x);
    Stored* const sums = sums_ + static_cast<size_t>(x) * padded_ + at;
    const Number* const indices = index_ + at;
    Number* const costs = costs_of(slot) + at;
    Vector best = at == 0 ? Vectors::set(worst) : Vectors::load(best_ + slot * kLanes);
    Vector place = at == 0 ? Vectors::set(-1) : Vectors::load(place_ + slot * kLanes);
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      constexpr int j = v.value * kLanes;
      for (int c = 0; c < C; ++c) change[v] = Sums::advance(change[v], column[c], j);
      Vector value = Vectors::set(worst);
      // A candidate that its pixel does not see in this row, it sees in none: nobody needs its sum.
      if (Whole || (at + j < hi && at + j + kLanes > lo)) {
        const auto sum = Summed::add(Summed::load(sums + j), change[v]);
        Summed::store(sums + j, sum);
        value = cost_of.value(sum, left, mirrored + j);
        const Vector index = Vectors::load(indices + j);
        if (!Whole) {
          const Vector none = Vectors::set(worst);
          value = Vectors::where_less(index, Vectors::set(static_cast<Number>(lo)), none, value);
          value = Vectors::where_less(index, Vectors::set(static_cast<Number>(hi)), value, none);
        }
        place = Vectors::where_less(value, best, index, place);
        best = Vectors::min(value, best);
      }
      Vectors::store(costs + j, value);
    });
    Vectors::store(best_ + slot * kLanes, best);
    Vectors::store(place_ + slot * kLanes, place);
  }

  // Of each pixel's lanes the least cost, and the least candidate that has it; candidates are exact as any number here.
  STEREOPSIS_NOINLINE void take_winners(int begin, int end) {
    Number least[kChunk], first[kChunk];
    Vectors::minima(best_, least);
    for (int slot = 0; slot < kChunk; ++slot) {
      Number* const place = place_ + slot * kLanes;
      const Vector best = Vectors::load(best_ + slot * kLanes);
      Vectors::store(place, Vectors::where_less(Vectors::set(least[slot]), best, Vectors::set(worst), Vectors::load(place)));
    }
    Vectors::minima(place_, first);
    for (int x = begin; x < end; ++x) {
      winner_[x] = static_cast<int32_t>(first[x - begin]);
      const Number* costs = costs_of(x - begin) + winner_[x];
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
    const Number* STEREOPSIS_RESTRICT costs = costs_of(0) + i;
    Vector best[N], column[N], here = Vectors::set(static_cast<Number>(begin));
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      best[v] = Vectors::set(worst);
      column[v] = here;
    });
    for (int x = begin; x < end; ++x) {
      unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
        const Vector value = Vectors::load(costs + v.value * kLanes);
        column[v] = Vectors::where_less(value, best[v], here, column[v]);
        best[v] = Vectors::min(value, best[v]);
      });
      here = Vectors::add(here, Vectors::set(1));
      costs += step;
    }
    unrolled<N>([&](auto v) STEREOPSIS_INLINE_LAMBDA {
      const int j = kChunk + (p_.width - 1 - begin) + i + v.value * kLanes;
      const Vector before = Vectors::load(right_best_ + j);
      Vectors::store(right_column_ + j, Vectors::where_less(best[v], before, column[v], Vectors::load(right_column_ + j)));
      Vectors::store(right_best_ + j, Vectors::min(best[v], before));
    });
  }

  // The least cost of the candidates that are not next to the winner. Strikes out the stored costs of those that are.
  void take_second(int x, int slot) {
    Number* costs = costs_of(slot);
    for (int i = winner_[x] - 1; i <= winner_[x] + 1; ++i) costs[i] = worst;
    Vector least = Vectors::set(worst);
    for (int at = 0; at < padded_; at += kLanes) least = Vectors::min(Vectors::load(costs + at), least);
    second_[x] = Vectors::least(least);
  }

  const Pair& p_;
  const FusedSettings& s_;
  Arena arena_;
  Sums kept_[C];
  Cost cost_of_;
  int vectors_, padded_, columns_, reach_, stats_;
  int32_t middle_;
  Stored *sums_, *slide_;
  int32_t *row_in_, *row_out_, *left_in_, *left_out_, *right_in_, *right_out_;
  double *column_[kRows], *window_[kRows];
  Number *costs_, *best_, *place_, *index_, *right_best_, *right_column_;
  Number *cost_, *before_, *after_, *second_;
  int32_t *right_index_, *winner_, *claims_;
};

template <int C, class Visit>
void with_cost(const Pair& pair, const FusedSettings& settings, void* memory, Visit visit) {
  const bool words = deep_words_fit(settings.range, settings.window, C);
  const bool held = deep_words_hold(settings.cost, settings.range, settings.window, C);
  switch (settings.cost) {
    case CostKind::sad:
      return held ? visit(Deep<SadCost<int32_t, C>>(pair, settings, memory)) : visit(Deep<SadCost<double, C>>(pair, settings, memory));
    case CostKind::ssd:
      if (words && held) return visit(Deep<SsdCost<WordProducts, int32_t, C>>(pair, settings, memory));
      return words ? visit(Deep<SsdCost<WordProducts, double, C>>(pair, settings, memory))
                   : visit(Deep<SsdCost<DoubleProducts, double, C>>(pair, settings, memory));
    case CostKind::zssd:
      return words ? visit(Deep<ZssdCost<WordProducts, C>>(pair, settings, memory))
                   : visit(Deep<ZssdCost<DoubleProducts, C>>(pair, settings, memory));
    case CostKind::ncc:
      return words ? visit(Deep<NccCost<WordProducts, C>>(pair, settings, memory))
                   : visit(Deep<NccCost<DoubleProducts, C>>(pair, settings, memory));
    case CostKind::zncc:
      return words ? visit(Deep<ZnccCost<WordProducts, C>>(pair, settings, memory))
                   : visit(Deep<ZnccCost<DoubleProducts, C>>(pair, settings, memory));
    case CostKind::zsad:
      return;  // its sums do not slide
  }
}

template <class Visit>
void with_kernel(const Pair& pair, const FusedSettings& settings, void* memory, Visit visit) {
  pair.channels == 1 ? with_cost<1>(pair, settings, memory, visit) : with_cost<3>(pair, settings, memory, visit);
}

size_t scratch_bytes(const Pair& pair, const FusedSettings& settings) {
  size_t bytes = 0;
  with_kernel(pair, settings, nullptr, [&](const auto& kernel) { bytes = kernel.bytes(); });
  return bytes;
}

void rows(const Pair& pair, const FusedSettings& settings, const FusedOutput& out, RowsToTake& rows, void* scratch,
          const Cancel& cancel) {
  with_kernel(pair, settings, scratch, [&](auto&& kernel) { kernel.rows(out, rows, cancel); });
}

}  // namespace

extern const DeepKernel deep;
const DeepKernel deep = {scratch_bytes, rows};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
