// The few vector idioms that plain loops do not give: one struct of static functions per instruction set.
//
// A translation unit names its set with STEREOPSIS_ISA (generic, avx2, avx512, avx512vnni) and gets `Simd`. All sets
// give the same bits: integers are exact, and every float operation is a single IEEE one; a multiply-add is fused where the
// code says so, and nowhere else.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>

#include "score.hpp"

#define STEREOPSIS_ISA_generic 1
#define STEREOPSIS_ISA_avx2 2
#define STEREOPSIS_ISA_avx512 3
#define STEREOPSIS_ISA_avx512bitalg 3
#define STEREOPSIS_ISA_avx512popcnt 3
#define STEREOPSIS_ISA_avx512vnni 4
#define STEREOPSIS_CONCAT_(a, b) a##b
#define STEREOPSIS_CONCAT(a, b) STEREOPSIS_CONCAT_(a, b)
#define STEREOPSIS_ISA_LEVEL STEREOPSIS_CONCAT(STEREOPSIS_ISA_, STEREOPSIS_ISA)

#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx2
#include <immintrin.h>
#endif

#if defined(_MSC_VER)
#define STEREOPSIS_INLINE __forceinline
#define STEREOPSIS_NOINLINE __declspec(noinline)
#define STEREOPSIS_INLINE_LAMBDA
#define STEREOPSIS_RESTRICT __restrict
#else
#define STEREOPSIS_INLINE_LAMBDA __attribute__((always_inline))
#define STEREOPSIS_RESTRICT __restrict__
#define STEREOPSIS_INLINE inline __attribute__((always_inline))
#define STEREOPSIS_NOINLINE __attribute__((noinline))
#endif

namespace stereopsis {
namespace STEREOPSIS_ISA {

// Unrolled where the compiler still keeps small arrays in registers: before its own unrolling.
template <int I>
struct Constant {
  static constexpr int value = I;
  constexpr operator int() const { return I; }
};
template <int N, int From = 0, class Body>
static STEREOPSIS_INLINE void unrolled(const Body& body) {
  if constexpr (From < N) {
    body(Constant<From>{});
    unrolled<N, From + 1>(body);
  }
}

// What is unrolled and instrumented takes minutes to compile: under the sanitizers it is less.
static constexpr int at_once(int vectors) {
#ifdef STEREOPSIS_SANITIZED
  return vectors < 2 ? vectors : 2;
#else
  return vectors;
#endif
}

// In place of std:: templates, which other units share.
static STEREOPSIS_INLINE int clamp(int v, int lo, int hi) { return v < lo ? lo : v > hi ? hi : v; }
static STEREOPSIS_INLINE int least(int a, int b) { return a < b ? a : b; }
static STEREOPSIS_INLINE int most(int a, int b) { return a > b ? a : b; }
static STEREOPSIS_INLINE int32_t pack16(int low, int high) {
  return static_cast<int32_t>((static_cast<uint32_t>(low) & 0xFFFF) | (static_cast<uint32_t>(high) << 16));
}
template <class T>
static void fill(T value, int count, T* STEREOPSIS_RESTRICT values) {
  for (int x = 0; x < count; ++x) values[x] = value;
}

#if STEREOPSIS_ISA_LEVEL >= STEREOPSIS_ISA_avx512

struct Simd {
  static constexpr int lanes = 16;
  static constexpr int block = at_once(8);  // vectors of disparities held in registers at once
  static constexpr int pixels = 2;          // and pixels whose costs are formed at once
  using I = __m512i;
  using F = __m512;
  using D = __m512d;
  using M = __mmask16;

  static STEREOPSIS_INLINE I load(const int32_t* p) { return _mm512_loadu_si512(p); }
  static STEREOPSIS_INLINE F load(const float* p) { return _mm512_loadu_ps(p); }
  static STEREOPSIS_INLINE void store(int32_t* p, I v) { _mm512_storeu_si512(p, v); }
  static STEREOPSIS_INLINE void store(float* p, F v) { _mm512_storeu_ps(p, v); }
  // The last lane, where `store` has it; of those before some or none.
  static STEREOPSIS_INLINE void store_last(int32_t* p, I v) {
    _mm_storeu_si128(reinterpret_cast<__m128i*>(p + 12), _mm512_extracti32x4_epi32(v, 3));
  }
  static STEREOPSIS_INLINE void store_last(float* p, F v) { _mm_storeu_ps(p + 12, _mm512_extractf32x4_ps(v, 3)); }
  static STEREOPSIS_INLINE I set(int32_t v) { return _mm512_set1_epi32(v); }
  static STEREOPSIS_INLINE F set(float v) { return _mm512_set1_ps(v); }
  static STEREOPSIS_INLINE I add(I a, I b) { return _mm512_add_epi32(a, b); }
  static STEREOPSIS_INLINE I sub(I a, I b) { return _mm512_sub_epi32(a, b); }
  static STEREOPSIS_INLINE F add(F a, F b) { return _mm512_add_ps(a, b); }
  static STEREOPSIS_INLINE F sub(F a, F b) { return _mm512_sub_ps(a, b); }
  static STEREOPSIS_INLINE F mul(F a, F b) { return _mm512_mul_ps(a, b); }
  static STEREOPSIS_INLINE F gather(const float* p, I index) { return _mm512_i32gather_ps(index, p, 4); }
  static STEREOPSIS_INLINE F fused(F a, F b, F c) { return _mm512_fmadd_ps(a, b, c); }
  static STEREOPSIS_INLINE F to_float(I a) { return _mm512_cvtepi32_ps(a); }
  static STEREOPSIS_INLINE I bits(F a) { return _mm512_castps_si512(a); }
  // Keeps a compiler from copying a sum that is to change where it is.
  static STEREOPSIS_INLINE I once(I a) {
#if defined(__GNUC__)
    __asm__("" : "+v"(a));
#endif
    return a;
  }
  // a's bits where `keep` has them, and `put` besides
  static STEREOPSIS_INLINE F mark(F a, I keep, I put) {
    return _mm512_castsi512_ps(_mm512_ternarylogic_epi32(_mm512_castps_si512(a), keep, put, 0xEA));
  }
  static STEREOPSIS_INLINE I mark(I a, I keep, I put) { return _mm512_ternarylogic_epi32(a, keep, put, 0xEA); }
  static STEREOPSIS_INLINE F mask(F a, I keep) {
    return _mm512_castsi512_ps(_mm512_and_si512(_mm512_castps_si512(a), keep));
  }
  static STEREOPSIS_INLINE I mask(I a, int32_t keep) { return _mm512_and_si512(a, set(keep)); }
  // Each lane's sum with those before it.
  static STEREOPSIS_INLINE I running_sum(I a) {
    const I zero = _mm512_setzero_si512();
    a = add(a, _mm512_alignr_epi32(a, zero, 15));
    a = add(a, _mm512_alignr_epi32(a, zero, 14));
    a = add(a, _mm512_alignr_epi32(a, zero, 12));
    return add(a, _mm512_alignr_epi32(a, zero, 8));
  }
  static STEREOPSIS_INLINE I last(I a) { return _mm512_permutexvar_epi32(set(15), a); }
  // The first lane that equals v; there is one.
  static STEREOPSIS_INLINE int first_equal(F a, float v) {
    return __builtin_ctz(_mm512_cmp_ps_mask(a, set(v), _CMP_EQ_OQ));
  }
  // a's lanes one further on, `first` before them
  static STEREOPSIS_INLINE I shift_in(int32_t first, I a) { return _mm512_alignr_epi32(a, set(first), 15); }
  static STEREOPSIS_INLINE F shift_in(float first, F a) {
    return _mm512_castsi512_ps(_mm512_alignr_epi32(_mm512_castps_si512(a), _mm512_castps_si512(set(first)), 15));
  }
  static STEREOPSIS_INLINE M less(F a, F b) { return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ); }
  static STEREOPSIS_INLINE M less(I a, I b) { return _mm512_cmplt_epi32_mask(a, b); }
  static STEREOPSIS_INLINE M inside(I i, int lo, int hi) {
    return _mm512_cmplt_epu32_mask(_mm512_sub_epi32(i, set(lo)), set(hi - lo));
  }
  static STEREOPSIS_INLINE F select(M m, F yes, F no) { return _mm512_mask_mov_ps(no, m, yes); }
  static STEREOPSIS_INLINE I select(M m, I yes, I no) { return _mm512_mask_mov_epi32(no, m, yes); }
  static STEREOPSIS_INLINE F min(F a, F b) { return _mm512_min_ps(a, b); }  // b where a is not a number
  // The same where both are positive, if they are numbers: ordered like their bits, which more of a processor's units compare.
  static STEREOPSIS_INLINE F min_positive(F a, F b) {
    return _mm512_castsi512_ps(_mm512_min_epi32(_mm512_castps_si512(a), _mm512_castps_si512(b)));
  }
  static STEREOPSIS_INLINE I min(I a, I b) { return _mm512_min_epi32(a, b); }
  // The minima of 16 vectors, row(0) to row(15): pairs are folded into one vector, halving what is left each time.
  template <class Row, class T>
  static STEREOPSIS_INLINE void row_minima(const Row& row, T* minima) {
    decltype(row(0)) a[16];
    const auto fold = [&](auto r, auto apart) STEREOPSIS_INLINE_LAMBDA {
      a[r] = min(low_pairs(a[r], a[r + apart]), high_pairs(a[r], a[r + apart]));
    };
    const auto join = [&](auto r, auto apart) STEREOPSIS_INLINE_LAMBDA {
      a[r] = min(even_quarters(a[r], a[r + apart]), odd_quarters(a[r], a[r + apart]));
    };
    unrolled<16>([&](auto r) STEREOPSIS_INLINE_LAMBDA { a[r] = row(r); });
    unrolled<8>([&](auto r) STEREOPSIS_INLINE_LAMBDA { fold(r, Constant<8>{}); });
    unrolled<4>([&](auto r) STEREOPSIS_INLINE_LAMBDA { fold(r, Constant<4>{}); });
    // Each 128-bit part now holds four rows: r, r + 8, r + 4, r + 12 are lanes 0, 2, 1, 3 of it.
    unrolled<2>([&](auto r) STEREOPSIS_INLINE_LAMBDA { join(r, Constant<2>{}); });
    join(Constant<0>{}, Constant<1>{});
    store(minima, in_order(_mm512_setr_epi32(0, 8, 4, 12, 1, 9, 5, 13, 2, 10, 6, 14, 3, 11, 7, 15), a[0]));
  }
  static STEREOPSIS_INLINE F low_pairs(F a, F b) { return _mm512_unpacklo_ps(a, b); }
  static STEREOPSIS_INLINE F high_pairs(F a, F b) { return _mm512_unpackhi_ps(a, b); }
  static STEREOPSIS_INLINE F even_quarters(F a, F b) { return _mm512_shuffle_f32x4(a, b, 0x88); }
  static STEREOPSIS_INLINE F odd_quarters(F a, F b) { return _mm512_shuffle_f32x4(a, b, 0xDD); }
  static STEREOPSIS_INLINE F in_order(I order, F a) { return _mm512_permutexvar_ps(order, a); }
  static STEREOPSIS_INLINE I low_pairs(I a, I b) { return _mm512_unpacklo_epi32(a, b); }
  static STEREOPSIS_INLINE I high_pairs(I a, I b) { return _mm512_unpackhi_epi32(a, b); }
  static STEREOPSIS_INLINE I even_quarters(I a, I b) { return _mm512_shuffle_i32x4(a, b, 0x88); }
  static STEREOPSIS_INLINE I odd_quarters(I a, I b) { return _mm512_shuffle_i32x4(a, b, 0xDD); }
  static STEREOPSIS_INLINE I in_order(I order, I a) { return _mm512_permutexvar_epi32(order, a); }
  static STEREOPSIS_INLINE float reduce_min(F a) { return _mm512_reduce_min_ps(a); }
  static STEREOPSIS_INLINE int32_t reduce_min(I a) { return _mm512_reduce_min_epi32(a); }
  static STEREOPSIS_INLINE M equal(F a, F b) { return _mm512_cmp_ps_mask(a, b, _CMP_EQ_OQ); }
  static STEREOPSIS_INLINE M equal(I a, I b) { return _mm512_cmpeq_epi32_mask(a, b); }
  // acc + a.low * b.low + a.high * b.high, on pairs of int16
  static STEREOPSIS_INLINE I dot16(I acc, I a, I b) {
#if STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx512vnni
    return _mm512_dpwssd_epi32(acc, a, b);
#else
    return _mm512_add_epi32(acc, _mm512_madd_epi16(a, b));
#endif
  }
  // Doubles, half as many a vector.
  static STEREOPSIS_INLINE D load(const double* p) { return _mm512_loadu_pd(p); }
  static STEREOPSIS_INLINE void store(double* p, D v) { _mm512_storeu_pd(p, v); }
  static STEREOPSIS_INLINE D set(double v) { return _mm512_set1_pd(v); }
  static STEREOPSIS_INLINE D add(D a, D b) { return _mm512_add_pd(a, b); }
  static STEREOPSIS_INLINE D sub(D a, D b) { return _mm512_sub_pd(a, b); }
  static STEREOPSIS_INLINE D mul(D a, D b) { return _mm512_mul_pd(a, b); }
  static STEREOPSIS_INLINE D min(D a, D b) { return _mm512_min_pd(a, b); }
  static STEREOPSIS_INLINE D abs(D a) { return _mm512_abs_pd(a); }
  // v where a <= b, else 0.
  static STEREOPSIS_INLINE D where_at_most(D a, D b, D v) { return _mm512_maskz_mov_pd(_mm512_cmp_pd_mask(a, b, _CMP_LE_OQ), v); }
  // The lanes of the lower, and of the upper, half.
  static STEREOPSIS_INLINE D lower(I v) { return _mm512_cvtepi32_pd(_mm512_castsi512_si256(v)); }
  static STEREOPSIS_INLINE D upper(I v) { return _mm512_cvtepi32_pd(_mm512_extracti64x4_epi64(v, 1)); }
  static STEREOPSIS_INLINE void store(float* p, D v) { _mm256_storeu_ps(p, _mm512_cvtpd_ps(v)); }
  static STEREOPSIS_INLINE F to_float(D lower, D upper) {
    return _mm512_insertf32x8(_mm512_castps256_ps512(_mm512_cvtpd_ps(lower)), _mm512_cvtpd_ps(upper), 1);
  }
  // sum + a b where both the product and the result are exact
  static STEREOPSIS_INLINE D add_product(D sum, D a, D b) { return _mm512_fmadd_pd(a, b, sum); }
  static STEREOPSIS_INLINE I times_16(I a) { return _mm512_slli_epi32(a, 4); }
  static STEREOPSIS_INLINE I times_256(I a) { return _mm512_slli_epi32(a, 8); }
  // On pairs of int16, products and differences that fit them.
  static STEREOPSIS_INLINE I mul16(I a, I b) { return _mm512_mullo_epi16(a, b); }
  static STEREOPSIS_INLINE I abs_diff16(I a, I b) { return _mm512_abs_epi16(_mm512_sub_epi16(a, b)); }
  // The bytes of two rows side by side, as pairs of int16.
  static STEREOPSIS_INLINE I pairs(const uint8_t* low, const uint8_t* high) {
    const auto widen = [](const uint8_t* p) {
      return _mm512_cvtepu8_epi32(_mm_loadu_si128(reinterpret_cast<const __m128i*>(p)));
    };
    return _mm512_or_si512(widen(low), _mm512_slli_epi32(widen(high), 16));
  }
  static STEREOPSIS_INLINE I even_bytes(I a) { return _mm512_and_si512(a, _mm512_set1_epi32(0x00FF00FF)); }
  static STEREOPSIS_INLINE I odd_bytes(I a) { return _mm512_srli_epi16(a, 8); }
  static STEREOPSIS_INLINE I abs_diff8(I a, I b) {
    return _mm512_or_si512(_mm512_subs_epu8(a, b), _mm512_subs_epu8(b, a));
  }
#if STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx512vnni
  static constexpr bool has_dot8 = true;
  // acc + the four products of unsigned and signed bytes
  static STEREOPSIS_INLINE I dot8(I acc, I u, I s) { return _mm512_dpbusd_epi32(acc, u, s); }
#else
  static constexpr bool has_dot8 = false;
#endif
};

#elif STEREOPSIS_ISA_LEVEL == STEREOPSIS_ISA_avx2

struct Simd {
  static constexpr int lanes = 8;
  static constexpr int block = at_once(8);
  static constexpr int pixels = 1;
  using I = __m256i;
  using F = __m256;
  using D = __m256d;
  struct M {
    __m256i v;
  };

  static STEREOPSIS_INLINE I load(const int32_t* p) { return _mm256_loadu_si256(reinterpret_cast<const I*>(p)); }
  static STEREOPSIS_INLINE F load(const float* p) { return _mm256_loadu_ps(p); }
  static STEREOPSIS_INLINE void store(int32_t* p, I v) { _mm256_storeu_si256(reinterpret_cast<I*>(p), v); }
  static STEREOPSIS_INLINE void store(float* p, F v) { _mm256_storeu_ps(p, v); }
  static STEREOPSIS_INLINE void store_last(int32_t* p, I v) {
    _mm_storeu_si128(reinterpret_cast<__m128i*>(p + 4), _mm256_extracti128_si256(v, 1));
  }
  static STEREOPSIS_INLINE void store_last(float* p, F v) { _mm_storeu_ps(p + 4, _mm256_extractf128_ps(v, 1)); }
  static STEREOPSIS_INLINE I set(int32_t v) { return _mm256_set1_epi32(v); }
  static STEREOPSIS_INLINE F set(float v) { return _mm256_set1_ps(v); }
  static STEREOPSIS_INLINE I add(I a, I b) { return _mm256_add_epi32(a, b); }
  static STEREOPSIS_INLINE I sub(I a, I b) { return _mm256_sub_epi32(a, b); }
  static STEREOPSIS_INLINE F add(F a, F b) { return _mm256_add_ps(a, b); }
  static STEREOPSIS_INLINE F sub(F a, F b) { return _mm256_sub_ps(a, b); }
  static STEREOPSIS_INLINE F mul(F a, F b) { return _mm256_mul_ps(a, b); }
  static STEREOPSIS_INLINE F gather(const float* p, I index) { return _mm256_i32gather_ps(p, index, 4); }
  static STEREOPSIS_INLINE F fused(F a, F b, F c) { return _mm256_fmadd_ps(a, b, c); }
  static STEREOPSIS_INLINE F to_float(I a) { return _mm256_cvtepi32_ps(a); }
  static STEREOPSIS_INLINE I bits(F a) { return _mm256_castps_si256(a); }
  static STEREOPSIS_INLINE I once(I a) {
#if defined(__GNUC__)
    __asm__("" : "+x"(a));
#endif
    return a;
  }
  static STEREOPSIS_INLINE F mark(F a, I keep, I put) {
    return _mm256_or_ps(_mm256_and_ps(a, _mm256_castsi256_ps(keep)), _mm256_castsi256_ps(put));
  }
  static STEREOPSIS_INLINE I mark(I a, I keep, I put) { return _mm256_or_si256(_mm256_and_si256(a, keep), put); }
  static STEREOPSIS_INLINE F mask(F a, I keep) { return _mm256_and_ps(a, _mm256_castsi256_ps(keep)); }
  static STEREOPSIS_INLINE I mask(I a, int32_t keep) { return _mm256_and_si256(a, set(keep)); }
  static STEREOPSIS_INLINE I running_sum(I a) {
    a = add(a, _mm256_slli_si256(a, 4));
    a = add(a, _mm256_slli_si256(a, 8));
    return add(a, _mm256_permutevar8x32_epi32(_mm256_blend_epi32(a, _mm256_setzero_si256(), 0xF0),
                                              _mm256_setr_epi32(7, 7, 7, 7, 3, 3, 3, 3)));
  }
  static STEREOPSIS_INLINE I last(I a) { return _mm256_permutevar8x32_epi32(a, set(7)); }
  static STEREOPSIS_INLINE int first_equal(F a, float v) {
    return __builtin_ctz(_mm256_movemask_ps(_mm256_cmp_ps(a, set(v), _CMP_EQ_OQ)));
  }
  static STEREOPSIS_INLINE I shift_in(int32_t first, I a) {
    return _mm256_blend_epi32(_mm256_permutevar8x32_epi32(a, _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6)), set(first), 1);
  }
  static STEREOPSIS_INLINE F shift_in(float first, F a) {
    return _mm256_blend_ps(_mm256_permutevar8x32_ps(a, _mm256_setr_epi32(7, 0, 1, 2, 3, 4, 5, 6)), set(first), 1);
  }
  static STEREOPSIS_INLINE M less(F a, F b) { return {_mm256_castps_si256(_mm256_cmp_ps(a, b, _CMP_LT_OQ))}; }
  static STEREOPSIS_INLINE M less(I a, I b) { return {_mm256_cmpgt_epi32(b, a)}; }
  static STEREOPSIS_INLINE M inside(I i, int lo, int hi) {
    return both(less(set(lo - 1), i), less(i, set(hi)));
  }
  static STEREOPSIS_INLINE M both(M a, M b) { return {_mm256_and_si256(a.v, b.v)}; }
  static STEREOPSIS_INLINE F select(M m, F yes, F no) { return _mm256_blendv_ps(no, yes, _mm256_castsi256_ps(m.v)); }
  static STEREOPSIS_INLINE I select(M m, I yes, I no) { return _mm256_blendv_epi8(no, yes, m.v); }
  static STEREOPSIS_INLINE F min(F a, F b) { return _mm256_min_ps(a, b); }
  static STEREOPSIS_INLINE F min_positive(F a, F b) { return min(a, b); }
  static STEREOPSIS_INLINE I min(I a, I b) { return _mm256_min_epi32(a, b); }
  static STEREOPSIS_INLINE float reduce_min(F a) {
    __m128 m = _mm_min_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));
    m = _mm_min_ps(m, _mm_movehl_ps(m, m));
    return _mm_cvtss_f32(_mm_min_ss(m, _mm_shuffle_ps(m, m, 1)));
  }
  static STEREOPSIS_INLINE int32_t reduce_min(I a) {
    __m128i m = _mm_min_epi32(_mm256_castsi256_si128(a), _mm256_extracti128_si256(a, 1));
    m = _mm_min_epi32(m, _mm_shuffle_epi32(m, 0x4E));
    return _mm_cvtsi128_si32(_mm_min_epi32(m, _mm_shuffle_epi32(m, 0xB1)));
  }
  // The minima of 16 vectors, row(0) to row(15), eight at once: pairs are folded into one vector, halving what is left each time.
  template <class Row, class T>
  static STEREOPSIS_INLINE void row_minima(const Row& row, T* minima) {
    for (int first = 0; first < 16; first += lanes) {
      decltype(row(0)) a[lanes];
      const auto fold = [&](auto r, auto apart) STEREOPSIS_INLINE_LAMBDA {
        a[r] = min(low_pairs(a[r], a[r + apart]), high_pairs(a[r], a[r + apart]));
      };
      unrolled<lanes>([&](auto r) STEREOPSIS_INLINE_LAMBDA { a[r] = row(first + r); });
      unrolled<4>([&](auto r) STEREOPSIS_INLINE_LAMBDA { fold(r, Constant<4>{}); });
      unrolled<2>([&](auto r) STEREOPSIS_INLINE_LAMBDA { fold(r, Constant<2>{}); });
      // Each half now holds four rows: r, r + 2, r + 4, r + 6.
      store(minima + first, in_order(_mm256_setr_epi32(0, 4, 1, 5, 2, 6, 3, 7), min(low_halves(a[0], a[1]), high_halves(a[0], a[1]))));
    }
  }
  static STEREOPSIS_INLINE F low_pairs(F a, F b) { return _mm256_unpacklo_ps(a, b); }
  static STEREOPSIS_INLINE F high_pairs(F a, F b) { return _mm256_unpackhi_ps(a, b); }
  static STEREOPSIS_INLINE F low_halves(F a, F b) { return _mm256_permute2f128_ps(a, b, 0x20); }
  static STEREOPSIS_INLINE F high_halves(F a, F b) { return _mm256_permute2f128_ps(a, b, 0x31); }
  static STEREOPSIS_INLINE F in_order(I order, F a) { return _mm256_permutevar8x32_ps(a, order); }
  static STEREOPSIS_INLINE I low_pairs(I a, I b) { return _mm256_unpacklo_epi32(a, b); }
  static STEREOPSIS_INLINE I high_pairs(I a, I b) { return _mm256_unpackhi_epi32(a, b); }
  static STEREOPSIS_INLINE I low_halves(I a, I b) { return _mm256_permute2x128_si256(a, b, 0x20); }
  static STEREOPSIS_INLINE I high_halves(I a, I b) { return _mm256_permute2x128_si256(a, b, 0x31); }
  static STEREOPSIS_INLINE I in_order(I order, I a) { return _mm256_permutevar8x32_epi32(a, order); }
  static STEREOPSIS_INLINE M equal(F a, F b) { return {_mm256_castps_si256(_mm256_cmp_ps(a, b, _CMP_EQ_OQ))}; }
  static STEREOPSIS_INLINE M equal(I a, I b) { return {_mm256_cmpeq_epi32(a, b)}; }
  static STEREOPSIS_INLINE I dot16(I acc, I a, I b) { return _mm256_add_epi32(acc, _mm256_madd_epi16(a, b)); }
  static STEREOPSIS_INLINE D load(const double* p) { return _mm256_loadu_pd(p); }
  static STEREOPSIS_INLINE void store(double* p, D v) { _mm256_storeu_pd(p, v); }
  static STEREOPSIS_INLINE D set(double v) { return _mm256_set1_pd(v); }
  static STEREOPSIS_INLINE D add(D a, D b) { return _mm256_add_pd(a, b); }
  static STEREOPSIS_INLINE D sub(D a, D b) { return _mm256_sub_pd(a, b); }
  static STEREOPSIS_INLINE D mul(D a, D b) { return _mm256_mul_pd(a, b); }
  static STEREOPSIS_INLINE D min(D a, D b) { return _mm256_min_pd(a, b); }
  static STEREOPSIS_INLINE D abs(D a) { return _mm256_andnot_pd(set(-0.0), a); }
  static STEREOPSIS_INLINE D where_at_most(D a, D b, D v) { return _mm256_and_pd(_mm256_cmp_pd(a, b, _CMP_LE_OQ), v); }
  static STEREOPSIS_INLINE D lower(I v) { return _mm256_cvtepi32_pd(_mm256_castsi256_si128(v)); }
  static STEREOPSIS_INLINE D upper(I v) { return _mm256_cvtepi32_pd(_mm256_extracti128_si256(v, 1)); }
  static STEREOPSIS_INLINE void store(float* p, D v) { _mm_storeu_ps(p, _mm256_cvtpd_ps(v)); }
  static STEREOPSIS_INLINE F to_float(D lower, D upper) { return _mm256_set_m128(_mm256_cvtpd_ps(upper), _mm256_cvtpd_ps(lower)); }
  static STEREOPSIS_INLINE D add_product(D sum, D a, D b) { return _mm256_fmadd_pd(a, b, sum); }
  static STEREOPSIS_INLINE I times_16(I a) { return _mm256_slli_epi32(a, 4); }
  static STEREOPSIS_INLINE I times_256(I a) { return _mm256_slli_epi32(a, 8); }
  static STEREOPSIS_INLINE I mul16(I a, I b) { return _mm256_mullo_epi16(a, b); }
  static STEREOPSIS_INLINE I abs_diff16(I a, I b) { return _mm256_abs_epi16(_mm256_sub_epi16(a, b)); }
  static STEREOPSIS_INLINE I pairs(const uint8_t* low, const uint8_t* high) {
    const auto widen = [](const uint8_t* p) {
      return _mm256_cvtepu8_epi32(_mm_loadl_epi64(reinterpret_cast<const __m128i*>(p)));
    };
    return _mm256_or_si256(widen(low), _mm256_slli_epi32(widen(high), 16));
  }
  static STEREOPSIS_INLINE I even_bytes(I a) { return _mm256_and_si256(a, _mm256_set1_epi32(0x00FF00FF)); }
  static STEREOPSIS_INLINE I odd_bytes(I a) { return _mm256_srli_epi16(a, 8); }
  static STEREOPSIS_INLINE I abs_diff8(I a, I b) {
    return _mm256_or_si256(_mm256_subs_epu8(a, b), _mm256_subs_epu8(b, a));
  }
  static constexpr bool has_dot8 = false;
};

#else

// Plain arrays: what every compiler turns into whatever the machine has.
struct Simd {
  static constexpr int lanes = 8;
  static constexpr int block = at_once(2);
  static constexpr int pixels = 1;
  struct I {
    int32_t v[lanes];
  };
  struct F {
    float v[lanes];
  };
  struct D {
    double v[lanes / 2];
  };
  struct M {
    int32_t v[lanes];  // 0 or -1
  };
#define STEREOPSIS_EACH(R, expression)                \
  R r;                                                \
  for (int i = 0; i < lanes; ++i) r.v[i] = expression; \
  return r

  static STEREOPSIS_INLINE I load(const int32_t* p) { STEREOPSIS_EACH(I, p[i]); }
  static STEREOPSIS_INLINE F load(const float* p) { STEREOPSIS_EACH(F, p[i]); }
  static STEREOPSIS_INLINE void store(int32_t* p, const I& v) { std::memcpy(p, v.v, sizeof v.v); }
  static STEREOPSIS_INLINE void store(float* p, const F& v) { std::memcpy(p, v.v, sizeof v.v); }
  static STEREOPSIS_INLINE void store_last(int32_t* p, const I& v) { p[lanes - 1] = v.v[lanes - 1]; }
  static STEREOPSIS_INLINE void store_last(float* p, const F& v) { p[lanes - 1] = v.v[lanes - 1]; }
  static STEREOPSIS_INLINE I set(int32_t v) { STEREOPSIS_EACH(I, v); }
  static STEREOPSIS_INLINE F set(float v) { STEREOPSIS_EACH(F, v); }
  // Sums wrap, as the vector instructions do; the totals that matter are bounded.
  static STEREOPSIS_INLINE int32_t wrap(uint32_t v) { return static_cast<int32_t>(v); }
  static STEREOPSIS_INLINE I add(const I& a, const I& b) {
    STEREOPSIS_EACH(I, wrap(static_cast<uint32_t>(a.v[i]) + static_cast<uint32_t>(b.v[i])));
  }
  static STEREOPSIS_INLINE I sub(const I& a, const I& b) {
    STEREOPSIS_EACH(I, wrap(static_cast<uint32_t>(a.v[i]) - static_cast<uint32_t>(b.v[i])));
  }
  static STEREOPSIS_INLINE F add(const F& a, const F& b) { STEREOPSIS_EACH(F, a.v[i] + b.v[i]); }
  static STEREOPSIS_INLINE F sub(const F& a, const F& b) { STEREOPSIS_EACH(F, a.v[i] - b.v[i]); }
  static STEREOPSIS_INLINE F gather(const float* p, const I& index) { STEREOPSIS_EACH(F, p[index.v[i]]); }
  static STEREOPSIS_INLINE F mul(const F& a, const F& b) { STEREOPSIS_EACH(F, a.v[i] * b.v[i]); }
  static STEREOPSIS_INLINE F fused(const F& a, const F& b, const F& c) {
    STEREOPSIS_EACH(F, stereopsis::fused(a.v[i], b.v[i], c.v[i]));
  }
  static STEREOPSIS_INLINE F to_float(const I& a) { STEREOPSIS_EACH(F, static_cast<float>(a.v[i])); }
  static STEREOPSIS_INLINE I once(const I& a) { return a; }
  static STEREOPSIS_INLINE I bits(const F& a) {
    I r;
    std::memcpy(r.v, a.v, sizeof r.v);
    return r;
  }
  static STEREOPSIS_INLINE float with_bits(float a, int32_t keep, int32_t put) {
    int32_t bits;
    std::memcpy(&bits, &a, sizeof bits);
    bits = (bits & keep) | put;
    std::memcpy(&a, &bits, sizeof bits);
    return a;
  }
  static STEREOPSIS_INLINE F mark(const F& a, const I& keep, const I& put) {
    STEREOPSIS_EACH(F, with_bits(a.v[i], keep.v[i], put.v[i]));
  }
  static STEREOPSIS_INLINE I mark(const I& a, const I& keep, const I& put) { STEREOPSIS_EACH(I, (a.v[i] & keep.v[i]) | put.v[i]); }
  static STEREOPSIS_INLINE F mask(const F& a, const I& keep) { STEREOPSIS_EACH(F, with_bits(a.v[i], keep.v[i], 0)); }
  static STEREOPSIS_INLINE I mask(const I& a, int32_t keep) { STEREOPSIS_EACH(I, a.v[i] & keep); }
  static STEREOPSIS_INLINE I running_sum(I a) {
    for (int i = 1; i < lanes; ++i) a.v[i] = wrap(static_cast<uint32_t>(a.v[i]) + static_cast<uint32_t>(a.v[i - 1]));
    return a;
  }
  static STEREOPSIS_INLINE I last(const I& a) { return set(a.v[lanes - 1]); }
  static STEREOPSIS_INLINE int first_equal(const F& a, float v) {
    int i = 0;
    while (i + 1 < lanes && a.v[i] != v) ++i;
    return i;
  }
  static STEREOPSIS_INLINE I shift_in(int32_t first, const I& a) { STEREOPSIS_EACH(I, i > 0 ? a.v[i - 1] : first); }
  static STEREOPSIS_INLINE F shift_in(float first, const F& a) { STEREOPSIS_EACH(F, i > 0 ? a.v[i - 1] : first); }
  static STEREOPSIS_INLINE M less(const F& a, const F& b) { STEREOPSIS_EACH(M, -(a.v[i] < b.v[i])); }
  static STEREOPSIS_INLINE M less(const I& a, const I& b) { STEREOPSIS_EACH(M, -(a.v[i] < b.v[i])); }
  static STEREOPSIS_INLINE M inside(const I& a, int lo, int hi) {
    STEREOPSIS_EACH(M, -((a.v[i] >= lo) & (a.v[i] < hi)));
  }
  static STEREOPSIS_INLINE F select(const M& m, const F& yes, const F& no) {
    STEREOPSIS_EACH(F, m.v[i] ? yes.v[i] : no.v[i]);
  }
  static STEREOPSIS_INLINE I select(const M& m, const I& yes, const I& no) {
    STEREOPSIS_EACH(I, m.v[i] ? yes.v[i] : no.v[i]);
  }
  static STEREOPSIS_INLINE F min(const F& a, const F& b) { STEREOPSIS_EACH(F, a.v[i] < b.v[i] ? a.v[i] : b.v[i]); }
  static STEREOPSIS_INLINE F min_positive(const F& a, const F& b) { return min(a, b); }
  static STEREOPSIS_INLINE I min(const I& a, const I& b) { STEREOPSIS_EACH(I, b.v[i] < a.v[i] ? b.v[i] : a.v[i]); }
  template <class V>
  static STEREOPSIS_INLINE auto reduce_min(const V& a) {
    auto m = a.v[0];
    for (int i = 1; i < lanes; ++i) m = a.v[i] < m ? a.v[i] : m;
    return m;
  }
  template <class Row, class T>
  static STEREOPSIS_INLINE void row_minima(const Row& row, T* minima) {
    for (int r = 0; r < 16; ++r) minima[r] = reduce_min(row(r));
  }
  static STEREOPSIS_INLINE M equal(const F& a, const F& b) { STEREOPSIS_EACH(M, -(a.v[i] == b.v[i])); }
  static STEREOPSIS_INLINE M equal(const I& a, const I& b) { STEREOPSIS_EACH(M, -(a.v[i] == b.v[i])); }
  static STEREOPSIS_INLINE int32_t low(int32_t v) { return static_cast<int16_t>(v & 0xFFFF); }
  static STEREOPSIS_INLINE int32_t high(int32_t v) { return v >> 16; }
  static STEREOPSIS_INLINE I dot16(const I& acc, const I& a, const I& b) {
    STEREOPSIS_EACH(I, wrap(static_cast<uint32_t>(acc.v[i]) +
                            static_cast<uint32_t>(low(a.v[i]) * low(b.v[i]) + high(a.v[i]) * high(b.v[i]))));
  }
#define STEREOPSIS_EACH_DOUBLE(expression)               \
  D r;                                                    \
  for (int i = 0; i < lanes / 2; ++i) r.v[i] = expression; \
  return r
  static STEREOPSIS_INLINE D load(const double* p) { STEREOPSIS_EACH_DOUBLE(p[i]); }
  static STEREOPSIS_INLINE void store(double* p, const D& v) { std::memcpy(p, v.v, sizeof v.v); }
  static STEREOPSIS_INLINE D set(double v) { STEREOPSIS_EACH_DOUBLE(v); }
  static STEREOPSIS_INLINE D add(const D& a, const D& b) { STEREOPSIS_EACH_DOUBLE(a.v[i] + b.v[i]); }
  static STEREOPSIS_INLINE D sub(const D& a, const D& b) { STEREOPSIS_EACH_DOUBLE(a.v[i] - b.v[i]); }
  static STEREOPSIS_INLINE D mul(const D& a, const D& b) { STEREOPSIS_EACH_DOUBLE(a.v[i] * b.v[i]); }
  static STEREOPSIS_INLINE D min(const D& a, const D& b) { STEREOPSIS_EACH_DOUBLE(a.v[i] < b.v[i] ? a.v[i] : b.v[i]); }
  static STEREOPSIS_INLINE D abs(const D& a) { STEREOPSIS_EACH_DOUBLE(a.v[i] < 0 ? -a.v[i] : a.v[i]); }
  static STEREOPSIS_INLINE D where_at_most(const D& a, const D& b, const D& v) { STEREOPSIS_EACH_DOUBLE(a.v[i] <= b.v[i] ? v.v[i] : 0.0); }
  static STEREOPSIS_INLINE D lower(const I& a) { STEREOPSIS_EACH_DOUBLE(static_cast<double>(a.v[i])); }
  static STEREOPSIS_INLINE D upper(const I& a) { STEREOPSIS_EACH_DOUBLE(static_cast<double>(a.v[i + lanes / 2])); }
  static STEREOPSIS_INLINE void store(float* p, const D& v) {
    for (int i = 0; i < lanes / 2; ++i) p[i] = static_cast<float>(v.v[i]);
  }
  static STEREOPSIS_INLINE F to_float(const D& lower, const D& upper) {
    F r;
    for (int i = 0; i < lanes; ++i) r.v[i] = static_cast<float>(i < lanes / 2 ? lower.v[i] : upper.v[i - lanes / 2]);
    return r;
  }
  static STEREOPSIS_INLINE D add_product(const D& sum, const D& a, const D& b) { STEREOPSIS_EACH_DOUBLE(sum.v[i] + a.v[i] * b.v[i]); }
  static STEREOPSIS_INLINE I times_16(const I& a) { STEREOPSIS_EACH(I, wrap(static_cast<uint32_t>(a.v[i]) << 4)); }
  static STEREOPSIS_INLINE I times_256(const I& a) { STEREOPSIS_EACH(I, wrap(static_cast<uint32_t>(a.v[i]) << 8)); }
#undef STEREOPSIS_EACH_DOUBLE
  static STEREOPSIS_INLINE int32_t both16(int32_t lower, int32_t upper) {
    return static_cast<int32_t>((static_cast<uint32_t>(lower) & 0xFFFF) | static_cast<uint32_t>(upper) << 16);
  }
  static STEREOPSIS_INLINE int32_t apart(int32_t a, int32_t b) { return a < b ? b - a : a - b; }
  static STEREOPSIS_INLINE I mul16(const I& a, const I& b) {
    STEREOPSIS_EACH(I, both16(low(a.v[i]) * low(b.v[i]), high(a.v[i]) * high(b.v[i])));
  }
  static STEREOPSIS_INLINE I abs_diff16(const I& a, const I& b) {
    STEREOPSIS_EACH(I, both16(apart(low(a.v[i]), low(b.v[i])), apart(high(a.v[i]), high(b.v[i]))));
  }
  static STEREOPSIS_INLINE I pairs(const uint8_t* low, const uint8_t* high) { STEREOPSIS_EACH(I, both16(low[i], high[i])); }
  static STEREOPSIS_INLINE I even_bytes(const I& a) { STEREOPSIS_EACH(I, a.v[i] & 0x00FF00FF); }
  static STEREOPSIS_INLINE I odd_bytes(const I& a) { STEREOPSIS_EACH(I, (a.v[i] >> 8) & 0x00FF00FF); }
  static STEREOPSIS_INLINE uint32_t byte_diff(uint32_t a, uint32_t b, int shift) {
    const uint32_t p = (a >> shift) & 255, q = (b >> shift) & 255;
    return (p > q ? p - q : q - p) << shift;
  }
  static STEREOPSIS_INLINE I abs_diff8(const I& a, const I& b) {
    STEREOPSIS_EACH(I, wrap(byte_diff(a.v[i], b.v[i], 0) | byte_diff(a.v[i], b.v[i], 8) |
                            byte_diff(a.v[i], b.v[i], 16) | byte_diff(a.v[i], b.v[i], 24)));
  }
  static constexpr bool has_dot8 = false;
#undef STEREOPSIS_EACH
};

#endif

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
