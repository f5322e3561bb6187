// One build of the kernels for weighted supports, for the instruction set that STEREOPSIS_ISA names: plain loops over the
// candidates, `static` and unnamed for the reason given in fused_narrow.hpp.
#include "arena.hpp"
#include "score.hpp"
#include "simd.hpp"
#include "supports.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

// How many candidates are taken at a time; Reversed holds as many more than there are.
constexpr int kCandidates = kSupportCandidates;

// ---- what is averaged over the window -------------------------------------------------------------------------------
//
// One plane of sums over the channels, |l - r|, (l - r)^2 or l r, which is `first`; and what else the cost is made of:
// the channels' differences (ZSSD), the right squares (NCC), these and the right channels (ZNCC).

enum class Term { absolute, squared, product };

constexpr Term term_of(CostKind cost) {
  return cost == CostKind::sad || cost == CostKind::zsad   ? Term::absolute
         : cost == CostKind::ssd || cost == CostKind::zssd ? Term::squared
                                                           : Term::product;
}
constexpr int planes_of(CostKind cost, int channels) {
  return cost == CostKind::zssd  ? 1 + channels
         : cost == CostKind::ncc  ? 2
         : cost == CostKind::zncc ? 2 + channels
                                  : 1;
}

template <Term Of, int C>
static STEREOPSIS_INLINE double first_term(const double* l, const double* r) {
  double sum = 0;
  for (int c = 0; c < C; ++c) {
    const double a = l[c] - r[c];
    sum += Of == Term::product ? l[c] * r[c] : Of == Term::squared ? a * a : a < 0 ? -a : a;
  }
  return sum;
}

// Adds weight times every plane's term to `sums`.
template <CostKind Kind, int C>
static STEREOPSIS_INLINE void add_terms(double weight, const double* l, const double* r, double* sums) {
  sums[0] += weight * first_term<term_of(Kind), C>(l, r);
  if (Kind == CostKind::zssd)
    for (int c = 0; c < C; ++c) sums[1 + c] += weight * (l[c] - r[c]);
  if (Kind == CostKind::ncc || Kind == CostKind::zncc)
    for (int c = 0; c < C; ++c) sums[1] += weight * (r[c] * r[c]);
  if (Kind == CostKind::zncc)
    for (int c = 0; c < C; ++c) sums[2 + c] += weight * r[c];
}

// ---- from means to costs --------------------------------------------------------------------------------------------

// What is left of the mean of squares without the squared means; nothing where that is not known to a millionth.
static STEREOPSIS_INLINE double deviation_of(double square, double of_means) {
  const double rest = square - of_means;
  return rest > 1e-9 * square ? rest : 0.0;
}

// planes[p][i] times `scale` are the means of candidate i.
template <CostKind Kind, int C>
static void finish(const double* const* planes, double scale, const double* mean, double square, int begin, int end,
                   float* STEREOPSIS_RESTRICT costs) {
  double left_means = 0;
  if (Kind == CostKind::zncc)
    for (int c = 0; c < C; ++c) left_means += mean[c] * mean[c];
  const double left = Kind == CostKind::zncc ? deviation_of(square, left_means) : square;
  const double* STEREOPSIS_RESTRICT p[planes_of(Kind, C)];
  for (int k = 0; k < planes_of(Kind, C); ++k) p[k] = planes[k];
  for (int i = begin; i < end; ++i) {
    const double first = p[0][i] * scale;
    if (Kind == CostKind::sad || Kind == CostKind::ssd || Kind == CostKind::zsad) {
      costs[i] = static_cast<float>(first);
    } else if (Kind == CostKind::zssd) {
      double means = 0;
      for (int c = 0; c < C; ++c) means += (p[1 + c][i] * scale) * (p[1 + c][i] * scale);
      costs[i] = static_cast<float>(deviation_of(first, means));
    } else {
      double covariance = first, right = p[1][i] * scale, means = 0;
      if (Kind == CostKind::zncc) {
        for (int c = 0; c < C; ++c) {
          const double m = p[2 + c][i] * scale;
          covariance -= mean[c] * m;
          means += m * m;
        }
        right = deviation_of(right, means);
      }
      const double norm = left * right;
      double correlation = covariance / std::sqrt(norm > 0 ? norm : 1.0);
      correlation = correlation > 1 ? 1 : correlation < -1 ? -1 : correlation;
      costs[i] = static_cast<float>(norm > 0 ? -correlation : 0.0);
    }
  }
}

// Candidates of column x that lie in the right image.
struct Seen {
  int begin, end;
};
static Seen seen(const SupportJob& job, int x) {
  const int step = job.sampling.disparity_step, lowest = x - job.first - (job.width - 1), highest = x - job.first;
  const int begin = lowest <= 0 ? 0 : (lowest + step - 1) / step;
  const int end = highest < 0 ? 0 : highest / step + 1;
  return {begin < job.count ? begin : job.count, end < job.count ? end : job.count};
}

static void out_of_view(const SupportJob& job, Seen in, float* costs) {
  for (int i = 0; i < job.count; ++i)
    if (i < in.begin || i >= in.end) costs[i] = worst_cost<float>();
}

static float* costs_at(const SupportJob& job, int row, int column) {
  return job.costs + (static_cast<size_t>(row) * sampled(job.width, job.sampling.step) + column) * job.count;
}

// ---- any weights: a block of candidates after the other, so that their sums stay at hand -------------------------------

template <CostKind Kind, int C>
class Any {
  // ZSAD takes the means of the differences first, which ZSSD's planes hold, then the absolute differences from them.
  static constexpr CostKind kSummed = Kind == CostKind::zsad ? CostKind::zssd : Kind;
  static constexpr int P = planes_of(kSummed, C);

 public:
  Any(const SupportJob& job, void* memory) : job_(job), arena_{static_cast<char*>(memory)} {
    taps_ = arena_.take<Tap>(job.most_taps);
  }
  size_t bytes() const { return arena_.used; }

  void units(int begin, int end, const Cancel& cancel) {
    const int step = job_.sampling.step;
    for (int row = begin; row < end; ++row)
      for (int x = 0; x < job_.width && !cancel.load(std::memory_order_relaxed); x += step)
        pixel(row * step, x, costs_at(job_, row, x / step));
  }

 private:
  void pixel(int y, int x, float* costs) const {
    const Seen in = seen(job_, x);
    out_of_view(job_, in, costs);
    if (in.begin >= in.end) return;
    const int count = job_.gather(job_, y, x, taps_);
    double mean[C] = {}, square = 0;
    for (int k = 0; k < count; ++k)
      for (int c = 0; c < C; ++c) {
        mean[c] += taps_[k].weight * taps_[k].left[c];
        square += taps_[k].weight * (taps_[k].left[c] * taps_[k].left[c]);
      }
    for (int i = in.begin; i < in.end; i += kCandidates) {
      double sums[P][kCandidates] = {};
      int k = 0;
      for (; k + 2 <= count; k += 2) add_taps<2>(taps_ + k, i, sums);
      if (k < count) add_taps<1>(taps_ + k, i, sums);
      if (Kind == CostKind::zsad) centre(count, i, sums);
      const double* planes[P];
      for (int p = 0; p < P; ++p) planes[p] = sums[p];
      const int left = in.end - i;
      finish<Kind, C>(planes, 1, mean, square, 0, left < kCandidates ? left : kCandidates, costs + i);
    }
  }

  template <int N>
  STEREOPSIS_INLINE void add_taps(const Tap* taps, int first, double (&sums)[P][kCandidates]) const {
    for (int i = 0; i < kCandidates; ++i) {
      double s[P];
      for (int p = 0; p < P; ++p) s[p] = sums[p][i];
      for (int n = 0; n < N; ++n) {
        double right[C];
        for (int c = 0; c < C; ++c) right[c] = taps[n].right[c * job_.right.channel + first + i];
        add_terms<kSummed, C>(taps[n].weight, taps[n].left, right, s);
      }
      for (int p = 0; p < P; ++p) sums[p][i] = s[p];
    }
  }

  void centre(int count, int first, double (&sums)[P][kCandidates]) const {
    for (int i = 0; i < kCandidates; ++i) sums[0][i] = 0;
    for (int k = 0; k < count; ++k)
      for (int c = 0; c < C; ++c) {
        const double weight = taps_[k].weight, l = taps_[k].left[c];
        const double* STEREOPSIS_RESTRICT r = taps_[k].right + c * job_.right.channel + first;
        for (int i = 0; i < kCandidates; ++i) {
          const double a = l - r[i] - sums[P - C + c][i];
          sums[0][i] += weight * (a < 0 ? -a : a);
        }
      }
  }

  const SupportJob& job_;
  Arena arena_;
  Tap* taps_;
};

// ---- separable weights: columns first, then rows. Only the first plane is summed for each candidate; the right image's
// own means are looked up -----------------------------------------------------------------------------------------------

template <CostKind Kind, int C>
class Separable {
 public:
  Separable(const SupportJob& job, void* memory) : job_(job), arena_{static_cast<char*>(memory)} {
    const size_t D = job.count;
    columns_ = arena_.take<double>((job.width + 2 * static_cast<size_t>(job.radius)) * D);
    sum_ = arena_.take<double>(D);
    differences_ = arena_.take<double>(C * D);
  }
  size_t bytes() const { return arena_.used; }

  void units(int begin, int end, const Cancel& cancel) {
    for (int row = begin; row < end && !cancel.load(std::memory_order_relaxed); ++row) {
      const int y = row * job_.sampling.step;
      for (int x = -job_.radius; x < job_.width + job_.radius && !cancel.load(std::memory_order_relaxed); ++x)
        sum_column(y, x, columns_ + static_cast<size_t>(x + job_.radius) * job_.count);
      for (int x = 0; x < job_.width && !cancel.load(std::memory_order_relaxed); x += job_.sampling.step)
        pixel(y, x, costs_at(job_, row, x / job_.sampling.step));
    }
  }

 private:
  template <int N>
  STEREOPSIS_INLINE void add_rows(int y, int x, int j, double* STEREOPSIS_RESTRICT sum) const {
    double w[N], l[N][C];
    const double* STEREOPSIS_RESTRICT r[N][C];
    const int column = clamp(x, 0, job_.width - 1);
    for (int n = 0; n < N; ++n) {
      const int row = clamp(y + j + n, 0, job_.height - 1);
      w[n] = job_.taps[j + n + job_.radius];
      for (int c = 0; c < C; ++c) {
        l[n][c] = job_.left[(static_cast<size_t>(row) * job_.width + column) * C + c];
        r[n][c] = at(job_.right, row, x) + c * job_.right.channel;
      }
    }
    for (int i = 0; i < job_.count; ++i) {
      double s = sum[i];
      for (int n = 0; n < N; ++n) {
        double right[C];
        for (int c = 0; c < C; ++c) right[c] = r[n][c][i];
        s += w[n] * first_term<term_of(Kind), C>(l[n], right);
      }
      sum[i] = s;
    }
  }

  void sum_column(int y, int x, double* sum) const {
    for (int i = 0; i < job_.count; ++i) sum[i] = 0;
    int j = -job_.radius;
    for (; j + 3 <= job_.radius; j += 4) add_rows<4>(y, x, j, sum);
    for (; j <= job_.radius; ++j) add_rows<1>(y, x, j, sum);
  }

  template <int N>
  STEREOPSIS_INLINE void add_columns(const double* columns, int j, Seen in) const {
    const double* STEREOPSIS_RESTRICT column[N];
    double w[N];
    double* STEREOPSIS_RESTRICT sum = sum_;
    for (int n = 0; n < N; ++n) {
      column[n] = columns + static_cast<size_t>(j + n) * job_.count;
      w[n] = job_.taps[j + n];
    }
    for (int i = in.begin; i < in.end; ++i) {
      double s = sum[i];
      for (int n = 0; n < N; ++n) s += w[n] * column[n][i];
      sum[i] = s;
    }
  }

  void pixel(int y, int x, float* costs) const {
    const Seen in = seen(job_, x);
    out_of_view(job_, in, costs);
    if (in.begin >= in.end) return;
    const double* columns = columns_ + static_cast<size_t>(x) * job_.count;
    for (int i = 0; i < job_.count; ++i) sum_[i] = 0;
    const int size = 2 * job_.radius + 1;
    int j = 0;
    for (; j + 4 <= size; j += 4) add_columns<4>(columns, j, in);
    for (; j < size; ++j) add_columns<1>(columns, j, in);

    const size_t D = job_.count, here = static_cast<size_t>(y) * job_.width + x;
    const double *mean = job_.mean + here * C, *planes[2 + C];
    planes[0] = sum_;
    if (Kind == CostKind::zssd)
      for (int c = 0; c < C; ++c) {
        const double* STEREOPSIS_RESTRICT right = at(job_.right_mean, y, x) + c * job_.right_mean.channel;
        double* STEREOPSIS_RESTRICT difference = differences_ + c * D;
        for (int i = in.begin; i < in.end; ++i) difference[i] = mean[c] - right[i];
        planes[1 + c] = difference;
      }
    if (is_correlation(Kind)) {
      planes[1] = at(job_.right_square, y, x);
      for (int c = 0; c < C; ++c) planes[2 + c] = at(job_.right_mean, y, x) + c * job_.right_mean.channel;
    }
    finish<Kind, C>(planes, 1, mean, job_.square[here], in.begin, in.end, costs);
  }

  const SupportJob& job_;
  Arena arena_;
  double *columns_, *sum_, *differences_;
};

// ---- rectangles and crosses: sums from the top and the left -----------------------------------------------------------
//
// Of a block of rows and a few candidates at a time, `lines` holds each row's sums from the left; a cross takes its
// horizontal arms' sums from them. `above` then holds sums of these from the top, of which the supports are differences.

template <CostKind Kind, int C>
class Prefix {
  static constexpr int P = planes_of(Kind, C), kStride = P * kCandidates;

 public:
  Prefix(const SupportJob& job, bool cross, void* memory)
      : job_(job), cross_(cross), arena_{static_cast<char*>(memory)} {
    before_ = cross ? 0 : job.most.left;
    columns_ = job.width + before_ + (cross ? 0 : job.most.right);
    kept_ = cross ? columns_ : columns_ + 1;
    const int rows = (kRowsInBlock - 1) * job.sampling.step + 1;
    rows_ = (rows < job.height ? rows : job.height) + job.most.above + job.most.below;
    line_ = arena_.take<double>((static_cast<size_t>(columns_) + 1) * kStride);
    above_ = arena_.take<double>((static_cast<size_t>(rows_) + 1) * kept_ * kStride);
    sums_ = arena_.take<double>(kStride);
  }
  size_t bytes() const { return arena_.used; }

  void units(int begin, int end, const Cancel& cancel) {
    for (int block = begin; block < end; ++block)
      for (int first = 0; first < job_.count; first += kCandidates) {
        const int left = job_.count - first;
        candidates(block * kRowsInBlock, first, left < kCandidates ? left : kCandidates, cancel);
      }
  }

 private:
  void candidates(int first_row, int first, int count, const Cancel& cancel) {
    const int step = job_.sampling.step, all = sampled(job_.height, step);
    const int last_row = (first_row + kRowsInBlock < all ? first_row + kRowsInBlock : all) - 1;
    const int top = first_row * step - job_.most.above, bottom = last_row * step + job_.most.below;
    const size_t width = static_cast<size_t>(kept_) * kStride;
    for (size_t k = 0; k < width; ++k) above_[k] = 0;
    for (int y = top; y <= bottom && !cancel.load(std::memory_order_relaxed); ++y) {
      const double* from = above_ + static_cast<size_t>(y - top) * width;
      // Crosses end at the image's edge.
      const bool empty = cross_ && (y < 0 || y >= job_.height);
      if (!empty) sum_line(clamp(y, 0, job_.height - 1), first, count);
      add_line(empty ? -1 : y, from, const_cast<double*>(from) + width);
    }
    for (int row = first_row; row <= last_row && !cancel.load(std::memory_order_relaxed); ++row)
      for (int x = 0; x < job_.width; x += step)
        pixel(row * step, x, top, first, count, costs_at(job_, row, x / step));
  }

  void sum_line(int y, int first, int count) {
    for (int k = 0; k < kStride; ++k) line_[k] = 0;
    for (int k = 0; k < columns_; ++k) {
      const int x = k - before_;
      const double* l = job_.left + (static_cast<size_t>(y) * job_.width + clamp(x, 0, job_.width - 1)) * C;
      const double* STEREOPSIS_RESTRICT r = at(job_.right, y, x) + first;
      const double* STEREOPSIS_RESTRICT from = line_ + static_cast<size_t>(k) * kStride;
      double* STEREOPSIS_RESTRICT to = line_ + static_cast<size_t>(k + 1) * kStride;
      for (int i = 0; i < count; ++i) {
        double right[C], s[P];
        for (int c = 0; c < C; ++c) right[c] = r[c * job_.right.channel + i];
        for (int p = 0; p < P; ++p) s[p] = from[p * kCandidates + i];
        add_terms<Kind, C>(1, l, right, s);
        for (int p = 0; p < P; ++p) to[p * kCandidates + i] = s[p];
      }
    }
  }

  void add_line(int y, const double* STEREOPSIS_RESTRICT from, double* STEREOPSIS_RESTRICT to) const {
    const size_t width = static_cast<size_t>(kept_) * kStride;
    if (cross_ && y < 0) {
      for (size_t k = 0; k < width; ++k) to[k] = from[k];
    } else if (cross_) {
      const Reach* reach = job_.reach + static_cast<size_t>(y) * job_.width;
      for (int x = 0; x < job_.width; ++x) {
        const double* STEREOPSIS_RESTRICT begin = line_ + static_cast<size_t>(x - reach[x].left) * kStride;
        const double* STEREOPSIS_RESTRICT end = line_ + static_cast<size_t>(x + reach[x].right + 1) * kStride;
        for (int k = 0; k < kStride; ++k) to[k] = from[k] + (end[k] - begin[k]);
        from += kStride;
        to += kStride;
      }
    } else {
      for (size_t k = 0; k < width; ++k) to[k] = from[k] + line_[k];
    }
  }

  void pixel(int y, int x, int top, int first, int count, float* costs) const {
    const size_t here = static_cast<size_t>(y) * job_.width + x, width = static_cast<size_t>(kept_) * kStride;
    const Reach reach = job_.reach[here];
    const double* upper = above_ + static_cast<size_t>(y - reach.above - top) * width;
    const double* lower = above_ + static_cast<size_t>(y + reach.below + 1 - top) * width;
    double* STEREOPSIS_RESTRICT sums = sums_;
    if (cross_) {
      const double *STEREOPSIS_RESTRICT a = upper + static_cast<size_t>(x) * kStride,
                                       *STEREOPSIS_RESTRICT b = lower + static_cast<size_t>(x) * kStride;
      for (int k = 0; k < kStride; ++k) sums[k] = b[k] - a[k];
    } else {
      const size_t begin = static_cast<size_t>(x + before_ - reach.left) * kStride;
      const size_t end = static_cast<size_t>(x + before_ + reach.right + 1) * kStride;
      const double *STEREOPSIS_RESTRICT a = upper + begin, *STEREOPSIS_RESTRICT b = upper + end,
                                       *STEREOPSIS_RESTRICT c = lower + begin, *STEREOPSIS_RESTRICT d = lower + end;
      for (int k = 0; k < kStride; ++k) sums[k] = (d[k] - c[k]) - (b[k] - a[k]);
    }
    const Seen in = seen(job_, x);
    const int begin = clamp(in.begin - first, 0, count), end = clamp(in.end - first, begin, count);
    const double* planes[P];
    for (int p = 0; p < P; ++p) planes[p] = sums_ + p * kCandidates;
    finish<Kind, C>(planes, 1 / job_.area[here], job_.mean + here * C, job_.square[here], begin, end, costs + first);
    for (int i = 0; i < count; ++i)
      if (i < begin || i >= end) costs[first + i] = worst_cost<float>();
  }

  const SupportJob& job_;
  bool cross_;
  Arena arena_;
  int before_, columns_, kept_, rows_;
  double *line_, *above_, *sums_;
};

// ---- the choice among them --------------------------------------------------------------------------------------------

template <CostKind Kind, int C, class Visit>
void with_channels(SupportKernel kernel, const SupportJob& job, void* memory, Visit visit) {
  // The mean that ZSAD removes is inside the absolute value: its sums are taken tap by tap.
  if constexpr (Kind == CostKind::zsad) {
    visit(Any<Kind, C>(job, memory));
  } else {
    switch (kernel) {
      case SupportKernel::separable:
        return visit(Separable<Kind, C>(job, memory));
      case SupportKernel::rectangle:
        return visit(Prefix<Kind, C>(job, false, memory));
      case SupportKernel::cross:
        return visit(Prefix<Kind, C>(job, true, memory));
      case SupportKernel::any:
        return visit(Any<Kind, C>(job, memory));
    }
  }
}

template <CostKind Kind, class Visit>
void with_cost(SupportKernel kernel, const SupportJob& job, void* memory, Visit visit) {
  if (job.channels == 1)
    with_channels<Kind, 1>(kernel, job, memory, visit);
  else
    with_channels<Kind, 3>(kernel, job, memory, visit);
}

template <class Visit>
void with_kernel(SupportKernel kernel, const SupportJob& job, void* memory, Visit visit) {
  switch (job.cost) {
    case CostKind::sad:
      return with_cost<CostKind::sad>(kernel, job, memory, visit);
    case CostKind::ssd:
      return with_cost<CostKind::ssd>(kernel, job, memory, visit);
    case CostKind::zsad:
      return with_cost<CostKind::zsad>(kernel, job, memory, visit);
    case CostKind::zssd:
      return with_cost<CostKind::zssd>(kernel, job, memory, visit);
    case CostKind::ncc:
      return with_cost<CostKind::ncc>(kernel, job, memory, visit);
    case CostKind::zncc:
      return with_cost<CostKind::zncc>(kernel, job, memory, visit);
  }
}

size_t scratch_bytes(SupportKernel kernel, const SupportJob& job) {
  size_t bytes = 0;
  with_kernel(kernel, job, nullptr, [&](const auto& chosen) { bytes = chosen.bytes(); });
  return bytes;
}

void units(SupportKernel kernel, const SupportJob& job, int begin, int end, void* scratch, const Cancel& cancel) {
  with_kernel(kernel, job, scratch, [&](auto&& chosen) { chosen.units(begin, end, cancel); });
}

}  // namespace

extern const SupportKernels supports;
const SupportKernels supports = {scratch_bytes, units};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
