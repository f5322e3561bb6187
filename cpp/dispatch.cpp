#include "dispatch.hpp"

#include <stdexcept>

#include "photometric.hpp"
#include "pixelwise.hpp"
#include "planar.hpp"
#include "rows.hpp"
#include "sgm.hpp"

#if defined(STEREOPSIS_X86) && defined(_MSC_VER)
#include <immintrin.h>
#include <intrin.h>
#endif

namespace stereopsis {

namespace generic {
extern const FusedKernel kernel;
extern const PhotometricKernel photometric;
extern const PixelwiseKernels pixelwise;
extern const PlanarKernel planar;
extern const RowKernels rows;
extern const SgmKernels sgm;
}  // namespace generic

#if defined(STEREOPSIS_X86)
namespace avx2 {
extern const FusedKernel kernel;
extern const PhotometricKernel photometric;
extern const PixelwiseKernels pixelwise;
extern const PlanarKernel planar;
extern const RowKernels rows;
extern const SgmKernels sgm;
}  // namespace avx2
namespace avx512 {
extern const FusedKernel kernel;
extern const PhotometricKernel photometric;
extern const PixelwiseKernels pixelwise;
extern const PlanarKernel planar;
extern const RowKernels rows;
extern const SgmKernels sgm;
}  // namespace avx512
namespace avx512vnni {
extern const FusedKernel kernel;
}
namespace avx512popcnt {
extern const PixelwiseKernels pixelwise;
}
namespace avx512bitalg {
extern const SgmKernels sgm;
}

namespace {

struct Features {
  bool avx2, avx512, vnni, popcnt, bitalg;
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
  return {ymm && fma && (r[1] >> 5 & 1), zmm && avx512, zmm && avx512 && (r[2] >> 11 & 1), zmm && avx512 && (r[2] >> 14 & 1),
          zmm && avx512 && (r[2] >> 12 & 1) && (r[2] >> 14 & 1) && (r[2] >> 1 & 1) && (r[2] >> 6 & 1)};
}
#else
Features features() {
  __builtin_cpu_init();
  const bool avx512 = __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
  return {__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma"), avx512, avx512 && __builtin_cpu_supports("avx512vnni"),
          avx512 && __builtin_cpu_supports("avx512vpopcntdq"),
          avx512 && __builtin_cpu_supports("avx512bitalg") && __builtin_cpu_supports("avx512vpopcntdq") &&
              __builtin_cpu_supports("avx512vbmi") && __builtin_cpu_supports("avx512vbmi2")};
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

namespace {

// Of four builds the one that goes with the named set. Counting bits takes instructions of their own, which not every
// processor with the newest set has.
template <class Kernels>
const Kernels& build_for(const std::string& name, const Kernels& plain, const Kernels* avx2, const Kernels* avx512,
                         const Kernels* counting) {
  const std::string chosen = choose_kernel(name).name;
  if (chosen == "avx512vnni" && counting) return *counting;
  if (chosen == "avx512vnni" || chosen == "avx512") return *avx512;
  return chosen == "avx2" ? *avx2 : plain;
}

}  // namespace

#if defined(STEREOPSIS_X86)
const PhotometricKernel& choose_photometric(const std::string& name) {
  return build_for<PhotometricKernel>(name, generic::photometric, &avx2::photometric, &avx512::photometric, nullptr);
}
const PixelwiseKernels& choose_pixelwise(const std::string& name) {
  return build_for(name, generic::pixelwise, &avx2::pixelwise, &avx512::pixelwise,
                   features().popcnt ? &avx512popcnt::pixelwise : nullptr);
}
const SgmKernels& choose_sgm(const std::string& name) {
  return build_for(name, generic::sgm, &avx2::sgm, &avx512::sgm, features().bitalg ? &avx512bitalg::sgm : nullptr);
}
const PlanarKernel& choose_planar(const std::string& name) {
  return build_for<PlanarKernel>(name, generic::planar, &avx2::planar, &avx512::planar, nullptr);
}
const RowKernels& choose_rows(const std::string& name) {
  return build_for<RowKernels>(name, generic::rows, &avx2::rows, &avx512::rows, nullptr);
}
#else
const PhotometricKernel& choose_photometric(const std::string& name) {
  return build_for<PhotometricKernel>(name, generic::photometric, nullptr, nullptr, nullptr);
}
const PixelwiseKernels& choose_pixelwise(const std::string& name) {
  return build_for<PixelwiseKernels>(name, generic::pixelwise, nullptr, nullptr, nullptr);
}
const SgmKernels& choose_sgm(const std::string& name) { return build_for<SgmKernels>(name, generic::sgm, nullptr, nullptr, nullptr); }
const PlanarKernel& choose_planar(const std::string& name) {
  return build_for<PlanarKernel>(name, generic::planar, nullptr, nullptr, nullptr);
}
const RowKernels& choose_rows(const std::string& name) {
  return build_for<RowKernels>(name, generic::rows, nullptr, nullptr, nullptr);
}
#endif

}  // namespace stereopsis
