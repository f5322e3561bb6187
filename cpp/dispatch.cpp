#include "dispatch.hpp"

#include <stdexcept>

#include "pixelwise.hpp"

#if defined(STEREOPSIS_X86) && defined(_MSC_VER)
#include <immintrin.h>
#include <intrin.h>
#endif

namespace stereopsis {

namespace generic {
extern const FusedKernel kernel;
extern const PixelwiseKernels pixelwise;
}

#if defined(STEREOPSIS_X86)
namespace avx2 {
extern const FusedKernel kernel;
extern const PixelwiseKernels pixelwise;
}
namespace avx512 {
extern const FusedKernel kernel;
extern const PixelwiseKernels pixelwise;
}
namespace avx512vnni {
extern const FusedKernel kernel;
}
namespace avx512popcnt {
extern const PixelwiseKernels pixelwise;
}

namespace {

struct Features {
  bool avx2, avx512, vnni, popcnt;
};

#if defined(_MSC_VER)
Features features() {
  int r[4];
  __cpuid(r, 0);
  if (r[0] < 7) return {};
  __cpuidex(r, 1, 0);
  if (!(r[2] & (1 << 27))) return {};  // the operating system keeps no wide registers
  const bool fma = r[2] >> 12 & 1;
  const unsigned long long kept = _xgetbv(0);
  __cpuidex(r, 7, 0);
  const bool ymm = (kept & 0x6) == 0x6, zmm = (kept & 0xE6) == 0xE6;
  const bool avx512 = (r[1] >> 16 & 1) && (r[1] >> 17 & 1) && (r[1] >> 30 & 1) && (r[1] >> 31 & 1);
  return {ymm && fma && (r[1] >> 5 & 1), zmm && avx512, zmm && avx512 && (r[2] >> 11 & 1), zmm && avx512 && (r[2] >> 14 & 1)};
}
#else
Features features() {
  __builtin_cpu_init();
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  return {__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"), avx512, avx512 && __builtin_cpu_supports("avx512vnni"),
          avx512 && __builtin_cpu_supports("avx512vpopcntdq")};
}
#endif

}  // namespace
#endif

std::vector<const FusedKernel*> available_kernels() {
  std::vector<const FusedKernel*> kernels;
#if defined(STEREOPSIS_X86)
  const Features has = features();
  if (has.vnni) kernels.push_back(&avx512vnni::kernel);
  if (has.avx512) kernels.push_back(&avx512::kernel);
  if (has.avx2) kernels.push_back(&avx2::kernel);
#endif
  kernels.push_back(&generic::kernel);
  return kernels;
}

const FusedKernel& choose_kernel(const std::string& name) {
  const auto kernels = available_kernels();
  if (name.empty()) return *kernels.front();
  std::string allowed;
  for (const FusedKernel* kernel : kernels) {
    if (name == kernel->name) return *kernel;
    allowed += (allowed.empty() ? "" : ", ") + std::string(kernel->name);
  }
  throw std::invalid_argument("instruction set must be one of " + allowed + " on this machine, not '" + name + "'");
}

const PixelwiseKernels& choose_pixelwise(const std::string& name) {
  const std::string chosen = choose_kernel(name).name;
#if defined(STEREOPSIS_X86)
  // Counting bits is an instruction of its own, that not every machine with the newest set has.
  if (chosen == "avx512vnni") return features().popcnt ? avx512popcnt::pixelwise : avx512::pixelwise;
  if (chosen == "avx512") return avx512::pixelwise;
  if (chosen == "avx2") return avx2::pixelwise;
#endif
  return generic::pixelwise;
}

}  // namespace stereopsis
