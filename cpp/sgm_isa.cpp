// One build of the semi-global kernels, for the instruction set that STEREOPSIS_ISA names; `static` and unnamed for the
// reason given in fused_narrow.hpp. The plain loops at the end are the definition of what the vectors do.
#include "sgm.hpp"
#include "simd.hpp"
#include "winners.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

// Into a cache, as far memory is slow to begin to answer.
static STEREOPSIS_INLINE void fetch(const char* p) {
#if defined(__GNUC__)
  __builtin_prefetch(p, 0, 2);
#elif STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
  _mm_prefetch(p, _MM_HINT_T1);
#else
  static_cast<void>(p);
#endif
}

static STEREOPSIS_INLINE ptrdiff_t clamp(ptrdiff_t v, ptrdiff_t lo, ptrdiff_t hi) { return v < lo ? lo : v > hi ? hi : v; }

#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2

#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
using Vec = __m512i;
#define STEREOPSIS_V(name) _mm512_##name
static STEREOPSIS_INLINE Vec load(const void* p) { return _mm512_loadu_si512(p); }
static STEREOPSIS_INLINE void store(void* p, Vec v) { _mm512_storeu_si512(p, v); }
static STEREOPSIS_INLINE Vec zero() { return _mm512_setzero_si512(); }
static STEREOPSIS_INLINE Vec either(Vec a, Vec b) { return _mm512_or_si512(a, b); }
// a where `keep` has ones, and `other`, which has bits elsewhere alone
static STEREOPSIS_INLINE Vec put(Vec a, Vec keep, Vec other) { return _mm512_ternarylogic_epi32(a, keep, other, 0xEA); }
static STEREOPSIS_INLINE Vec is_zero(Vec a, uint8_t) { return _mm512_movm_epi8(_mm512_testn_epi8_mask(a, a)); }
static STEREOPSIS_INLINE Vec is_zero(Vec a, uint16_t) { return _mm512_movm_epi16(_mm512_testn_epi16_mask(a, a)); }
static STEREOPSIS_INLINE Vec table_of(const uint8_t* p) {
  return _mm512_broadcast_i32x4(_mm_load_si128(reinterpret_cast<const __m128i*>(p)));
}
// The vectors of 16-byte parts (before, a, after) a part further down, or up.
static STEREOPSIS_INLINE Vec parts_before(Vec before, Vec a) { return _mm512_alignr_epi64(a, before, 6); }
static STEREOPSIS_INLINE Vec parts_after(Vec a, Vec after) { return _mm512_alignr_epi64(after, a, 2); }
// Halves of 16-byte parts, lower ones in `lo` and upper ones in `hi`, side by side.
static STEREOPSIS_INLINE Vec joined_first(Vec lo, Vec hi) {
  return _mm512_permutex2var_epi64(lo, _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11), hi);
}
static STEREOPSIS_INLINE Vec joined_second(Vec lo, Vec hi) {
  return _mm512_permutex2var_epi64(lo, _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15), hi);
}
// So that unpacking the lower, and the upper, words of all parts gives the first, and the second, half.
static STEREOPSIS_INLINE Vec for_unpacking(Vec v) {
  return _mm512_permutexvar_epi64(_mm512_setr_epi64(0, 4, 1, 5, 2, 6, 3, 7), v);
}
#else
using Vec = __m256i;
#define STEREOPSIS_V(name) _mm256_##name
static STEREOPSIS_INLINE Vec load(const void* p) { return _mm256_loadu_si256(static_cast<const __m256i*>(p)); }
static STEREOPSIS_INLINE void store(void* p, Vec v) { _mm256_storeu_si256(static_cast<__m256i*>(p), v); }
static STEREOPSIS_INLINE Vec zero() { return _mm256_setzero_si256(); }
static STEREOPSIS_INLINE Vec either(Vec a, Vec b) { return _mm256_or_si256(a, b); }
static STEREOPSIS_INLINE Vec put(Vec a, Vec keep, Vec other) { return _mm256_or_si256(_mm256_and_si256(a, keep), other); }
static STEREOPSIS_INLINE Vec is_zero(Vec a, uint8_t) { return _mm256_cmpeq_epi8(a, zero()); }
static STEREOPSIS_INLINE Vec is_zero(Vec a, uint16_t) { return _mm256_cmpeq_epi16(a, zero()); }
static STEREOPSIS_INLINE Vec table_of(const uint8_t* p) {
  return _mm256_broadcastsi128_si256(_mm_load_si128(reinterpret_cast<const __m128i*>(p)));
}
static STEREOPSIS_INLINE Vec parts_before(Vec before, Vec a) { return _mm256_permute2x128_si256(before, a, 0x21); }
static STEREOPSIS_INLINE Vec parts_after(Vec a, Vec after) { return _mm256_permute2x128_si256(a, after, 0x21); }
static STEREOPSIS_INLINE Vec joined_first(Vec lo, Vec hi) { return _mm256_permute2x128_si256(lo, hi, 0x20); }
static STEREOPSIS_INLINE Vec joined_second(Vec lo, Vec hi) { return _mm256_permute2x128_si256(lo, hi, 0x31); }
static STEREOPSIS_INLINE Vec for_unpacking(Vec v) { return _mm256_permute4x64_epi64(v, 0xD8); }
#endif
constexpr int kBytes = sizeof(Vec);

template <class Lane>
struct Of;
template <>
struct Of<uint8_t> {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  static STEREOPSIS_INLINE Vec broadcast(__m128i v) { return _mm512_broadcastb_epi8(v); }
#else
  static STEREOPSIS_INLINE Vec broadcast(__m128i v) { return _mm256_broadcastb_epi8(v); }
#endif
  static STEREOPSIS_INLINE Vec broadcast(const void* p) {
    uint8_t v;
    std::memcpy(&v, p, sizeof v);
    return broadcast(_mm_cvtsi32_si128(v));
  }
  static STEREOPSIS_INLINE Vec set(uint8_t v) { return STEREOPSIS_V(set1_epi8)(static_cast<char>(v)); }
  static STEREOPSIS_INLINE Vec min(Vec a, Vec b) { return STEREOPSIS_V(min_epu8)(a, b); }
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  using Mask = __mmask64;
  static STEREOPSIS_INLINE Vec min_where(Vec a, Vec b, Mask mask) { return _mm512_mask_min_epu8(a, mask, a, b); }
#endif
  static STEREOPSIS_INLINE Vec add(Vec a, Vec b) { return STEREOPSIS_V(add_epi8)(a, b); }
  static STEREOPSIS_INLINE Vec sub(Vec a, Vec b) { return STEREOPSIS_V(sub_epi8)(a, b); }
  static STEREOPSIS_INLINE Vec one_up(Vec before, Vec a) { return STEREOPSIS_V(alignr_epi8)(a, parts_before(before, a), 15); }
  static STEREOPSIS_INLINE Vec one_down(Vec a, Vec after) { return STEREOPSIS_V(alignr_epi8)(parts_after(a, after), a, 1); }
  static STEREOPSIS_INLINE __m128i least_of_word(__m128i v) {
    const __m128i half = _mm_min_epu8(v, _mm_srli_epi32(v, 16));
    return _mm_shuffle_epi8(_mm_min_epu8(half, _mm_srli_epi32(half, 8)),
                            _mm_setr_epi8(0, 0, 0, 0, 4, 4, 4, 4, 8, 8, 8, 8, 12, 12, 12, 12));
  }
};
template <>
struct Of<uint16_t> {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  static STEREOPSIS_INLINE Vec broadcast(__m128i v) { return _mm512_broadcastw_epi16(v); }
#else
  static STEREOPSIS_INLINE Vec broadcast(__m128i v) { return _mm256_broadcastw_epi16(v); }
#endif
  static STEREOPSIS_INLINE Vec broadcast(const void* p) {
    uint16_t v;
    std::memcpy(&v, p, sizeof v);
    return broadcast(_mm_cvtsi32_si128(v));
  }
  static STEREOPSIS_INLINE Vec set(uint16_t v) { return STEREOPSIS_V(set1_epi16)(static_cast<short>(v)); }
  static STEREOPSIS_INLINE Vec min(Vec a, Vec b) { return STEREOPSIS_V(min_epu16)(a, b); }
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  using Mask = __mmask32;
  static STEREOPSIS_INLINE Vec min_where(Vec a, Vec b, Mask mask) { return _mm512_mask_min_epu16(a, mask, a, b); }
#endif
  static STEREOPSIS_INLINE Vec add(Vec a, Vec b) { return STEREOPSIS_V(add_epi16)(a, b); }
  static STEREOPSIS_INLINE Vec sub(Vec a, Vec b) { return STEREOPSIS_V(sub_epi16)(a, b); }
  static STEREOPSIS_INLINE Vec one_up(Vec before, Vec a) { return STEREOPSIS_V(alignr_epi8)(a, parts_before(before, a), 14); }
  static STEREOPSIS_INLINE Vec one_down(Vec a, Vec after) { return STEREOPSIS_V(alignr_epi8)(parts_after(a, after), a, 2); }
  static STEREOPSIS_INLINE __m128i least_of_word(__m128i v) {
    return _mm_shuffle_epi8(_mm_min_epu16(v, _mm_srli_epi32(v, 16)),
                            _mm_setr_epi8(0, 1, 0, 1, 4, 5, 4, 5, 8, 9, 8, 9, 12, 13, 12, 13));
  }
};

// A word of four, throughout a vector.
template <int K>
static STEREOPSIS_INLINE Vec word_of(__m128i v) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  return _mm512_permutexvar_epi32(_mm512_set1_epi32(K), _mm512_castsi128_si512(v));
#else
  return _mm256_permutevar8x32_epi32(_mm256_castsi128_si256(v), _mm256_set1_epi32(K));
#endif
}

// The least lane of each of four vectors, in a word each, which it fills.
template <class Lane>
static STEREOPSIS_INLINE __m128i leasts(const Vec* v) {
  using L = Of<Lane>;
  const auto folded = [](Vec a, Vec b) {
    return L::min(STEREOPSIS_V(unpacklo_epi64)(a, b), STEREOPSIS_V(unpackhi_epi64)(a, b));
  };
  const Vec a = folded(v[0], v[1]), b = folded(v[2], v[3]);
  // a holds, in each part, two words of the first and two of the second.
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  const __m512 fa = _mm512_castsi512_ps(a), fb = _mm512_castsi512_ps(b);
  const Vec all = L::min(_mm512_castps_si512(_mm512_shuffle_ps(fa, fb, 0x88)), _mm512_castps_si512(_mm512_shuffle_ps(fa, fb, 0xDD)));
  const __m256i lower = _mm512_castsi512_si256(all), upper = _mm512_extracti64x4_epi64(all, 1);
  const __m256i half = sizeof(Lane) == 1 ? _mm256_min_epu8(lower, upper) : _mm256_min_epu16(lower, upper);
#else
  const __m256 fa = _mm256_castsi256_ps(a), fb = _mm256_castsi256_ps(b);
  const __m256i half =
      L::min(_mm256_castps_si256(_mm256_shuffle_ps(fa, fb, 0x88)), _mm256_castps_si256(_mm256_shuffle_ps(fa, fb, 0xDD)));
#endif
  const __m128i lo = _mm256_castsi256_si128(half), hi = _mm256_extracti128_si256(half, 1);
  return L::least_of_word(sizeof(Lane) == 1 ? _mm_min_epu8(lo, hi) : _mm_min_epu16(lo, hi));
}
// Adds the paths' costs to the sums.
template <int N>
static STEREOPSIS_INLINE void add_up(const Vec* t, const uint16_t* before, uint16_t* sums, uint8_t) {
  Vec lo, hi;
  if constexpr (N == 1) {
    lo = STEREOPSIS_V(unpacklo_epi8)(t[0], zero()), hi = STEREOPSIS_V(unpackhi_epi8)(t[0], zero());
  } else {
    const Vec ones = STEREOPSIS_V(set1_epi8)(1);
    lo = STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpacklo_epi8)(t[0], t[1]), ones);
    hi = STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpackhi_epi8)(t[0], t[1]), ones);
    static_assert(N == 2 || N == 4, "paths are summed in pairs");
    if constexpr (N == 4) {
      lo = STEREOPSIS_V(add_epi16)(lo, STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpacklo_epi8)(t[2], t[3]), ones));
      hi = STEREOPSIS_V(add_epi16)(hi, STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpackhi_epi8)(t[2], t[3]), ones));
    }
  }
  Vec first = joined_first(lo, hi), second = joined_second(lo, hi);
  if (before) {
    first = STEREOPSIS_V(add_epi16)(first, load(before));
    second = STEREOPSIS_V(add_epi16)(second, load(before + kBytes / 2));
  }
  store(sums, first);
  store(sums + kBytes / 2, second);
}
// The same where two paths' costs beyond the pixel's own fit a byte: of the paths before these alone are handed over.
template <int N>
static STEREOPSIS_INLINE void hand_over(const Vec* more, uint16_t* sums) {
  static_assert(N == 2 || N == 4, "in pairs");
  uint8_t* const pairs = reinterpret_cast<uint8_t*>(sums);
  store(pairs, STEREOPSIS_V(add_epi8)(more[0], more[1]));
  if constexpr (N == 4) store(pairs + kBytes, STEREOPSIS_V(add_epi8)(more[2], more[3]));
}
template <int N>
static STEREOPSIS_INLINE void complete(const Vec* more, Vec cost, Vec ones, Vec weights, const uint16_t* before, uint16_t* sums) {
  const uint8_t* const pairs = reinterpret_cast<const uint8_t*>(before);
  const Vec mine = STEREOPSIS_V(add_epi8)(more[0], more[1]), others = load(pairs);
  Vec lo = STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpacklo_epi8)(mine, cost), weights);
  Vec hi = STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpackhi_epi8)(mine, cost), weights);
  if constexpr (N == 4) {
    const Vec next = load(pairs + kBytes), last = STEREOPSIS_V(add_epi8)(more[2], more[3]);
    lo = STEREOPSIS_V(add_epi16)(lo, STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpacklo_epi8)(others, next), ones));
    hi = STEREOPSIS_V(add_epi16)(hi, STEREOPSIS_V(maddubs_epi16)(STEREOPSIS_V(unpackhi_epi8)(others, next), ones));
    lo = STEREOPSIS_V(add_epi16)(lo, STEREOPSIS_V(unpacklo_epi8)(last, zero()));
    hi = STEREOPSIS_V(add_epi16)(hi, STEREOPSIS_V(unpackhi_epi8)(last, zero()));
  } else {
    lo = STEREOPSIS_V(add_epi16)(lo, STEREOPSIS_V(unpacklo_epi8)(others, zero()));
    hi = STEREOPSIS_V(add_epi16)(hi, STEREOPSIS_V(unpackhi_epi8)(others, zero()));
  }
  store(sums, joined_first(lo, hi));
  store(sums + kBytes / 2, joined_second(lo, hi));
}
template <int N>
static STEREOPSIS_INLINE void add_up(const Vec* t, const uint16_t* before, uint16_t* sums, uint16_t) {
  Vec sum = t[0];
  for (int k = 1; k < N; ++k) sum = STEREOPSIS_V(add_epi16)(sum, t[k]);
  store(sums, before ? STEREOPSIS_V(add_epi16)(sum, load(before)) : sum);
}

// N paths, the last of them along the row where Along. Vectors: as many as a pixel's candidates fill, or 0 where
// only `row` knows, and the last one may have room left.
// Guided: P2 differs from pixel to pixel.
template <class Lane, int N, bool Along, int Vectors, bool Guided, bool Paired>
static void paths_of(const PathRow<Lane>& given) {
  using L = Of<Lane>;
  constexpr int lanes = kBytes / sizeof(Lane), above = N - (Along ? 1 : 0);
  const PathRow<Lane> row = given;  // so that nothing that is stored can change it
  const ptrdiff_t room = static_cast<ptrdiff_t>(row.room);
  const int vectors = Vectors ? Vectors : (row.count + lanes - 1) / lanes;
  const Vec p1 = L::set(row.first), p2 = L::set(row.second[0][0]);
  // All ones beyond the first candidate, and beyond the last.
  alignas(64) Lane edge[2 * lanes] = {};
  edge[0] = static_cast<Lane>(~Lane{0});
  edge[2 * lanes - 1] = static_cast<Lane>(~Lane{0});
  const Vec before_first = load(edge), after_last = load(edge + lanes), all_ones = L::set(static_cast<Lane>(~Lane{0}));
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  typename L::Mask but_first = static_cast<typename L::Mask>(~typename L::Mask{1}), but_last = static_cast<typename L::Mask>(~typename L::Mask{0}) >> 1;
#if defined(__GNUC__)
  asm("" : "+k"(but_first), "+k"(but_last));  // made once, and not anew where they are used
#endif
#endif
  constexpr bool padded = Vectors == 0;
  Vec ones = L::set(1), weights = STEREOPSIS_V(set1_epi16)(static_cast<short>(1 | 2 * N << 8));  // of what is summed, and of the cost
#if defined(__GNUC__)
  if constexpr (Paired) asm("" : "+v"(ones), "+v"(weights));
#endif
  const Vec no_candidate = load(row.no_candidate + (vectors - 1) * lanes), candidate = is_zero(no_candidate, Lane{});
  Lane* const line = row.line;
  std::memcpy(line, row.no_candidate, row.room * sizeof(Lane));
  Vec line_least = zero();
#if defined(STEREOPSIS_BITALG)
  // Two vectors hold all of a pixel's bytes: they are turned by a candidate, and the one that leaves each is put into the other.
  constexpr bool turned = sizeof(Lane) == 1 && Vectors == 2;
  alignas(64) uint8_t turns[2 * 64];
  for (int k = 0; k < 64; ++k) turns[k] = static_cast<uint8_t>((k + 63) % 64), turns[64 + k] = static_cast<uint8_t>((k + 1) % 64);
  const Vec up = load(turns), down = load(turns + 64);
  Vec line_costs[2] = {zero(), zero()};
#endif
  ptrdiff_t x = row.step > 0 ? 0 : row.width - 1;
  for (int n = 0; n < row.width; ++n, x += row.step) {
    const ptrdiff_t at = x * room;
    const Lane* const costs = row.costs + at;
    if (row.soon) fetch(row.soon + ptrdiff_t{64} * n);
    Vec least[N], most[N], lowest[4];
    unrolled<4 - N>([&](auto k) STEREOPSIS_INLINE_LAMBDA { lowest[N + k] = all_ones; });
    const Lane* from[N];
    Lane* to[N];
    unrolled<above>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
      from[k] = row.from[k] + at;
      to[k] = row.to[k] + at;
      least[k] = STEREOPSIS_V(set1_epi32)(static_cast<int>(row.least[k][x * kPathsAtOnce]));
      most[k] = Guided ? L::broadcast(row.second[k] + x) : p2;
    });
    if constexpr (Along) {
      least[N - 1] = line_least;
      most[N - 1] = Guided ? L::broadcast(row.second[N - 1] + x) : p2;
    }
    // What path k's costs at i have over the pixel's own, from those of the pixel before at i, i - 1 and i + 1.
    const auto step = [&](auto k, bool is_first, bool is_last, Vec a, Vec below, Vec beyond) STEREOPSIS_INLINE_LAMBDA {
      Vec next;
      if (is_first && is_last)
        next = L::min(either(below, before_first), either(beyond, after_last));
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
      else if (is_first)
        next = L::min_where(beyond, below, but_first);
      else if (is_last)
        next = L::min_where(below, beyond, but_last);
#else
      else if (is_first)
        next = L::min(beyond, either(below, before_first));
      else if (is_last)
        next = L::min(below, either(beyond, after_last));
#endif
      else
        next = L::min(below, beyond);
      return L::min(L::sub(L::min(a, L::add(next, p1)), least[k]), most[k]);
    };
    const auto sum_up = [&](ptrdiff_t i, const Vec* t, const Vec* more, Vec cost) STEREOPSIS_INLINE_LAMBDA {
      if constexpr (Paired) {
        if (row.sums_before)
          complete<N>(more, cost, ones, weights, row.sums_before + at + i, row.sums + at + i);
        else
          hand_over<N>(more, row.sums + at + i);
      } else if constexpr (N != 3) {  // three are followed for what they leave alone
        if (row.sums_before)
          add_up<N>(t, row.sums_before + at + i, row.sums + at + i, Lane{});
        else if (row.sums)
          add_up<N>(t, nullptr, row.sums + at + i, Lane{});
      }
    };
#if defined(STEREOPSIS_BITALG)
    if constexpr (turned) {
      const Vec cost[2] = {load(costs), load(costs + lanes)};
      Vec t[2][N], more[2][N];
      unrolled<N>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
        constexpr bool is_along = Along && k == N - 1;
        const Vec a = is_along ? line_costs[0] : load(from[k]), b = is_along ? line_costs[1] : load(from[k] + lanes);
        const Vec below = _mm512_permutexvar_epi8(up, a), after = _mm512_permutexvar_epi8(down, b);
        more[0][k] = step(k, true, false, a, below, _mm512_mask_permutexvar_epi8(after, but_last, down, a));
        more[1][k] = step(k, false, true, b, _mm512_mask_permutexvar_epi8(below, but_first, up, b), after);
        for (int v = 0; v < 2; ++v) {
          t[v][k] = L::add(more[v][k], cost[v]);
          if constexpr (is_along)
            line_costs[v] = t[v][k];
          else
            store(to[k] + v * lanes, t[v][k]);
        }
        lowest[k] = L::min(t[0][k], t[1][k]);
      });
      for (int v = 0; v < 2; ++v) sum_up(v * lanes, t[v], more[v], cost[v]);
    } else
#endif
    {
      Vec along_before = all_ones, along = load(line);
      const auto block = [&](int v) STEREOPSIS_INLINE_LAMBDA {
        const ptrdiff_t i = static_cast<ptrdiff_t>(v) * lanes;
        const bool is_first = v == 0, is_last = v == vectors - 1;
        const Vec cost = load(costs + i);
        Vec t[N], more[N];
        unrolled<N>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
          if constexpr (Along && k == N - 1) {
            const Vec after = is_last ? all_ones : load(line + i + lanes);
            more[k] = step(k, is_first, is_last, along, L::one_up(along_before, along), L::one_down(along, after));
            along_before = along;
            along = after;
          } else {
            more[k] = step(k, is_first, is_last, load(from[k] + i), load(from[k] + i - 1), load(from[k] + i + 1));
          }
          t[k] = L::add(more[k], cost);
          if (is_last && padded) t[k] = put(t[k], candidate, no_candidate);
          lowest[k] = is_first ? t[k] : L::min(lowest[k], t[k]);
          store(Along && k == N - 1 ? line + i : to[k] + i, t[k]);
        });
        sum_up(i, t, more, cost);
      };
      if constexpr (Vectors > 0)
        unrolled<Vectors>(block);
      else
        for (int v = 0; v < vectors; ++v) block(v);
    }
    const __m128i found = leasts<Lane>(lowest);
    _mm_storeu_si128(reinterpret_cast<__m128i*>(row.least_to + x * kPathsAtOnce), found);
    if constexpr (Along) line_least = word_of<N - 1>(found);
  }
}

template <class Lane, int N, bool Along, bool Paired, bool Guided>
static void paths_guided(const PathRow<Lane>& row) {
  constexpr int lanes = kBytes / sizeof(Lane);
  if (row.count == 128) return paths_of<Lane, N, Along, 128 / lanes, Guided, Paired>(row);
  paths_of<Lane, N, Along, 0, Guided, Paired>(row);
}
template <class Lane, int N, bool Along, bool Paired = false>
static void paths_with(const PathRow<Lane>& row) {
  if constexpr (sizeof(Lane) == 1 && Along && N > 1 && !Paired)
    if (row.in_pairs) return paths_with<Lane, N, Along, true>(row);
  row.guided ? paths_guided<Lane, N, Along, Paired, true>(row) : paths_guided<Lane, N, Along, Paired, false>(row);
}

template <class Lane>
static void paths(const PathRow<Lane>& row) {
  if (!row.along && row.above == 4) return paths_with<Lane, 4, false>(row);
  if (!row.along && row.above == 3) return paths_with<Lane, 3, false>(row);
  if (!row.along) return paths_with<Lane, 1, false>(row);
  if (row.above == 3) return paths_with<Lane, 4, true>(row);
  if (row.above == 1) return paths_with<Lane, 2, true>(row);
  paths_with<Lane, 1, true>(row);
}

// ---- costs -----------------------------------------------------------------------------------------------------------------
//
// A few bits of the strings at a time: eight, where there is an instruction that counts them; else four, of which the left
// pixel's say which table holds, for the right one's, how many differ.

#if defined(STEREOPSIS_BITALG)
constexpr int kPart = 8;
alignas(16) static const uint8_t kPairs[16] = {0, 8, 1, 9, 2, 10, 3, 11, 4, 12, 5, 13, 6, 14, 7, 15};
// The parts of a string, each four times over.
static STEREOPSIS_INLINE void split(uint64_t string, int, uint32_t* parts) {
  const __m256i repeat = _mm256_setr_epi8(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3, 4, 4, 4, 4, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7);
  _mm256_storeu_si256(reinterpret_cast<__m256i*>(parts), _mm256_shuffle_epi8(_mm256_set1_epi64x(static_cast<long long>(string)), repeat));
}
// The q-th part of every string into the q-th plane, of eight: bytes of 64 strings at a time change places with the strings.
static void split_planes(const uint64_t* strings, size_t count, int, uint8_t* planes, size_t stride) {
  alignas(64) uint16_t collect[32];
  for (int k = 0; k < 32; ++k) collect[k] = static_cast<uint16_t>(k % 4 * 8 + k / 4);
  const Vec pairs = table_of(kPairs), words = load(collect);
  for (size_t t = 0; t < count; t += 64) {
    Vec a[8], b[8];
    for (int k = 0; k < 8; ++k)  // eight strings: eight bytes each of planes 0, 1, ...
      a[k] = _mm512_permutexvar_epi16(words, _mm512_shuffle_epi8(load(strings + t + 8 * k), pairs));
    for (int k = 0; k < 8; k += 2) b[k] = _mm512_unpacklo_epi64(a[k], a[k + 1]), b[k + 1] = _mm512_unpackhi_epi64(a[k], a[k + 1]);
    // Parts of 16 bytes: b[0], b[2], b[4], b[6] hold planes 0, 2, 4, 6, and those after them the odd ones.
    for (int odd = 0; odd < 2; ++odd) {
      const Vec low = _mm512_shuffle_i64x2(b[odd], b[2 + odd], 0x44), high = _mm512_shuffle_i64x2(b[odd], b[2 + odd], 0xEE);
      const Vec low_after = _mm512_shuffle_i64x2(b[4 + odd], b[6 + odd], 0x44), high_after = _mm512_shuffle_i64x2(b[4 + odd], b[6 + odd], 0xEE);
      store(planes + odd * stride + t, _mm512_shuffle_i64x2(low, low_after, 0x88));
      store(planes + (2 + odd) * stride + t, _mm512_shuffle_i64x2(low, low_after, 0xDD));
      store(planes + (4 + odd) * stride + t, _mm512_shuffle_i64x2(high, high_after, 0x88));
      store(planes + (6 + odd) * stride + t, _mm512_shuffle_i64x2(high, high_after, 0xDD));
    }
  }
}
static STEREOPSIS_INLINE Vec part_of(uint32_t repeated) { return _mm512_set1_epi32(static_cast<int>(repeated)); }
static STEREOPSIS_INLINE Vec differing_bits(Vec left, Vec right) { return _mm512_popcnt_epi8(_mm512_xor_si512(left, right)); }
#else
constexpr int kPart = 4;
static STEREOPSIS_INLINE void split(uint64_t string, int count, uint32_t* parts) {
  for (int q = 0; q < count; ++q) parts[q] = static_cast<uint32_t>(string >> (kPart * q) & 15);
}
alignas(64) static const uint8_t kDiffering[16][16] = {
    {0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4},
    {1, 0, 2, 1, 2, 1, 3, 2, 2, 1, 3, 2, 3, 2, 4, 3},
    {1, 2, 0, 1, 2, 3, 1, 2, 2, 3, 1, 2, 3, 4, 2, 3},
    {2, 1, 1, 0, 3, 2, 2, 1, 3, 2, 2, 1, 4, 3, 3, 2},
    {1, 2, 2, 3, 0, 1, 1, 2, 2, 3, 3, 4, 1, 2, 2, 3},
    {2, 1, 3, 2, 1, 0, 2, 1, 3, 2, 4, 3, 2, 1, 3, 2},
    {2, 3, 1, 2, 1, 2, 0, 1, 3, 4, 2, 3, 2, 3, 1, 2},
    {3, 2, 2, 1, 2, 1, 1, 0, 4, 3, 3, 2, 3, 2, 2, 1},
    {1, 2, 2, 3, 2, 3, 3, 4, 0, 1, 1, 2, 1, 2, 2, 3},
    {2, 1, 3, 2, 3, 2, 4, 3, 1, 0, 2, 1, 2, 1, 3, 2},
    {2, 3, 1, 2, 3, 4, 2, 3, 1, 2, 0, 1, 2, 3, 1, 2},
    {3, 2, 2, 1, 4, 3, 3, 2, 2, 1, 1, 0, 3, 2, 2, 1},
    {2, 3, 3, 4, 1, 2, 2, 3, 1, 2, 2, 3, 0, 1, 1, 2},
    {3, 2, 4, 3, 2, 1, 3, 2, 2, 1, 3, 2, 1, 0, 2, 1},
    {3, 4, 2, 3, 2, 3, 1, 2, 2, 3, 1, 2, 1, 2, 0, 1},
    {4, 3, 3, 2, 3, 2, 2, 1, 3, 2, 2, 1, 2, 1, 1, 0}};
static void split_planes(const uint64_t* STEREOPSIS_RESTRICT strings, size_t count, int parts, uint8_t* planes, size_t stride) {
  for (int q = 0; q < parts; ++q) {
    uint8_t* STEREOPSIS_RESTRICT plane = planes + q * stride;
    for (size_t t = 0; t < count; ++t) plane[t] = static_cast<uint8_t>(strings[t] >> (kPart * q) & 15);
  }
}
static STEREOPSIS_INLINE Vec part_of(uint32_t part) { return table_of(kDiffering[part]); }
static STEREOPSIS_INLINE Vec differing_bits(Vec table, Vec right) { return STEREOPSIS_V(shuffle_epi8)(table, right); }
#endif

// The distances of the bits of one word, in Parts planes `stride` apart, added to those of the words before where Added. Right
// pixel and candidate move on together, so a pixel's candidates lie side by side.
template <int Parts, bool Added>
static STEREOPSIS_INLINE void hamming_word(const uint8_t* STEREOPSIS_RESTRICT right, ptrdiff_t stride, const uint32_t* STEREOPSIS_RESTRICT left,
                                           size_t room, uint8_t* STEREOPSIS_RESTRICT costs) {
  Vec here[Parts];
  unrolled<Parts>([&](auto q) STEREOPSIS_INLINE_LAMBDA { here[q] = part_of(left[q]); });
  for (size_t i = 0; i < room; i += kBytes) {
    Vec sum = Added ? load(costs + i) : zero();
    unrolled<Parts>([&](auto q) STEREOPSIS_INLINE_LAMBDA {
      const Vec differing = differing_bits(here[q], load(right + static_cast<ptrdiff_t>(q) * stride + i));
      sum = q == 0 && !Added ? differing : STEREOPSIS_V(add_epi8)(sum, differing);
    });
    store(costs + i, sum);
  }
}

template <int Parts, bool Added>
static void hamming_plane(const HammingRow& row, const uint8_t* planes, ptrdiff_t given_stride, const uint32_t* left) {
  const int last = row.width - 1, margin = row.margin;
  const ptrdiff_t room = static_cast<ptrdiff_t>(row.room), most = row.width + room;
  const ptrdiff_t origin = ptrdiff_t{last} + row.first + room;
  const int16_t* const shift = row.shift;
  uint8_t* costs = row.costs;
  // With a distance that is known beforehand, one register points to all planes.
  const auto each = [&](auto stride) STEREOPSIS_INLINE_LAMBDA {
    for (int column = -margin; column <= last + margin; ++column, costs += room) {
      const int x = static_cast<int>(clamp(column, 0, last));
      const ptrdiff_t at = clamp(origin - column + (shift ? shift[x] : 0), 0, most);
      hamming_word<Parts, Added>(planes + at, stride, left + static_cast<ptrdiff_t>(x) * (64 / kPart), room, costs);
    }
  };
  if (given_stride == kPlaneStride)
    each(std::integral_constant<ptrdiff_t, kPlaneStride>{});
  else
    each(given_stride);
}

#if defined(STEREOPSIS_BITALG)
// The same for words of which most bits count: the strings' counts, of eight at a time, are shifted together. Eight pixels that
// follow each other compare the same aligned vectors of strings, where these lie so that the last pixel's first candidate is
// the first of eight: pixel k's candidates then begin 7 - k strings later, and what it counts before them, which is written
// over the last ones of the pixel before, is put right by that one's last few.
template <bool Added>
static void hamming_strings(const HammingRow& row, const uint64_t* strings, const uint64_t* left) {
  const int last = row.width - 1, end = last + row.margin;
  const ptrdiff_t room = static_cast<ptrdiff_t>(row.room), most = row.width + room, origin = ptrdiff_t{last} + row.first + room;
  const int16_t* const shift = row.shift;
  alignas(64) uint8_t order[64];
  for (int k = 0; k < 64; ++k) order[k] = static_cast<uint8_t>(k % 8 * 8 + k / 8);
  const Vec by_string = load(order);
  const auto string_of = [&](int column) STEREOPSIS_INLINE_LAMBDA {
    return _mm512_set1_epi64(static_cast<long long>(left[clamp(column, 0, last)]));
  };
  const auto with_next = [&](Vec counts, Vec one, Vec other) STEREOPSIS_INLINE_LAMBDA {
    return _mm512_shrdi_epi64(counts, _mm512_popcnt_epi64(_mm512_xor_si512(one, other)), 8);
  };
  uint8_t* costs = row.costs;
  for (int column = -row.margin; column <= end;) {
    const ptrdiff_t at = origin - column;
    if (!Added && !shift && column + 7 <= end && at >= 7 && at <= most && at % 8 == 7) {
      const uint64_t* const right = strings + (at - 7);
      Vec here[8], counts[8];
      unrolled<8>([&](auto k) STEREOPSIS_INLINE_LAMBDA { here[k] = string_of(column + k), counts[k] = zero(); });
      for (ptrdiff_t i = 0; i < room; i += 64) {
        for (int n = 0; n < 64; n += 8) {
          const Vec eight = load(right + i + n);
          unrolled<8>([&](auto k) STEREOPSIS_INLINE_LAMBDA { counts[k] = with_next(counts[k], here[k], eight); });
        }
        unrolled<8>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
          const Vec sum = _mm512_permutexvar_epi8(by_string, counts[k]);
          uint8_t* const to = costs + k * room + i - (7 - k);
          if (k == 0 && i == 0)
            _mm512_mask_storeu_epi8(to, ~uint64_t{0} << 7, sum);
          else
            store(to, sum);
        });
      }
      const Vec eight = load(right + room);
      Vec few = zero();
      unrolled<8>([&](auto k) STEREOPSIS_INLINE_LAMBDA { few = with_next(few, here[k], eight); });
      few = _mm512_permutexvar_epi8(by_string, few);  // eight of each pixel
      unrolled<7>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
        _mm512_mask_storeu_epi8(costs + (k + 1) * room - (7 - k) - 8 * k, ((uint64_t{1} << (7 - k)) - 1) << 8 * k, few);
      });
      column += 8, costs += 8 * room;
      continue;
    }
    const Vec here = string_of(column);
    const uint64_t* const right = strings + clamp(at + (shift ? shift[clamp(column, 0, last)] : 0), 0, most);
    for (ptrdiff_t i = 0; i < room; i += 64) {
      Vec sum = zero();
      unrolled<8>([&](auto k) STEREOPSIS_INLINE_LAMBDA { sum = with_next(sum, here, load(right + i + 8 * k)); });
      sum = _mm512_permutexvar_epi8(by_string, sum);
      store(costs + i, Added ? _mm512_add_epi8(sum, load(costs + i)) : sum);
    }
    ++column, costs += room;
  }
}
#endif

static void hamming(const HammingRow& row) {
  // Of the last word 8, 4 or 2 bytes: enough for 9 x 7, for 5 x 5 or 7 x 5 sparse, for 3 x 3 or a center-symmetric window.
  const int rest = (row.bits - 1) % 64 + 1, bytes = rest > 32 ? 8 : rest > 16 ? 4 : 2, last = row.width - 1;
  const size_t reach = hamming_reach(row.width, row.room), stride = hamming_stride(row.width, row.room);
  // The right strings from right to left; their parts, each in a plane of its own; and those of the left ones, a word each.
  uint64_t* STEREOPSIS_RESTRICT strings = reinterpret_cast<uint64_t*>(row.scratch);
  uint32_t* STEREOPSIS_RESTRICT left = reinterpret_cast<uint32_t*>(row.scratch + 8 * reach);
  uint8_t* const planes = row.scratch + 8 * reach + 4 * (64 / kPart) * static_cast<size_t>(row.width);
  for (int begin = 0; begin < row.bits; begin += 64) {
    const uint64_t* STEREOPSIS_RESTRICT from = row.right + begin / 64 * row.plane;
    const uint64_t* STEREOPSIS_RESTRICT mine = row.left + begin / 64 * row.plane;
    const int parts = (begin + 64 < row.bits ? 64 : 8 * bytes) / kPart;
    const size_t room = row.room, end = room + row.width;
    for (size_t t = 0; t < room; ++t) strings[t] = from[last];
    for (size_t t = room; t < end; ++t) strings[t] = from[end - 1 - t];
    for (size_t t = end; t < reach; ++t) strings[t] = from[0];
#if defined(STEREOPSIS_BITALG)
    if (parts == 64 / kPart) {
      (begin ? hamming_strings<true> : hamming_strings<false>)(row, strings, mine);
      continue;
    }
#endif
    split_planes(strings, reach, parts, planes, stride);
    for (int x = 0; x <= last; ++x) split(mine[x], parts, left + static_cast<size_t>(x) * (64 / kPart));
    const auto kernel = [&](auto count) STEREOPSIS_INLINE_LAMBDA {
      constexpr int all = decltype(count)::value;
      (begin ? hamming_plane<all, true> : hamming_plane<all, false>)(row, planes, static_cast<ptrdiff_t>(stride), left);
    };
    if (parts == 64 / kPart)
      kernel(Constant<64 / kPart>{});
    else if (parts == 32 / kPart)
      kernel(Constant<32 / kPart>{});
    else
      kernel(Constant<16 / kPart>{});
  }
}

// Blocks: vectors of candidates, from i on, that are followed along the row together.
template <class Lane, int Blocks>
static STEREOPSIS_INLINE void aggregate_from(const AggregateRow& given, size_t i) {
  constexpr int half = kBytes / 2;
  const AggregateRow row = given;
  const Vec rounding = STEREOPSIS_V(set1_epi16)(static_cast<short>(1 << row.unit >> 1));
  const __m128i shift = _mm_cvtsi32_si128(row.unit);
  Lane* out = static_cast<Lane*>(row.costs) + i;
  // Three distances fit a byte (kMostAggregatedBits); their sums are kept in the order of unpacking, as words.
  const auto column = [&](size_t at, Vec* words) STEREOPSIS_INLINE_LAMBDA {
    const Vec sum = STEREOPSIS_V(add_epi8)(STEREOPSIS_V(add_epi8)(load(row.above + at), load(row.here + at)), load(row.below + at));
    words[0] = STEREOPSIS_V(unpacklo_epi8)(sum, zero());
    words[1] = STEREOPSIS_V(unpackhi_epi8)(sum, zero());
  };
  // The last two columns' sums, and both with the rounding.
  Vec one[Blocks][2], two[Blocks][2], both[Blocks][2];
  unrolled<Blocks>([&](auto block) STEREOPSIS_INLINE_LAMBDA {
    column(i + block * kBytes, one[block]);
    column(row.room + i + block * kBytes, two[block]);
    for (int part = 0; part < 2; ++part)
      both[block][part] = STEREOPSIS_V(add_epi16)(STEREOPSIS_V(add_epi16)(one[block][part], two[block][part]), rounding);
  });
  for (int x = 0; x < row.width; ++x, out += row.room)
    unrolled<Blocks>([&](auto block) STEREOPSIS_INLINE_LAMBDA {
      Vec next[2], sum[2];
      column((x + 2) * row.room + i + block * kBytes, next);
      for (int part = 0; part < 2; ++part) {
        const Vec total = STEREOPSIS_V(add_epi16)(both[block][part], next[part]);
        sum[part] = STEREOPSIS_V(srl_epi16)(total, shift);
        both[block][part] = STEREOPSIS_V(sub_epi16)(total, one[block][part]);
        one[block][part] = two[block][part];
        two[block][part] = next[part];
      }
      Lane* const to = out + block * kBytes;
      if constexpr (sizeof(Lane) == 1) {
        store(to, STEREOPSIS_V(packus_epi16)(sum[0], sum[1]));
      } else {
        store(to, joined_first(sum[0], sum[1]));
        store(to + half, joined_second(sum[0], sum[1]));
      }
    });
}
template <class Lane>
static void aggregate(const AggregateRow& row) {
  constexpr int blocks = 2;
  size_t i = 0;
  for (; i + blocks * kBytes <= row.room; i += blocks * kBytes) aggregate_from<Lane, blocks>(row, i);
  for (; i < row.room; i += kBytes) aggregate_from<Lane, 1>(row, i);
}

// ---- winners ---------------------------------------------------------------------------------------------------------------

constexpr size_t kVectorSums = kBytes / 2;
// Pixels whose sums are offered to the right view together: what they mean fills one vector more than what one of them means.
constexpr int kOffered = kVectorSums;


static STEREOPSIS_INLINE int first_bit(uint64_t bits) {
#if defined(_MSC_VER)
  unsigned long at;
  _BitScanForward64(&at, bits);
  return static_cast<int>(at);
#else
  return __builtin_ctzll(bits);
#endif
}
// Which of 64 sums are `v`.
static STEREOPSIS_INLINE uint64_t equal_of_64(const uint16_t* sums, Vec v) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  return static_cast<uint64_t>(_mm512_cmpeq_epi16_mask(load(sums + 32), v)) << 32 | _mm512_cmpeq_epi16_mask(load(sums), v);
#else
  const auto equal = [&](int i) STEREOPSIS_INLINE_LAMBDA {
    const Vec both = _mm256_packs_epi16(_mm256_cmpeq_epi16(load(sums + i), v), _mm256_cmpeq_epi16(load(sums + i + 16), v));
    return static_cast<uint64_t>(static_cast<uint32_t>(_mm256_movemask_epi8(_mm256_permute4x64_epi64(both, 0xD8))));
  };
  return equal(32) << 32 | equal(0);
#endif
}
// The least lane, in the lowest one of those that are returned.
static STEREOPSIS_INLINE __m128i least_word(Vec v) {
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
  const __m256i half = _mm256_min_epu16(_mm512_castsi512_si256(v), _mm512_extracti64x4_epi64(v, 1));
#else
  const __m256i half = v;
#endif
  return _mm_minpos_epu16(_mm_min_epu16(_mm256_castsi256_si128(half), _mm256_extracti128_si256(half, 1)));
}
static STEREOPSIS_INLINE Vec least_words(const uint16_t* sums, size_t room) {
  static_assert(kSgmBlock % (kBytes / 2) == 0 && kSgmBlock == 64, "whole vectors, and whole masks");
  Vec best = load(sums);
  for (size_t i = kBytes / 2; i < room; i += kBytes / 2) best = STEREOPSIS_V(min_epu16)(best, load(sums + i));
  return best;
}
// The first of a pixel's least sums.
static STEREOPSIS_INLINE int first_least(const uint16_t* sums, size_t room) {
  const Vec least = Of<uint16_t>::broadcast(least_word(least_words(sums, room)));
  size_t i = 0;
  uint64_t equal = equal_of_64(sums, least);
  while (!equal) i += 64, equal = equal_of_64(sums + i, least);
  return static_cast<int>(i) + first_bit(equal);
}
static STEREOPSIS_INLINE uint16_t least_of(const uint16_t* sums, size_t room) {
  return static_cast<uint16_t>(_mm_extract_epi16(least_word(least_words(sums, room)), 0));
}
static STEREOPSIS_INLINE uint16_t least_between(const uint16_t* sums, int begin, int end) {
  constexpr int words = kBytes / 2;
  uint16_t best = 65535;
  if (end - begin < words) {
    for (int i = begin; i < end; ++i) best = sums[i] < best ? sums[i] : best;
    return best;
  }
  Vec v = load(sums + end - words);
  for (int i = begin; i < end - words; i += words) v = STEREOPSIS_V(min_epu16)(v, load(sums + i));
  return static_cast<uint16_t>(_mm_extract_epi16(least_word(v), 0));
}

// Offers the sums of `pixels` neighbouring pixels from x on, `room` each, to the right pixels that they mean, pixel k's first
// candidate's being at least[base[k]]; whoever offers the least is its `best`, and the first of these. Where Alike, base[k] is
// base[0] - k. `outside`: zeros for a pixel's candidates, and all ones for as many as a vector holds before and after.
template <bool Alike>
static STEREOPSIS_NOINLINE void offer(const uint16_t* sums, ptrdiff_t room, const uint16_t* outside, const ptrdiff_t* base, int x, int pixels,
                                      uint16_t* least, uint16_t* best) {
  constexpr ptrdiff_t words = kBytes / 2;
  ptrdiff_t begin = base[0], end = base[0];
  for (int k = 1; k < pixels; ++k) {
    begin = base[k] < begin ? base[k] : begin;
    end = base[k] > end ? base[k] : end;
  }
  end += room;
  const Vec first = STEREOPSIS_V(set1_epi16)(static_cast<short>(x)), one = STEREOPSIS_V(set1_epi16)(1);
  const auto at = [&](ptrdiff_t j, const auto& all) STEREOPSIS_INLINE_LAMBDA {
    Vec lowest = load(least + j), who = load(best + j), here = first;
    all([&](const uint16_t* offered, const uint16_t* hidden) STEREOPSIS_INLINE_LAMBDA {
      const Vec sum = hidden ? either(load(offered), load(hidden)) : load(offered);
      const Vec lower = STEREOPSIS_V(min_epu16)(lowest, sum);
#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512
      who = _mm512_mask_mov_epi16(here, _mm512_cmpeq_epi16_mask(lower, lowest), who);
#else
      who = _mm256_blendv_epi8(here, who, _mm256_cmpeq_epi16(lower, lowest));
#endif
      lowest = lower;
    }, here);
    store(least + j, lowest);
    store(best + j, who);
  };
  if (Alike && pixels == kOffered) {
    const ptrdiff_t apart = room + 1;
    for (ptrdiff_t j = begin; j < end; j += words) {
      const ptrdiff_t i = j - base[0];
      const bool within = i >= 0 && i + kOffered - 1 + words <= room;
      const auto offered = [&](auto hidden) STEREOPSIS_INLINE_LAMBDA {
        at(j, [&](const auto& take, Vec& here) STEREOPSIS_INLINE_LAMBDA {
          unrolled<kOffered>([&](auto k) STEREOPSIS_INLINE_LAMBDA {
            take(sums + i + k * apart, hidden ? outside + words + i + k : nullptr);
            here = STEREOPSIS_V(add_epi16)(here, one);
          });
        });
      };
      within ? offered(std::false_type{}) : offered(std::true_type{});
    }
    return;
  }
  for (ptrdiff_t j = begin; j < end; j += words)
    at(j, [&](const auto& take, Vec& here) STEREOPSIS_INLINE_LAMBDA {
      for (int k = 0; k < pixels; ++k) {
        if (j > base[k] - words && j < base[k] + room) take(sums + k * room + (j - base[k]), outside + words + (j - base[k]));
        here = STEREOPSIS_V(add_epi16)(here, one);
      }
    });
}

#else

constexpr size_t kVectorSums = 0;
constexpr int kOffered = 8;

// ---- plain loops -----------------------------------------------------------------------------------------------------------

// One path at one pixel; returns the least of its costs.
template <class Lane>
static STEREOPSIS_INLINE Lane step_path(const Lane* STEREOPSIS_RESTRICT from, Lane* STEREOPSIS_RESTRICT to,
                                        const Lane* STEREOPSIS_RESTRICT costs, const Lane* STEREOPSIS_RESTRICT no_candidate,
                                        int room, int least, int p1, int p2) {
  const Lane most = static_cast<Lane>(static_cast<Lane>(~Lane{0}) - p1);
  const Lane limit = static_cast<Lane>(least + p2), less = static_cast<Lane>(least), penalty = static_cast<Lane>(p1);
  const auto at = [&](int i, Lane before, Lane after) {
    const Lane next = before < after ? before : after;
    const Lane stepped = static_cast<Lane>(next + penalty);
    Lane best = from[i] < stepped ? from[i] : stepped;
    best = best < limit ? best : limit;
    const Lane cost = static_cast<Lane>(best - less + costs[i]);
    return no_candidate[i] ? no_candidate[i] : cost;
  };
  to[0] = at(0, most, room > 1 ? from[1] : most);
  for (int i = 1; i < room - 1; ++i) to[i] = at(i, from[i - 1], from[i + 1]);
  to[room - 1] = at(room - 1, from[room - 2], most);
  Lane lowest = to[0];
  for (int i = 1; i < room; ++i) lowest = to[i] < lowest ? to[i] : lowest;
  return lowest;
}

template <class Lane>
static void paths(const PathRow<Lane>& row) {
  const int room = static_cast<int>(row.room);
  Lane *line = row.line, *next = row.line + room;
  for (int i = 0; i < room; ++i) line[i] = row.no_candidate[i];
  int least = 0, x = row.step > 0 ? 0 : row.width - 1;
  for (int n = 0; n < row.width; ++n, x += row.step) {
    if (row.soon) fetch(row.soon + ptrdiff_t{64} * n);
    const ptrdiff_t at = static_cast<ptrdiff_t>(x) * room;
    uint16_t* STEREOPSIS_RESTRICT sums = row.sums ? row.sums + at : nullptr;
    if (sums && !row.sums_before)
      for (int i = 0; i < room; ++i) sums[i] = 0;
    else if (sums && row.sums_before != row.sums)
      for (int i = 0; i < room; ++i) sums[i] = row.sums_before[at + i];
    const auto add = [&](const Lane* STEREOPSIS_RESTRICT t) {
      for (int i = 0; sums && i < room; ++i) sums[i] = static_cast<uint16_t>(sums[i] + t[i]);
    };
    for (int k = 0; k < row.above; ++k) {
      row.least_to[x * kPathsAtOnce + k] = step_path(row.from[k] + at, row.to[k] + at, row.costs + at, row.no_candidate, room,
                                                     static_cast<Lane>(row.least[k][x * kPathsAtOnce]), row.first, row.second[k][x]);
      add(row.to[k] + at);
    }
    if (row.along) {
      least = step_path(line, next, row.costs + at, row.no_candidate, room, least, row.first, row.second[row.above][x]);
      Lane* const done = next;
      next = line, line = done;
      add(done);
    }
  }
}

static void hamming(const HammingRow& row) {
  const int bytes = (row.bits + 7) / 8, last = row.width - 1, room = static_cast<int>(row.room);
  const size_t reach = row.width + 2 * row.room + kSgmBlock;
  for (int q = 0; q < bytes; ++q) {
    const uint64_t* from = row.right + (q / 8) * row.plane;
    uint8_t* plane = row.scratch + q * reach;
    for (size_t t = 0; t < reach; ++t)
      plane[t] = static_cast<uint8_t>(from[clamp(last - (static_cast<ptrdiff_t>(t) - room), 0, last)] >> 8 * (q % 8));
  }
  uint8_t* STEREOPSIS_RESTRICT costs = row.costs;
  for (int column = -row.margin; column < row.width + row.margin; ++column) {
    const int x = static_cast<int>(clamp(column, 0, last));
    const ptrdiff_t at = ptrdiff_t{last} - column + row.first + (row.shift ? row.shift[x] : 0) + room;
    const uint8_t* right = row.scratch + clamp(at, 0, row.width + room);
    for (int i = 0; i < room; ++i) costs[i] = 0;
    for (int q = 0; q < bytes; ++q) {
      const uint8_t* STEREOPSIS_RESTRICT string = right + q * reach;
      const uint8_t left = static_cast<uint8_t>(row.left[(q / 8) * row.plane + x] >> 8 * (q % 8));
      for (int i = 0; i < room; ++i) {
        uint8_t v = left ^ string[i];
        v = static_cast<uint8_t>(v - (v >> 1 & 0x55));
        v = static_cast<uint8_t>((v & 0x33) + (v >> 2 & 0x33));
        costs[i] = static_cast<uint8_t>(costs[i] + ((v + (v >> 4)) & 15));
      }
    }
    costs += room;
  }
}

template <class Lane>
static void aggregate(const AggregateRow& row) {
  const int room = static_cast<int>(row.room), rounding = 1 << row.unit >> 1;
  for (int x = 0; x < row.width; ++x) {
    Lane* STEREOPSIS_RESTRICT out = static_cast<Lane*>(row.costs) + static_cast<size_t>(x) * room;
    const size_t at = static_cast<size_t>(x) * room;
    for (int i = 0; i < room; ++i) {
      int sum = rounding;
      for (int column = 0; column < 3; ++column) {
        const size_t k = at + column * row.room + i;
        sum += row.above[k] + row.here[k] + row.below[k];
      }
      out[i] = static_cast<Lane>(sum >> row.unit);
    }
  }
}

static STEREOPSIS_INLINE uint16_t least_between(const uint16_t* sums, int begin, int end) {
  uint16_t best = 65535;
  for (int i = begin; i < end; ++i) best = sums[i] < best ? sums[i] : best;
  return best;
}
static STEREOPSIS_INLINE uint16_t least_of(const uint16_t* sums, size_t room) { return least_between(sums, 0, static_cast<int>(room)); }
static STEREOPSIS_INLINE int first_least(const uint16_t* sums, size_t room) {
  const uint16_t least = least_of(sums, room);
  int i = 0;
  while (sums[i] != least) ++i;
  return i;
}
template <bool Alike>
static STEREOPSIS_INLINE void offer(const uint16_t* sums, ptrdiff_t room, const uint16_t*, const ptrdiff_t* base, int x, int pixels,
                                    uint16_t* all_least, uint16_t* all_best) {
  for (int k = 0; k < pixels; ++k) {
    const uint16_t* STEREOPSIS_RESTRICT offered = sums + k * room;
    uint16_t *STEREOPSIS_RESTRICT least = all_least + base[k], *STEREOPSIS_RESTRICT best = all_best + base[k];
    const uint16_t here = static_cast<uint16_t>(x + k);
    for (ptrdiff_t i = 0; i < room; ++i) {
      best[i] = offered[i] < least[i] ? here : best[i];
      least[i] = offered[i] < least[i] ? offered[i] : least[i];
    }
  }
}

#endif

// Room: what there is for a pixel's candidates, or 0 where only `row` knows.
template <size_t Room>
static void winners_of(const WinnerRow& row) {
  const Pair& pair = *row.pair;
  const int W = pair.width, count = row.count;
  const size_t room = Room ? Room : row.room, width = static_cast<size_t>(W), reach = winner_reach(pair, room);
  const bool left_right = row.settings->left_right, uniqueness = row.settings->uniqueness;
  int32_t *winner = row.scratch, *cost = winner + W, *before = cost + W, *after = before + W, *second = after + W;
  int32_t* claims = second + W;  // 2 W + 1
  // By right pixels, from right to left: the index of the winner, and before it is known its sum and its left pixel.
  int32_t* const right = row.right;
  uint16_t *least = reinterpret_cast<uint16_t*>(right + reach), *best = least + reach, *outside = best + reach;
  if (left_right) {
    for (size_t j = 0; j < reach; ++j) least[j] = 65535;
    for (size_t i = 0; i < kSgmBlock + room + kSgmBlock; ++i) outside[i] = i < kVectorSums || i >= kVectorSums + room ? 65535 : 0;
  }
  for (int begin = 0; begin < W; begin += kOffered) {
    const int pixels = W - begin < kOffered ? W - begin : kOffered;
    ptrdiff_t base[kOffered];
    for (int k = 0; k < pixels; ++k) {
      const int x = begin + k;
      uint16_t* sums = row.sums + x * room;
      const int from = row.shift ? row.shift[x] - row.least_shift : 0;
      base[k] = static_cast<ptrdiff_t>(W - 1 - x) + from;
      const int i = first_least(sums, room);
      const int32_t here = sums[i];
      const bool has_before = i > 0 && sums[i - 1] != 65535, has_after = i + 1 < count && sums[i + 1] != 65535;
      winner[x] = i + from;
      cost[x] = here;
      // At an end of the candidates the one neighbour stands for both.
      before[x] = has_before ? sums[i - 1] : has_after ? sums[i + 1] : here;
      after[x] = has_after ? sums[i + 1] : before[x];
      if (!uniqueness) continue;
      const int lo = i > 0 ? i - 1 : 0, hi = i + 1 < count ? i + 1 : i;
      uint16_t kept[3];
      for (int k = lo; k <= hi; ++k) kept[k - lo] = sums[k], sums[k] = 65535;
      const uint16_t next = least_of(sums, room);
      second[x] = next == 65535 ? worst_cost<int32_t>() : next;
      for (int k = lo; k <= hi; ++k) sums[k] = kept[k - lo];
    }
    // From left to right, so that of equal sums the first candidate's stays.
    const uint16_t* const sums = row.sums + begin * room;
    if (left_right && row.shift)
      offer<false>(sums, static_cast<ptrdiff_t>(room), outside, base, begin, pixels, least, best);
    else if (left_right)
      offer<true>(sums, static_cast<ptrdiff_t>(room), outside, base, begin, pixels, least, best);
  }
  if (left_right)
    for (size_t j = 0; j < reach; ++j)
      right[j] = least[j] == 65535 ? -1 : static_cast<int32_t>((best[j] + j - (width - 1)) & 65535);
  if (row.shift)
    for (int x = 0; x < W; ++x) {
      // A pixel of whose own candidates none is in view, though others' would be, passes through as any of these.
      const int lo = x - pair.first - (W - 1), hi = x - pair.first < pair.count - 1 ? x - pair.first : pair.count - 1;
      if (cost[x] == 65535) winner[x] = static_cast<int32_t>(clamp(winner[x], lo > 0 ? lo : 0, hi > 0 ? hi : 0));
    }
  finish<int32_t>(pair, *row.settings, {winner, cost, before, after, second, claims, right}, *row.out, row.y);
  if (row.shift)
    for (int x = 0; x < W; ++x) {
      if (cost[x] != 65535) continue;
      const size_t at = static_cast<size_t>(row.y) * W + x;
      row.out->disparity[at] = std::numeric_limits<float>::quiet_NaN();
      row.out->confidence[at] = 0;
      row.out->flags[at] = kOutOfView;
      if (row.out->cost) row.out->cost[at] = std::numeric_limits<float>::infinity();
    }
}

static void winners(const WinnerRow& row) { row.room == 128 ? winners_of<128>(row) : winners_of<0>(row); }

static Beyond hide(uint16_t* sums, int lo, int hi, int count) {
  lo = lo < hi ? lo : hi;
  const uint16_t before = least_between(sums, 0, lo), after = least_between(sums, hi, count);
  Beyond found{-1, before < after ? before : after};
  if (found.sum < least_between(sums, lo, hi)) {
    found.index = before <= after ? 0 : hi;
    while (sums[found.index] != found.sum) ++found.index;
  }
  for (int i = 0; i < lo; ++i) sums[i] = 65535;
  for (int i = hi; i < count; ++i) sums[i] = 65535;
  return found;
}

}  // namespace

extern const SgmKernels sgm;
const SgmKernels sgm = {hamming, aggregate<uint8_t>, aggregate<uint16_t>, paths<uint8_t>, paths<uint16_t>, winners, hide};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
