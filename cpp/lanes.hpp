// Four floats at a time, alike on every machine: what is summed in four strands rounds the same everywhere.
#pragma once

#include <cstdint>
#include <cstring>

namespace stereopsis {

constexpr int kLanes = 4;

#if defined(__GNUC__)

// NOLINTNEXTLINE: a typedef is what the attribute wants
typedef float Lanes __attribute__((vector_size(16)));
typedef int32_t LaneMask __attribute__((vector_size(16)));

inline Lanes choose(LaneMask where, Lanes yes, Lanes no) {
  return reinterpret_cast<Lanes>((where & reinterpret_cast<LaneMask>(yes)) | (~where & reinterpret_cast<LaneMask>(no)));
}

#else

struct LaneMask {
  bool at[kLanes];
};
struct Lanes {
  float at[kLanes];
  float operator[](int k) const { return at[k]; }
};
#define STEREOPSIS_LANES(op)                                              \
  inline Lanes operator op(const Lanes& a, const Lanes& b) {              \
    Lanes out;                                                            \
    for (int k = 0; k < kLanes; ++k) out.at[k] = a.at[k] op b.at[k];      \
    return out;                                                           \
  }                                                                       \
  inline Lanes operator op(const Lanes& a, float b) { return a op Lanes{{b, b, b, b}}; } \
  inline Lanes operator op(float a, const Lanes& b) { return Lanes{{a, a, a, a}} op b; }
STEREOPSIS_LANES(+)
STEREOPSIS_LANES(-)
STEREOPSIS_LANES(*)
#undef STEREOPSIS_LANES
inline Lanes& operator+=(Lanes& a, const Lanes& b) { return a = a + b; }
inline LaneMask operator>=(const Lanes& a, float b) {
  LaneMask out;
  for (int k = 0; k < kLanes; ++k) out.at[k] = a.at[k] >= b;
  return out;
}
inline Lanes choose(const LaneMask& where, const Lanes& yes, const Lanes& no) {
  Lanes out;
  for (int k = 0; k < kLanes; ++k) out.at[k] = where.at[k] ? yes.at[k] : no.at[k];
  return out;
}

#endif

inline Lanes load(const float* from) {
  Lanes lanes;
  std::memcpy(&lanes, from, sizeof lanes);
  return lanes;
}
inline double total(const Lanes& lanes) {
  double sum = 0;
  for (int k = 0; k < kLanes; ++k) sum += lanes[k];
  return sum;
}

}  // namespace stereopsis
