// Where, around a winner, the right window lies that correlates best with the left one: from inner products of windows at
// whole shifts alone, which slide, so that the time does not grow with the window.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr int kReach = 2;              // whole shifts on either side of the winner
constexpr int kShifts = 2 * kReach + 1;
constexpr int kLags = 4;               // a cubic mixes four neighbouring windows

int clamp(int v, int low, int high) { return std::min(std::max(v, low), high); }

// The inner products of one left window with the five right ones around its winner, and theirs with each other.
struct Products {
  double ll;
  double lr[kShifts];
  double rr[kShifts][kShifts];  // where two are less than `kLags` apart
};

// Sums over windows on a row, kept as sums over columns that go from row to row. `Sum` holds a column's.
template <class Sum>
class Rows {
 public:
  Rows(const AlignedPair& pair, const Window& window, int first, int count, bool centred)
      : p_(pair), w_(window), first_(first), count_(count), centred_(centred), left_columns_(pair.width + window.width - 1),
        right_columns_(left_columns_ + 2 * kReach) {
    const size_t C = pair.channels;
    cross_.resize(static_cast<size_t>(left_columns_) * count);
    l_.resize(left_columns_ * C);
    ll_.resize(left_columns_);
    r_.resize(right_columns_ * C);
    rr_.resize(static_cast<size_t>(right_columns_) * kLags);
    left_row_.resize(left_columns_ * C);
    right_row_.resize((right_columns_ + kLags) * C);
    // Right columns backwards, so that candidates run forwards.
    reversed_.resize(static_cast<size_t>(left_columns_ + count) * C);
    sum_l_.resize(pair.width * C);
    sum_ll_.resize(pair.width);
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

  // Of the window at x with the ones around candidate i + kReach. `same`: i is what it was at x - 1.
  void products(int x, int i, bool same, Products& out) {
    if (same) {
      const Sum* leaves = &cross_[static_cast<size_t>(x - 1) * count_ + i];
      const Sum* enters = &cross_[static_cast<size_t>(x + w_.width - 1) * count_ + i];
      for (int k = 0; k < kShifts; ++k) slide_[k] += static_cast<int64_t>(enters[k]) - leaves[k];
    } else {
      std::fill(slide_, slide_ + kShifts, 0);
      for (int u = 0; u < w_.width; ++u) {
        const Sum* column = &cross_[static_cast<size_t>(x + u) * count_ + i];
        for (int k = 0; k < kShifts; ++k) slide_[k] += column[k];
      }
    }
    const int C = p_.channels, match = x - (first_ + i + kReach);  // of the winner; sum_r_ starts at -kReach
    const double n = centred_ ? static_cast<double>(w_.area()) : 1;
    const double mean = centred_ ? 1 : 0;
    const double* l = &sum_l_[static_cast<size_t>(x) * C];
    out.ll = n * sum_ll_[x] - mean * dot(l, l);
    for (int k = 0; k < kShifts; ++k) {
      // A larger candidate lies further to the left.
      const int at = match - k + 2 * kReach;
      const double* r = &sum_r_[static_cast<size_t>(at) * C];
      out.lr[kShifts - 1 - k] = n * static_cast<double>(slide_[k]) - mean * dot(l, r);
      for (int lag = 0; lag < std::min<int>(kLags, k + 1); ++lag) {
        const double product = n * sum_rr_[static_cast<size_t>(at) * kLags + lag] - mean * dot(r, r + lag * C);
        const int a = kShifts - 1 - k;
        out.rr[a][a + lag] = out.rr[a + lag][a] = product;
      }
    }
  }

 private:
  double dot(const double* a, const double* b) const {
    double sum = 0;
    for (int c = 0; c < p_.channels; ++c) sum += a[c] * b[c];
    return sum;
  }

  void add(int y, Sum sign) {
    const int C = p_.channels, W = p_.width;
    const int32_t* L = p_.left + static_cast<size_t>(clamp(y, 0, p_.height - 1)) * W * C;
    const int32_t* R = p_.right + static_cast<size_t>(clamp(y, 0, p_.height - 1)) * W * C;
    const int last = left_columns_ - 1 - w_.left() - first_;  // the rightmost right column that is met
    for (int c = 0; c < C; ++c) {
      Sum* back = &reversed_[static_cast<size_t>(c) * (left_columns_ + count_)];
      for (int j = 0; j < left_columns_ + count_; ++j) back[j] = R[clamp(last - j, 0, W - 1) * C + c];
      for (int i = 0; i < left_columns_; ++i) {
        const Sum l = L[clamp(i - w_.left(), 0, W - 1) * C + c], signed_l = sign * l;
        l_[static_cast<size_t>(i) * C + c] += signed_l;
        ll_[i] += signed_l * l;
        Sum* __restrict to = &cross_[static_cast<size_t>(i) * count_];
        const Sum* __restrict from = back + (left_columns_ - 1 - i);
        for (int k = 0; k < count_; ++k) to[k] += signed_l * from[k];
      }
      for (int i = 0; i < right_columns_ + kLags; ++i)
        right_row_[i] = R[clamp(i - w_.left() - kReach, 0, W - 1) * C + c];
      for (int i = 0; i < right_columns_; ++i) {
        const Sum signed_r = sign * right_row_[i];
        r_[static_cast<size_t>(i) * C + c] += signed_r;
        for (int lag = 0; lag < kLags; ++lag) rr_[static_cast<size_t>(i) * kLags + lag] += signed_r * right_row_[i + lag];
      }
    }
  }

  // From columns to windows.
  void finish() {
    const int C = p_.channels, W = p_.width;
    across(l_, C, W, sum_l_);
    across(ll_, 1, W, sum_ll_);
    across(r_, C, W + 2 * kReach, sum_r_);
    across(rr_, kLags, W + 2 * kReach, sum_rr_);
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
  const int left_columns_, right_columns_;
  std::vector<Sum> cross_, l_, ll_, r_, rr_, left_row_, right_row_, reversed_;
  std::vector<double> sum_l_, sum_ll_, sum_r_, sum_rr_;
  int64_t slide_[kShifts];
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

// What a cubic through four neighbours (Catmull and Rom's) weighs them by, t of the way from the second to the third; and
// how fast that changes with t.
void cubic_weights(double t, double (&w)[4], double (&slope)[4]) {
  const double u = t * t, v = u * t;
  w[0] = 0.5 * (-v + 2 * u - t);
  w[1] = 0.5 * (3 * v - 5 * u + 2);
  w[2] = 0.5 * (-3 * v + 4 * u + t);
  w[3] = 0.5 * (v - u);
  slope[0] = 0.5 * (-3 * u + 4 * t - 1);
  slope[1] = 0.5 * (9 * u - 10 * t);
  slope[2] = 0.5 * (-9 * u + 8 * t + 1);
  slope[3] = 0.5 * (3 * u - 2 * t);
}

// Gauss-Newton on |L - o - g R(shift)|^2 in offset, gain and shift, from `shift` and within [-1, 1]: the best that it meets.
double cubic_optimum(const Products& p, double shift) {
  double best = 0, best_shift = shift;
  for (int k = 0; k < 20; ++k) {
    const int base = shift < 0 ? 0 : 1;  // the cubic's first window
    double w[4], dw[4];
    cubic_weights(shift + 1 - base, w, dw);
    // Of L, R(shift) and its slope S.
    double lr = 0, ls = 0, rr = 0, rs = 0, ss = 0;
    for (int i = 0; i < 4; ++i) {
      lr += w[i] * p.lr[base + i];
      ls += dw[i] * p.lr[base + i];
      for (int j = 0; j < 4; ++j) {
        const double product = p.rr[base + i][base + j];
        rr += w[i] * w[j] * product;
        rs += w[i] * dw[j] * product;
        ss += dw[i] * dw[j] * product;
      }
    }
    const double found = correlation(lr, rr, p.ll);
    if (k > 0 && !(found > best)) break;
    best = found;
    best_shift = shift;
    const double gain = lr * ss - ls * rs, step = ls * rr - lr * rs;
    if (!(gain > 0)) break;
    const double next = std::min(std::max(shift + step / gain, -1.0), 1.0);
    if (std::abs(next - shift) < 1e-3) break;
    shift = next;
  }
  return best_shift;
}

template <class Sum>
void align_rows(const AlignedPair& pair, const Window& window, Alignment alignment, bool centred, const float* start,
                float* disparity, const Workers& workers) {
  const size_t size = static_cast<size_t>(pair.height) * pair.width;
  float low = std::numeric_limits<float>::infinity(), high = -low;
  for (size_t i = 0; i < size; ++i)
    if (!std::isnan(start[i])) low = std::min(low, start[i]), high = std::max(high, start[i]);
  if (!(low <= high)) {
    std::copy(start, start + size, disparity);
    return;
  }
  const auto whole = [](float d) { return static_cast<int>(std::floor(d + 0.5f)); };
  const int first = whole(low) - kReach, count = whole(high) - whole(low) + kShifts;
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Rows<Sum> rows(pair, window, first, count, centred);
    Products products;
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
      if (y == begin) rows.start(y);
      else rows.next(y);
      int before = -1;
      for (int x = 0; x < pair.width; ++x) {
        const size_t at = static_cast<size_t>(y) * pair.width + x;
        disparity[at] = start[at];
        const int winner = std::isnan(start[at]) ? 0 : whole(start[at]);
        const bool inside = !std::isnan(start[at]) && 0 <= x - winner && x - winner < pair.width;
        const int i = inside ? winner - kReach - first : -1;
        if (inside) {
          rows.products(x, i, i == before, products);
          if (alignment == Alignment::correlation) {
            disparity[at] = static_cast<float>(winner - linear_optimum(products));
          } else {
            disparity[at] = static_cast<float>(winner - cubic_optimum(products, static_cast<double>(winner) - start[at]));
          }
        }
        before = i;
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
