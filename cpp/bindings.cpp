// The only file that knows Python: checks what it is handed, releases the GIL, calls.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "crew.hpp"
#include "dispatch.hpp"
#include "heap.hpp"
#include "parallel.hpp"
#include "photometric.hpp"
#include "planar.hpp"
#include "planes.hpp"
#include "rows.hpp"
#include "sgm.hpp"
#include "stages.hpp"

namespace nb = nanobind;
using namespace stereopsis;

namespace {

template <class T, int N>
using Array = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;

void require(bool condition, const char* message) {
  if (!condition) throw std::invalid_argument(message);
}

// Calls what takes the GIL and throws nothing. While an interpreter ends, that ends any other thread: before Python 3.14 by
// unwinding its stack, where the system can. C++ that promises not to throw is no place for that, nor are threads at work
// on what lies there: the thread stays here for good instead, and the process ends without it.
template <class Enter>
auto enter_python(Enter enter) {
  try {
    return enter();
  } catch (...) {
    for (;;) std::this_thread::sleep_for(std::chrono::hours(1));
  }
}

// While it exists its thread has no GIL.
class Unlocked {
 public:
  Unlocked() : state_(PyEval_SaveThread()) {}
  ~Unlocked() {
    enter_python([&] { PyEval_RestoreThread(state_); });
  }
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

  // Whether a signal has reached Python, which tells the thread alone that has called; looks twenty times a second, however
  // many pieces the work is in.
  bool interrupted() {
    if (std::this_thread::get_id() != thread_ || Clock::now() < next_) return false;
    enter_python([&] { PyEval_RestoreThread(state_); });
    const bool found = PyErr_CheckSignals() != 0;
    state_ = PyEval_SaveThread();
    next_ = Clock::now() + kPatience;
    return found;
  }

 private:
  using Clock = std::chrono::steady_clock;
  const std::thread::id thread_ = std::this_thread::get_id();
  Clock::time_point next_ = Clock::now() + kPatience;
  PyThreadState* state_;
};

// Runs `work` without the GIL; a signal that reaches Python meanwhile ends it.
template <class Work>
void run(int threads, Work work) {
  try {
    Unlocked python;
    work(Workers{resolve_threads(threads), [&] { return python.interrupted(); }});
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
                const std::optional<Array<float, 2>>& winning_cost, int threads, const std::string& instructions) {
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
  if (winning_cost) require_shape(*winning_cost, pair.height, pair.width);
  const FusedOutput out{disparity.data(), confidence.data(), flags.data(), winning_cost ? winning_cost->data() : nullptr};
  run(threads, [&](const Workers& workers) { match(pair, settings, narrow, kernel, out, workers); });
}

// Every candidate's cost as the streaming kernel forms it.
void narrow_costs(const Array<const uint8_t, 3>& left, const Array<const uint8_t, 3>& right, int first, int cost,
                  int window_width, int window_height, const Array<float, 3>& costs, int threads,
                  const std::string& instructions) {
  const Pair pair = pair_of(left, right, first, static_cast<int>(costs.shape(2)));
  const FusedSettings settings{static_cast<CostKind>(cost), window_of(window_width, window_height), Subpixel::none, false, 0,
                               false, 1};
  require(settings.cost == CostKind::zssd || is_correlation(settings.cost), "zssd, ncc or zncc");
  require(narrow_fits(settings.window, pair.channels), "window too large for 32-bit sums");
  require_shape(costs, pair.height, pair.width, pair.count);
  const FusedKernel& kernel = choose_kernel(instructions);
  const size_t pixels = static_cast<size_t>(pair.height) * pair.width;
  std::vector<float> disparity(pixels), confidence(pixels);
  std::vector<uint8_t> flags(pixels);
  const FusedOutput out{disparity.data(), confidence.data(), flags.data(), nullptr, costs.data()};
  run(threads, [&](const Workers& workers) { match(pair, settings, true, kernel, out, workers); });
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

AlignedPair aligned_pair(const Pixels& left, const Pixels& right) {
  for (int axis = 0; axis < 3; ++axis) require(left.shape(axis) == right.shape(axis), "left and right differ in shape");
  require(left.size() > 0 && (left.shape(2) == 1 || left.shape(2) == 3), "one channel or three");
  return {left.data(), right.data(), static_cast<int>(left.shape(0)), static_cast<int>(left.shape(1)),
          static_cast<int>(left.shape(2))};
}

template <class T>
void bind_grey(nb::module_& m) {
  m.def("grey", [](const Array<const T, 3>& rgb, const Array<T, 3>& out, int threads, const std::string& instructions) {
    const int H = rgb.shape(0), W = rgb.shape(1);
    require_shape(rgb, H, W, 3);
    require_shape(out, H, W, 1);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) { grey<T>(rgb.data(), H, W, out.data(), kernels, workers); });
  });
}

Lattice lattice_of(int width, int step, int disparity_step, int columns) {
  require(width >= 1 && step >= 1 && disparity_step >= 1, "width and steps run from 1");
  require(columns == sampled(width, step), "wrong array shape");
  return {width, step, disparity_step};
}

template <class T>
void bind_select(nb::module_& m) {
  m.def("select_left",
        [](const Array<const T, 3>& volume, int first, int width, int step, int disparity_step,
           const Array<int32_t, 2>& index, const Array<T, 2>& cost, const Array<T, 2>& before, const Array<T, 2>& after,
           const Array<T, 2>& second, int threads) {
          const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
          const Lattice lattice = lattice_of(width, step, disparity_step, W);
          require_shape(index, H, W);
          for (const auto* array : {&cost, &before, &after, &second}) require_shape(*array, H, W);
          run(threads, [&](const Workers& workers) {
            select_left<T>(volume.data(), H, lattice, D, first,
                           {index.data(), cost.data(), before.data(), after.data(), second.data()}, workers);
          });
        });
  m.def("select_at",
        [](const Array<const T, 3>& volume, int first, const Array<int32_t, 2>& index, const Array<T, 2>& cost,
           const Array<T, 2>& before, const Array<T, 2>& after, const Array<T, 2>& second, int threads) {
          const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
          require_shape(index, H, W);
          for (const auto* array : {&cost, &before, &after, &second}) require_shape(*array, H, W);
          run(threads, [&](const Workers& workers) {
            select_at<T>(volume.data(), H, W, D, first,
                         {index.data(), cost.data(), before.data(), after.data(), second.data()}, workers);
          });
        });
  m.def("select_right", [](const Array<const T, 3>& volume, int first, int width, int step, int disparity_step,
                           const Array<int32_t, 2>& index, int threads) {
    const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
    const Lattice lattice = lattice_of(width, step, disparity_step, W);
    require_shape(index, H, width);
    run(threads, [&](const Workers& workers) { select_right<T>(volume.data(), H, lattice, D, first, index.data(), workers); });
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

template <class T>
void bind_census(nb::module_& m) {
  m.def("census", [](const Array<const T, 2>& image, const Array<const int32_t, 3>& points, const Array<uint64_t, 3>& strings,
                     int threads, const std::string& instructions) {
    const int H = image.shape(0), W = image.shape(1), n = points.shape(0);
    require(image.size() > 0 && 1 <= n && n <= 128, "from 1 to 128 comparisons");
    require_shape(points, n, 2, 2);
    for (size_t k = 0; k < points.size(); ++k)
      require(-127 <= points.data()[k] && points.data()[k] <= 127, "comparisons reach up to 127 pixels");
    require_shape(strings, (n + 63) / 64, H, W);
    const PixelwiseKernels& kernels = choose_pixelwise(instructions);
    const auto* pairs = reinterpret_cast<const CensusPoint*>(points.data());
    run(threads, [&](const Workers& workers) { census<T>(image.data(), H, W, pairs, n, strings.data(), kernels, workers); });
  });
}

template <class T>
void bind_pixel_costs(nb::module_& m) {
  m.def("pixel_costs", [](int kind, const Array<const T, 3>& left, const Array<const T, 3>& right, int bits, int first, int most,
                          const std::optional<Array<const uint8_t, 2>>& table, int box_width, int box_height, bool add,
                          const Array<uint16_t, 3>& costs, int threads, const std::string& instructions) {
    const auto cost = static_cast<PixelCost>(kind);
    const int P = left.shape(0), H = left.shape(1), W = left.shape(2), D = costs.shape(2);
    const Window box = window_of(box_width, box_height);
    require(sizeof(T) == 8   ? cost == PixelCost::census && P == (bits + 63) / 64 && 1 <= bits && bits <= 128
            : sizeof(T) == 2 ? (cost == PixelCost::vector && P == 2) || (cost == PixelCost::interval && P == 3)
                             : (cost == PixelCost::absolute || cost == PixelCost::table) && P == 1,
            "no such cost of these features");
    require(left.size() > 0 && D > 0, "nothing to match");
    require_shape(right, P, H, W);
    require_shape(costs, H, W, D);
    require(1 <= most && most <= 255 && most * box.area() < 65535, "sums stay below 65535");
    require(table.has_value() == (cost == PixelCost::table), "a table for the cost that needs one");
    if (table) require_shape(*table, 256, 256);
    const PixelwiseKernels& kernels = choose_pixelwise(instructions);
    const PixelJob job{cost,  left.data(), right.data(), H, W, P, bits, first, D, most, table ? table->data() : nullptr,
                       box, add, costs.data()};
    run(threads, [&](const Workers& workers) { pixel_costs(job, kernels, workers); });
  });
}

void bind_combine(nb::module_& m) {
  m.def("combine", [](const Array<uint16_t, 3>& costs, const Array<const uint16_t, 3>& other, uint32_t factor,
                      uint32_t other_factor, int threads) {
    const int H = costs.shape(0), W = costs.shape(1), D = costs.shape(2);
    require_shape(other, H, W, D);
    run(threads, [&](const Workers& workers) {
      combine(costs.data(), other.data(), H, static_cast<size_t>(W) * D, factor, other_factor, workers);
    });
  });
}

// The cost volume of a support, handed to `work` with everything that the kernels share.
template <class Work>
void support_volume(const Pixels& left, const Pixels& right, int first, int cost, int step, int disparity_step,
                    const Array<float, 3>& costs, int threads, const std::string& instructions, Work work) {
  const Pair pair = pair_of(left, right, first, static_cast<int>(costs.shape(2)));
  require(step >= 1 && disparity_step >= 1, "steps run from 1");
  require_shape(costs, sampled(pair.height, step), sampled(pair.width, step), pair.count);
  const SupportKernels& kernels = *choose_kernel(instructions).supports;
  run(threads, [&](const Workers& workers) {
    work(pair, static_cast<CostKind>(cost), Sampling{step, disparity_step}, kernels, workers);
  });
}

const Reach* reach_of(const Array<const int32_t, 3>& reach) { return reinterpret_cast<const Reach*>(reach.data()); }

void bind_supports(nb::module_& m) {
  m.def("separable_costs",
        [](const Pixels& left, const Pixels& right, int first, int cost, int step, int disparity_step,
           const Array<const double, 1>& taps, const Array<float, 3>& costs, int threads, const std::string& instructions) {
          require(taps.shape(0) % 2 == 1 && taps.shape(0) < 4096, "an odd number of taps");
          const int radius = static_cast<int>(taps.shape(0) / 2);
          support_volume(left, right, first, cost, step, disparity_step, costs, threads, instructions,
                         [&](const Pair& pair, CostKind kind, const Sampling& sampling, const SupportKernels& kernels,
                             const Workers& workers) {
                           separable_costs(pair, kind, sampling, taps.data(), radius, costs.data(), kernels, workers);
                         });
        });
  m.def("reach_costs",
        [](const Pixels& left, const Pixels& right, int first, int cost, int step, int disparity_step, bool cross,
           const Array<const int32_t, 3>& reach, const Array<float, 3>& costs, int threads, const std::string& instructions) {
          const int H = static_cast<int>(left.shape(0)), W = static_cast<int>(left.shape(1));
          require_shape(reach, H, W, 4);
          for (int y = 0; y < H; ++y)
            for (int x = 0; x < W; ++x) {
              const Reach& r = reach_of(reach)[static_cast<size_t>(y) * W + x];
              for (const int side : {r.left, r.right, r.above, r.below}) require(0 <= side && side <= 255, "reaches run to 255");
              require(!cross || (r.left <= x && x + r.right < W && r.above <= y && y + r.below < H), "arms leave the image");
            }
          support_volume(left, right, first, cost, step, disparity_step, costs, threads, instructions,
                         [&](const Pair& pair, CostKind kind, const Sampling& sampling, const SupportKernels& kernels,
                             const Workers& workers) {
                           reach_costs(pair, kind, sampling, cross, reach_of(reach), costs.data(), kernels, workers);
                         });
        });
  m.def("bilateral_costs",
        [](const Pixels& left, const Pixels& right, int first, int cost, int step, int disparity_step, int window_width,
           int window_height, double sigma_space, double sigma_colour, const Array<float, 3>& costs, int threads,
           const std::string& instructions) {
          const Window window = window_of(window_width, window_height);
          require(sigma_space > 0 && sigma_colour > 0, "sigmas are positive");
          support_volume(left, right, first, cost, step, disparity_step, costs, threads, instructions,
                         [&](const Pair& pair, CostKind kind, const Sampling& sampling, const SupportKernels& kernels,
                             const Workers& workers) {
                           bilateral_costs(pair, kind, sampling, window, sigma_space, sigma_colour, costs.data(), kernels,
                                           workers);
                         });
        });
  m.def("cross_arms", [](const Pixels& image, int arm, double threshold, const Array<int32_t, 3>& reach, int threads) {
    const int H = static_cast<int>(image.shape(0)), W = static_cast<int>(image.shape(1));
    require(1 <= arm && arm <= 255, "arms run from 1 to 255");
    require_shape(reach, H, W, 4);
    run(threads, [&](const Workers& workers) {
      cross_arms(image.data(), H, W, static_cast<int>(image.shape(2)), arm, threshold,
                 reinterpret_cast<Reach*>(reach.data()), workers);
    });
  });
}

Smoothness smoothness_of(int power, double weight, double truncation) {
  require(power == 1 || power == 2, "power is 1 or 2");
  require(0 <= weight && weight <= 1e20 && truncation > 0, "weight runs from 0 to 1e20, truncation from above 0");
  return {power, weight, truncation};
}

Grid grid_of(const Array<const float, 3>& costs, const Array<int32_t, 2>& labels) {
  const int H = costs.shape(0), W = costs.shape(1), D = costs.shape(2);
  require(0 < D && D < 1 << 24, "from 1 to 2^24 - 1 labels");
  require_shape(labels, H, W);
  for (size_t p = 0; p < labels.size(); ++p)
    require(-1 <= labels.data()[p] && labels.data()[p] < D, "labels run from 0, and are -1 where there is none");
  return {costs.data(), H, W, D};
}

template <class T>
void bind_optimize(nb::module_& m) {
  m.def("relative_costs", [](const Array<const T, 3>& volume, const Array<float, 3>& costs, const Array<double, 2>& least,
                             int threads) {
    const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
    require(D > 0, "no candidates");
    require_shape(costs, H, W, D);
    require_shape(least, H, W);
    run(threads, [&](const Workers& workers) {
      relative_costs<T>(volume.data(), H, W, D, costs.data(), least.data(), workers);
    });
  });
  m.def("right_volume", [](const Array<const T, 3>& left, int first, const Array<T, 3>& right, int threads) {
    const int H = left.shape(0), W = left.shape(1), D = left.shape(2);
    require_shape(right, H, W, D);
    run(threads, [&](const Workers& workers) { right_volume<T>(left.data(), H, W, D, first, right.data(), workers); });
  });
  m.def("second_pass", [](const Array<const T, 3>& volume, const Array<const int32_t, 2>& guide, int window_width,
                          int window_height, const Array<const int64_t, 1>& penalties, double scale, double weight,
                          const Array<float, 3>& total, int threads) {
    const int H = volume.shape(0), W = volume.shape(1), D = volume.shape(2);
    const Window window = window_of(window_width, window_height);
    require(D > 0, "no candidates");
    require_shape(guide, H, W);
    require_shape(penalties, 2 * int64_t{D} - 1);
    require_shape(total, H, W, D);
    for (size_t p = 0; p < guide.size(); ++p) require(guide.data()[p] < D, "a label beyond the candidates");
    run(threads, [&](const Workers& workers) {
      second_pass<T>(volume.data(), H, W, D, guide.data(), window, penalties.data(), scale, weight, total.data(), workers);
    });
  });
}

// Disparity, confidence, cost, misfit; flags, plane.
using HypothesisArrays = std::tuple<Array<float, 2>, Array<float, 2>, Array<float, 2>, Array<float, 2>, Array<uint8_t, 2>,
                                    Array<uint8_t, 2>>;

Hypothesis hypothesis_of(const HypothesisArrays& arrays, int height, int width) {
  std::apply([&](const auto&... array) { (require_shape(array, height, width), ...); }, arrays);
  const auto& [disparity, confidence, cost, misfit, flags, plane] = arrays;
  return {disparity.data(), confidence.data(), cost.data(), misfit.data(), flags.data(), plane.data()};
}

Plane plane_of(const std::tuple<double, double, double>& plane) {
  return {std::get<0>(plane), std::get<1>(plane), std::get<2>(plane)};
}

template <class T>
void bind_warp(nb::module_& m) {
  m.def("warp", [](const Array<const T, 3>& image, std::tuple<double, double, double> plane, double floor, T lowest,
                   T highest, const Array<T, 3>& warped, int threads) {
    const int H = image.shape(0), W = image.shape(1), C = image.shape(2);
    const int margin = (static_cast<int>(warped.shape(1)) - W) / 2;
    require(margin >= 0, "the warped image is at least as wide as the image");
    require_shape(warped, H, W + 2 * margin, C);
    run(threads, [&](const Workers& workers) {
      warp<T>(image.data(), H, W, C, {plane_of(plane), floor}, margin, lowest, highest, warped.data(), workers);
    });
  });
}

// ---- semi-global matching ------------------------------------------------------------------------------------------------

SgmSettings sgm_settings(int paths, int most, int p1, const Array<const int32_t, 1>& p2,
                         const std::optional<Array<const uint8_t, 2>>& guide, const Pair& pair) {
  require(paths == 2 || paths == 4 || paths == 5 || paths == 8 || paths == 16, "2, 4, 5, 8 or 16 paths");
  require_shape(p2, 256);
  if (guide) require_shape(*guide, pair.height, pair.width);
  require(0 <= most && most <= kLargestSum && p1 >= 0, "costs and penalties run from 0");
  for (int k = 0; k < 256; ++k) require(0 <= p2(k) && p2(k) <= kLargestSum, "costs and penalties run from 0");
  const SgmSettings settings{paths, most, p1, p2.data(), guide ? guide->data() : nullptr};
  require(static_cast<int64_t>(paths) * (most + settings.largest_p2()) <= kLargestSum, "sums would not fit 16 bits");
  return settings;
}

template <bool MoreGlobal>
void sgm_volume(const Array<const uint16_t, 3>& costs, int paths, int most, int p1, const Array<const int32_t, 1>& p2,
                const std::optional<Array<const uint8_t, 2>>& guide, const Array<uint16_t, 3>& sums, int threads,
                const std::string& instructions) {
  const Pair pair{nullptr, nullptr, static_cast<int>(costs.shape(0)), static_cast<int>(costs.shape(1)), 1, 0,
                  static_cast<int>(costs.shape(2))};
  require(costs.size() > 0 && pair.count < 65536, "nothing to match");
  require_shape(sums, pair.height, pair.width, pair.count);
  const SgmSettings settings = sgm_settings(paths, most, p1, p2, guide, pair);
  const uint16_t* cost = costs.data();
  uint16_t largest = 0;
  for (size_t k = 0; k < costs.size(); ++k) largest = cost[k] > largest ? cost[k] : largest;
  require(largest <= most, "costs above the most");
  const SgmKernels& kernels = choose_sgm(instructions);
  require(!MoreGlobal || paths == 4 || paths == 8, "4 or 8 directions");
  run(threads, [&](const Workers& workers) {
    if (MoreGlobal)
      mgm_sums(pair, cost, settings, sums.data(), workers);
    else
      sgm_sums(pair, cost, settings, sums.data(), kernels, workers);
  });
}

void bind_hide(nb::module_& m) {
  m.def("hide_out_of_view", [](const Array<uint16_t, 3>& sums, int first, const Array<int32_t, 2>& beyond, int threads) {
    const Pair pair{nullptr, nullptr, static_cast<int>(sums.shape(0)), static_cast<int>(sums.shape(1)), 1, first,
                    static_cast<int>(sums.shape(2))};
    require_shape(beyond, pair.height, pair.width);
    run(threads, [&](const Workers& workers) { hide_out_of_view(pair, sums.data(), beyond.data(), choose_sgm({}), workers); });
  });
}

void sgm_match(const Array<const uint64_t, 3>& left, const Array<const uint64_t, 3>& right, int bits, bool aggregated, int unit,
               int first, int count, const std::optional<Array<const int16_t, 2>>& shift, int paths, int most, int p1,
               const Array<const int32_t, 1>& p2, const std::optional<Array<const uint8_t, 2>>& guide, int subpixel,
               std::optional<double> left_right, std::optional<double> uniqueness, const Array<float, 2>& disparity,
               const Array<float, 2>& confidence, const Array<uint8_t, 2>& flags,
               const std::optional<Array<float, 2>>& winning_cost, int threads, const std::string& instructions) {
  for (int axis = 0; axis < 3; ++axis) require(left.shape(axis) == right.shape(axis), "left and right differ in shape");
  require(left.size() > 0 && count > 0, "nothing to match");
  const Pair pair{nullptr, nullptr, static_cast<int>(left.shape(1)), static_cast<int>(left.shape(2)), 1, first, count};
  require(1 <= bits && bits <= (aggregated ? kMostAggregatedBits : 255) && (bits + 63) / 64 == static_cast<int>(left.shape(0)),
          "strings of as many bits as they have room for");
  require(0 <= unit && unit <= 15, "unit runs from 0 to 15");
  const int rounding = 1 << unit >> 1;
  require(((aggregated ? 9 : 1) * bits + rounding) >> unit <= most, "costs above the most");
  int span = 0;
  if (shift) {
    require_shape(*shift, pair.height, pair.width);
    int least = shift->data()[0], largest = least;
    for (size_t k = 0; k < shift->size(); ++k) {
      least = std::min<int>(least, shift->data()[k]);
      largest = std::max<int>(largest, shift->data()[k]);
    }
    span = largest - least;
  }
  require(static_cast<int64_t>(count) + span < 65536 && std::abs(static_cast<int64_t>(first)) < 1 << 25, "too many candidates");
  const SgmSettings settings = sgm_settings(paths, most, p1, p2, guide, pair);
  const FusedSettings select{CostKind::sad,
                             {1, 1},
                             static_cast<Subpixel>(subpixel),
                             left_right.has_value(),
                             left_right.value_or(0),
                             uniqueness.has_value(),
                             uniqueness.value_or(1)};
  require_shape(disparity, pair.height, pair.width);
  require_shape(confidence, pair.height, pair.width);
  require_shape(flags, pair.height, pair.width);
  if (winning_cost) require_shape(*winning_cost, pair.height, pair.width);
  const CensusCosts costs{left.data(), right.data(), bits, aggregated, unit, shift ? shift->data() : nullptr};
  const FusedOutput out{disparity.data(), confidence.data(), flags.data(), winning_cost ? winning_cost->data() : nullptr};
  const SgmKernels& kernels = choose_sgm(instructions);
  run(threads, [&](const Workers& workers) { sgm_census(pair, costs, settings, select, out, kernels, workers); });
}

template <class T>
void bind_move_rows(nb::module_& m) {
  m.def("move_rows", [](const Array<const T, 3>& image, std::tuple<double, double, double, double> offset, T lowest,
                        T highest, const Array<T, 3>& moved, int threads, const std::string& instructions) {
    const int H = image.shape(0), W = image.shape(1), C = image.shape(2);
    require(C == 1 || C == 3, "one channel or three");
    require_shape(moved, H, W, C);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) {
      const auto [a, b, c, twist] = offset;
      move_rows<T>(image.data(), H, W, C, {a, b, c, twist}, lowest, highest, moved.data(), kernels, workers);
    });
  });
}

template <class T>
void bind_sharpen(nb::module_& m) {
  m.def("sharpen", [](const Array<const T, 3>& image, int amount, const Array<T, 3>& sharp, int threads) {
    const int H = image.shape(0), W = image.shape(1), C = image.shape(2);
    require(C == 1 || C == 3, "one channel or three");
    require(amount >= 0 && amount <= 256, "from 0 to 256");
    require_shape(sharp, H, W, C);
    run(threads, [&](const Workers& workers) { sharpen<T>(image.data(), H, W, C, amount, sharp.data(), workers); });
  });
}

using Ends = Array<const int32_t, 2>;

std::optional<Shown> shown_by(const std::optional<Ends>& rows, const std::optional<Ends>& columns) {
  require(rows.has_value() == columns.has_value(), "rows and columns");
  if (!rows) return std::nullopt;
  require(rows->shape(1) == 2 && columns->shape(1) == 2, "two ends");
  return Shown{rows->data(), columns->data(), static_cast<int>(rows->shape(0)), static_cast<int>(columns->shape(0))};
}

void require_within(const std::optional<Shown>& image, const Patch& part) {
  require(part.top >= 0 && part.left >= 0, "top and left of at least 0");
  require(!image || (part.top + part.height <= image->height && part.left + part.width <= image->width), "a part of the image");
}

void bind_blank(nb::module_& m) {
  m.def("continue_over", [](const Ends& rows, const Ends& columns, const Array<const uint8_t, 3>& row_pixels,
                            const Array<const uint8_t, 3>& column_pixels, int top, int left, const Array<uint8_t, 3>& pixels,
                            int threads) {
    const std::optional<Shown> image = shown_by(rows, columns);
    const int size = pixels.shape(2);
    require_shape(row_pixels, image->height, 2, size);
    require_shape(column_pixels, image->width, 2, size);
    const Patch part{top, left, static_cast<int>(pixels.shape(0)), static_cast<int>(pixels.shape(1))};
    require_within(image, part);
    const BorderEdge edge{row_pixels.data(), column_pixels.data(), static_cast<size_t>(size)};
    run(threads, [&](const Workers& workers) { continue_over(*image, edge, part, pixels.data(), workers); });
  });
  m.def("find_hidden", [](const Array<const float, 2>& disparity, float sign, const std::optional<Ends>& rows,
                          const std::optional<Ends>& columns, const std::optional<Ends>& other_rows,
                          const std::optional<Ends>& other_columns, int top, int left, const Array<uint8_t, 2>& hidden,
                          int threads) {
    const std::optional<Shown> here = shown_by(rows, columns), there = shown_by(other_rows, other_columns);
    const Patch part{top, left, static_cast<int>(disparity.shape(0)), static_cast<int>(disparity.shape(1))};
    require_within(here, part);
    require_within(there, part);
    require_shape(hidden, part.height, part.width);
    run(threads, [&](const Workers& workers) {
      find_hidden(disparity.data(), sign, here ? &*here : nullptr, there ? &*there : nullptr, part, hidden.data(), workers);
    });
  });
}

template <class T>
void bind_texture(nb::module_& m) {
  m.def("texture",
        [](const Array<const T, 3>& image, int window_width, int window_height, const Array<float, 2>& mean, int threads) {
          const Window window = window_of(window_width, window_height);
          const int H = image.shape(0), W = image.shape(1), C = image.shape(2);
          require_shape(mean, H, W);
          run(threads, [&](const Workers& workers) { texture<T>(image.data(), H, W, C, window, mean.data(), workers); });
        });
}

Refusal refusal_of(uint8_t bit, const Array<float, 2>& disparity, const Array<float, 2>& confidence,
                   const Array<uint8_t, 2>& flags, int height, int width) {
  require_shape(disparity, height, width);
  require_shape(confidence, height, width);
  require_shape(flags, height, width);
  return {disparity.data(), confidence.data(), flags.data(), bit};
}

template <class T>
void bind_refuse_dull(nb::module_& m) {
  m.def("refuse_dull", [](const Array<const T, 3>& image, int window_width, int window_height, double least, uint8_t bit,
                          const Array<float, 2>& disparity, const Array<float, 2>& confidence, const Array<uint8_t, 2>& flags,
                          int threads, const std::string& instructions) {
    const Window window = window_of(window_width, window_height);
    const int H = image.shape(0), W = image.shape(1), C = image.shape(2);
    const Refusal refused = refusal_of(bit, disparity, confidence, flags, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) {
      refuse_dull<T>(image.data(), H, W, C, window, static_cast<float>(least), refused, kernels, workers);
    });
  });
}

template <class T>
void bind_background(nb::module_& m) {
  m.def("background", [](const Array<const T, 2>& disparity, const Array<T, 2>& filled, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(filled, H, W);
    run(threads, [&](const Workers& workers) { background<T>(disparity.data(), H, W, filled.data(), workers); });
  });
}

// ---- planes: image, disparity, weight; the model's numbers in the order of SegmentModel ---------------------------------
using ObservedArrays = std::tuple<Array<const float, 3>, Array<const float, 2>, Array<const float, 2>>;
using ModelNumbers = std::tuple<double, double, double, double, double, double, double, double, double, double>;
using Labels = Array<int32_t, 2>;
using Planes = Array<double, 2>;

Observed observed_of(const ObservedArrays& seen, const Labels& label) {
  const auto& [image, disparity, weight] = seen;
  const int H = label.shape(0), W = label.shape(1), C = static_cast<int>(image.shape(2));
  require_shape(image, H, W, C);
  require(C == 1 || C == 3, "one channel or three");
  require_shape(disparity, H, W);
  require_shape(weight, H, W);
  return {image.data(), disparity.data(), weight.data(), H, W, C};
}

SegmentModel model_of(const ModelNumbers& numbers) {
  return std::apply([](auto... number) { return SegmentModel{number...}; }, numbers);
}

int count_of(const Planes& planes, const Labels& label) {
  require_shape(planes, planes.shape(0), 3);
  const int count = static_cast<int>(planes.shape(0));
  for (size_t p = 0; p < label.size(); ++p)
    require(0 <= label.data()[p] && label.data()[p] < count, "labels run from 0 to the number of planes less 1");
  return count;
}

void bind_planes(nb::module_& m) {
  m.def("fit_planes", [](const ObservedArrays& seen, const ModelNumbers& numbers, const Labels& label, int trials,
                         const Planes& planes, int threads) {
    const Observed observed = observed_of(seen, label);
    const int count = count_of(planes, label);
    run(threads, [&](const Workers& workers) {
      fit_planes(observed, model_of(numbers), label.data(), count, trials, planes.data(), workers);
    });
  });

  m.def("move_boundaries", [](const ObservedArrays& seen, const ModelNumbers& numbers, const Planes& planes, int sweeps,
                              const Labels& label, int threads) {
    const Observed observed = observed_of(seen, label);
    const int count = count_of(planes, label);
    require(0 <= sweeps && sweeps <= 63, "sweeps run from 0 to 63");
    run(threads, [&](const Workers& workers) {
      move_boundaries(observed, model_of(numbers), planes.data(), count, sweeps, label.data(), workers);
    });
  });

  m.def("smooth_planes", [](const ObservedArrays& seen, const ModelNumbers& numbers, const Labels& label, int columns,
                            int rounds, const Planes& planes, int threads) {
    const Observed observed = observed_of(seen, label);
    const int count = count_of(planes, label);
    require(columns > 0 && rounds >= 0 && rounds < 1 << 20, "a column at least, and up to 2^20 rounds");
    run(threads, [&](const Workers& workers) {
      smooth_planes(observed, model_of(numbers), label.data(), count, columns, rounds, planes.data(), workers);
    });
  });

  m.def("render_planes", [](const Labels& label, const Planes& planes, double least, double most,
                            const Array<float, 2>& disparity, int threads) {
    const int H = label.shape(0), W = label.shape(1);
    count_of(planes, label);
    require_shape(disparity, H, W);
    run(threads, [&](const Workers& workers) {
      render_planes(label.data(), H, W, planes.data(), least, most, disparity.data(), workers);
    });
  });
}

void require_tracked(int reach) {
  require(1 <= reach && 2 * reach + 1 <= kMostTrackedRows, "a tracked window reaches from 1 to 7 rows");
}

// Two tables of weights, fine and coarse.
SurfaceGuide surface_guide(const Array<const int32_t, 3>& guide, const Array<const float, 2>& tables, float strength, int H, int W) {
  require_shape(guide, H, W);
  require(tables.shape(0) == 2 && tables.shape(1) > 0, "two tables");
  const int length = static_cast<int>(tables.shape(1));
  return {guide.data(), static_cast<int>(guide.shape(2)), tables.data(), tables.data() + length, length, strength};
}

}  // namespace

NB_MODULE(_core, m) {
  keep_freed_memory();
  m.attr("narrow_limit") = narrow_limit;

  // What `work` returns. All that it calls here from this thread is done by the same threads, which end with it.
  m.def("with_crew", [](const nb::callable& work) {
    const auto result = [&] {
      PyObject* const found = enter_python([&] { return PyObject_CallNoArgs(work.ptr()); });
      if (!found) throw nb::python_error();
      return nb::steal<nb::object>(found);
    };
    if (crew_at_hand()) return result();
    const auto crew = std::make_unique<Crew>();  // not on the stack: its threads may outlive the one that has it
    const AtHand lent(crew.get());
    return result();
  });

  m.def("instruction_sets", [] {
    std::vector<std::string> names;
    for (const FusedKernel* kernel : available_kernels()) names.emplace_back(kernel->name);
    return names;
  });

  // Two names, not one: where an argument needs converting, a call may else end up with the wrong kind of pixels.
  m.def("match_narrow", &match_pair<uint8_t>);
  m.def("match_wide", &match_pair<int32_t>);

  m.def("narrow_costs", &narrow_costs);
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

  bind_census<uint8_t>(m);
  bind_census<int32_t>(m);
  bind_pixel_costs<uint64_t>(m);
  bind_pixel_costs<uint8_t>(m);
  bind_pixel_costs<int16_t>(m);
  bind_combine(m);
  bind_supports(m);
  bind_optimize<int64_t>(m);
  bind_optimize<uint16_t>(m);
  bind_optimize<float>(m);

  m.def("distance_transform",
        [](const Array<const float, 2>& h, int power, double weight, double truncation, const Array<float, 2>& best) {
          const int rows = h.shape(0), D = h.shape(1);
          require(0 < D && D < 1 << 24, "from 1 to 2^24 - 1 labels");
          require_shape(best, rows, D);
          distance_transform(h.data(), rows, D, smoothness_of(power, weight, truncation), best.data());
        });

  m.def("iterated_conditional_modes", [](const Array<const float, 3>& costs, int power, double weight, double truncation,
                                         int iterations, const Array<int32_t, 2>& labels, int threads) {
    const Grid grid = grid_of(costs, labels);
    const Smoothness smoothness = smoothness_of(power, weight, truncation);
    run(threads, [&](const Workers& workers) {
      iterated_conditional_modes(grid, smoothness, iterations, labels.data(), workers);
    });
  });

  m.def("tree_reweighted", [](const Array<const float, 3>& costs, int power, double weight, double truncation, int iterations,
                              const Array<int32_t, 2>& labels, int threads) {
    const Grid grid = grid_of(costs, labels);
    const Smoothness smoothness = smoothness_of(power, weight, truncation);
    double bound = 0;
    run(threads, [&](const Workers& workers) { bound = tree_reweighted(grid, smoothness, iterations, labels.data(), workers); });
    return bound;
  });

  m.def("belief_propagation", [](const Array<const float, 3>& costs, int power, double weight, double truncation, int iterations,
                                 int levels, const Array<int32_t, 2>& labels, int threads) {
    const Grid grid = grid_of(costs, labels);
    const Smoothness smoothness = smoothness_of(power, weight, truncation);
    run(threads, [&](const Workers& workers) {
      belief_propagation(grid, smoothness, iterations, levels, labels.data(), workers);
    });
  });

  m.def("find_plane", [](const Array<const float, 2>& disparity, int top, int radius, double most_a, double least_b,
                         double most_b, double tolerance, int trials, int sample, const Array<double, 1>& found, int threads,
                         const std::string& instructions) {
    require_shape(found, 3);
    require(top >= 0 && radius >= 0 && trials > 0 && sample > 0, "a search needs trials and a sample");
    const PlanarKernel& kernel = choose_planar(instructions);
    Plane plane{0, 0, 0};
    int inliers = 0;
    run(threads, [&](const Workers& workers) {
      const PlaneSearch search{top, radius, most_a, least_b, most_b, tolerance, trials, sample};
      inliers = find_plane(disparity.data(), static_cast<int>(disparity.shape(0)), static_cast<int>(disparity.shape(1)),
                           search, &plane, kernel, workers);
    });
    found(0) = plane.a;
    found(1) = plane.b;
    found(2) = plane.c;
    return inliers;
  });

  bind_warp<uint8_t>(m);
  bind_warp<int32_t>(m);

  bind_move_rows<uint8_t>(m);
  bind_move_rows<int32_t>(m);
  bind_blank(m);
  bind_sharpen<uint8_t>(m);
  bind_sharpen<int32_t>(m);

  m.def("halve", [](const Array<const uint8_t, 2>& image, const Array<uint8_t, 2>& means, int threads,
                    const std::string& instructions) {
    const int H = image.shape(0), W = image.shape(1);
    require_shape(means, H / 2, W / 2);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) { halve(image.data(), H, W, means.data(), kernels, workers); });
  });

  m.def("stretch", [](const Array<const int32_t, 2>& image, double low, double factor, const Array<uint8_t, 2>& bytes,
                      const std::string& instructions) {
    const int H = image.shape(0), W = image.shape(1);
    require_shape(bytes, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(1, [&](const Workers& workers) { stretch(image.data(), H, W, low, factor, bytes.data(), kernels, workers); });
  });

  m.def("corners", [](const Array<const uint8_t, 2>& image, int tile, int stride, int reach, double least,
                      const Array<int32_t, 3>& found, int threads, const std::string& instructions) {
    const int H = image.shape(0), W = image.shape(1);
    require_tracked(reach);
    require(tile > 0 && stride > 0, "tile and stride are at least 1");
    require_shape(found, H / tile, W / tile, 2);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) {
      corners(image.data(), H, W, tile, stride, reach, least, found.data(), kernels, workers);
    });
  });

  m.def("track", [](const Array<const uint8_t, 2>& left, const Array<const uint8_t, 2>& right,
                    const Array<const int32_t, 2>& points, int reach, int iterations,
                    const Array<double, 2>& motion, const Array<double, 1>& correlation, int threads,
                    const std::string& instructions) {
    const int H = left.shape(0), W = left.shape(1), count = points.shape(0);
    require_tracked(reach);
    require_shape(right, H, W);
    require_shape(points, count, 2);
    require_shape(motion, count, 2);
    require_shape(correlation, count);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) {
      track(left.data(), right.data(), H, W, points.data(), count, reach, iterations, motion.data(), correlation.data(),
            kernels, workers);
    });
  });

  m.def("fit_rows", [](const Array<const double, 1>& across, const Array<const double, 1>& down,
                       const Array<const double, 1>& rows, double slope, double keystone, double settled,
                       const Array<double, 1>& field) {
    const int count = rows.shape(0);
    require(count > 0 && slope > 0 && keystone > 0, "points, and deviations above 0");
    require_shape(across, count);
    require_shape(down, count);
    require_shape(field, 4);
    return fit_rows(across.data(), down.data(), rows.data(), count, slope, keystone, settled, field.data());
  });

  m.def("unbow", [](const Array<float, 2>& disparity, float bow, float middle, float least, float most, bool of_right,
                    int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    run(threads, [&](const Workers& workers) {
      unbow(disparity.data(), H, W, {bow, middle, least, most, of_right}, workers);
    });
  });

  m.def("merge_pass", [](const Array<const float, 2>& disparity, const Array<const float, 2>& confidence,
                         const Array<const float, 2>& cost, const Array<const uint8_t, 2>& flags, int kind,
                         std::tuple<double, double, double> plane, double floor, double handicap, double least, double most,
                         bool beyond, int number, const HypothesisArrays& best, int threads) {
    const int H = std::get<0>(best).shape(0), W = std::get<0>(best).shape(1);
    const int margin = (static_cast<int>(disparity.shape(1)) - W) / 2;
    require(margin >= 0, "a pass is at least as wide as the image");
    for (const auto* array : {&disparity, &confidence, &cost}) require_shape(*array, H, W + 2 * margin);
    require_shape(flags, H, W + 2 * margin);
    const Pass pass{disparity.data(), confidence.data(), cost.data(), flags.data(), static_cast<CostKind>(kind), margin,
                    {plane_of(plane), floor}, handicap, least, most, beyond, static_cast<uint8_t>(number)};
    const Hypothesis into = hypothesis_of(best, H, W);
    run(threads, [&](const Workers& workers) { merge_pass(pass, H, W, into, workers); });
  });

  m.def("merge_window", [](const HypothesisArrays& other, int kind, const HypothesisArrays& best,
                           const Array<float, 2>& variance, int threads) {
    const int H = variance.shape(0), W = variance.shape(1);
    const Hypothesis from = hypothesis_of(other, H, W), into = hypothesis_of(best, H, W);
    run(threads, [&](const Workers& workers) {
      merge_window(from, static_cast<CostKind>(kind), H, W, into, variance.data(), workers);
    });
  });

  bind_select<int64_t>(m);
  bind_select<uint16_t>(m);
  bind_select<float>(m);

  bind_texture<uint8_t>(m);
  bind_texture<int32_t>(m);

  m.def("left_right_maps", [](const Array<const float, 2>& left, const Array<const float, 2>& right, int least, int most,
                              double tolerance, const Array<uint8_t, 2>& flags, int threads) {
    const int H = left.shape(0), W = left.shape(1);
    require_shape(right, H, W);
    require_shape(flags, H, W);
    run(threads, [&](const Workers& workers) {
      left_right_maps(left.data(), right.data(), H, W, least, most, tolerance, flags.data(), workers);
    });
  });

  m.def("speckle", [](const Array<const float, 2>& disparity, int area, float difference, const Array<uint8_t, 2>& out,
                      int threads, const std::string& instructions) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(out, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) { speckle(disparity.data(), H, W, area, difference, out.data(), kernels, workers); });
  });

  bind_refuse_dull<uint8_t>(m);
  bind_refuse_dull<int32_t>(m);

  m.def("refuse_speckle", [](int area, float difference, uint8_t bit, const Array<float, 2>& disparity,
                             const Array<float, 2>& confidence, const Array<uint8_t, 2>& flags, int threads,
                             const std::string& instructions) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    const Refusal refused = refusal_of(bit, disparity, confidence, flags, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) { refuse_speckle(H, W, area, difference, refused, kernels, workers); });
  });

  m.def("cut_off", [](const Array<const float, 2>& disparity, int left, int area, float difference, float nearer,
                      const Array<uint8_t, 2>& out, const std::string& instructions) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(out, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(1, [&](const Workers& workers) {
      cut_off(disparity.data(), H, W, left, area, difference, nearer, out.data(), kernels, workers);
    });
  });

  m.def("relief", [](const Array<const float, 3>& planes, float calm, float unit, const Array<uint8_t, 2>& out, int threads,
                     const std::string& instructions) {
    const int C = planes.shape(0), H = planes.shape(1), W = planes.shape(2);
    require(unit > 0, "unit is above 0");
    require_shape(out, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) { relief(planes.data(), C, H, W, calm, unit, out.data(), kernels, workers); });
  });

  m.def("flood", [](const Array<const uint8_t, 2>& relief, const Array<uint8_t, 2>& out) {
    const int H = relief.shape(0), W = relief.shape(1);
    require_shape(out, H, W);
    run(1, [&](const Workers& workers) { flood(relief.data(), H, W, out.data(), workers); });
  });

  m.def("keep_regions", [](const Array<const uint8_t, 2>& inside, const Array<const uint8_t, 2>& marked, double share, bool others,
                           const Array<uint8_t, 2>& out) {
    const int H = inside.shape(0), W = inside.shape(1);
    require_shape(marked, H, W);
    require_shape(out, H, W);
    run(1, [&](const Workers& workers) { keep_regions(inside.data(), marked.data(), H, W, share, others, out.data(), workers); });
  });

  m.def("noise_means", [](const Array<const float, 3>& image, int height, int width, const Array<double, 3>& out, int threads) {
    const int H = image.shape(0), W = image.shape(1), C = image.shape(2), rows = out.shape(0), columns = out.shape(1);
    require(height >= 1 && width >= 1, "a block has rows and columns");
    require(static_cast<int64_t>(rows) * height + 2 <= H && static_cast<int64_t>(columns) * width + 2 <= W, "blocks lie inside the image");
    require_shape(out, rows, columns, C);
    run(threads, [&](const Workers& workers) {
      noise_means(image.data(), W, C, {rows, columns, height, width}, out.data(), workers);
    });
  });

  m.def("median", [](const Array<const float, 2>& disparity, int size, const Array<float, 2>& out, int threads,
                     const std::string& instructions) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require(1 <= size && size <= 255, "size runs from 1 to 255");
    require_shape(out, H, W);
    const RowKernels& kernels = choose_rows(instructions);
    run(threads, [&](const Workers& workers) { median(disparity.data(), H, W, size, out.data(), kernels, workers); });
  });

  m.def("planar", [](const Array<const float, 2>& disparity, int window_width, int window_height, float tolerance, int iterations,
                     const Array<float, 2>& out, int threads, const std::string& instructions) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require(iterations >= 1, "iterations is at least 1");
    require_shape(out, H, W);
    const PlanarKernel& kernel = choose_planar(instructions);
    const Window window = window_of(window_width, window_height);
    run(threads, [&](const Workers& workers) {
      planar(disparity.data(), H, W, window, tolerance, iterations, out.data(), kernel, workers);
    });
  });

  m.def("accept", [](const Array<const float, 2>& disparity, const Array<const float, 2>& confidence,
                     const Array<const uint8_t, 2>& flags, const Array<float, 2>& accepted, const Array<float, 2>& trust,
                     int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    for (const auto& map : {confidence, Array<const float, 2>(accepted), Array<const float, 2>(trust)}) require_shape(map, H, W);
    require_shape(flags, H, W);
    run(threads, [&](const Workers& workers) {
      accept(disparity.data(), confidence.data(), flags.data(), H, W, accepted.data(), trust.data(), workers);
    });
  });

  m.def("judge", [](const std::optional<Array<const float, 2>>& winners, const Array<const float, 2>& confidence, float least,
                    float most, float near, int revocable, int wrong, const Array<float, 2>& smooth,
                    const Array<uint8_t, 2>& flags, const Array<float, 2>& accepted, const Array<float, 2>& trust, int threads) {
    const int H = smooth.shape(0), W = smooth.shape(1);
    if (winners) require_shape(*winners, H, W);
    for (const auto& map : {confidence, Array<const float, 2>(accepted), Array<const float, 2>(trust)}) require_shape(map, H, W);
    require_shape(flags, H, W);
    require(0 <= revocable && revocable <= 255 && 0 <= wrong && wrong <= 255, "flags have 8 bits");
    const Evidence seen{winners ? winners->data() : nullptr, confidence.data()};
    const Verdict verdict{least, most, near, static_cast<uint8_t>(revocable), static_cast<uint8_t>(wrong)};
    run(threads, [&](const Workers& workers) {
      judge(seen, verdict, H, W, smooth.data(), flags.data(), accepted.data(), trust.data(), workers);
    });
  });

  m.def("weighted_median", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 3>& guide, int size, int slope,
                              const Array<float, 2>& out, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require(1 <= size && size <= 11 && size % 2, "size is odd, up to 11");
    require(0 <= slope && slope <= 4080, "slope runs from 0 to 4080");
    require_shape(guide, H, W);
    require_shape(out, H, W);
    run(threads, [&](const Workers& workers) {
      weighted_median(disparity.data(), guide.data(), H, W, static_cast<int>(guide.shape(2)), size, slope, out.data(), workers);
    });
  });

  m.def("edge_aware", [](const Array<const float, 2>& disparity, const Pixels& guide, const Array<const float, 2>& tables,
                         float strength, int iterations, const Array<float, 2>& out, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    const SurfaceGuide surfaces = surface_guide(guide, tables, strength, H, W);
    require_shape(out, H, W);
    run(threads, [&](const Workers& workers) { edge_aware(disparity.data(), surfaces, H, W, iterations, out.data(), workers); });
  });

  m.def("probability", [](const Array<const float, 2>& surface, const Array<const uint8_t, 2>& answered,
                          const Array<const float, 2>& sharpness, const Array<const float, 2>& winners,
                          const Array<const float, 2>& texture, const Array<const float, 2>& weights,
                          const Array<const float, 1>& logistic, const Array<float, 2>& out, int threads) {
    const int H = surface.shape(0), W = surface.shape(1);
    require_shape(answered, H, W);
    require_shape(sharpness, H, W);
    require_shape(winners, H, W);
    require_shape(texture, H, W);
    require_shape(weights, 2, LogisticModel::kFeatures);
    require_shape(logistic, 257);
    require_shape(out, H, W);
    const AnsweredMap map{surface.data(), answered.data(), sharpness.data(), winners.data(), texture.data(), H, W};
    const LogisticModel model{weights.data(), weights.data() + LogisticModel::kFeatures, logistic.data()};
    run(threads, [&](const Workers& workers) { probability(map, model, out.data(), workers); });
  });

  bind_background<float>(m);
  bind_background<double>(m);

  m.def("interpolate", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 2>& occluded,
                          const Array<float, 2>& out) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(occluded, H, W);
    require_shape(out, H, W);
    run(1, [&](const Workers& workers) { interpolate(disparity.data(), occluded.data(), H, W, out.data(), workers); });
  });

  m.def("fill_surfaces", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 2>& occluded, const Pixels& guide,
                            const Array<const float, 2>& tables, float strength, float least, float most,
                            const Array<float, 2>& out, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    const SurfaceGuide surfaces = surface_guide(guide, tables, strength, H, W);
    require_shape(occluded, H, W);
    require_shape(out, H, W);
    run(threads, [&](const Workers& workers) {
      fill_surfaces(disparity.data(), occluded.data(), surfaces, H, W, least, most, out.data(), workers);
    });
  });

  m.def("nearer", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 2>& doubtful,
                     const Array<const float, 2>& again, const Array<float, 2>& out, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(doubtful, H, W);
    require_shape(again, H, W);
    require_shape(out, H, W);
    run(threads, [&](const Workers& workers) { nearer(disparity.data(), doubtful.data(), again.data(), H, W, out.data(), workers); });
  });

  m.def("outlines", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 2>& doubtful,
                       const Array<const uint8_t, 3>& image, const Array<const int32_t, 1>& alike, const Array<float, 2>& out,
                       int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    require_shape(doubtful, H, W);
    require_shape(image, H, W);
    require_shape(alike, 256);
    require_shape(out, H, W);
    run(threads, [&](const Workers& workers) {
      outlines(disparity.data(), doubtful.data(), image.data(), static_cast<int>(image.shape(2)), alike.data(), H, W, out.data(), workers);
    });
  });

  m.def("unfatten", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 2>& doubtful,
                       const Array<const uint8_t, 2>& left, const Array<const uint8_t, 2>& right, const Array<const uint8_t, 3>& image,
                       const Array<const int32_t, 1>& alike, const Array<float, 2>& out, int threads) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    for (const auto& map : {doubtful, left, right}) require_shape(map, H, W);
    require_shape(image, H, W);
    require_shape(alike, 256);
    require_shape(out, H, W);
    const GreyPair grey{left.data(), right.data()};
    run(threads, [&](const Workers& workers) {
      unfatten(disparity.data(), doubtful.data(), grey, image.data(), static_cast<int>(image.shape(2)), alike.data(), H, W, out.data(),
               workers);
    });
  });

  m.def("photometric", [](const Array<const float, 2>& disparity, const Array<const uint8_t, 2>& doubtful,
                          const Array<const uint8_t, 2>& left, const Array<const uint8_t, 2>& right, float least, float most,
                          const Array<float, 2>& out, int threads, const std::string& instructions) {
    const int H = disparity.shape(0), W = disparity.shape(1);
    for (const auto& map : {doubtful, left, right}) require_shape(map, H, W);
    require_shape(out, H, W);
    const GreyPair grey{left.data(), right.data()};
    const PhotometricKernel& kernel = choose_photometric(instructions);
    run(threads, [&](const Workers& workers) {
      photometric(disparity.data(), doubtful.data(), grey, H, W, least, most, out.data(), kernel, workers);
    });
  });

  m.def("align", [](const Pixels& left, const Pixels& right, int window_width, int window_height, int alignment, bool centred,
                    bool bytes, const Array<const float, 2>& start, const Array<float, 2>& disparity, int threads) {
    const AlignedPair pair = aligned_pair(left, right);
    const Window window = window_of(window_width, window_height);
    for (const auto& map : {start, Array<const float, 2>(disparity)}) require_shape(map, pair.height, pair.width);
    run(threads, [&](const Workers& workers) {
      align(pair, window, static_cast<Alignment>(alignment), centred, bytes, start.data(), disparity.data(), workers);
    });
  });

  m.def("align_planes", [](const Pixels& left, const Pixels& right, int window_width, int window_height,
                           const Array<const float, 2>& start, const Array<float, 2>& disparity,
                           const Array<float, 3>& slopes, int threads) {
    const AlignedPair pair = aligned_pair(left, right);
    const Window window = window_of(window_width, window_height);
    for (const auto& map : {start, Array<const float, 2>(disparity)}) require_shape(map, pair.height, pair.width);
    require_shape(slopes, pair.height, pair.width, 2);
    run(threads, [&](const Workers& workers) {
      align_planes(pair, window, start.data(), disparity.data(), slopes.data(), workers);
    });
  });

  m.def("align_intervals", [](const Pixels& left, const Pixels& right, int window_width, int window_height, int steps,
                              const Array<const float, 2>& start, const Array<float, 2>& disparity, int threads) {
    const AlignedPair pair = aligned_pair(left, right);
    const Window window = window_of(window_width, window_height);
    require(1 <= steps && steps <= 16, "steps run from 1 to 16");
    for (const auto& map : {start, Array<const float, 2>(disparity)}) require_shape(map, pair.height, pair.width);
    run(threads, [&](const Workers& workers) {
      align_intervals(pair, window, steps, start.data(), disparity.data(), workers);
    });
  });

  m.attr("most_aggregated_bits") = kMostAggregatedBits;
  bind_hide(m);
  m.def("sgm_sums", sgm_volume<false>);
  m.def("mgm_sums", sgm_volume<true>);
  m.def("sgm_census", sgm_match);
  bind_planes(m);
}
