// One build of the streaming kernels, for the instruction set that STEREOPSIS_ISA names.
#include "fused_narrow.hpp"
#include "fused_wide.hpp"

namespace stereopsis {
namespace STEREOPSIS_ISA {
namespace {

template <CostKind Kind, class Visit>
void with_cost(const Pair& pair, const FusedSettings& settings, bool narrow, void* memory, Visit visit) {
  if constexpr (Kind != CostKind::zsad)
    if (narrow) {
      if (pair.channels == 1)
        visit(Narrow<Kind, 1>(pair, settings, memory));
      else
        visit(Narrow<Kind, 3>(pair, settings, memory));
      return;
    }
  visit(Wide<Kind>(pair, settings, memory));
}

template <class Visit>
void with_kernel(const Pair& pair, const FusedSettings& settings, bool narrow, void* memory, Visit visit) {
  switch (settings.cost) {
    case CostKind::sad:
      return with_cost<CostKind::sad>(pair, settings, narrow, memory, visit);
    case CostKind::ssd:
      return with_cost<CostKind::ssd>(pair, settings, narrow, memory, visit);
    case CostKind::zsad:
      return with_cost<CostKind::zsad>(pair, settings, narrow, memory, visit);
    case CostKind::zssd:
      return with_cost<CostKind::zssd>(pair, settings, narrow, memory, visit);
    case CostKind::ncc:
      return with_cost<CostKind::ncc>(pair, settings, narrow, memory, visit);
    case CostKind::zncc:
      return with_cost<CostKind::zncc>(pair, settings, narrow, memory, visit);
  }
}

size_t scratch_bytes(const Pair& pair, const FusedSettings& settings, bool narrow) {
  size_t bytes = 0;
  with_kernel(pair, settings, narrow, nullptr, [&](const auto& kernel) { bytes = kernel.bytes(); });
  return bytes;
}

void rows(const Pair& pair, const FusedSettings& settings, bool narrow, const FusedOutput& out, int begin, int end,
          void* scratch, const Cancel& cancel) {
  with_kernel(pair, settings, narrow, scratch, [&](auto&& kernel) { kernel.rows(out, begin, end, cancel); });
}

#define STEREOPSIS_TEXT_(name) #name
#define STEREOPSIS_TEXT(name) STEREOPSIS_TEXT_(name)

}  // namespace

extern const SupportKernels supports;
extern const FusedKernel kernel;
const FusedKernel kernel = {STEREOPSIS_TEXT(STEREOPSIS_ISA), scratch_bytes, rows, &supports};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
