// The streaming kernel for what no other serves: the largest windows, also of 16-bit and float images (as 21-bit fixed
// point), in 64-bit integers; and ZSAD, whose sums do not slide. Plain loops, compiled once per instruction set; `static`
// and unnamed for the reason given in fused_narrow.hpp.
#pragma once

#include <cstring>

#include "arena.hpp"
#include "fused.hpp"
#include "score.hpp"
#include "simd.hpp"
#include "winners.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

template <CostKind Kind>
class Wide {
  using Scalar = typename WideCost<Kind>::Scalar;
  static constexpr bool slides = Kind != CostKind::zsad;
  static constexpr bool squares = Kind != CostKind::sad && Kind != CostKind::zsad;
  static constexpr Scalar worst = WideCost<Kind>::worst;

 public:
  Wide(const Pair& pair, const FusedSettings& settings, void* memory)
      : p_(pair), s_(settings), arena_{static_cast<char*>(memory)} {
    const int W = p_.width, D = p_.count, C = p_.channels;
    columns_ = W + s_.window.width - 1;
    mirrored_ = columns_ + D + s_.window.width;
    kept_rows_ = slides || s_.window.height < 2 ? 2 : s_.window.height;
    left_rows_ = arena_.take<int32_t>(static_cast<size_t>(kept_rows_) * C * columns_);
    right_rows_ = arena_.take<int32_t>(static_cast<size_t>(kept_rows_) * C * mirrored_);
    if (slides) sums_ = arena_.take<int64_t>(static_cast<size_t>(W) * D);
    slide_ = arena_.take<int64_t>(D);
    column_ = arena_.take<Moments>(static_cast<size_t>(2) * C * W);
    window_ = arena_.take<WindowStatistics>(static_cast<size_t>(C) * W);
    window_right_ = arena_.take<WindowStatistics>(static_cast<size_t>(C) * W);
    scale_ = arena_.take<double>(2 * static_cast<size_t>(W));
    costs_ = arena_.take<Scalar>(D + 2) + 1;
    above_ = arena_.take<int64_t>(D);
    above_count_ = arena_.take<int64_t>(D);
    right_best_ = arena_.take<Scalar>(static_cast<size_t>(W) + D);
    right_index_ = arena_.take<int32_t>(static_cast<size_t>(W) + D);
    claims_ = arena_.template take<int32_t>(2 * p_.width + 1);
    winner_ = arena_.take<int32_t>(W);
    cost_ = arena_.take<Scalar>(W);
    before_ = arena_.take<Scalar>(W);
    after_ = arena_.take<Scalar>(W);
    second_ = arena_.take<Scalar>(W);
  }

  size_t bytes() const { return arena_.used; }

  void rows(const FusedOutput& out, RowsToTake& rows, const Cancel& cancel) {
    std::memset(arena_.base, 0, arena_.used);
    const int step = rows.step(), top = rows.first() - step - s_.window.above();
    for (int y = top; y < top + s_.window.height; ++y) {
      take_row(0, inside(y));
      add_moments(0, 1);
      if (slides) accumulate(1, 0);
      if (cancel.load(std::memory_order_relaxed)) return;
    }
    for (int y = rows.first(); rows.take(); y += step) {
      if (cancel.load(std::memory_order_relaxed)) return;
      take_row(0, inside(y + s_.window.ahead(step)));
      add_moments(0, 1);
      take_row(1, inside(y - step + s_.window.ahead(-step)));
      add_moments(1, -1);
      if (slides)
        accumulate(1, -1);
      else
        for (int k = 0; k < s_.window.height; ++k) take_row(k, inside(y - s_.window.above() + k));
      describe_windows();
      if (!match_row(cancel)) return;
      finish(p_, s_, RowWinners<Scalar>{winner_, cost_, before_, after_, second_, claims_, right_index_}, out, y);
    }
  }

 private:
  int inside(int y) const { return y < 0 ? 0 : y < p_.height ? y : p_.height - 1; }
  int32_t* left_row(int slot, int c) const { return left_rows_ + (static_cast<size_t>(slot) * p_.channels + c) * columns_; }
  int32_t* right_row(int slot, int c) const {
    return right_rows_ + (static_cast<size_t>(slot) * p_.channels + c) * mirrored_;
  }

  // Image row y, its edge pixels repeated; the right one mirrored, so that candidate i of padded column k meets
  // entry columns - 1 - k + i.
  void take_row(int slot, int y) {
    const int W = p_.width, C = p_.channels, before = s_.window.left();
    const int last = W - 1 + s_.window.right() - p_.first;
    const int32_t* left = static_cast<const int32_t*>(p_.left) + static_cast<size_t>(y) * W * C;
    const int32_t* right = static_cast<const int32_t*>(p_.right) + static_cast<size_t>(y) * W * C;
    for (int c = 0; c < C; ++c) {
      int32_t* l = left_row(slot, c);
      int32_t* r = right_row(slot, c);
      for (int k = 0; k < columns_; ++k) {
        const int x = k - before;
        l[k] = left[static_cast<size_t>(x < 0 ? 0 : x < W ? x : W - 1) * C + c];
      }
      for (int j = 0; j < mirrored_; ++j) {
        const int x = last - j;
        r[j] = right[static_cast<size_t>(x < 0 ? 0 : x < W ? x : W - 1) * C + c];
      }
    }
  }

  void add_moments(int slot, int sign) {
    const int W = p_.width, C = p_.channels;
    const int last = W - 1 + s_.window.right() - p_.first;
    for (int c = 0; c < C; ++c) {
      Moments* left = column_ + static_cast<size_t>(c) * W;
      Moments* right = column_ + static_cast<size_t>(C + c) * W;
      const int32_t* l = left_row(slot, c) + s_.window.left();
      const int32_t* r = right_row(slot, c);
      for (int x = 0; x < W; ++x) left[x].add(l[x], sign);
      // Right pixels that no candidate meets are in no kept entry; nothing asks for their windows alone, but windows
      // that do matter reach over them.
      for (int x = 0; x < W; ++x) {
        const int j = last - x;
        if (j >= 0 && j < mirrored_) right[x].add(r[j], sign);
      }
    }
  }

  // Adds `entering` times row slot 0 and `leaving` times row slot 1 to every window's sum.
  void accumulate(int entering, int leaving) {
    const int D = p_.count, w = s_.window.width;
    std::memset(slide_, 0, D * sizeof *slide_);
    for (int k = 0; k < columns_; ++k) {
      for (int c = 0; c < p_.channels; ++c) {
        move(k, c, 0, entering);
        if (leaving) move(k, c, 1, leaving);
      }
      if (k < w - 1) continue;
      int64_t* STEREOPSIS_RESTRICT sums = sums_ + static_cast<size_t>(k - w + 1) * D;
      const int64_t* STEREOPSIS_RESTRICT slide = slide_;
      for (int i = 0; i < D; ++i) sums[i] += slide[i];
    }
  }

  // Lets column k enter the sliding sum, and column k - w leave it.
  void move(int k, int c, int slot, int sign) {
    const int D = p_.count, w = s_.window.width;
    int64_t* STEREOPSIS_RESTRICT slide = slide_;
    const int32_t* STEREOPSIS_RESTRICT r = right_row(slot, c) + (columns_ - 1 - k);
    const int64_t l = left_row(slot, c)[k], t = k >= w ? left_row(slot, c)[k - w] : 0;
    const int64_t gone = k >= w ? 1 : 0;
    if (squares)
      for (int i = 0; i < D; ++i) slide[i] += sign * (l * r[i] - t * r[i + w]);
    else
      for (int i = 0; i < D; ++i) {
        const int64_t a = l - r[i], b = t - r[i + w];
        slide[i] += sign * ((a < 0 ? -a : a) - gone * (b < 0 ? -b : b));
      }
  }

  void describe_windows() {
    const int W = p_.width;
    for (int c = 0; c < p_.channels; ++c) {
      describe(column_ + static_cast<size_t>(c) * W, window_ + static_cast<size_t>(c) * W);
      describe(column_ + static_cast<size_t>(p_.channels + c) * W, window_right_ + static_cast<size_t>(c) * W);
    }
    for (int x = 0; x < W; ++x) {
      scale_[x] = wide_scale<Kind>(window_ + x, W, p_.channels);
      scale_[W + x] = wide_scale<Kind>(window_right_ + x, W, p_.channels);
    }
  }

  void describe(const Moments* column, WindowStatistics* windows) const {
    const int W = p_.width, before = s_.window.left(), after = s_.window.right();
    const auto at = [&](int x) { return column[x < 0 ? 0 : x < W ? x : W - 1]; };
    Moments sum{};
    for (int x = -before; x <= after; ++x) sum.join(at(x), 1);
    for (int x = 0; x < W; ++x) {
      windows[x] = WindowStatistics::of(sum, s_.window.area());
      sum.join(at(x + after + 1), 1);
      sum.join(at(x - before), -1);
    }
  }

  bool match_row(const Cancel& cancel) {
    const int W = p_.width, D = p_.count;
    if (s_.left_right)
      for (int j = 0; j < W + D; ++j) {
        right_best_[j] = worst;
        right_index_[j] = -1;
      }
    for (int x = 0; x < W; ++x) {
      const int beyond = x - p_.first - (W - 1), reach = x - p_.first + 1;
      const int lo = beyond > 0 ? beyond : 0, hi = reach < D ? reach : D;
      winner_[x] = -1;
      if (hi <= lo) continue;
      if (!slides && cancel.load(std::memory_order_relaxed)) return false;
      if (slides)
        slide_costs(x, lo, hi);
      else
        direct_costs(x, lo, hi);
      int best = lo;
      for (int i = lo + 1; i < hi; ++i)
        if (costs_[i] < costs_[best]) best = i;
      winner_[x] = best;
      cost_[x] = costs_[best];
      before_[x] = costs_[best - 1];
      after_[x] = costs_[best + 1];
      if (s_.uniqueness) {
        Scalar second = worst;
        for (int i = lo; i < hi; ++i)
          if ((i < best - 1 || i > best + 1) && costs_[i] < second) second = costs_[i];
        second_[x] = second;
      }
      if (s_.left_right)
        for (int i = lo; i < hi; ++i)
          if (costs_[i] < right_best_[W - 1 - x + i]) {
            right_best_[W - 1 - x + i] = costs_[i];
            right_index_[W - 1 - x + i] = i;
          }
    }
    return true;
  }

  void slide_costs(int x, int lo, int hi) {
    const int W = p_.width;
    const int64_t* sums = sums_ + static_cast<size_t>(x) * p_.count;
    const int64_t n = s_.window.area();
    for (int i = lo; i < hi; ++i) {
      const int xr = x - p_.first - i;
      costs_[i] = WideCost<Kind>::of(sums[i], window_ + x, window_right_ + xr, W, p_.channels, n, scale_[x], scale_[W + xr]);
    }
  }

  // ZSAD: the mean of the differences is another one for every window, so its sum of absolute values has to be taken
  // over the whole window each time.
  void direct_costs(int x, int lo, int hi) {
    const int w = s_.window.width, W = p_.width;
    const int64_t n = s_.window.area();
    for (int i = lo; i < hi; ++i) costs_[i] = 0;
    for (int c = 0; c < p_.channels; ++c) {
      int64_t* STEREOPSIS_RESTRICT above = above_;
      int64_t* STEREOPSIS_RESTRICT count = above_count_;
      int64_t* STEREOPSIS_RESTRICT mean = slide_;
      const int64_t left = window_[static_cast<size_t>(c) * W + x].sum;
      const WindowStatistics* right = window_right_ + static_cast<size_t>(c) * W;
      for (int i = lo; i < hi; ++i) {
        mean[i] = floor_mean(left - right[x - p_.first - i].sum, n);
        above[i] = count[i] = 0;
      }
      for (int row = 0; row < s_.window.height; ++row) {
        const int32_t* STEREOPSIS_RESTRICT l = left_row(row, c) + x;
        for (int k = 0; k < w; ++k) {
          const int32_t* STEREOPSIS_RESTRICT r = right_row(row, c) + (columns_ - 1 - x - k);
          const int64_t value = l[k];
          for (int i = lo; i < hi; ++i) {
            const int64_t over = value - r[i] - mean[i];
            above[i] += over > 0 ? over : 0;
            count[i] += over > 0 ? 1 : 0;
          }
        }
      }
      for (int i = lo; i < hi; ++i)
        costs_[i] += zsad_cost(above[i], count[i], mean[i], left - right[x - p_.first - i].sum, n);
    }
  }

  const Pair& p_;
  const FusedSettings& s_;
  Arena arena_;
  int columns_, mirrored_, kept_rows_;
  int32_t *left_rows_, *right_rows_;
  int64_t *sums_ = nullptr, *slide_, *above_, *above_count_;
  Moments* column_;
  WindowStatistics *window_, *window_right_;
  double* scale_;
  Scalar *costs_, *right_best_, *cost_, *before_, *after_, *second_;
  int32_t *right_index_, *winner_, *claims_;
};

}  // namespace
}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
