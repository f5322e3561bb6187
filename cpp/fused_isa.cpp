// One build of the streaming kernels, for the instruction set that STEREOPSIS_ISA names.
#include "deep.hpp"
#include "fused_gaussian.hpp"
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

}  // namespace

extern const DeepKernel deep;

namespace {

bool is_deep(const Pair& pair, const FusedSettings& settings, bool narrow) {
  return !narrow && deep_fits(settings.cost, settings.range, settings.window, pair.channels);
}

size_t scratch_bytes(const Pair& pair, const FusedSettings& settings, bool narrow) {
  if (is_deep(pair, settings, narrow)) return deep.scratch_bytes(pair, settings);
  size_t bytes = 0;
  with_kernel(pair, settings, narrow, nullptr, [&](const auto& kernel) { bytes = kernel.bytes(); });
  return bytes;
}

void rows(const Pair& pair, const FusedSettings& settings, bool narrow, const FusedOutput& out, RowsToTake& rows,
          void* scratch, const Cancel& cancel) {
  if (!rows.any()) return;
  if (is_deep(pair, settings, narrow)) return deep.rows(pair, settings, out, rows, scratch, cancel);
  with_kernel(pair, settings, narrow, scratch, [&](auto&& kernel) { kernel.rows(out, rows, cancel); });
}

template <class Visit>
void with_gaussian_cost(CostKind cost, Visit visit) {
  switch (cost) {
    case CostKind::sad:
      return visit(std::integral_constant<CostKind, CostKind::sad>{});
    case CostKind::ssd:
      return visit(std::integral_constant<CostKind, CostKind::ssd>{});
    case CostKind::zssd:
      return visit(std::integral_constant<CostKind, CostKind::zssd>{});
    case CostKind::ncc:
      return visit(std::integral_constant<CostKind, CostKind::ncc>{});
    case CostKind::zncc:
      return visit(std::integral_constant<CostKind, CostKind::zncc>{});
    case CostKind::zsad:
      return;  // its terms depend on the window
  }
}

template <class Visit>
void with_gaussian_rows(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, void* memory,
                        Visit visit) {
  with_gaussian_cost(settings.cost, [&](auto cost) {
    if (pair.channels == 1)
      visit(GaussianRows<decltype(cost)::value, 1>(pair, settings, filter, memory));
    else
      visit(GaussianRows<decltype(cost)::value, 3>(pair, settings, filter, memory));
  });
}

template <bool Absolute, class Visit>
void with_channels(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, void* memory, Visit visit) {
  if (pair.channels == 1)
    visit(GaussianKnots<Absolute, 1>(pair, settings, filter, memory));
  else
    visit(GaussianKnots<Absolute, 3>(pair, settings, filter, memory));
}

template <class Visit>
void with_gaussian_knots(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, void* memory,
                         Visit visit) {
  if (settings.cost == CostKind::sad)
    with_channels<true>(pair, settings, filter, memory, visit);
  else
    with_channels<false>(pair, settings, filter, memory, visit);
}

size_t gaussian_knots_bytes(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter) {
  size_t bytes = 0;
  with_gaussian_knots(pair, settings, filter, nullptr, [&](const auto& kernel) { bytes = kernel.bytes(); });
  return bytes;
}

void gaussian_knots(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, const KnotRows& rows,
                    int begin, int end, void* scratch, const Cancel& cancel) {
  with_gaussian_knots(pair, settings, filter, scratch, [&](auto&& kernel) { kernel.make(rows, begin, end, cancel); });
}

size_t gaussian_rows_bytes(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter) {
  size_t bytes = 0;
  with_gaussian_rows(pair, settings, filter, nullptr, [&](const auto& kernel) { bytes = kernel.bytes(); });
  return bytes;
}

void gaussian_rows(const Pair& pair, const FusedSettings& settings, const GaussianFilter& filter, const KnotRows& knots,
                   const FusedOutput& out, int begin, int end, void* scratch, const Cancel& cancel) {
  with_gaussian_rows(pair, settings, filter, scratch,
                     [&](auto&& kernel) { kernel.rows(knots, out, begin, end, cancel); });
}

const GaussianKernel gaussian = {gaussian_knots_bytes, gaussian_knots, GaussianKnots<false, 1>::filter, gaussian_rows_bytes,
                                 gaussian_rows};

#define STEREOPSIS_TEXT_(name) #name
#define STEREOPSIS_TEXT(name) STEREOPSIS_TEXT_(name)

}  // namespace

extern const SupportKernels supports;
extern const FusedKernel kernel;
const FusedKernel kernel = {STEREOPSIS_TEXT(STEREOPSIS_ISA), scratch_bytes, rows, &supports, &gaussian};

}  // namespace STEREOPSIS_ISA
}  // namespace stereopsis
