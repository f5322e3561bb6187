// Where, around a winner, the right window lies that correlates best with the left one: from inner products of windows at
// whole shifts alone, which slide, so that the time does not grow with the window.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"
#include "start.hpp"

namespace stereopsis {

namespace {

constexpr int kReach = 2;              // whole shifts on either side of the winner
constexpr int kShifts = 2 * kReach + 1;
constexpr int kLags = 4;               // a cubic mixes four neighbouring windows
constexpr int kSides = 3;              // a slope takes the windows on both sides

int clamp(int v, int low, int high) { return std::min(std::max(v, low), high); }

// The inner products of one left window, and of its slope along the row, with the five right windows around the winner;
// and theirs with each other.
struct Products {
  double ll, lg, gg;
  double lr[kShifts], gr[kShifts];
  double rr[kShifts][kShifts];  // where two are less than `kLags` apart
};

// Sums over windows on a row, kept as sums over columns that go from row to row. `Sum` holds a column's.
template <class Sum>
class Rows {
 public:
  // Candidates from `first` on, `count` of them, can be asked about.
  Rows(const AlignedPair& pair, const Window& window, int first, int count, bool centred)
      : p_(pair), w_(window), first_(first - 1), count_(count + 2), centred_(centred), width_(pair.width + 2),
        left_columns_(width_ + window.width - 1), right_columns_(pair.width + 2 * kReach + window.width - 1) {
    const size_t C = pair.channels;
    cross_.resize(static_cast<size_t>(left_columns_) * count_);
    l_.resize(left_columns_ * C);
    ll_.resize(static_cast<size_t>(left_columns_) * kSides);
    r_.resize(right_columns_ * C);
    rr_.resize(static_cast<size_t>(right_columns_) * kLags);
    row_.resize(static_cast<size_t>(std::max(left_columns_ + kSides, right_columns_ + kLags)));
    // Right columns backwards, so that candidates run forwards.
    reversed_.resize(static_cast<size_t>(left_columns_ + count_));
    sum_l_.resize(width_ * C);
    sum_ll_.resize(static_cast<size_t>(width_) * kSides);
    sum_r_.resize((pair.width + 2 * kReach) * C);
    sum_rr_.resize(static_cast<size_t>(pair.width + 2 * kReach) * kLags);
  }

  void start(int y) {
    for (auto* sums : {&cross_, &l_, &ll_, &r_, &rr_}) std::fill(sums->begin(), sums->end(), Sum{0});
    for (int v = -w_.above(); v <= w_.below(); ++v) add(y + v, 1);
    finish();
  }

  void next(int y) {
    add(y - 1 - w_.above(), -1);
    add(y + w_.below(), 1);
    finish();
  }

  // Of the window at x with the ones around the winner; `same`: that is what it was at x - 1.
  void products(int x, int winner, bool same, Products& out) {
    const int i = winner - kReach - first_, C = p_.channels;
    // The slope is half of what the window one to the right has more than the one to the left.
    for (int side = 0; side < 3; ++side) slide(side, x + side, i + side - 1, same);
    const double n = centred_ ? static_cast<double>(w_.area()) : 1, mean = centred_ ? 1 : 0;
    const double *before = &sum_l_[static_cast<size_t>(x) * C], *l = before + C, *after = l + C;
    const double* ll = &sum_ll_[static_cast<size_t>(x + 1) * kSides];
    double g[3];
    for (int c = 0; c < C; ++c) g[c] = 0.5 * (after[c] - before[c]);
    out.ll = n * ll[0] - mean * dot(l, l);
    out.lg = n * 0.5 * (ll[1] - ll[1 - kSides]) - mean * dot(l, g);
    out.gg = n * 0.25 * (ll[kSides] + ll[-kSides] - 2 * ll[2 - kSides]) - mean * dot(g, g);
    for (int k = 0; k < kShifts; ++k) {
      // A larger candidate lies further to the left. Right windows are counted from -kReach.
      const int a = kShifts - 1 - k, at = x - winner - k + 2 * kReach;
      const double* r = &sum_r_[static_cast<size_t>(at) * C];
      out.lr[a] = n * static_cast<double>(slide_[1][k]) - mean * dot(l, r);
      out.gr[a] = n * 0.5 * static_cast<double>(slide_[2][k] - slide_[0][k]) - mean * dot(g, r);
      for (int lag = 0; lag < std::min(kLags, k + 1); ++lag) {
        const double product = n * sum_rr_[static_cast<size_t>(at) * kLags + lag] - mean * dot(r, r + lag * C);
        out.rr[a][a + lag] = out.rr[a + lag][a] = product;
      }
    }
  }

 private:
  // Sums of the left window that starts at column x with the right ones of candidates from i on.
  void slide(int side, int x, int i, bool same) {
    int64_t* sums = slide_[side];
    if (same) {
      const Sum* leaves = &cross_[static_cast<size_t>(x - 1) * count_ + i];
      const Sum* enters = &cross_[static_cast<size_t>(x + w_.width - 1) * count_ + i];
      for (int k = 0; k < kShifts; ++k) sums[k] += static_cast<int64_t>(enters[k]) - leaves[k];
    } else {
      std::fill(sums, sums + kShifts, 0);
      for (int u = 0; u < w_.width; ++u) {
        const Sum* column = &cross_[static_cast<size_t>(x + u) * count_ + i];
        for (int k = 0; k < kShifts; ++k) sums[k] += column[k];
      }
    }
  }

  double dot(const double* a, const double* b) const {
    double sum = 0;
    for (int c = 0; c < p_.channels; ++c) sum += a[c] * b[c];
    return sum;
  }

  void add(int y, Sum sign) {
    const int C = p_.channels, W = p_.width;
    const size_t row = static_cast<size_t>(clamp(y, 0, p_.height - 1)) * W * C;
    const int leftmost = -1 - w_.left();                             // column 0 of the left sums
    const int last = leftmost + left_columns_ - 1 - first_;          // the rightmost right column that is met
    for (int c = 0; c < C; ++c) {
      const auto left = [&](int x) { return static_cast<Sum>(p_.left[row + static_cast<size_t>(clamp(x, 0, W - 1)) * C + c]); };
      const auto right = [&](int x) { return static_cast<Sum>(p_.right[row + static_cast<size_t>(clamp(x, 0, W - 1)) * C + c]); };
      for (int j = 0; j < left_columns_ + count_; ++j) reversed_[j] = right(last - j);
      for (int i = 0; i < left_columns_ + kSides; ++i) row_[i] = left(leftmost + i);
      for (int i = 0; i < left_columns_; ++i) {
        const Sum signed_l = sign * row_[i];
        l_[static_cast<size_t>(i) * C + c] += signed_l;
        for (int lag = 0; lag < kSides; ++lag) ll_[static_cast<size_t>(i) * kSides + lag] += signed_l * row_[i + lag];
        Sum* __restrict to = &cross_[static_cast<size_t>(i) * count_];
        const Sum* __restrict from = &reversed_[left_columns_ - 1 - i];
        for (int k = 0; k < count_; ++k) to[k] += signed_l * from[k];
      }
      for (int i = 0; i < right_columns_ + kLags; ++i) row_[i] = right(i - w_.left() - kReach);
      for (int i = 0; i < right_columns_; ++i) {
        const Sum signed_r = sign * row_[i];
        r_[static_cast<size_t>(i) * C + c] += signed_r;
        for (int lag = 0; lag < kLags; ++lag) rr_[static_cast<size_t>(i) * kLags + lag] += signed_r * row_[i + lag];
      }
    }
  }

  // From columns to windows.
  void finish() {
    const int C = p_.channels, right_windows = p_.width + 2 * kReach;
    across(l_, C, width_, sum_l_);
    across(ll_, kSides, width_, sum_ll_);
    across(r_, C, right_windows, sum_r_);
    across(rr_, kLags, right_windows, sum_rr_);
  }

  void across(const std::vector<Sum>& columns, int step, int windows, std::vector<double>& sums) const {
    for (int c = 0; c < step; ++c) {
      int64_t sum = 0;
      for (int i = 0; i < w_.width - 1; ++i) sum += columns[static_cast<size_t>(i) * step + c];
      for (int x = 0; x < windows; ++x) {
        sum += columns[static_cast<size_t>(x + w_.width - 1) * step + c];
        sums[static_cast<size_t>(x) * step + c] = static_cast<double>(sum);
        sum -= columns[static_cast<size_t>(x) * step + c];
      }
    }
  }

  const AlignedPair p_;
  const Window w_;
  const int first_, count_;
  const bool centred_;
  const int width_, left_columns_, right_columns_;  // left windows: one more on both sides
  std::vector<Sum> cross_, l_, ll_, r_, rr_, row_, reversed_;
  std::vector<double> sum_l_, sum_ll_, sum_r_, sum_rr_;
  int64_t slide_[3][kShifts];
};

double correlation(double lr, double rr, double ll) { return rr > 0 && ll > 0 ? lr / std::sqrt(ll * rr) : 0; }

// The shift in [-1, 1] at which the right window, straight lines between its pixels, correlates best.
double linear_optimum(const Products& p) {
  double best = correlation(p.lr[kReach], p.rr[kReach][kReach], p.ll), shift = 0;
  for (const int to : {-1, 1}) {
    const double a = p.lr[kReach], b = p.lr[kReach + to];
    const double aa = p.rr[kReach][kReach], bb = p.rr[kReach + to][kReach + to], ab = p.rr[kReach][kReach + to];
    // The correlation is stationary at one place alone; it may also rise all the way.
    const double rise = b * aa - a * ab, reach = a * (bb - ab) + b * (aa - ab);
    for (const double t : {0 < rise && rise < reach ? rise / reach : 1.0, 1.0}) {
      const double s = 1 - t;
      const double found = correlation(s * a + t * b, s * s * aa + 2 * s * t * ab + t * t * bb, p.ll);
      if (found > best) best = found, shift = to * t;
    }
  }
  return shift;
}

// What a cubic through four neighbours (Catmull and Rom's) weighs them by, t of the way from the second to the third.
void cubic_weights(double t, double (&w)[4]) {
  const double u = t * t, v = u * t;
  w[0] = 0.5 * (-v + 2 * u - t);
  w[1] = 0.5 * (3 * v - 5 * u + 2);
  w[2] = 0.5 * (-3 * v + 4 * u + t);
  w[3] = 0.5 * (v - u);
}

// Gauss-Newton on |L - o - g R(shift)|^2 in offset, gain and shift, from `shift` and within [-1, 1]. The left window's slope
// G stands for g R'(shift): noise that interpolation smooths away would draw the right one's to half pixels. What ends no
// better than it began stays.
double cubic_optimum(const Products& p, double shift) {
  double first = 0, now = shift;
  for (int k = 0; k < 20; ++k) {
    const int base = now < 0 ? 0 : 1;  // the cubic's first window
    double w[4], lr = 0, gr = 0, rr = 0;
    cubic_weights(now + 1 - base, w);
    for (int i = 0; i < 4; ++i) {
      lr += w[i] * p.lr[base + i];
      gr += w[i] * p.gr[base + i];
      for (int j = 0; j < 4; ++j) rr += w[i] * w[j] * p.rr[base + i][base + j];
    }
    const double found = correlation(lr, rr, p.ll);
    if (k == 0) first = found;
    const double determinant = rr * p.gg - gr * gr;
    if (!(lr > 0 && determinant > 1e-9 * rr * p.gg)) return shift;
    // L = o + g R + by G
    const double by = (rr * p.lg - gr * lr) / determinant;
    const double next = std::min(std::max(now + by, -1.0), 1.0);
    if (std::abs(next - now) < 1e-3) return found >= first ? now : shift;
    now = next;
  }
  return shift;
}

template <class Sum>
void align_rows(const AlignedPair& pair, const Window& window, Alignment alignment, bool centred, const float* start,
                float* disparity, const Workers& workers) {
  const Start from_map(pair, start, disparity);
  if (from_map.none()) return;
  const int first = from_map.low - kReach, count = from_map.high - from_map.low + kShifts;
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Rows<Sum> rows(pair, window, first, count, centred);
    Products products;
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      if (y == begin) rows.start(y);
      else rows.next(y);
      int before = 0;
      bool same = false;
      for (int x = 0; x < pair.width; ++x) {
        const size_t at = static_cast<size_t>(y) * pair.width + x;
        const bool inside = from_map.in_view(x, at);
        const int winner = inside ? from_map.whole(at) : 0;
        if (inside) {
          rows.products(x, winner, same && winner == before, products);
          disparity[at] = static_cast<float>(winner - (alignment == Alignment::correlation
                                                           ? linear_optimum(products)
                                                           : cubic_optimum(products, static_cast<double>(winner) - start[at])));
        }
        same = inside;
        before = winner;
      }
    }
  });
}

}  // namespace

void align(const AlignedPair& pair, const Window& window, Alignment alignment, bool centred, bool bytes, const float* start,
           float* disparity, const Workers& workers) {
  // 255 rows of products of bytes in three channels stay below 2^26; of 21-bit numbers, below 2^52.
  const auto run = bytes ? align_rows<int32_t> : align_rows<int64_t>;
  run(pair, window, alignment, centred, start, disparity, workers);
}

}  // namespace stereopsis
