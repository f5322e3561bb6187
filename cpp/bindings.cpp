// The only file that knows Python: checks what it is handed, releases the GIL, calls.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "dispatch.hpp"
#include "parallel.hpp"
#include "stages.hpp"

namespace nb = nanobind;
using namespace stereopsis;

namespace {

template <class T, int N>
using Array = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

// Runs `work` without the GIL; a signal that reaches Python meanwhile ends it.
template <class Work>
void run(int threads, Work work) {
  const Workers workers{resolve_threads(threads), [] {
                          const nb::gil_scoped_acquire gil;
                          return PyErr_CheckSignals() != 0;
                        }};
  try {
    const nb::gil_scoped_release release;
    work(workers);
  } catch (const Interrupted&) {
    throw nb::python_error();
  }
}

template <class T>
Pair pair_of(const Array<const T, 3>& left, const Array<const T, 3>& right, int first, int count) {
  for (int axis = 0; axis < 3; ++axis) require(left.shape(axis) == right.shape(axis), "left and right differ in shape");
  require(left.size() > 0 && count > 0, "nothing to match");
  require(left.shape(2) == 1 || left.shape(2) == 3, "one channel or three");
  return {left.data(), right.data(), static_cast<int>(left.shape(0)), static_cast<int>(left.shape(1)),
          static_cast<int>(left.shape(2)), first, count};
}

Window window_of(int width, int height) {
  require(1 <= width && width <= 255 && 1 <= height && height <= 255, "window sides run from 1 to 255");
  return {width, height};
}

template <class AnyArray, class... Sides>
void require_shape(const AnyArray& array, Sides... sides) {
  const int64_t wanted[] = {static_cast<int64_t>(sides)...};
  for (size_t axis = 0; axis < sizeof...(sides); ++axis)
    require(static_cast<int64_t>(array.shape(axis)) == wanted[axis], "wrong array shape");
}

template <class T>
void match_pair(const Array<const T, 3>& left, const Array<const T, 3>& right, int first, int count, int cost, int window_width,
                int window_height, int subpixel, std::optional<double> left_right, std::optional<double> uniqueness,
                const Array<float, 2>& disparity, const Array<float, 2>& confidence, const Array<uint8_t, 2>& flags,
                int threads, const std::string& instructions) {
  const Pair pair = pair_of(left, right, first, count);
  const FusedSettings settings{static_cast<CostKind>(cost),
                               window_of(window_width, window_height),
                               static_cast<Subpixel>(subpixel),
                               left_right.has_value(),
                               left_right.value_or(0),
                               uniqueness.has_value(),
                               uniqueness.value_or(1)};
  constexpr bool narrow = sizeof(T) == 1;
  require(!narrow || (settings.cost != CostKind::zsad && narrow_fits(settings.window, pair.channels)),
          "this cost and window need 32-bit pixels");
  require_shape(disparity, pair.height, pair.width);
  require_shape(confidence, pair.height, pair.width);
  require_shape(flags, pair.height, pair.width);
  const FusedKernel& kernel = choose_kernel(instructions);
  const FusedOutput out{disparity.data(), confidence.data(), flags.data()};
  run(threads, [&](const Workers& workers) { match(pair, settings, narrow, kernel, out, workers); });
}

void match_gaussian_pair(const Array<const uint8_t, 3>& left, const Array<const uint8_t, 3>& right, int first, int count,
                         int cost, int stride, const Array<const double, 1>& taps, int subpixel,
                         std::optional<double> left_right, std::optional<double> uniqueness, const Array<float, 2>& disparity,
                         const Array<float, 2>& confidence, const Array<uint8_t, 2>& flags, int threads,
                         const std::string& instructions) {
  const Pair pair = pair_of(left, right, first, count);
  const FusedSettings settings{static_cast<CostKind>(cost),
                               {1, 1},
                               static_cast<Subpixel>(subpixel),
                               left_right.has_value(),
                               left_right.value_or(0),
                               uniqueness.has_value(),
                               uniqueness.value_or(1)};
  require(settings.cost != CostKind::zsad, "ZSAD has no Gaussian window here");
  require(1 <= stride && stride <= kLargestStride && taps.size() > 0, "no such filter");
  const GaussianFilter filter{stride, static_cast<int>(taps.size()) - 1, taps.data()};
  require_shape(disparity, pair.height, pair.width);
  require_shape(confidence, pair.height, pair.width);
  require_shape(flags, pair.height, pair.width);
  const FusedKernel& kernel = choose_kernel(instructions);
  const FusedOutput out{disparity.data(), confidence.data(), flags.data()};
  run(threads, [&](const Workers& workers) { match_gaussian(pair, settings, filter, kernel, out, workers); });
}

using Pixels = Array<const int32_t, 3>;

template <class T>
void bind_grey(nb::module_& m) {
  m.def("grey", [](const Array<const T, 3>& rgb, const Array<T, 3>& out, int threads) {
    const int H = rgb.shape(0), W = rgb.shape(1);
    require_shape(rgb, H, W, 3);
    require_shape(out, H, W, 1);
    run(threads, [&](const Workers& workers) { grey<T>(rgb.data(), H, W, out.data(), workers); });
  });
}

template <class T>
void bind_select(nb::module_& m) {
  m.def("select_left",
        [](const Array<const T, 3>& volume, int first, const Array<int32_t, 2>& index, const Array<T, 2>& cost,
           const Array<T, 2>& before, const Array<T, 2>& after, const Array<T, 2>& second, int threads) {
          const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
          require_shape(index, H, W);
          for (const auto* array : {&cost, &before, &after, &second}) require_shape(*array, H, W);
          run(threads, [&](const Workers& workers) {
            select_left<T>(volume.data(), H, W, D, first,
                           {index.data(), cost.data(), before.data(), after.data(), second.data()}, workers);
          });
        });
  m.def("select_right", [](const Array<const T, 3>& volume, int first, const Array<int32_t, 2>& index, int threads) {
    const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
    require_shape(index, H, W);
    run(threads, [&](const Workers& workers) { select_right<T>(volume.data(), H, W, D, first, index.data(), workers); });
  });
}

template <class T>
void bind_score(nb::module_& m) {
  m.def("score", [](const Pixels& left, const Pixels& right, int first, int window_width, int window_height, int cost,
                    bool narrow, const Array<const int64_t, 3>& sums, const Array<T, 3>& costs, int threads) {
    const Pair pair = pair_of(left, right, first, static_cast<int>(costs.shape(2)));
    const Window window = window_of(window_width, window_height);
    require_shape(sums, pair.height, pair.width, pair.count);
    require_shape(costs, pair.height, pair.width, pair.count);
    require(!narrow || narrow_fits(window, pair.channels), "window too large for 32-bit sums");
    run(threads, [&](const Workers& workers) {
      score(pair, window, static_cast<CostKind>(cost), narrow, sums.data(), costs.data(), workers);
    });
  });
}

}  // namespace

NB_MODULE(_core, m) {
  m.attr("narrow_limit") = narrow_limit;

  m.def("instruction_sets", [] {
    std::vector<std::string> names;
    for (const FusedKernel* kernel : available_kernels()) names.emplace_back(kernel->name);
    return names;
  });

  // Two names, not one: where an argument needs converting, a call may else end up with the wrong kind of pixels.
  m.def("match_narrow", &match_pair<uint8_t>);
  m.def("match_wide", &match_pair<int32_t>);

  m.def("match_gaussian", &match_gaussian_pair);
  m.attr("largest_stride") = kLargestStride;

  bind_grey<uint8_t>(m);
  bind_grey<int32_t>(m);

  m.def("terms", [](const Pixels& left, const Pixels& right, int first, int window_width, int window_height, int term,
                    const Array<int64_t, 3>& out, int threads) {
    const Pair pair = pair_of(left, right, first, static_cast<int>(out.shape(2)));
    const Window window = window_of(window_width, window_height);
    require_shape(out, pair.height + window.height - 1, pair.width + window.width - 1, pair.count);
    run(threads, [&](const Workers& workers) { terms(pair, window, static_cast<Term>(term), out.data(), workers); });
  });

  m.def("box", [](const Array<const int64_t, 3>& terms, int window_width, int window_height, const Array<int64_t, 3>& sums,
                  int threads) {
    const Window window = window_of(window_width, window_height);
    const int H = sums.shape(0), W = sums.shape(1), D = sums.shape(2);
    require_shape(terms, H + window.height - 1, W + window.width - 1, D);
    run(threads, [&](const Workers& workers) { box(terms.data(), H, W, D, window, sums.data(), workers); });
  });

  bind_score<int64_t>(m);
  bind_score<float>(m);

  m.def("score_zsad", [](const Pixels& left, const Pixels& right, int first, int window_width, int window_height,
                         const Array<float, 3>& costs, int threads) {
    const Pair pair = pair_of(left, right, first, static_cast<int>(costs.shape(2)));
    const Window window = window_of(window_width, window_height);
    require_shape(costs, pair.height, pair.width, pair.count);
    run(threads, [&](const Workers& workers) { score_zsad(pair, window, costs.data(), workers); });
  });

  bind_select<int64_t>(m);
  bind_select<float>(m);

  m.def("texture",
        [](const Pixels& image, int window_width, int window_height, const Array<float, 2>& mean, int threads) {
          const Window window = window_of(window_width, window_height);
          require_shape(mean, image.shape(0), image.shape(1));
          run(threads, [&](const Workers& workers) {
            texture(image.data(), static_cast<int>(image.shape(0)), static_cast<int>(image.shape(1)),
                    static_cast<int>(image.shape(2)), window, mean.data(), workers);
          });
        });

  m.def("speckle", [](const Array<const float, 2>& disparity, int area, float difference, const Array<uint8_t, 2>& out) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(out, H, W);
    run(1, [&](const Workers& workers) { speckle(disparity.data(), H, W, area, difference, out.data(), workers); });
  });

  m.def("median", [](const Array<const float, 2>& disparity, int size, const Array<float, 2>& out, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require(1 <= size && size <= 255, "size runs from 1 to 255");
    require_shape(out, H, W);
    run(threads, [&](const Workers& workers) { median(disparity.data(), H, W, size, out.data(), workers); });
  });
}
