// Lucas and Kanade's alignment of slanted windows.
#include <algorithm>
#include <cmath>
#include <vector>

#include "lanes.hpp"
#include "parallel.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

constexpr double kSteepest[2] = {0.33, 1.0};  // disparity gained a column, and a row

constexpr double kReach = 1;  // pixels from the start
double within(double v, double low, double high) { return std::min(std::max(v, low), high); }

int clamp(int v, int low, int high) { return std::min(std::max(v, low), high); }

// The left image and its slope along the row; the right one as the cubics between its columns (Catmull and Rom's, which
// pass through the pixels). Planes of (C, H, pitch); edge pixels go on for `margin` columns on both sides.
struct Signals {
  int height, width, margin;
  size_t pitch;
  std::vector<float> left, slope, cubic[4];

  Signals(const AlignedPair& pair, int m)
      : height(pair.height), width(pair.width), margin(m), pitch(static_cast<size_t>(pair.width) + 2 * m) {
    const size_t size = pitch * pair.height * pair.channels;
    left.resize(size);
    slope.resize(size);
    for (auto& plane : cubic) plane.resize(size);
    for (int c = 0; c < pair.channels; ++c)
      for (int y = 0; y < height; ++y) {
        const auto at = [&](const int32_t* image, int x) {
          const size_t pixel = static_cast<size_t>(y) * width + clamp(x, 0, width - 1);
          return static_cast<float>(image[pixel * pair.channels + c]);
        };
        for (int x = -m; x < width + m; ++x) {
          const size_t to = row(c, y) + x;
          left[to] = at(pair.left, x);
          slope[to] = 0.5f * (at(pair.left, x + 1) - at(pair.left, x - 1));
          const float p = at(pair.right, x - 1), q = at(pair.right, x), r = at(pair.right, x + 1), s = at(pair.right, x + 2);
          cubic[0][to] = q;
          cubic[1][to] = 0.5f * (r - p);
          cubic[2][to] = p - 2.5f * q + 2 * r - 0.5f * s;
          cubic[3][to] = 1.5f * (q - r) + 0.5f * (s - p);
        }
      }
  }
  // Where column 0 of a row lies.
  size_t row(int c, int y) const { return (static_cast<size_t>(c) * height + y) * pitch + margin; }
};

// Solves A x = b for a symmetric A, in place; false where it is not positive definite.
template <int N>
bool solve(double (&A)[N][N], double (&b)[N]) {
  for (int i = 0; i < N; ++i) {
    const double whole = A[i][i];
    for (int j = 0; j < i; ++j) A[i][i] -= A[i][j] * A[i][j];
    if (!(A[i][i] > 1e-9 * whole)) return false;
    A[i][i] = std::sqrt(A[i][i]);
    for (int k = i + 1; k < N; ++k) {
      for (int j = 0; j < i; ++j) A[k][i] -= A[k][j] * A[i][j];
      A[k][i] /= A[i][i];
    }
  }
  for (int i = 0; i < N; ++i) {
    for (int j = 0; j < i; ++j) b[i] -= A[i][j] * b[j];
    b[i] /= A[i][i];
  }
  for (int i = N; i-- > 0;) {
    for (int k = i + 1; k < N; ++k) b[i] -= A[k][i] * b[k];
    b[i] /= A[i][i];
  }
  return true;
}

// Disparity d + a u + b v at column u and row v of the window.
struct Tilt {
  double d, a, b;
};

class Aligner {
 public:
  Aligner(const Signals& signals, const Window& window, int channels)
      : s_(signals), w_(window), channels_(channels), pitch_((window.width + kLanes - 1) / kLanes * kLanes), u_(pitch_),
        inside_(pitch_), left_(static_cast<size_t>(pitch_) * window.height * channels), slope_(left_.size()) {
    for (int i = 0; i < w_.width; ++i) {
      u_[i] = static_cast<float>(i - w_.left());
      inside_[i] = 1;
    }
  }

  // Takes the left window; values are counted from those of the pixel and its match, so that their squares stay small.
  void take(int x, int y, double disparity) {
    x_ = x;
    y_ = y;
    const int match = clamp(floor(x - disparity + 0.5), 0, s_.width - 1);
    fixed_ = Fixed{};
    for (int c = 0; c < channels_; ++c) {
      const float origin = s_.left[s_.row(c, y) + x];
      origin_[c] = s_.cubic[0][s_.row(c, y) + match];
      // Of 1, g, t = u g and their products, with powers of v where rows are told apart.
      Lanes l{}, ll{}, g{}, t{}, vg{}, lg{}, lt{}, vlg{}, gg{}, gt{}, tt{}, vgg{}, vgt{}, vvgg{};
      for (int i = 0; i < w_.height; ++i) {
        const float v = static_cast<float>(i - w_.above());
        const size_t from = s_.row(c, clamp(y + i - w_.above(), 0, s_.height - 1)) + x - w_.left();
        const size_t to = (static_cast<size_t>(c) * w_.height + i) * pitch_;
        float *L = &left_[to], *G = &slope_[to];
        for (int k = 0; k < w_.width; ++k) {
          L[k] = s_.left[from + k] - origin;
          G[k] = s_.slope[from + k];
        }
        Lanes row_g{}, row_lg{}, row_gg{}, row_gt{};
        for (int j = 0; j < pitch_; j += kLanes) {
          const Lanes lj = load(L + j), gj = load(G + j), tj = load(&u_[j]) * gj;
          l += lj;
          ll += lj * lj;
          row_g += gj;
          t += tj;
          row_lg += lj * gj;
          lt += lj * tj;
          row_gg += gj * gj;
          row_gt += gj * tj;
          tt += tj * tj;
        }
        g += row_g;
        vg += v * row_g;
        lg += row_lg;
        vlg += v * row_lg;
        gg += row_gg;
        vgg += v * row_gg;
        vvgg += v * v * row_gg;
        gt += row_gt;
        vgt += v * row_gt;
      }
      const double n = static_cast<double>(w_.area()), sum = total(l);
      const double gs[3] = {total(g), total(t), total(vg)}, lgs[3] = {total(lg), total(lt), total(vlg)};
      const double ggs[3][3] = {{total(gg)}, {total(gt), total(tt)}, {total(vgg), total(vgt), total(vvgg)}};
      fixed_.l[c] = sum;
      fixed_.ll += total(ll) - sum * sum / n;
      for (int i = 0; i < 3; ++i) {
        fixed_.g[c][i] = gs[i];
        fixed_.lg[i] += lgs[i] - sum * gs[i] / n;
        for (int j = 0; j <= i; ++j) fixed_.gg[i][j] += ggs[i][j] - gs[i] * gs[j] / n;
      }
    }
  }

  // The window's correlation with the right image under the plane, and the step that should raise it.
  struct Step {
    double correlation;
    bool solved;
    Tilt by;
  };
  Step step(const Tilt& plane) const {
    // Columns of the linear problem: the warped right window, and the left one's slope times 1, u, v.
    double A[4][4] = {}, b[4] = {};
    const double n = static_cast<double>(w_.area()), drift = -plane.a;
    const float each = static_cast<float>(drift);
    const Lanes along = load(kAlong) * each;
    for (int c = 0; c < channels_; ++c) {
      const float origin = origin_[c];
      Lanes r{}, rr{}, lr{}, rg{}, rt{}, vrg{};
      for (int i = 0; i < w_.height; ++i) {
        const int v = i - w_.above();
        const size_t row = s_.row(c, clamp(y_ + v, 0, s_.height - 1));
        const size_t window = (static_cast<size_t>(c) * w_.height + i) * pitch_;
        const float *L = &left_[window], *G = &slope_[window];
        const double first = x_ - plane.d - plane.b * v - (1 + drift) * w_.left();
        Lanes row_rg{};
        for (int j = 0; j < pitch_; j += kLanes) {
          // Beside their whole steps, four columns drift less than a pixel apart: each lies in one of two cubics.
          const double at = first + (1 + drift) * j;
          const int column = floor(drift < 0 ? at + (kLanes - 1) * drift : at);
          const size_t from = row + clamp(column, -s_.margin, s_.width + s_.margin - 1 - kLanes);
          const Lanes t = static_cast<float>(at - column) + along;
          const auto next = t >= 1.0f;
          const auto cubic = [&](int power) {
            const float* q = &s_.cubic[power][from];
            return choose(next, load(q + 1), load(q));
          };
          const Lanes f = choose(next, t - 1.0f, t);
          const Lanes q = (cubic(0) - origin) + f * (cubic(1) + f * (cubic(2) + f * cubic(3)));
          const Lanes warped = q * load(&inside_[j]), slope = load(G + j);
          r += warped;
          rr += warped * warped;
          lr += warped * load(L + j);
          row_rg += warped * slope;
          rt += warped * (slope * load(&u_[j]));
        }
        rg += row_rg;
        vrg += static_cast<float>(v) * row_rg;
      }
      const double sum = total(r), rgs[3] = {total(rg), total(rt), total(vrg)};
      A[0][0] += total(rr) - sum * sum / n;
      b[0] += total(lr) - fixed_.l[c] * sum / n;
      for (int i = 0; i < 3; ++i) A[i + 1][0] += rgs[i] - sum * fixed_.g[c][i] / n;
    }
    const double rr = A[0][0], lr = b[0];
    for (int i = 0; i < 3; ++i) {
      b[i + 1] = fixed_.lg[i];
      for (int j = 0; j <= i; ++j) A[i + 1][j + 1] = fixed_.gg[i][j];
    }
    Step out{fixed_.ll > 0 && rr > 0 ? lr / std::sqrt(fixed_.ll * rr) : 0, false, {}};
    // L = o + g R(x - d): a step of d takes g R', which is about L', times it away.
    if (lr > 0 && solve(A, b)) {
      out.solved = true;
      out.by = {-b[1], -b[2], -b[3]};
    }
    return out;
  }

 private:
  struct Fixed {
    double ll = 0, l[3] = {}, g[3][3] = {}, lg[3] = {}, gg[3][3] = {};
  };

  static constexpr float kAlong[kLanes] = {0, 1, 2, 3};

  static int floor(double v) {
    const int whole = static_cast<int>(v);
    return whole - (v < whole);
  }

  const Signals& s_;
  const Window w_;
  const int channels_, pitch_;
  std::vector<float> u_, inside_, left_, slope_;  // beyond the window's width they hold zeros
  int x_ = 0, y_ = 0;
  float origin_[3] = {};
  Fixed fixed_;
};

}  // namespace

void align_planes(const AlignedPair& pair, const Window& window, const float* start, float* disparity, float* slopes,
                  const Workers& workers) {
  constexpr int iterations = 8;
  constexpr double tolerance = 0.01;  // pixels, at the window's corners
  const double half_u = 0.5 * window.width, half_v = 0.5 * window.height;
  // Beyond it nothing but the edge pixel would be seen.
  const Signals signals(pair, 2 * window.width + window.height + 8);
  parallel_rows(pair.height, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel& cancel) {
    Aligner aligner(signals, window, pair.channels);
    for (int y = begin; y < end; ++y)
      for (int x = 0; x < pair.width && !cancel.load(std::memory_order_relaxed); ++x) {
        const size_t at = static_cast<size_t>(y) * pair.width + x;
        disparity[at] = start[at];
        slopes[2 * at] = slopes[2 * at + 1] = 0;
        if (std::isnan(start[at])) continue;
        aligner.take(x, y, start[at]);
        Tilt plane{start[at], 0, 0};
        double best = 0;
        bool moved = true;
        for (int k = 0; k < iterations && moved; ++k) {
          const auto step = aligner.step(plane);
          if (k > 0 && step.correlation <= best) break;
          best = step.correlation;
          disparity[at] = static_cast<float>(plane.d);
          slopes[2 * at] = static_cast<float>(plane.a);
          slopes[2 * at + 1] = static_cast<float>(plane.b);
          if (!step.solved) break;
          const Tilt before = plane;
          plane.d = within(plane.d + step.by.d, start[at] - kReach, start[at] + kReach);
          plane.a = within(plane.a + step.by.a, -kSteepest[0], kSteepest[0]);
          plane.b = within(plane.b + step.by.b, -kSteepest[1], kSteepest[1]);
          moved = std::abs(plane.d - before.d) + std::abs(plane.a - before.a) * half_u + std::abs(plane.b - before.b) * half_v >= tolerance;
        }
      }
  });
}

}  // namespace stereopsis
