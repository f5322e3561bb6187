// One build of the kernels for costs of single pixels, for the instruction set that STEREOPSIS_ISA names: plain loops over
// the candidates, `static` and unnamed for the reason given in fused_narrow.hpp.
#include "arena.hpp"
#include "pixelwise.hpp"
#include "simd.hpp"

#if defined(STEREOPSIS_POPCNT)
#include <immintrin.h>
#endif

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {


// Costs are made for so many candidates at a time: what holds a pixel's candidates has room for a multiple of it.
constexpr int kLanes = 64;
static STEREOPSIS_INLINE size_t padded(int count) { return (static_cast<size_t>(count) + kLanes - 1) / kLanes * kLanes; }

// ---- the costs of one pixel's candidates -------------------------------------------------------------------------------
//
// Each holds the left pixel's features, and reads those of the right pixels from planes in which they lie one behind the
// other. `Stored` is what the right planes hold.

static STEREOPSIS_INLINE int ones(uint64_t v) {
#if defined(__POPCNT__)
  return __builtin_popcountll(v);
#else
  v -= v >> 1 & 0x5555555555555555u;
  v = (v & 0x3333333333333333u) + (v >> 2 & 0x3333333333333333u);
  v = (v + (v >> 4)) & 0x0f0f0f0f0f0f0f0fu;
  return static_cast<int>((v * 0x0101010101010101u) >> 56);
#endif
}
static STEREOPSIS_INLINE int ones(uint32_t v) {
#if defined(__POPCNT__)
  return __builtin_popcount(v);
#else
  v -= v >> 1 & 0x55555555u;
  v = (v & 0x33333333u) + (v >> 2 & 0x33333333u);
  v = (v + (v >> 4)) & 0x0f0f0f0fu;
  return static_cast<int>((v * 0x01010101u) >> 24);
#endif
}

template <class Word, int P>
struct Hamming {
  using Given = uint64_t;
  using Stored = Word;
  static constexpr int kPlanes = P;
  Word left[P];
  Hamming(const PixelJob&, const Given* l, size_t plane) {
    for (int p = 0; p < P; ++p) left[p] = static_cast<Word>(l[p * plane]);
  }
  STEREOPSIS_INLINE void operator()(const Stored* right, size_t plane, int count, uint8_t* STEREOPSIS_RESTRICT costs) const {
#if defined(STEREOPSIS_POPCNT)
    if constexpr (sizeof(Word) == 4) {
      const __m512i l = _mm512_set1_epi32(static_cast<int>(left[0]));
      for (int i = 0; i < count; i += 16) {
        const __m512i differing = _mm512_xor_si512(l, _mm512_loadu_si512(right + i));
        _mm_storeu_si128(reinterpret_cast<__m128i*>(costs + i), _mm512_cvtepi32_epi8(_mm512_popcnt_epi32(differing)));
      }
    } else {
      __m512i l[P];
      for (int p = 0; p < P; ++p) l[p] = _mm512_set1_epi64(static_cast<long long>(left[p]));
      for (int i = 0; i < count; i += 8) {
        __m512i sum = _mm512_popcnt_epi64(_mm512_xor_si512(l[0], _mm512_loadu_si512(right + i)));
        for (int p = 1; p < P; ++p)
          sum = _mm512_add_epi64(sum, _mm512_popcnt_epi64(_mm512_xor_si512(l[p], _mm512_loadu_si512(right + p * plane + i))));
        _mm_storel_epi64(reinterpret_cast<__m128i*>(costs + i), _mm512_cvtepi64_epi8(sum));
      }
    }
#else
    for (int i = 0; i < count; ++i) {
      int sum = 0;
      for (int p = 0; p < P; ++p) sum += ones(static_cast<Word>(left[p] ^ right[p * plane + i]));
      costs[i] = static_cast<uint8_t>(sum);
    }
#endif
  }
};

struct Absolute {
  using Given = uint8_t;
  using Stored = uint8_t;
  static constexpr int kPlanes = 1;
  uint8_t left, most;
  Absolute(const PixelJob& job, const Given* l, size_t) : left(*l), most(static_cast<uint8_t>(job.most)) {}
  STEREOPSIS_INLINE void operator()(const Stored* right, size_t, int count, uint8_t* STEREOPSIS_RESTRICT costs) const {
    for (int i = 0; i < count; ++i) {
      const uint8_t r = right[i], apart = static_cast<uint8_t>(left > r ? left - r : r - left);
      costs[i] = apart < most ? apart : most;
    }
  }
};

struct Vector {
  using Given = int16_t;
  using Stored = int16_t;
  static constexpr int kPlanes = 2;
  int16_t x, y, most;
  Vector(const PixelJob& job, const Given* l, size_t plane) : x(l[0]), y(l[plane]), most(static_cast<int16_t>(job.most)) {}
  STEREOPSIS_INLINE void operator()(const Stored* right, size_t plane, int count, uint8_t* STEREOPSIS_RESTRICT costs) const {
    const int16_t *STEREOPSIS_RESTRICT rx = right, *STEREOPSIS_RESTRICT ry = right + plane;
    for (int i = 0; i < count; ++i) {
      const int16_t dx = static_cast<int16_t>(x > rx[i] ? x - rx[i] : rx[i] - x);
      const int16_t dy = static_cast<int16_t>(y > ry[i] ? y - ry[i] : ry[i] - y);
      const int16_t sum = static_cast<int16_t>(dx + dy);
      costs[i] = static_cast<uint8_t>(sum < most ? sum : most);
    }
  }
};

struct Interval {
  using Given = int16_t;
  using Stored = int16_t;
  static constexpr int kPlanes = 3;
  int16_t value, low, high, most;
  Interval(const PixelJob& job, const Given* l, size_t plane)
      : value(l[0]), low(l[plane]), high(l[2 * plane]), most(static_cast<int16_t>(job.most)) {}
  STEREOPSIS_INLINE void operator()(const Stored* right, size_t plane, int count, uint8_t* STEREOPSIS_RESTRICT costs) const {
    const int16_t *STEREOPSIS_RESTRICT r = right, *STEREOPSIS_RESTRICT lows = right + plane,
                  *STEREOPSIS_RESTRICT highs = right + 2 * plane;
    for (int i = 0; i < count; ++i) {
      // At most one side of an interval is passed, and a value that lies in it passes neither.
      const int16_t above = static_cast<int16_t>(value - highs[i]), below = static_cast<int16_t>(lows[i] - value);
      const int16_t other_above = static_cast<int16_t>(r[i] - high), other_below = static_cast<int16_t>(low - r[i]);
      const int16_t one = above > below ? above : below, other = other_above > other_below ? other_above : other_below;
      const int16_t least = one < other ? one : other, cost = least > 0 ? least : int16_t{0};
      costs[i] = static_cast<uint8_t>(cost < most ? cost : most);
    }
  }
};

struct Table {
  using Given = uint8_t;
  using Stored = uint8_t;
  static constexpr int kPlanes = 1;
  const uint8_t* row;
  Table(const PixelJob& job, const Given* l, size_t) : row(job.table + static_cast<size_t>(*l) * 256) {}
  STEREOPSIS_INLINE void operator()(const Stored* right, size_t, int count, uint8_t* STEREOPSIS_RESTRICT costs) const {
    for (int i = 0; i < count; ++i) costs[i] = row[right[i]];
  }
};

// ---- rows of the volume --------------------------------------------------------------------------------------------------

// Bytes may alias anything, the members of a class too: a function of its own, whose bounds and pointers no byte can change.
static STEREOPSIS_NOINLINE void replace(const uint8_t* STEREOPSIS_RESTRICT raw, const size_t room, uint8_t* STEREOPSIS_RESTRICT old,
                                        uint16_t* STEREOPSIS_RESTRICT column) {
  for (size_t i = 0; i < room; ++i) {
    column[i] = static_cast<uint16_t>(column[i] + raw[i] - old[i]);
    old[i] = raw[i];
  }
}

template <class Of>
class Costs {
  using Stored = typename Of::Stored;

 public:
  Costs(const PixelJob& job, void* memory) : job_(job), arena_{static_cast<char*>(memory)} {
    room_ = padded(job.count);
    columns_ = job.width + job.box.width - 1;
    // Right pixels from the one that the last column's first candidate sees to the first column's last one.
    reach_ = static_cast<size_t>(columns_) + room_;
    right_ = arena_.take<Stored>(Of::kPlanes * reach_);
    raw_ = arena_.take<uint8_t>(room_);
    if (!summed()) return;
    kept_ = arena_.take<uint8_t>(static_cast<size_t>(job.box.height) * columns_ * room_);
    column_sums_ = arena_.take<uint16_t>(static_cast<size_t>(columns_) * room_);
    sums_ = arena_.take<uint16_t>(room_);
  }
  size_t bytes() const { return arena_.used; }

  void rows(int begin, int end, const Cancel& cancel) {
    if (!summed()) {
      for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y) {
        reverse(y);
        for (int x = 0; x < job_.width; ++x) {
          one(y, x);
          write(y, x, raw_);
        }
      }
      return;
    }
    const size_t row = static_cast<size_t>(columns_) * room_;
    for (size_t k = 0; k < job_.box.height * row; ++k) kept_[k] = 0;
    for (size_t k = 0; k < row; ++k) column_sums_[k] = 0;
    int slot = 0;
    for (int y = begin - job_.box.above(); y < end + job_.box.below(); ++y) {
      if (cancel.load(std::memory_order_relaxed)) return;
      const int out = y - job_.box.below();
      add_row(clamp(y, 0, job_.height - 1), kept_ + slot * row, out >= begin ? out : -1);
      slot = slot + 1 < job_.box.height ? slot + 1 : 0;
    }
  }

 private:
  bool summed() const { return job_.box.area() > 1; }

  // Row y of the right features, so that a pixel's candidates follow each other.
  void reverse(int y) {
    const size_t plane = static_cast<size_t>(job_.height) * job_.width;
    const auto* row = static_cast<const typename Of::Given*>(job_.right) + static_cast<size_t>(y) * job_.width;
    const int last = job_.width - 1 + job_.box.right() - job_.first;
    for (int p = 0; p < Of::kPlanes; ++p)
      for (size_t t = 0; t < reach_; ++t)
        right_[p * reach_ + t] = static_cast<Stored>(row[p * plane + clamp(last - static_cast<int>(t), 0, job_.width - 1)]);
  }

  // All candidates' costs of column x, which may lie beyond the image.
  STEREOPSIS_INLINE void one(int y, int x) {
    const size_t plane = static_cast<size_t>(job_.height) * job_.width;
    const auto* left = static_cast<const typename Of::Given*>(job_.left) + static_cast<size_t>(y) * job_.width;
    Of(job_, left + clamp(x, 0, job_.width - 1), plane)(right_ + (job_.width - 1 + job_.box.right() - x), reach_,
                                                        static_cast<int>(room_), raw_);
  }

  // Takes a row into the columns' sums in place of the one in `kept`; and writes row `out` of the volume unless it is -1.
  void add_row(int y, uint8_t* kept, int out) {
    reverse(y);
    uint16_t* STEREOPSIS_RESTRICT sums = sums_;
    for (size_t i = 0; i < room_; ++i) sums[i] = 0;
    for (int k = 0; k < columns_; ++k) {
      one(y, k - job_.box.left());
      uint16_t* STEREOPSIS_RESTRICT column = column_sums_ + k * room_;
      replace(raw_, room_, kept + k * room_, column);
      if (out < 0) continue;
      for (size_t i = 0; i < room_; ++i) sums[i] = static_cast<uint16_t>(sums[i] + column[i]);
      const int x = k - (job_.box.width - 1);
      if (x < 0) continue;
      write(out, x, sums);
      const uint16_t* STEREOPSIS_RESTRICT leaving = column_sums_ + x * room_;
      for (size_t i = 0; i < room_; ++i) sums[i] = static_cast<uint16_t>(sums[i] - leaving[i]);
    }
  }

  template <class Sum>
  STEREOPSIS_INLINE void write(int y, int x, const Sum* STEREOPSIS_RESTRICT sums) const {
    const int lowest = x - job_.first - (job_.width - 1), highest = x - job_.first;
    const int begin = clamp(lowest, 0, job_.count), end = clamp(highest + 1, 0, job_.count);
    uint16_t* STEREOPSIS_RESTRICT costs = job_.costs + (static_cast<size_t>(y) * job_.width + x) * job_.count;
    for (int i = 0; i < begin; ++i) costs[i] = 65535;
    if (job_.add)
      for (int i = begin; i < end; ++i) costs[i] = static_cast<uint16_t>(costs[i] + sums[i]);
    else
      for (int i = begin; i < end; ++i) costs[i] = sums[i];
    for (int i = end; i < job_.count; ++i) costs[i] = 65535;
  }

  const PixelJob& job_;
  Arena arena_;
  size_t room_, reach_;
  int columns_;
  Stored* right_;
  uint8_t *raw_, *kept_ = nullptr;
  uint16_t *column_sums_ = nullptr, *sums_ = nullptr;
};

template <class Visit>
void with_costs(const PixelJob& job, void* memory, Visit visit) {
  switch (job.cost) {
    case PixelCost::census:
      if (job.planes > 1) return visit(Costs<Hamming<uint64_t, 2>>(job, memory));
      if (job.bits > 32) return visit(Costs<Hamming<uint64_t, 1>>(job, memory));
      return visit(Costs<Hamming<uint32_t, 1>>(job, memory));
    case PixelCost::absolute:
      return visit(Costs<Absolute>(job, memory));
    case PixelCost::vector:
      return visit(Costs<Vector>(job, memory));
    case PixelCost::interval:
      return visit(Costs<Interval>(job, memory));
    case PixelCost::table:
      return visit(Costs<Table>(job, memory));
  }
}

size_t scratch_bytes(const PixelJob& job) {
  size_t bytes = 0;
  with_costs(job, nullptr, [&](const auto& costs) { bytes = costs.bytes(); });
  return bytes;
}

void rows(const PixelJob& job, int begin, int end, void* scratch, const Cancel& cancel) {
  with_costs(job, scratch, [&](auto&& costs) { costs.rows(begin, end, cancel); });
}

// ---- the census ------------------------------------------------------------------------------------------------------------

// So many pixels at a time.
constexpr int kStretch = kCensusStretch;

// Apart from the loops around it, which the compiler would else weave into it instead of taking many pixels at once.
template <class T>
[[maybe_unused]] static STEREOPSIS_NOINLINE void compare_one(const T* STEREOPSIS_RESTRICT first, const T* STEREOPSIS_RESTRICT second,
                                                             const uint8_t bit, uint8_t* STEREOPSIS_RESTRICT bytes) {
  for (int x = 0; x < kStretch; ++x) bytes[x] = static_cast<uint8_t>(bytes[x] | (first[x] < second[x] ? bit : 0));
}

// Up to eight comparisons make a byte of each pixel.
template <class T>
static STEREOPSIS_INLINE void compare(const T* here, const Comparison* comparisons, int count, uint8_t* STEREOPSIS_RESTRICT bytes) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  if constexpr (sizeof(T) == 1) {
    static_assert(kStretch == 64, "a vector");
    __m512i sum = _mm512_setzero_si512(), bit = _mm512_set1_epi8(1);
    for (int k = 0; k < count; ++k, bit = _mm512_add_epi8(bit, bit)) {
      const __m512i first = _mm512_loadu_si512(here + comparisons[k].first), second = _mm512_loadu_si512(here + comparisons[k].second);
      sum = _mm512_mask_add_epi8(sum, _mm512_cmplt_epu8_mask(first, second), sum, bit);
    }
    _mm512_storeu_si512(bytes, sum);
    return;
  } else {
    __m512i sum = _mm512_setzero_si512(), bit = _mm512_set1_epi8(1);
    for (int k = 0; k < count; ++k, bit = _mm512_add_epi8(bit, bit)) {
      const auto darker = [&](int x) STEREOPSIS_INLINE_LAMBDA {
        const T* const at = here + x;
        return _mm512_cmplt_epi32_mask(_mm512_loadu_si512(at + comparisons[k].first), _mm512_loadu_si512(at + comparisons[k].second));
      };
      const __mmask64 all = _mm512_kunpackd(_mm512_kunpackw(darker(48), darker(32)), _mm512_kunpackw(darker(16), darker(0)));
      sum = _mm512_mask_add_epi8(sum, all, sum, bit);
    }
    _mm512_storeu_si512(bytes, sum);
    return;
  }
#elif STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
  if constexpr (sizeof(T) == 1) {
    const auto load = [](const T* p) STEREOPSIS_INLINE_LAMBDA { return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p)); };
    for (int x = 0; x < kStretch; x += 32) {
      __m256i sum = _mm256_setzero_si256(), bit = _mm256_set1_epi8(1);
      for (int k = 0; k < count; ++k, bit = _mm256_add_epi8(bit, bit)) {
        const __m256i first = load(here + x + comparisons[k].first), second = load(here + x + comparisons[k].second);
        sum = _mm256_or_si256(sum, _mm256_andnot_si256(_mm256_cmpeq_epi8(_mm256_max_epu8(first, second), first), bit));
      }
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(bytes + x), sum);
    }
    return;
  } else {
    for (int x = 0; x < kStretch; x += 32) {
      __m256i sum = _mm256_setzero_si256(), bit = _mm256_set1_epi8(1);
      for (int k = 0; k < count; ++k, bit = _mm256_add_epi8(bit, bit)) {
        const auto darker = [&](int at) STEREOPSIS_INLINE_LAMBDA {
          const auto load = [](const T* p) STEREOPSIS_INLINE_LAMBDA { return _mm256_loadu_si256(reinterpret_cast<const __m256i*>(p)); };
          return _mm256_cmpgt_epi32(load(here + x + at + comparisons[k].second), load(here + x + at + comparisons[k].first));
        };
        const __m256i mixed = _mm256_packs_epi16(_mm256_packs_epi32(darker(0), darker(8)), _mm256_packs_epi32(darker(16), darker(24)));
        sum = _mm256_or_si256(sum, _mm256_and_si256(mixed, bit));
      }
      // Packing works in halves of 128 bits: groups of four stand 0 2 4 6, 1 3 5 7.
      const __m256i order = _mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7);
      _mm256_storeu_si256(reinterpret_cast<__m256i*>(bytes + x), _mm256_permutevar8x32_epi32(sum, order));
    }
    return;
  }
#endif
  for (int x = 0; x < kStretch; ++x) bytes[x] = 0;
  for (int k = 0; k < count; ++k)
    compare_one(here + comparisons[k].first, here + comparisons[k].second, static_cast<uint8_t>(1 << k), bytes);
}

template <class T>
void census(const CensusJob& job, int begin, int end, const Cancel& cancel) {
  const size_t plane = static_cast<size_t>(job.height) * job.width;
  alignas(64) uint8_t bytes[8][kStretch] = {};
  alignas(64) uint64_t words[kStretch];
  for (int word = 0; word < job.count; word += 64) {
    const int count = job.count - word < 64 ? job.count - word : 64;
    for (int group = (count + 7) / 8; group < 8; ++group)  // what an earlier word has left
      for (int x = 0; x < kStretch; ++x) bytes[group][x] = 0;
    for (int y = begin; y < end && !cancel.load(std::memory_order_relaxed); ++y)
      for (int x0 = 0; x0 < job.width; x0 += kStretch) {
        const int n = job.width - x0 < kStretch ? job.width - x0 : kStretch;
        const T* here = static_cast<const T*>(job.image) + y * job.stride + x0;
        for (int group = 0; group < count; group += 8)
          compare(here, job.comparisons + word + group, count < group + 8 ? count - group : 8, bytes[group / 8]);
        uint64_t* const strings = job.strings + (word / 64) * plane + static_cast<size_t>(y) * job.width + x0;
        uint64_t* const to = n == kStretch ? strings : words;
        for (int x = 0; x < kStretch; ++x) {
          uint64_t string = 0;
          for (int group = 0; group < 8; ++group) string |= static_cast<uint64_t>(bytes[group][x]) << 8 * group;
          to[x] = string;
        }
        if (to == words) std::memcpy(strings, words, n * sizeof *words);
      }
  }
}

void census_rows(const CensusJob& job, int begin, int end, const Cancel& cancel) {
  job.bytes ? census<uint8_t>(job, begin, end, cancel) : census<int32_t>(job, begin, end, cancel);
}

}  // namespace

extern const PixelwiseKernels pixelwise;
const PixelwiseKernels pixelwise = {scratch_bytes, rows, census_rows};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
