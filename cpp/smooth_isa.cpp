// One build of edge-aware smoothing along lines, for the instruction set that STEREOPSIS_ISA names; `static` and unnamed for the
// reason given in fused_narrow.hpp.
#include "simd.hpp"
#include "smooth.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

static int length_of(const Strip& strip) { return strip.rows ? strip.width : strip.height; }
static int lines_of(const Strip& strip) {
  const int left = (strip.rows ? strip.height : strip.width) - strip.first;
  return left < kLines ? left : kLines;
}

// The strip's lines side by side, sample by sample; beyond the last line, it once more.
static void load(const Strip& strip, const float* STEREOPSIS_RESTRICT plane, float* STEREOPSIS_RESTRICT samples) {
  const int n = length_of(strip), m = lines_of(strip);
  if (strip.rows) {
    const float* lines[kLines];
    for (int k = 0; k < kLines; ++k) lines[k] = plane + static_cast<size_t>(strip.first + (k < m ? k : m - 1)) * strip.width;
    for (int i = 0; i < n; ++i)
      for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = lines[k][i];
    return;
  }
  for (int i = 0; i < n; ++i) {
    const float* STEREOPSIS_RESTRICT line = plane + static_cast<size_t>(i) * strip.width + strip.first;
    if (m == kLines)
      for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = line[k];
    else
      for (int k = 0; k < kLines; ++k) samples[i * kLines + k] = line[k < m ? k : m - 1];
  }
}

static void store(const Strip& strip, const float* STEREOPSIS_RESTRICT samples, float* STEREOPSIS_RESTRICT plane) {
  const int n = length_of(strip), m = lines_of(strip);
  for (int k = 0; strip.rows && k < m; ++k)
    for (int i = 0; i < n; ++i) plane[static_cast<size_t>(strip.first + k) * strip.width + i] = samples[i * kLines + k];
  for (int i = 0; !strip.rows && i < n; ++i)
    for (int k = 0; k < m; ++k) plane[static_cast<size_t>(i) * strip.width + strip.first + k] = samples[i * kLines + k];
}

// What elimination leaves of the matrix: inverse pivots and the factors of the way back. Only sums of positive terms.
static void eliminate(const float* STEREOPSIS_RESTRICT edges, int n, float strength, float* STEREOPSIS_RESTRICT inverse,
                      float* STEREOPSIS_RESTRICT back) {
  float left[kLines] = {};
  for (int i = 0; i < n; ++i) {
    const float factor = i + 1 < n ? strength : 0.0f;
    for (int k = 0; k < kLines; ++k) {
      const float next = factor * edges[i * kLines + k];
      const float kept = 1 + left[k], pivot = 1 / (kept + next);
      inverse[i * kLines + k] = pivot;
      back[i * kLines + k] = next * pivot;
      left[k] = next * (kept * pivot);
    }
  }
}

static void substitute(const float* STEREOPSIS_RESTRICT edges, const float* STEREOPSIS_RESTRICT inverse,
                       const float* STEREOPSIS_RESTRICT back, int n, float strength, float* STEREOPSIS_RESTRICT samples) {
  float last[kLines];
  for (int k = 0; k < kLines; ++k) last[k] = samples[k] *= inverse[k];
  for (int i = 1; i < n; ++i)
    for (int k = 0; k < kLines; ++k) {
      const int at = i * kLines + k;
      samples[at] = last[k] = (samples[at] + strength * edges[at - kLines] * last[k]) * inverse[at];
    }
  for (int i = n - 2; i >= 0; --i)
    for (int k = 0; k < kLines; ++k) {
      const int at = i * kLines + k;
      samples[at] = last[k] = samples[at] + back[at] * last[k];
    }
}

// From the rise to the next sample to the height above the first one.
static void add_up(int n, float* STEREOPSIS_RESTRICT rise) {
  float height[kLines] = {};
  for (int i = 0; i < n; ++i)
    for (int k = 0; k < kLines; ++k) {
      const float step = rise[i * kLines + k];
      rise[i * kLines + k] = height[k];
      height[k] += step;
    }
}
static void subtract(size_t size, const float* STEREOPSIS_RESTRICT rise, float* STEREOPSIS_RESTRICT value) {
  for (size_t i = 0; i < size; ++i) value[i] -= rise[i];
}
static void add(size_t size, const float* STEREOPSIS_RESTRICT rise, float* STEREOPSIS_RESTRICT value) {
  for (size_t i = 0; i < size; ++i) value[i] += rise[i];
}
static void multiply(size_t size, const float* STEREOPSIS_RESTRICT weight, float* STEREOPSIS_RESTRICT value) {
  for (size_t i = 0; i < size; ++i) value[i] *= weight[i];
}
static void divide(size_t size, const float* STEREOPSIS_RESTRICT weight, float* STEREOPSIS_RESTRICT value) {
  for (size_t i = 0; i < size; ++i) value[i] /= weight[i];
}

static void smooth_strip(const Strip& strip, float* memory) {
  const int n = length_of(strip);
  const size_t size = static_cast<size_t>(n) * kLines;
  float *edge = memory, *inverse = edge + size, *back = inverse + size, *value = back + size, *weight = value + size,
        *rise = weight + size;
  load(strip, strip.edges, edge);
  eliminate(edge, n, strip.strength, inverse, back);
  if (strip.slopes) {
    load(strip, strip.slopes, rise);
    add_up(n, rise);
  }
  for (int k = 0; k < strip.field_count; ++k) {
    const Weighed& field = strip.fields[k];
    load(strip, field.value, value);
    load(strip, field.weight, weight);
    if (strip.slopes) subtract(size, rise, value);
    multiply(size, weight, value);
    substitute(edge, inverse, back, n, strip.strength, value);
    substitute(edge, inverse, back, n, strip.strength, weight);
    divide(size, weight, value);
    if (strip.slopes) add(size, rise, value);
    store(strip, value, field.value);
    store(strip, weight, field.weight);
  }
}

}  // namespace

extern const SmoothKernel smoothing;
const SmoothKernel smoothing = smooth_strip;

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
