// The kernels against naive loops, in every instruction set that this machine runs. Meant to be run under AddressSanitizer
// and UndefinedBehaviorSanitizer: every array, and the kernels' scratch memory, is exactly as large as it is said to be.
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <map>
#include <new>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "../dispatch.hpp"
#include "../parallel.hpp"
#include "../photometric.hpp"
#include "../pixelwise.hpp"
#include "../planar.hpp"
#include "../planes.hpp"
#include "../rows.hpp"
#include "../sgm.hpp"
#include "../stages.hpp"

using namespace stereopsis;

namespace {

int passed = 0, failed = 0;

void check(bool holds, int line, const std::string& told) {
  ++(holds ? passed : failed);
  if (!holds && failed <= 20) std::fprintf(stderr, "line %d: %s\n", line, told.c_str());
}
#define CHECK(condition, told) check((condition), __LINE__, std::string(#condition) + ": " + (told))

std::string text(int v) { return std::to_string(v); }

// A generator of its own, so that every machine tests the same.
struct Random {
  uint64_t state;
  uint32_t next() {
    state = state * 6364136223846793005u + 1442695040888963407u;
    return static_cast<uint32_t>(state >> 33);
  }
  int below(int n) { return static_cast<int>(next() % static_cast<uint32_t>(n)); }
  int between(int low, int high) { return low + below(high - low + 1); }
};

const Workers kAlone{1, [] { return false; }};

// One of the builds that this machine can run.
std::string any_instructions(Random& random) {
  const auto kernels = available_kernels();
  return kernels[random.below(static_cast<int>(kernels.size()))]->name;
}
const RowKernels& any_rows(Random& random) { return choose_rows(any_instructions(random)); }

int clamp(int v, int lo, int hi) { return std::min(std::max(v, lo), hi); }

// ---- problems -------------------------------------------------------------------------------------------------------

struct Problem {
  int height, width, channels, first, count;
  Window window;
  std::vector<int32_t> left, right;
  std::vector<uint8_t> left8, right8;  // the same, where they fit

  Pair wide() const { return {left.data(), right.data(), height, width, channels, first, count}; }
  Pair narrow() const { return {left8.data(), right8.data(), height, width, channels, first, count}; }
  bool fits() const { return !left8.empty() && narrow_fits(window, channels); }

  int32_t at(const std::vector<int32_t>& image, int y, int x, int c) const {
    return image[(static_cast<size_t>(clamp(y, 0, height - 1)) * width + clamp(x, 0, width - 1)) * channels + c];
  }
  bool in_view(int x, int i) const { return 0 <= x - first - i && x - first - i < width; }

  std::string told() const {
    return text(height) + "x" + text(width) + "x" + text(channels) + " first " + text(first) + " count " + text(count) +
           " window " + text(window.width) + "x" + text(window.height) + (fits() ? " narrow" : " wide");
  }
};

enum class Pixels { few, bytes, extreme, white, black_white, camera, words, fixed };

Problem problem(Random& random, Pixels pixels, int height, int width, int channels, int first, int count, Window window) {
  Problem p{height, width, channels, first, count, window, {}, {}, {}, {}};
  const size_t size = static_cast<size_t>(height) * width * channels;
  const auto pixel = [&](bool right) -> int32_t {
    switch (pixels) {
      case Pixels::few:
        return random.below(3);
      case Pixels::bytes:
        return random.below(256);
      case Pixels::extreme:
        return random.below(2) * 255;
      case Pixels::white:
        return 255 - (random.below(10) == 0);
      case Pixels::black_white:
        return right ? 255 : 0;
      case Pixels::camera:
        return random.below(4) ? random.below(4096) : random.below(2) * 4095;
      case Pixels::words:
        return random.below(4) ? random.below(65536) : random.below(2) * 65535;
      case Pixels::fixed:
        return random.below(4) ? random.between(-(1 << 21), 1 << 21) : random.below(2) * (1 << 22) - (1 << 21);
    }
    return 0;
  };
  for (size_t k = 0; k < size; ++k) {
    p.left.push_back(pixel(false));
    p.right.push_back(pixel(true));
  }
  // Half of the rows have true matches.
  const int shift = random.below(4);
  if (pixels != Pixels::black_white)
    for (int y = 0; y < height; y += 2)
      for (int x = 0; x + shift < width; ++x)
        for (int c = 0; c < channels; ++c)
          p.right[(static_cast<size_t>(y) * width + x) * channels + c] = p.at(p.left, y, x + shift, c);
  if (pixels != Pixels::camera && pixels != Pixels::words && pixels != Pixels::fixed) {
    p.left8.assign(p.left.begin(), p.left.end());
    p.right8.assign(p.right.begin(), p.right.end());
  }
  p.left.shrink_to_fit();
  p.right.shrink_to_fit();
  p.left8.shrink_to_fit();
  p.right8.shrink_to_fit();
  return p;
}

// ---- the formulas, window by window ---------------------------------------------------------------------------------

struct Naive {
  int64_t whole;   // SAD and SSD, exact
  double cost;     // any cost
  double natural;  // what its rounding is measured by
};

Naive naive_cost(const Problem& p, CostKind kind, int y, int x, int i) {
  const int xr = x - p.first - i;
  int64_t absolute = 0, squared = 0;
  double zero_mean_absolute = 0, product = 0, ll = 0, rr = 0, zll = 0, zrr = 0, zlr = 0, magnitude = 0;
  for (int c = 0; c < p.channels; ++c) {
    int64_t sl = 0, sr = 0;
    const auto each = [&](auto visit) {
      for (int dy = -p.window.above(); dy <= p.window.below(); ++dy)
        for (int dx = -p.window.left(); dx <= p.window.right(); ++dx)
          visit(static_cast<int64_t>(p.at(p.left, y + dy, x + dx, c)), static_cast<int64_t>(p.at(p.right, y + dy, xr + dx, c)));
    };
    each([&](int64_t l, int64_t r) {
      absolute += std::abs(l - r);
      squared += (l - r) * (l - r);
      product += static_cast<double>(l * r);
      ll += static_cast<double>(l * l);
      rr += static_cast<double>(r * r);
      sl += l;
      sr += r;
      magnitude += static_cast<double>(std::abs(l) + std::abs(r));
    });
    const double n = static_cast<double>(p.window.area()), ml = static_cast<double>(sl) / n, mr = static_cast<double>(sr) / n;
    each([&](int64_t l, int64_t r) {
      const double a = static_cast<double>(l) - ml, b = static_cast<double>(r) - mr;
      zero_mean_absolute += std::fabs(a - b);
      zll += a * a;
      zrr += b * b;
      zlr += a * b;
    });
  }
  switch (kind) {
    case CostKind::sad:
      return {absolute, static_cast<double>(absolute), 0};
    case CostKind::ssd:
      return {squared, static_cast<double>(squared), 0};
    case CostKind::zsad:
      return {0, zero_mean_absolute, magnitude};
    case CostKind::zssd:
      return {0, zll + zrr - 2 * zlr, zll + zrr + std::fabs(squared)};
    case CostKind::ncc:
      return {0, ll > 0 && rr > 0 ? -product / std::sqrt(ll * rr) : 0, 1};
    case CostKind::zncc: {
      // Exactly constant windows have no norm; the sums above are exact enough to tell.
      const bool flat = zll < 1e-6 || zrr < 1e-6;
      // In 32-bit arithmetic the covariance is rounded where it is still as large as the windows' area times a pixel.
      const double norm = std::sqrt(zll * zrr), pixels = static_cast<double>(p.window.area()) * p.channels;
      return {0, flat ? 0 : -zlr / norm, flat ? 1 : 1 + (p.fits() ? 2 * pixels / norm : 0)};
    }
  }
  return {0, 0, 0};
}

// ---- the composed path -----------------------------------------------------------------------------------------------

const CostKind kCosts[] = {CostKind::sad, CostKind::ssd, CostKind::zsad, CostKind::zssd, CostKind::ncc, CostKind::zncc};
const char* const kNames[] = {"sad", "ssd", "zsad", "zssd", "ncc", "zncc"};
std::string name(CostKind kind) { return kNames[static_cast<int>(kind)]; }

template <class T>
std::vector<T> composed_volume(const Problem& p, CostKind kind, bool narrow, const Workers& workers = kAlone) {
  const size_t size = static_cast<size_t>(p.height) * p.width * p.count;
  std::vector<T> costs(size);
  if constexpr (std::is_same<T, float>::value)
    if (kind == CostKind::zsad) {
      score_zsad(p.wide(), p.window, costs.data(), workers);
      return costs;
    }
  const size_t padded =
      static_cast<size_t>(p.height + p.window.height - 1) * (p.width + p.window.width - 1) * static_cast<size_t>(p.count);
  std::vector<int64_t> each(padded), sums(size);
  terms(p.wide(), p.window, kind == CostKind::sad ? Term::absolute_difference : Term::product, each.data(), workers);
  box(each.data(), p.height, p.width, p.count, p.window, sums.data(), workers);
  score(p.wide(), p.window, kind, narrow, sums.data(), costs.data(), workers);
  return costs;
}

struct Answer {
  std::vector<float> disparity, confidence;
  std::vector<uint8_t> flags;
  explicit Answer(size_t size) : disparity(size, -1), confidence(size, -1), flags(size, 255) {}
  FusedOutput out() { return {disparity.data(), confidence.data(), flags.data()}; }
};

template <class T>
int naive_winner(const std::vector<T>& costs) {
  int best = -1;
  for (int i = 0; i < static_cast<int>(costs.size()); ++i)
    if (costs[i] != worst_cost<T>() && (best < 0 || costs[i] < costs[best])) best = i;
  return best;
}

// Everything after the volume, in the plainest terms.
template <class T>
Answer naive_answer(const Problem& p, const std::vector<T>& volume, const FusedSettings& s) {
  const int H = p.height, W = p.width, D = p.count;
  Answer answer(static_cast<size_t>(H) * W);
  const auto costs_at = [&](int y, int x) {
    const auto begin = volume.begin() + (static_cast<ptrdiff_t>(y) * W + x) * D;
    return std::vector<T>(begin, begin + D);
  };
  const auto right_winner = [&](int y, int xr) {
    std::vector<T> costs(D, worst_cost<T>());
    for (int i = 0; i < D; ++i) {
      const int x = xr + p.first + i;
      if (0 <= x && x < W) costs[i] = volume[(static_cast<size_t>(y) * W + x) * D + i];
    }
    return naive_winner(costs);
  };
  const float perfect = s.cost == CostKind::ncc || s.cost == CostKind::zncc ? -1.0f : 0.0f;
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x) {
      const size_t at = static_cast<size_t>(y) * W + x;
      const std::vector<T> costs = costs_at(y, x);
      const int i = naive_winner(costs);
      int flag = 0;
      if (i < 0) flag = 32;
      if (s.uniqueness && i >= 0)
        for (int k = 0; k < D; ++k)
          if (std::abs(k - i) > 1 && p.in_view(x, k) &&
              static_cast<double>(costs[k]) - perfect <= (static_cast<double>(costs[i]) - perfect) * s.ratio)
            flag |= 4;
      if (s.left_right && i >= 0) {
        if (static_cast<float>(std::abs(right_winner(y, x - p.first - i) - i)) > s.tolerance) {
          bool claimed = false;
          for (int xr = 0; xr < W; ++xr) {
            const int j = right_winner(y, xr);
            claimed = claimed || (j >= 0 && static_cast<float>(std::abs(xr + p.first + j - x)) <= s.tolerance);
          }
          flag |= claimed ? 2 : 1;
        }
      }
      answer.flags[at] = static_cast<uint8_t>(flag);
      if (flag) {
        answer.disparity[at] = std::numeric_limits<float>::quiet_NaN();
        answer.confidence[at] = 0;
        continue;
      }
      const bool before = i > 0 && p.in_view(x, i - 1), after = i + 1 < D && p.in_view(x, i + 1);
      const T c = costs[i], b = before ? costs[i - 1] : after ? costs[i + 1] : c, a = after ? costs[i + 1] : b;
      float offset = 0;
      if (before && after && s.subpixel != Subpixel::none) {
        const float rb = static_cast<float>(b - c), ra = static_cast<float>(a - c);
        const float reach = s.subpixel == Subpixel::parabola ? rb + ra : std::max(rb, ra);
        offset = reach > 0 ? 0.5f * (rb - ra) / reach : 0.0f;
      }
      answer.disparity[at] = static_cast<float>(p.first + i) + offset;
      const float around = 0.5f * (static_cast<float>(b) + static_cast<float>(a)), reach = around - perfect;
      answer.confidence[at] =
          reach > 0 ? std::min(std::max((around - static_cast<float>(c)) / reach, 0.0f), 1.0f) : 0.0f;
    }
  return answer;
}

bool same(const std::vector<float>& a, const std::vector<float>& b) {
  return std::memcmp(a.data(), b.data(), a.size() * sizeof(float)) == 0;
}
bool same(const Answer& a, const Answer& b) {
  return a.flags == b.flags && same(a.disparity, b.disparity) && same(a.confidence, b.confidence);
}

// ---- the streaming kernels -------------------------------------------------------------------------------------------

struct Scratch {
  void* memory;
  explicit Scratch(size_t bytes) : memory(::operator new(bytes, std::align_val_t{64})) {
    // What an earlier row left behind must not matter.
    std::memset(memory, 0xA5, bytes);
  }
  ~Scratch() { ::operator delete(memory, std::align_val_t{64}); }
  Scratch(const Scratch&) = delete;
  Scratch& operator=(const Scratch&) = delete;
};

Answer stream(const FusedKernel& kernel, const Problem& p, const FusedSettings& s, bool narrow, int bands = 1) {
  const Pair pair = narrow ? p.narrow() : p.wide();
  Answer answer(static_cast<size_t>(p.height) * p.width);
  const Cancel cancel{false};
  for (int k = 0; k < bands; ++k) {
    const Scratch scratch(kernel.scratch_bytes(pair, s, narrow));
    const int begin = p.height * k / bands, end = p.height * (k + 1) / bands;
    std::atomic<int> left{end - begin};
    RowsToTake rows(begin, end, left, k % 2 == 1);
    kernel.rows(pair, s, narrow, answer.out(), rows, scratch.memory, cancel);
  }
  return answer;
}

void compare_volume(const Problem& p, CostKind kind, bool narrow, const std::vector<int64_t>& volume) {
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x)
      for (int i = 0; i < p.count; ++i) {
        const int64_t cost = volume[(static_cast<size_t>(y) * p.width + x) * p.count + i];
        const bool right = p.in_view(x, i) ? cost == naive_cost(p, kind, y, x, i).whole : cost == worst_cost<int64_t>();
        if (!right) return CHECK(!"the volume is the formula's", name(kind) + text(narrow) + " " + p.told());
      }
  ++passed;
}

void compare_volume(const Problem& p, CostKind kind, bool narrow, const std::vector<float>& volume) {
  for (int y = 0; y < p.height; ++y)
    for (int x = 0; x < p.width; ++x)
      for (int i = 0; i < p.count; ++i) {
        const double cost = volume[(static_cast<size_t>(y) * p.width + x) * p.count + i];
        const Naive naive = naive_cost(p, kind, y, x, i);
        const bool right = p.in_view(x, i) ? std::fabs(cost - naive.cost) <= 2e-5 * (naive.natural + std::fabs(naive.cost))
                                           : cost == std::numeric_limits<double>::infinity();
        if (!right)
          return CHECK(!"the volume is the formula's", name(kind) + (narrow ? " narrow " : " wide ") + std::to_string(cost) +
                                                           " not " + std::to_string(naive.cost) + " " + p.told());
      }
  ++passed;
}

FusedSettings settings(Random& random, CostKind kind, const Window& window) {
  FusedSettings s{kind, window, static_cast<Subpixel>(random.below(3)), random.below(2) == 0, 0, random.below(2) == 0, 1};
  s.tolerance = static_cast<float>(random.below(5)) * 0.5f;
  s.ratio = 1 + random.below(3) * 0.05;
  return s;
}

template <class T>
void compare_paths(Random& random, const Problem& p, CostKind kind, bool narrow, bool formula) {
  const std::vector<T> volume = composed_volume<T>(p, kind, narrow);
  if (formula) compare_volume(p, kind, narrow, volume);
  for (int round = 0; round < 2; ++round) {
    FusedSettings s = settings(random, kind, p.window);
    if (round > 0 && !narrow) s.range = range_of(p.wide());
    const Answer definition = naive_answer(p, volume, s);
    for (const FusedKernel* kernel : available_kernels()) {
      const Answer answer = stream(*kernel, p, s, narrow, 1 + round * random.below(p.height + 1));
      CHECK(same(answer, definition), std::string(kernel->name) + " " + name(kind) + (narrow ? " narrow " : " wide ") +
                                          p.told() + " subpixel " + text(static_cast<int>(s.subpixel)) + " left-right " +
                                          text(s.left_right) + " uniqueness " + text(s.uniqueness));
    }
  }
}

void compare(Random& random, const Problem& p, CostKind kind, bool formula = true) {
  for (const bool narrow : {false, true}) {
    if (narrow && (!p.fits() || kind == CostKind::zsad)) continue;
    if (kind == CostKind::sad || kind == CostKind::ssd)
      compare_paths<int64_t>(random, p, kind, narrow, formula);
    else
      compare_paths<float>(random, p, kind, narrow, formula);
  }
}

// ---- tests -----------------------------------------------------------------------------------------------------------

void test_small_problems() {
  Random random{1};
  const Pixels kinds[] = {Pixels::few, Pixels::bytes, Pixels::extreme, Pixels::white, Pixels::camera, Pixels::words, Pixels::fixed};
  for (int round = 0; round < 60; ++round)
    for (const CostKind cost : kCosts) {
      const int width = random.between(1, 40), first = random.between(-width - 2, width + 2);
      // Only candidates that some pixel can see are asked for.
      const int low = std::max(first, 1 - width), high = std::min(first + random.between(1, 2 * width), width);
      if (low >= high) continue;
      compare(random, problem(random, kinds[random.below(7)], random.between(1, 7), width, random.below(2) ? 1 : 3, low,
                              high - low, {random.between(1, 9), random.between(1, 9)}),
              cost);
    }
}

void test_sizes_around_those_of_vectors() {
  Random random{2};
  for (const int count : {1, 7, 8, 9, 15, 16, 17, 31, 32, 33, 63, 64, 65, 127, 128, 129, 200, 300})
    for (const CostKind cost : kCosts) {
      const int width = count + random.between(-1, 20), first = random.between(-2, 2);
      if (width < 1) continue;
      const int low = std::max(first, 1 - width), high = std::min(first + count, width);
      compare(random, problem(random, Pixels::bytes, 2, width, count < 100 && random.below(2) ? 3 : 1, low, high - low, {3, 2}),
              cost, false);
    }
  for (const int width : {1, 2, 15, 16, 17, 31, 32, 33, 127, 128, 129})
    for (const CostKind cost : kCosts)
      for (const int channels : {1, 3})
        compare(random, problem(random, Pixels::extreme, 2, width, channels, 0, std::min(width, 19), {4, 3}), cost, false);
}

// Windows on both sides of where sums no longer fit 32 bits, over images that drive them to their bounds.
void test_bounds_of_sums() {
  Random random{3};
  for (const Window window : {Window{255, 129}, {181, 182}, {182, 182}, {192, 172}, {172, 192}, {254, 130}, {255, 130}})
    for (const Pixels pixels : {Pixels::extreme, Pixels::white, Pixels::black_white, Pixels::bytes})
      for (const CostKind cost : kCosts)
        if (cost != CostKind::zsad)
          compare(random, problem(random, pixels, 2, 7, 1, -1, 3, window), cost, pixels == Pixels::white);
  for (const Window window : {Window{128, 86}, {86, 128}, {105, 105}})
    for (const Pixels pixels : {Pixels::extreme, Pixels::white, Pixels::black_white})
      for (const CostKind cost : kCosts)
        if (cost != CostKind::zsad) compare(random, problem(random, pixels, 2, 6, 3, -1, 3, window), cost, false);
  for (const Pixels pixels : {Pixels::extreme, Pixels::words, Pixels::fixed})
    for (const CostKind cost : kCosts)
      compare(random, problem(random, pixels, 1, 3, 3, -1, 2, {255, 255}), cost, pixels != Pixels::extreme);
  // Products of 12 bits fit 32 up to 511 pixels, of 21 and a sign a double's 53 up to 511 as well; squared differences of 12 bits fit
  // 31 up to 128 pixels, absolute ones of 16 bits up to 32768.
  for (const Window window : {Window{73, 7}, {7, 73}, {64, 8}, {8, 64}, {64, 2}, {43, 3}})
    for (const Pixels pixels : {Pixels::camera, Pixels::fixed})
      for (const CostKind cost : kCosts)
        if (cost != CostKind::zsad) compare(random, problem(random, pixels, 3, 20, 1, -4, 20, window), cost, cost == CostKind::zncc);
  for (const Window window : {Window{255, 128}, {255, 129}})
    compare(random, problem(random, Pixels::words, 2, 7, 1, -1, 3, window), CostKind::sad);
  for (const Window window : {Window{17, 10}, {19, 9}, {7, 6}, {43, 1}})
    for (const Pixels pixels : {Pixels::camera, Pixels::fixed})
      for (const CostKind cost : kCosts)
        if (cost != CostKind::zsad) compare(random, problem(random, pixels, 2, 20, 3, -4, 20, window), cost, false);
  for (const Window window : {Window{255, 1}, {1, 255}, {255, 2}, {2, 255}})
    for (const CostKind cost : kCosts) compare(random, problem(random, Pixels::extreme, 3, 20, 1, -4, 12, window), cost);
}

void test_ties_go_to_the_first_candidate() {
  for (const CostKind cost : kCosts) {
    Random random{4};
    Problem p = problem(random, Pixels::few, 3, 40, 1, -4, 30, {5, 3});
    for (auto* image : {&p.left, &p.right}) std::fill(image->begin(), image->end(), 77);
    for (auto* image : {&p.left8, &p.right8}) std::fill(image->begin(), image->end(), 77);
    const FusedSettings s{cost, p.window, Subpixel::none, false, 0, false, 1};
    for (const FusedKernel* kernel : available_kernels()) {
      const Answer answer = stream(*kernel, p, s, cost != CostKind::zsad);
      bool smallest = true;
      for (int y = 0; y < 3; ++y)
        for (int x = 0; x < 40; ++x)
          smallest = smallest && answer.disparity[y * 40 + x] == static_cast<float>(std::max(-4, x - 39));
      CHECK(smallest, std::string(kernel->name) + " " + name(cost));
    }
  }
}

void test_grey() {
  Random random{5};
  std::vector<int32_t> rgb, out(35);
  std::vector<uint8_t> rgb8, out8(35);
  for (int k = 0; k < 105; ++k) {
    rgb8.push_back(static_cast<uint8_t>(k < 30 ? 255 : random.below(256)));
    rgb.push_back(k < 30 ? (k < 15 ? 1 << 21 : -(1 << 21)) : random.between(-(1 << 21), 1 << 21));
  }
  grey(rgb.data(), 5, 7, out.data(), any_rows(random), {3, [] { return false; }});
  grey(rgb8.data(), 5, 7, out8.data(), any_rows(random), kAlone);
  bool right = true;
  for (int k = 0; k < 35; ++k) {
    const auto exact = [&](const auto* v) { return (9798.0 * v[0] + 19235.0 * v[1] + 3735.0 * v[2]) / 32768; };
    right = right && out[k] == static_cast<int32_t>(std::floor(exact(&rgb[3 * k]) + 0.5)) &&
            out8[k] == static_cast<uint8_t>(std::floor(exact(&rgb8[3 * k]) + 0.5));
  }
  CHECK(right, "grey");
  CHECK(out8[0] == 255 && out[0] == 1 << 21, "white stays white");
  // Rows of every length end where the memory does.
  for (int width = 1; width < 100; ++width) {
    std::vector<uint8_t> row(3 * width), found(width);
    for (uint8_t& value : row) value = static_cast<uint8_t>(random.below(256));
    grey(row.data(), 1, width, found.data(), any_rows(random), kAlone);
    bool same = true;
    for (int k = 0; k < width; ++k)
      same = same && found[k] == (9798 * row[3 * k] + 19235 * row[3 * k + 1] + 3735 * row[3 * k + 2] + (1 << 14)) >> 15;
    CHECK(same, "width " + text(width));
  }
}

void test_halving() {
  Random random{6};
  for (int round = 0; round < 40; ++round) {
    const int H = random.between(1, 7), W = random.between(1, 150);
    std::vector<uint8_t> image(static_cast<size_t>(H) * W), means(static_cast<size_t>(H / 2) * (W / 2));
    for (uint8_t& value : image) value = static_cast<uint8_t>(random.below(256));
    halve(image.data(), H, W, means.data(), any_rows(random), kAlone);
    bool right = true;
    for (int y = 0; y < H / 2; ++y)
      for (int x = 0; x < W / 2; ++x) {
        const uint8_t* const at = &image[2 * y * W + 2 * x];
        right = right && means[y * (W / 2) + x] == (at[0] + at[1] + at[W] + at[W + 1] + 2) / 4;
      }
    CHECK(right, text(H) + "x" + text(W));
  }
}

void test_stretching() {
  Random random{7};
  for (int round = 0; round < 40; ++round) {
    const int H = random.between(1, 5), W = random.between(1, 100);
    const double low = random.between(-500, 500) + 0.25 * random.below(4), factor = 1.0 / (1 << random.below(5));
    std::vector<int32_t> image(static_cast<size_t>(H) * W);
    std::vector<uint8_t> bytes(image.size());
    for (int32_t& value : image) value = random.between(-1000, 5000);
    stretch(image.data(), H, W, low, factor, bytes.data(), any_rows(random), kAlone);
    bool right = true;
    for (size_t k = 0; k < image.size(); ++k)
      right = right && bytes[k] == std::nearbyint(std::min(std::max((image[k] - low) * factor, 0.0), 255.0));
    CHECK(right, text(H) + "x" + text(W));
  }
}

void test_terms_and_box() {
  Random random{6};
  for (int round = 0; round < 30; ++round) {
    const Problem p = problem(random, Pixels::fixed, random.between(1, 6), random.between(1, 9), random.below(2) ? 1 : 3,
                              random.between(-9, 5), random.between(1, 6), {random.between(1, 8), random.between(1, 8)});
    const Workers workers{random.between(1, 9), [] { return false; }};
    const int rows = p.height + p.window.height - 1, columns = p.width + p.window.width - 1;
    for (const Term term : {Term::product, Term::absolute_difference}) {
      std::vector<int64_t> each(static_cast<size_t>(rows) * columns * p.count);
      std::vector<int64_t> sums(static_cast<size_t>(p.height) * p.width * p.count);
      terms(p.wide(), p.window, term, each.data(), workers);
      box(each.data(), p.height, p.width, p.count, p.window, sums.data(), workers);
      bool right = true;
      for (int y = 0; y < p.height; ++y)
        for (int x = 0; x < p.width; ++x)
          for (int i = 0; i < p.count; ++i) {
            int64_t sum = 0;
            for (int dy = -p.window.above(); dy <= p.window.below(); ++dy)
              for (int dx = -p.window.left(); dx <= p.window.right(); ++dx)
                for (int c = 0; c < p.channels; ++c) {
                  const int64_t l = p.at(p.left, y + dy, x + dx, c), r = p.at(p.right, y + dy, x + dx - p.first - i, c);
                  sum += term == Term::product ? l * r : std::abs(l - r);
                }
            right = right && sums[(static_cast<size_t>(y) * p.width + x) * p.count + i] == sum;
          }
      CHECK(right, p.told());
    }
  }
}

// ---- supports -------------------------------------------------------------------------------------------------------

struct Weighed {
  int dy, dx;
  double weight;
};

double naive_mean_cost(const Problem& p, CostKind kind, const std::vector<Weighed>& support, int y, int x, int d) {
  const auto mean = [&](auto value) {
    double sum = 0, weights = 0;
    for (const Weighed& w : support) {
      sum += w.weight * value(w);
      weights += w.weight;
    }
    return sum / weights;
  };
  const bool centred = kind == CostKind::zsad || kind == CostKind::zssd || kind == CostKind::zncc;
  double first = 0, left_norm = 0, right_norm = 0, left_square = 0, right_square = 0;
  for (int c = 0; c < p.channels; ++c) {
    const auto l = [&](const Weighed& w) { return static_cast<double>(p.at(p.left, y + w.dy, x + w.dx, c)); };
    const auto r = [&](const Weighed& w) { return static_cast<double>(p.at(p.right, y + w.dy, x - d + w.dx, c)); };
    const double ml = centred ? mean(l) : 0, mr = centred ? mean(r) : 0;
    first += mean([&](const Weighed& w) {
      const double a = l(w) - ml, b = r(w) - mr;
      return is_correlation(kind) ? a * b : kind == CostKind::sad || kind == CostKind::zsad ? std::abs(a - b) : (a - b) * (a - b);
    });
    left_norm += mean([&](const Weighed& w) { return (l(w) - ml) * (l(w) - ml); });
    right_norm += mean([&](const Weighed& w) { return (r(w) - mr) * (r(w) - mr); });
    left_square += mean([&](const Weighed& w) { return l(w) * l(w); });
    right_square += mean([&](const Weighed& w) { return r(w) * r(w); });
  }
  if (!is_correlation(kind)) return first;
  const bool has_norm = left_norm > 1e-12 * left_square && right_norm > 1e-12 * right_square;
  return has_norm ? -first / std::sqrt(left_norm * right_norm) : 0;
}

template <class Support>
void check_support(const Problem& p, const Sampling& sampling, const std::string& told, Support support,
                   const std::function<void(CostKind, float*, const SupportKernels&)>& costs) {
  const int rows = sampled(p.height, sampling.step), columns = sampled(p.width, sampling.step);
  for (int kind = 0; kind < 6; ++kind) {
    std::vector<float> expected;
    for (const FusedKernel* kernel : available_kernels()) {
      std::vector<float> got(static_cast<size_t>(rows) * columns * p.count);
      costs(static_cast<CostKind>(kind), got.data(), *kernel->supports);
      if (expected.empty()) {
        expected = got;
        bool right = true;
        size_t at = 0;
        for (int y = 0; y < p.height; y += sampling.step)
          for (int x = 0; x < p.width; x += sampling.step)
            for (int i = 0; i < p.count; ++i, ++at) {
              const int d = p.first + i * sampling.disparity_step;
              if (x - d < 0 || x - d >= p.width) {
                right = right && got[at] == worst_cost<float>();
                continue;
              }
              const double naive = naive_mean_cost(p, static_cast<CostKind>(kind), support(y, x), y, x, d);
              right = right && std::abs(got[at] - naive) <= 1e-5 * std::max(1.0, std::abs(naive)) + 1e-3 * (kind == 3);
            }
        CHECK(right, told + " " + text(kind) + " " + p.told());
      }
      CHECK(got == expected, kernel->name + (" " + told) + " " + text(kind) + " " + p.told());
    }
  }
}

void test_supports() {
  Random random{11};
  for (int round = 0; round < 24; ++round) {
    const Problem p = problem(random, round % 3 ? Pixels::bytes : Pixels::words, random.between(1, 5), random.between(1, 20),
                              round % 4 ? 1 : 3, random.between(-9, 5), random.between(1, 20),
                              {random.between(1, 5), random.between(1, 5)});
    const Pair pair = p.wide();
    const Sampling sampling{random.between(1, 2), random.between(1, 3)};
    const Workers workers{random.between(1, 3), [] { return false; }};
    const auto box = [&](auto weight) {
      std::vector<Weighed> support;
      for (int dy = -p.window.above(); dy <= p.window.below(); ++dy)
        for (int dx = -p.window.left(); dx <= p.window.right(); ++dx) support.push_back({dy, dx, weight(dy, dx)});
      return support;
    };

    const std::vector<double> taps{0.1, 0.2, 0.4, 0.2, 0.1};
    check_support(
        p, sampling, "separable",
        [&](int, int) {
          std::vector<Weighed> support;
          for (int dy = -2; dy <= 2; ++dy)
            for (int dx = -2; dx <= 2; ++dx) support.push_back({dy, dx, taps[dy + 2] * taps[dx + 2]});
          return support;
        },
        [&](CostKind kind, float* costs, const SupportKernels& kernels) {
          separable_costs(pair, kind, sampling, taps.data(), 2, costs, kernels, workers);
        });

    check_support(
        p, sampling, "bilateral",
        [&](int y, int x) {
          return box([&](int dy, int dx) {
            double square = 0;
            for (int c = 0; c < p.channels; ++c) {
              const double a = p.at(p.left, y + dy, x + dx, c) - static_cast<double>(p.at(p.left, y, x, c));
              square += a * a / p.channels;
            }
            return std::exp(-std::sqrt(static_cast<double>(dx * dx + dy * dy)) / 3 - std::sqrt(square) / 5000);
          });
        },
        [&](CostKind kind, float* costs, const SupportKernels& kernels) {
          bilateral_costs(pair, kind, sampling, p.window, 3, 5000, costs, kernels, workers);
        });

    std::vector<Reach> arms(static_cast<size_t>(p.height) * p.width), boxes;
    cross_arms(p.left.data(), p.height, p.width, p.channels, 4, 100, arms.data(), workers);
    check_support(
        p, sampling, "cross",
        [&](int y, int x) {
          std::vector<Weighed> support;
          const Reach& arm = arms[static_cast<size_t>(y) * p.width + x];
          for (int dy = -arm.above; dy <= arm.below; ++dy) {
            const Reach& other = arms[static_cast<size_t>(y + dy) * p.width + x];
            for (int dx = -other.left; dx <= other.right; ++dx) support.push_back({dy, dx, 1});
          }
          return support;
        },
        [&](CostKind kind, float* costs, const SupportKernels& kernels) {
          reach_costs(pair, kind, sampling, true, arms.data(), costs, kernels, workers);
        });

    for (size_t k = 0; k < arms.size(); ++k)
      boxes.push_back({random.below(6), random.below(6), random.below(6), random.below(6)});
    check_support(
        p, sampling, "rectangle",
        [&](int y, int x) {
          std::vector<Weighed> support;
          const Reach& reach = boxes[static_cast<size_t>(y) * p.width + x];
          for (int dy = -reach.above; dy <= reach.below; ++dy)
            for (int dx = -reach.left; dx <= reach.right; ++dx) support.push_back({dy, dx, 1});
          return support;
        },
        [&](CostKind kind, float* costs, const SupportKernels& kernels) {
          reach_costs(pair, kind, sampling, false, boxes.data(), costs, kernels, workers);
        });
  }
}

template <class T>
void test_select() {
  Random random{7};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 4), W = random.between(1, 12), D = random.between(1, 14), first = random.between(-14, 14);
    const size_t size = static_cast<size_t>(H) * W;
    std::vector<T> volume(size * D), cost(size), before(size), after(size), second(size);
    std::vector<int32_t> index(size), right(size);
    const auto in_view = [&](int x, int i) { return 0 <= x - first - i && x - first - i < W; };
    for (size_t k = 0; k < volume.size(); ++k)
      volume[k] = in_view(static_cast<int>(k / D % W), static_cast<int>(k % D)) ? static_cast<T>(random.below(5)) : worst_cost<T>();
    const Workers workers{random.between(1, 5), [] { return false; }};
    select_left<T>(volume.data(), H, W, D, first, {index.data(), cost.data(), before.data(), after.data(), second.data()}, workers);
    select_right<T>(volume.data(), H, W, D, first, right.data(), workers);
    bool lefts = true, rights = true;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x) {
        const size_t at = static_cast<size_t>(y) * W + x;
        const std::vector<T> costs(volume.begin() + at * D, volume.begin() + (at + 1) * D);
        const int i = naive_winner(costs);
        T least = worst_cost<T>();
        for (int k = 0; k < D; ++k)
          if (i >= 0 && std::abs(k - i) > 1) least = std::min(least, costs[k]);
        lefts = lefts && index[at] == i && cost[at] == (i < 0 ? worst_cost<T>() : costs[i]) &&
                before[at] == (i > 0 ? costs[i - 1] : worst_cost<T>()) &&
                after[at] == (i >= 0 && i + 1 < D ? costs[i + 1] : worst_cost<T>()) && second[at] == least;
        std::vector<T> across(D, worst_cost<T>());
        for (int k = 0; k < D; ++k)
          if (0 <= x + first + k && x + first + k < W) across[k] = volume[(static_cast<size_t>(y) * W + x + first + k) * D + k];
        rights = rights && right[at] == naive_winner(across);
      }
    CHECK(lefts, "round " + text(round));
    CHECK(rights, "round " + text(round));
  }
}

void test_texture() {
  Random random{8};
  for (int round = 0; round < 40; ++round) {
    const Problem p = problem(random, round % 2 ? Pixels::fixed : Pixels::bytes, random.between(1, 7), random.between(1, 9),
                              round % 3 ? 1 : 3, 0, 1, {random.between(1, 12), random.between(1, 12)});
    std::vector<float> mean(static_cast<size_t>(p.height) * p.width);
    texture(p.left.data(), p.height, p.width, p.channels, p.window, mean.data(), {random.between(1, 9), [] { return false; }});
    bool right = true;
    for (int y = 0; y < p.height; ++y)
      for (int x = 0; x < p.width; ++x) {
        double sum = 0;
        for (int dy = -p.window.above(); dy <= p.window.below(); ++dy)
          for (int dx = -p.window.left(); dx <= p.window.right(); ++dx)
            for (int c = 0; c < p.channels; ++c) {
              const int u = clamp(x + dx, 0, p.width - 1);
              sum += std::abs(p.at(p.left, y + dy, u + 1, c) - p.at(p.left, y + dy, u - 1, c)) / 2.0;
            }
        const double expected = sum / (static_cast<double>(p.window.area()) * p.channels);
        right = right && std::fabs(mean[y * p.width + x] - expected) <= 1e-6 * expected;
      }
    CHECK(right, p.told());
    const float least = random.below(4) ? mean[random.below(static_cast<int>(mean.size()))] : 1e9f;
    std::vector<float> disparity(mean.size(), 3), confidence(mean.size(), 1);
    std::vector<uint8_t> flags(mean.size(), 2), bytes(p.left.begin(), p.left.end());
    const Refusal refused{disparity.data(), confidence.data(), flags.data(), 8};
    const Workers workers{random.between(1, 9), [] { return false; }};
    if (round % 2)
      refuse_dull(p.left.data(), p.height, p.width, p.channels, p.window, least, refused, any_rows(random), workers);
    else
      refuse_dull(bytes.data(), p.height, p.width, p.channels, p.window, least, refused, any_rows(random), workers);
    right = true;
    for (size_t k = 0; k < mean.size(); ++k) {
      const bool low = mean[k] < least;
      right = right && std::isnan(disparity[k]) == low && confidence[k] == (low ? 0 : 1) && flags[k] == (low ? 10 : 2);
    }
    CHECK(right, p.told() + " refused");
  }
}

void test_speckle() {
  Random random{9};
  for (int round = 0; round < 200; ++round) {
    const int H = random.between(1, 9), W = random.below(4) ? random.between(1, 9) : 64 + random.between(-2, 2);
    const int area = random.below(12);
    const float difference = static_cast<float>(random.below(4)) * 0.5f;
    std::vector<float> map;
    for (int k = 0; k < H * W; ++k)
      map.push_back(random.below(5) ? static_cast<float>(random.below(6)) * 0.5f : std::numeric_limits<float>::quiet_NaN());
    std::vector<uint8_t> found(map.size());
    const Workers workers{random.between(1, 4), [] { return false; }};
    speckle(map.data(), H, W, area, difference, found.data(), any_rows(random), workers);
    // Labels spread until nothing changes any more.
    std::vector<int> label(map.size());
    for (int k = 0; k < H * W; ++k) label[k] = k;
    for (bool changed = true; changed;) {
      changed = false;
      for (int k = 0; k < H * W; ++k)
        for (const int next : {k % W ? k - 1 : k, (k + 1) % W ? k + 1 : k, k >= W ? k - W : k, k + W < H * W ? k + W : k})
          if (std::fabs(map[k] - map[next]) <= difference && label[next] < label[k]) {
            label[k] = label[next];
            changed = true;
          }
    }
    bool right = true;
    for (int k = 0; k < H * W; ++k) {
      const auto pixels = std::count(label.begin(), label.end(), label[k]);
      right = right && found[k] == (!std::isnan(map[k]) && pixels < area ? 1 : 0);
    }
    std::vector<float> refused = map, confidence(map.size(), 1);
    std::vector<uint8_t> flags(map.size(), 1);
    refuse_speckle(H, W, area, difference, {refused.data(), confidence.data(), flags.data(), 64}, any_rows(random), workers);
    for (int k = 0; k < H * W; ++k)
      right = right && std::isnan(refused[k]) == (found[k] || std::isnan(map[k])) && confidence[k] == (found[k] ? 0 : 1) &&
              flags[k] == (found[k] ? 65 : 1);
    CHECK(right, text(H) + "x" + text(W) + " area " + text(area));

    const int left = random.below(3);
    std::vector<uint8_t> cut(map.size());
    for (bool more = true; more;) {
      std::vector<int> ends(map.size()), hidden(map.size());
      for (int k = 0; k < H * W; ++k) {
        int next = k + 1;
        while (next % W && (std::isnan(map[next]) || cut[label[next]])) ++next;
        if (std::isnan(map[k]) || cut[label[k]] || next % W == 0 || label[next] == label[k]) continue;
        ++ends[label[k]];
        hidden[label[k]] += map[next] > map[k] + 1 && map[next] > static_cast<float>(left + k % W);
      }
      more = false;
      for (int k = 0; k < H * W; ++k)
        if (hidden[k] && 2 * hidden[k] >= ends[k] && std::count(label.begin(), label.end(), k) < area) cut[k] = more = true;
    }
    cut_off(map.data(), H, W, left, area, difference, 1, found.data(), any_rows(random), kAlone);
    for (int k = 0; k < H * W; ++k) right = right && found[k] == cut[label[k]];
    CHECK(right, text(H) + "x" + text(W) + " cut off");
  }
}

void test_left_right_of_maps() {
  Random random{77};
  for (int round = 0; round < 100; ++round) {
    const int H = random.between(1, 5), W = random.between(1, 12), least = random.between(-6, 4), most = least + random.below(9);
    const double tolerance = random.below(5) * 0.75;
    std::vector<float> left, right;
    for (auto* map : {&left, &right})
      for (int k = 0; k < H * W; ++k)
        map->push_back(random.below(5) ? static_cast<float>(random.between(-24, 24)) * 0.25f : std::numeric_limits<float>::quiet_NaN());
    std::vector<uint8_t> flags(left.size(), 99);
    const Workers workers{random.between(1, 4), [] { return false; }};
    left_right_maps(left.data(), right.data(), H, W, least, most, tolerance, flags.data(), workers);
    bool agree = true;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x) {
        const float* const there = right.data() + y * W;
        const float own = left[y * W + x];
        const int match = static_cast<int>(std::nearbyint(x - (std::isnan(own) ? 0 : own)));
        const bool met = match >= 0 && match < W && std::fabs(there[match] - own) <= tolerance;
        bool claimed = false;
        for (int u = 0; u < W; ++u)
          claimed = claimed || (std::fabs(u + there[u] - x) <= tolerance && x - u >= least && x - u <= most);
        agree = agree && flags[y * W + x] == (std::isnan(own) || met ? 0 : claimed ? 2 : 1);
      }
    CHECK(agree, text(H) + "x" + text(W));
  }
}

void test_relief() {
  Random random{22};
  for (int round = 0; round < 40; ++round) {
    const int C = random.below(2) ? 1 : 3, H = random.between(1, 40), W = random.between(1, 12);
    std::vector<float> planes(static_cast<size_t>(C) * H * W);
    for (float& value : planes) value = static_cast<float>(random.between(-4000, 4000)) / 64;
    const float calm = static_cast<float>(random.below(3)) * 2, unit = 0.25f + static_cast<float>(random.below(3));
    std::vector<double> steepest(static_cast<size_t>(H) * W);
    for (int c = 0; c < C; ++c) {
      std::vector<double> blurred(planes.begin() + c * H * W, planes.begin() + (c + 1) * H * W), before;
      const auto at = [&](int y, int x) { return before[std::clamp(y, 0, H - 1) * W + std::clamp(x, 0, W - 1)]; };
      for (int twice = 0; twice < 2; ++twice) {
        before = blurred;
        for (int k = 0; k < H * W; ++k) {
          blurred[k] = 0;
          for (int v = -1; v <= 1; ++v)
            for (int u = -1; u <= 1; ++u) blurred[k] += (2 - std::abs(v)) * (2 - std::abs(u)) * at(k / W + v, k % W + u) / 16;
        }
      }
      before = blurred;
      for (int k = 0; k < H * W; ++k)
        steepest[k] = std::max({steepest[k], std::fabs(at(k / W, k % W + 1) - at(k / W, k % W - 1)) / 2,
                                std::fabs(at(k / W + 1, k % W) - at(k / W - 1, k % W)) / 2});
    }
    std::vector<uint8_t> found(steepest.size());
    relief(planes.data(), C, H, W, calm, unit, found.data(), any_rows(random), {random.between(1, 4), [] { return false; }});
    bool near = true;
    for (int k = 0; k < H * W; ++k) near = near && std::fabs(found[k] - std::clamp((steepest[k] - calm) / unit, 0.0, 255.0)) < 0.501;
    CHECK(near, text(C) + "x" + text(H) + "x" + text(W));
  }
}

void test_flood() {
  Random random{23};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 9), W = random.between(1, 9);
    std::vector<uint8_t> relief, level(static_cast<size_t>(H) * W);
    for (int k = 0; k < H * W; ++k) relief.push_back(static_cast<uint8_t>(random.below(4) ? random.below(6) : 250 + random.below(6)));
    flood(relief.data(), H, W, level.data(), kAlone);
    // Levels fall until nothing changes any more.
    std::vector<int> lowest(relief.begin(), relief.end());
    for (int k = W; k < H * W; ++k) lowest[k] = 256;
    for (bool changed = true; changed;) {
      changed = false;
      for (int k = 0; k < H * W; ++k)
        for (const int next : {k % W ? k - 1 : k, (k + 1) % W ? k + 1 : k, k >= W ? k - W : k, k + W < H * W ? k + W : k}) {
          const int over = std::max<int>(relief[k], lowest[next]);
          if (over < lowest[k]) {
            lowest[k] = over;
            changed = true;
          }
        }
    }
    CHECK(std::equal(level.begin(), level.end(), lowest.begin()), text(H) + "x" + text(W));
  }
}

void test_keep_regions() {
  Random random{24};
  for (int round = 0; round < 80; ++round) {
    const int H = random.between(1, 9), W = random.between(1, 9);
    std::vector<uint8_t> inside, marked;
    for (int k = 0; k < H * W; ++k) {
      inside.push_back(random.below(5) > 1);
      marked.push_back(random.below(2));
    }
    const double share = random.below(5) / 4.0;
    const bool others = random.below(2);
    std::vector<uint8_t> kept(inside.size(), 7);
    keep_regions(inside.data(), marked.data(), H, W, share, others, kept.data(), kAlone);
    // The first pixel of each region spreads until nothing changes any more.
    std::vector<int> first(inside.size()), pixels(inside.size()), marks(inside.size());
    for (int k = 0; k < H * W; ++k) first[k] = k;
    for (bool changed = true; changed;) {
      changed = false;
      for (int k = 0; k < H * W; ++k)
        for (const int next : {k % W ? k - 1 : k, (k + 1) % W ? k + 1 : k, k >= W ? k - W : k, k + W < H * W ? k + W : k})
          if (inside[k] && inside[next] && first[next] < first[k]) {
            first[k] = first[next];
            changed = true;
          }
    }
    for (int k = 0; k < H * W; ++k) {
      pixels[first[k]] += inside[k];
      marks[first[k]] += inside[k] && marked[k];
    }
    bool right = true;
    for (int k = 0; k < H * W; ++k)
      right = right && kept[k] == (inside[k] && (marks[first[k]] > share * pixels[first[k]]) != others);
    CHECK(right, text(H) + "x" + text(W));
  }
}

void test_noise_means() {
  Random random{25};
  for (int round = 0; round < 40; ++round) {
    const int C = random.below(2) ? 1 : 3, H = random.between(3, 30), W = random.between(3, 30);
    const int high = random.between(1, H - 2), wide = random.between(1, W - 2), rows = (H - 2) / high, columns = (W - 2) / wide;
    std::vector<float> image(static_cast<size_t>(H) * W * C);
    for (float& value : image) value = static_cast<float>(random.below(256));
    std::vector<double> means(static_cast<size_t>(rows) * columns * C), expected(means.size());
    noise_means(image.data(), W, C, {rows, columns, high, wide}, means.data(), {random.between(1, 4), [] { return false; }});
    constexpr int mask[3][3] = {{1, -2, 1}, {-2, 4, -2}, {1, -2, 1}};
    for (int y = 0; y < rows * high; ++y)
      for (int x = 0; x < columns * wide; ++x)
        for (int c = 0; c < C; ++c) {
          double answer = 0;
          for (int v = 0; v < 3; ++v)
            for (int u = 0; u < 3; ++u) answer += mask[v][u] * image[((y + v) * W + x + u) * C + c];
          expected[((y / high) * columns + x / wide) * C + c] += std::fabs(answer) / (high * wide);
        }
    bool near = true;
    for (size_t k = 0; k < means.size(); ++k) near = near && std::fabs(means[k] - expected[k]) < 1e-9 * (1 + expected[k]);
    CHECK(near, text(C) + "x" + text(H) + "x" + text(W));
  }
}

void test_median() {
  Random random{10};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 9), W = random.between(1, 9), size = 2 * random.below(6) + 1;
    std::vector<float> map, filtered(static_cast<size_t>(H) * W);
    for (int k = 0; k < H * W; ++k)
      map.push_back(random.below(4) ? static_cast<float>(random.between(-20, 20)) / 3.0f : std::numeric_limits<float>::quiet_NaN());
    median(map.data(), H, W, size, filtered.data(), any_rows(random), {random.between(1, 9), [] { return false; }});
    std::vector<float> in_place = map;
    median(in_place.data(), H, W, size, in_place.data(), any_rows(random), {random.between(1, 9), [] { return false; }});
    bool right = std::memcmp(in_place.data(), filtered.data(), filtered.size() * sizeof(float)) == 0;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x) {
        std::vector<float> around;
        for (int v = 0; v < H; ++v)
          for (int u = 0; u < W; ++u)
            if (std::abs(v - y) <= size / 2 && std::abs(u - x) <= size / 2 && !std::isnan(map[v * W + u]))
              around.push_back(map[v * W + u]);
        std::sort(around.begin(), around.end());
        const size_t n = around.size();
        const float got = filtered[y * W + x];
        if (std::isnan(map[y * W + x]))
          right = right && std::isnan(got);
        else
          right = right && got == (n % 2 ? around[n / 2] : 0.5f * (around[n / 2] + around[n / 2 - 1]));
      }
    CHECK(right, text(H) + "x" + text(W) + " size " + text(size));
  }
}

// The Python tests hold these to their definitions; here: that they stay within their arrays, keep what is answered where they
// say so, and do not depend on threads.
void test_after_the_checks() {
  Random random{14};
  const float none = std::numeric_limits<float>::quiet_NaN();
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 20), W = random.between(1, 40), channels = random.below(2) ? 3 : 1, size = H * W;
    const int holes = random.between(1, 6), far = random.below(3) ? 8 : 4000;
    std::vector<float> map, sharpness;
    std::vector<uint8_t> occluded, bytes;
    std::vector<int32_t> image;
    for (int k = 0; k < size; ++k) {
      map.push_back(random.below(holes) ? static_cast<float>(random.between(-far, far)) / 3.0f : none);
      sharpness.push_back(static_cast<float>(random.below(100)) / 99.0f);
      occluded.push_back(static_cast<uint8_t>(random.below(2)));
      for (int c = 0; c < channels; ++c) bytes.push_back(static_cast<uint8_t>(random.below(256)));
    }
    image.assign(bytes.begin(), bytes.end());
    std::vector<float> fine(200), coarse(200), logistic(257), weights(LogisticModel::kFeatures);
    for (int k = 0; k < 200; ++k) fine[k] = std::max(1e-6f, std::exp(-k / 3.0f)), coarse[k] = std::exp(-k / 20.0f);
    for (int k = 0; k < 257; ++k) logistic[k] = static_cast<float>(k) / 256;
    for (auto& weight : weights) weight = static_cast<float>(random.between(-4, 4));
    std::vector<int32_t> alike(256);
    for (int k = 0; k < 256; ++k) alike[k] = 255 - k;
    const SurfaceGuide guide{image.data(), channels, fine.data(), coarse.data(), 200, static_cast<float>(random.between(0, 600))};
    const LogisticModel model{weights.data(), weights.data(), logistic.data()};
    const int side = 2 * random.below(6) + 1, slope = random.between(0, 4080), iterations = random.between(1, 3);
    std::vector<std::vector<float>> first;
    for (const int threads : {1, random.between(2, 9)}) {
      const Workers workers{threads, [] { return false; }};
      std::vector<std::vector<float>> found(12, std::vector<float>(size));
      weighted_median(map.data(), bytes.data(), H, W, channels, side, slope, found[0].data(), workers);
      edge_aware(map.data(), guide, H, W, iterations, found[1].data(), workers);
      interpolate(map.data(), occluded.data(), H, W, found[2].data(), workers);
      fill_surfaces(map.data(), occluded.data(), guide, H, W, -5000, 5000, found[3].data(), workers);
      std::vector<float> surface(found[3]);
      for (auto& value : surface)
        if (std::isnan(value)) value = 0;
      const AnsweredMap answers{surface.data(), occluded.data(), sharpness.data(), map.data(), sharpness.data(), H, W};
      probability(answers, model, found[4].data(), workers);
      outlines(map.data(), occluded.data(), bytes.data(), channels, alike.data(), H, W, found[5].data(), workers);
      const GreyPair grey{bytes.data(), bytes.data() + size * (channels - 1)};
      unfatten(map.data(), occluded.data(), grey, bytes.data(), channels, alike.data(), H, W, found[10].data(), workers);
      photometric(map.data(), occluded.data(), grey, H, W, -7, 9, found[11].data(), choose_photometric(any_instructions(random)), workers);
      nearer(map.data(), occluded.data(), found[3].data(), H, W, found[9].data(), workers);
      found[6] = surface;
      std::vector<uint8_t> flags(occluded);
      judge({map.data(), sharpness.data()}, {-7, 9, 1.5f, 1, 2}, H, W, found[6].data(), flags.data(), found[7].data(), found[8].data(),
            workers);
      bool right = true, any = false;
      for (int k = 0; k < size; ++k) {
        const float kept = std::min(std::max(surface[k], -7.0f), 9.0f);
        const bool near = std::fabs(map[k] - kept) < 1.5f;
        right = right && found[6][k] == kept && flags[k] == (near ? 0 : occluded[k] ? 1 : 2);
        right = right && (near ? found[7][k] == kept : std::isnan(found[7][k])) && found[8][k] == (near ? sharpness[k] : 0);
      }
      for (const float value : map) any = any || !std::isnan(value);
      for (int k = 0; k < size; ++k) {
        const bool hole = std::isnan(map[k]);
        for (int kept : {0, 1}) right = right && std::isnan(found[kept][k]) == hole;
        for (int filled : {2, 3}) right = right && (hole || found[filled][k] == map[k]);
        right = right && std::isnan(found[3][k]) != any && found[4][k] >= 0 && found[4][k] <= 1;
        right = right && (hole || std::find(map.begin(), map.end(), found[0][k]) != map.end());
        right = right && (occluded[k] ? !(found[5][k] < map[k]) : std::isnan(found[5][k]) == hole && (hole || found[5][k] == map[k]));
        right = right && std::isnan(found[10][k]) == hole && !(found[10][k] > map[k]);
        const float kept = std::min(std::max(map[k], -7.0f), 9.0f);
        right = right && std::isnan(found[11][k]) == hole && (hole || found[11][k] == map[k] || std::fabs(found[11][k] - kept) <= 0.5f);
      }
      for (int k = 0; k < size; ++k) {
        const float value = found[9][k];
        right = right && std::isnan(value) == std::isnan(map[k]) && !(value < map[k]) && (occluded[k] || !(value > map[k]));
      }
      CHECK(right, text(H) + "x" + text(W) + " threads " + text(threads));
      if (first.empty()) first = found;
      for (size_t k = 0; k < found.size(); ++k)
        CHECK(std::memcmp(first[k].data(), found[k].data(), size * sizeof(float)) == 0, "kernel " + text(static_cast<int>(k)));
    }
  }
}

// The Python tests hold these to their definitions; here: that they stay within their arrays, within a pixel of where they
// start, and do not depend on threads.
void test_refinement_from_images() {
  Random random{12};
  const float none = std::numeric_limits<float>::quiet_NaN();
  for (int round = 0; round < 150; ++round) {
    const Pixels pixels = round % 3 == 0 ? Pixels::bytes : round % 3 == 1 ? Pixels::white : Pixels::fixed;
    const int H = random.between(1, 9), W = random.between(1, 40);
    const Window window{random.between(1, 40), random.between(1, 20)};
    const Problem p = problem(random, pixels, H, W, random.below(2) ? 1 : 3, 0, 1, window);
    const AlignedPair pair{p.left.data(), p.right.data(), H, W, p.channels};
    std::vector<float> start(static_cast<size_t>(H) * W);
    for (int k = 0; k < H * W; ++k)
      start[k] = random.below(4) ? static_cast<float>(k % W - random.below(W)) + 0.1f * static_cast<float>(random.between(-5, 5)) : none;
    if (round % 10 == 0) start[0] = 1e9f;  // out of view
    const bool bytes = pixels != Pixels::fixed;
    const Window small{window.width % 9 + 1, window.height % 5 + 1};
    for (int method = 0; method < 4; ++method) {
      const auto refine = [&](int threads, std::vector<float>& out) {
        const Workers workers{threads, [] { return false; }};
        std::vector<float> slopes(2 * out.size());
        if (method < 2)
          align(pair, window, static_cast<Alignment>(method), round % 2 == 0, bytes, start.data(), out.data(), workers);
        else if (method == 2)
          align_intervals(pair, small, round % 4 + 1, start.data(), out.data(), workers);
        else
          align_planes(pair, small, start.data(), out.data(), slopes.data(), workers);
      };
      std::vector<float> alone(start.size()), crowd(start.size());
      refine(1, alone);
      refine(random.between(2, 12), crowd);
      CHECK(std::memcmp(alone.data(), crowd.data(), alone.size() * sizeof(float)) == 0, p.told());
      bool near = true;
      for (size_t k = 0; k < start.size(); ++k)
        near = near && (std::isnan(start[k]) ? std::isnan(alone[k]) : std::abs(alone[k] - start[k]) <= 1.51f);
      CHECK(near, p.told() + " method " + text(method));
    }
  }
}

void test_threads_do_not_matter() {
  Random random{11};
  for (const CostKind cost : kCosts) {
    const Problem p = problem(random, Pixels::bytes, 23, 50, 1, -2, 20, {6, 7});
    const bool narrow = cost != CostKind::zsad;
    const FusedSettings s{cost, p.window, Subpixel::parabola, true, 1, true, 1.05};
    for (const FusedKernel* kernel : available_kernels()) {
      const Answer alone = stream(*kernel, p, s, narrow);
      for (const int threads : {1, 2, 7, 22, 23, 24, 100}) {
        Answer answer(static_cast<size_t>(p.height) * p.width);
        match(narrow ? p.narrow() : p.wide(), s, narrow, *kernel, answer.out(), {threads, [] { return false; }});
        CHECK(same(answer, alone), std::string(kernel->name) + " " + name(cost) + " on " + text(threads));
      }
    }
  }
}

double seconds_since(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

void test_planes() {
  Random random{21};
  for (int round = 0; round < 40; ++round) {
    const int H = random.between(1, 40), W = random.between(1, 50), top = random.below(3);
    const Plane plane{random.between(-4, 4) / 16.0, random.between(1, 8) / 16.0, static_cast<double>(random.between(-9, 9))};
    std::vector<float> disparity(static_cast<size_t>(H) * W);
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x)
        disparity[y * W + x] =
            random.below(5) ? static_cast<float>(plane.at(x, y)) : random.below(2) ? std::nanf("") : 99.0f;
    Plane found{};
    const PlaneSearch search{top, round % 2 ? 0 : 12, 0.5, 0, 1, 0.5, 200, round % 3 ? 50 : 5000};
    const int inliers = find_plane(disparity.data(), H, W, search, &found, choose_planar("generic"), kAlone);
    const std::string told = text(H) + "x" + text(W);
    CHECK(inliers <= H * W, told);
    for (const FusedKernel* kernel : available_kernels())
      for (const int threads : {1, 2, 7}) {
        Plane again{};
        const int counted =
            find_plane(disparity.data(), H, W, search, &again, choose_planar(kernel->name), {threads, [] { return false; }});
        CHECK(counted == inliers && again.a == found.a && again.b == found.b && again.c == found.c,
              told + " " + kernel->name + " on " + text(threads));
      }
    if (H >= 20 && W >= 20)
      CHECK(std::fabs(found.a - plane.a) < 1e-6 && std::fabs(found.b - plane.b) < 1e-6 && std::fabs(found.c - plane.c) < 1e-4,
            told);
  }
}

template <class T>
void test_warp() {
  Random random{22};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 5), W = random.between(1, 20), C = round % 2 ? 1 : 3, margin = random.below(10);
    const int shift = random.between(-30, 30), wide = W + 2 * margin;
    std::vector<T> image(static_cast<size_t>(H) * W * C), warped(static_cast<size_t>(H) * wide * C);
    for (T& pixel : image) pixel = static_cast<T>(random.below(256));
    const Workers workers{random.between(1, 4), [] { return false; }};
    warp<T>(image.data(), H, W, C, {{0, 0, static_cast<double>(shift)}, -1e300}, margin, 0, 255, warped.data(), workers);
    bool right = true;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < wide; ++x)
        for (int c = 0; c < C; ++c)
          right = right && warped[(y * wide + x) * C + c] == image[(y * W + clamp(x - margin - shift, 0, W - 1)) * C + c];
    CHECK(right, text(H) + "x" + text(W) + " by " + text(shift));
    // Steep planes leave the image on both sides; what they find there is the edge.
    warp<T>(image.data(), H, W, C, {{-7.3, 1e6, -3e8}, 3}, margin, 0, 255, warped.data(), workers);
    warp<T>(image.data(), H, W, C, {{0.99, -1e6, 3e8}, -1e300}, margin, 0, 255, warped.data(), workers);
  }
}

template <class T>
void test_move_rows() {
  Random random{24};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 9), W = random.between(1, 20), C = round % 2 ? 1 : 3, shift = random.between(-12, 12);
    std::vector<T> image(static_cast<size_t>(H) * W * C), moved(image.size());
    for (T& pixel : image) pixel = static_cast<T>(random.below(256));
    const Workers workers{random.between(1, 4), [] { return false; }};
    move_rows<T>(image.data(), H, W, C, {0, 0, static_cast<double>(shift), 0}, 0, 255, moved.data(), any_rows(random), workers);
    bool right = true;
    for (int y = 0; y < H; ++y)
      for (int i = 0; i < W * C; ++i) right = right && moved[y * W * C + i] == image[clamp(y + shift, 0, H - 1) * W * C + i];
    CHECK(right, text(H) + "x" + text(W) + " by " + text(shift));
    // Steep fields leave the image above and below; what they find there is the edge.
    move_rows<T>(image.data(), H, W, C, {-7.3, 1e6, -3e8, 4e4}, 0, 255, moved.data(), any_rows(random), workers);
    move_rows<T>(image.data(), H, W, C, {0.4, 0.3, -3.7, -0.2}, 0, 255, moved.data(), any_rows(random), workers);
  }
}

template <class T>
void test_sharpen() {
  Random random{26};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 9), W = random.between(1, 20), C = round % 2 ? 1 : 3, amount = random.between(0, 256);
    std::vector<T> image(static_cast<size_t>(H) * W * C), sharp(image.size());
    for (T& pixel : image) pixel = static_cast<T>(sizeof(T) == 1 ? random.below(256) : random.between(-(1 << 24), 1 << 24));
    const auto at = [&](int y, int x, int c) -> int64_t { return image[(clamp(y, 0, H - 1) * W + clamp(x, 0, W - 1)) * C + c]; };
    sharpen<T>(image.data(), H, W, C, amount, sharp.data(), {random.between(1, 4), [] { return false; }});
    bool right = true;
    for (int k = 0; k < H * W * C; ++k) {
      const int y = k / C / W, x = k / C % W, weights[] = {1, 4, 6, 4, 1};
      int64_t around = 0;
      for (int v = 0; v < 5; ++v)
        for (int u = 0; u < 5; ++u) around += weights[v] * weights[u] * at(y + v - 2, x + u - 2, k % C);
      int64_t value = (64 * 256 * at(y, x, k % C) + amount * (256 * at(y, x, k % C) - around) + (1 << 13)) >> 14;
      if (sizeof(T) == 1) value = std::min<int64_t>(255, std::max<int64_t>(0, value));
      right = right && sharp[k] == value;
    }
    CHECK(right, text(H) + "x" + text(W) + " by " + text(amount));
  }
}

// Parts of images with any borders, whole and cut: the same pixels.
void test_borders() {
  Random random{27};
  for (int round = 0; round < 100; ++round) {
    const int H = random.between(1, 12), W = random.between(1, 20);
    const size_t size = random.between(1, 12);
    const auto ends = [&](int lines, int length) {
      std::vector<int32_t> found(2 * lines);
      for (int k = 0; k < lines; ++k) {
        const int first = random.below(length), end = random.between(0, length);
        if (first < end) found[2 * k] = first, found[2 * k + 1] = end;
      }
      return found;
    };
    const std::vector<int32_t> rows = ends(H, W), columns = ends(W, H);
    const auto bytes = [&](size_t count) {
      std::vector<uint8_t> found(count * size);
      for (uint8_t& byte : found) byte = static_cast<uint8_t>(random.below(256));
      return found;
    };
    const std::vector<uint8_t> image = bytes(H * W), of_rows = bytes(2 * H), of_columns = bytes(2 * W);
    const Shown shown{rows.data(), columns.data(), H, W};
    const BorderEdge edge{of_rows.data(), of_columns.data(), size};
    const Workers workers{random.between(1, 4), [] { return false; }};
    std::vector<uint8_t> whole = image;
    continue_over(shown, edge, {0, 0, H, W}, whole.data(), workers);
    const auto hides = [&](int y, int x) {
      return x < rows[2 * y] || x >= rows[2 * y + 1] || y < columns[2 * x] || y >= columns[2 * x + 1];
    };
    const Patch part{random.below(H), random.below(W), random.between(1, H), random.between(1, W)};
    const Patch cut{part.top, part.left, std::min(part.height, H - part.top), std::min(part.width, W - part.left)};
    std::vector<uint8_t> piece(cut.height * cut.width * size), hidden(cut.height * cut.width);
    std::vector<float> disparity(cut.height * cut.width);
    for (int y = 0; y < cut.height; ++y)
      for (int x = 0; x < cut.width; ++x) {
        std::memcpy(&piece[(y * cut.width + x) * size], &image[((y + cut.top) * W + x + cut.left) * size], size);
        disparity[y * cut.width + x] = random.below(5) ? static_cast<float>(random.between(-9, 30)) : NAN;
      }
    continue_over(shown, edge, cut, piece.data(), workers);
    const bool of_left = random.below(2), of_right = random.below(2);
    const float sign = random.below(2) ? 1.0f : -1.0f;
    find_hidden(disparity.data(), sign, of_left ? &shown : nullptr, of_right ? &shown : nullptr, cut, hidden.data(), workers);
    bool same = true, kept = true, right = true;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x) {
        const size_t at = (y * W + x) * size;
        kept = kept && (hides(y, x) || std::memcmp(&whole[at], &image[at], size) == 0);
      }
    for (int y = 0; y < cut.height; ++y)
      for (int x = 0; x < cut.width; ++x) {
        const int row = y + cut.top, column = x + cut.left, k = y * cut.width + x;
        same = same && std::memcmp(&piece[k * size], &whole[(row * W + column) * size], size) == 0;
        bool wanted = of_left && hides(row, column);
        if (of_right && !std::isnan(disparity[k]))
          wanted = wanted || hides(row, clamp(column - static_cast<int>(sign * disparity[k]), 0, W - 1));
        right = right && hidden[k] == wanted;
      }
    CHECK(kept && same && right, text(H) + "x" + text(W));
  }
}

void test_corners_and_tracks() {
  Random random{25};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 30), W = random.between(1, 40), tile = random.between(1, 20);
    const int reach = random.between(1, 7), reach_x = kTrackedColumns / 2;
    std::vector<uint8_t> image(static_cast<size_t>(H) * W);
    for (uint8_t& pixel : image) pixel = static_cast<uint8_t>(random.below(256));
    const Workers workers{random.between(1, 4), [] { return false; }};
    std::vector<int32_t> found(static_cast<size_t>(H / tile) * (W / tile) * 2);
    corners(image.data(), H, W, tile, random.between(1, 6), reach, 0, found.data(), any_rows(random), workers);
    std::vector<int32_t> points{0, 0, W - 1, H - 1};
    for (size_t k = 0; k < found.size(); k += 2)
      if (found[k] >= 0) {
        const bool inside = found[k] > reach_x && found[k] + reach_x + 1 < W && found[k + 1] > reach &&
                            found[k + 1] + reach + 1 < H;
        CHECK(inside, text(found[k]) + ", " + text(found[k + 1]));
        points.insert(points.end(), {found[k], found[k + 1]});
      }
    const int count = static_cast<int>(points.size() / 2);
    std::vector<double> motion(points.size(), 0), correlation(count, 7);
    track(image.data(), image.data(), H, W, points.data(), count, reach, 4, motion.data(), correlation.data(), any_rows(random), workers);
    CHECK(std::isnan(correlation[0]) && std::isnan(correlation[1]), "windows that leave the image");
    for (int k = 2; k < count; ++k) {
      CHECK(std::fabs(motion[2 * k]) < 1e-3 && std::fabs(motion[2 * k + 1]) < 1e-3, "a point of the same image");
      CHECK(correlation[k] > 0.999, std::to_string(correlation[k]));
    }
    for (double& one : motion) one = random.between(-40, 40) * 0.37;
    track(image.data(), image.data(), H, W, points.data(), count, reach, 4, motion.data(), correlation.data(), any_rows(random), workers);
  }
}

void test_fit_rows() {
  Random random{27};
  // Points on a plane, and a third of them far off it.
  std::vector<double> across, down, rows;
  for (int k = 0; k < 90; ++k) {
    across.push_back(random.between(-50, 50) * 0.01);
    down.push_back(random.between(-50, 50) * 0.01);
    const double field = 0.5 + 0.25 * across[k] - 0.75 * down[k] + 1.5 * across[k] * down[k];
    rows.push_back(k % 3 ? field : random.between(-400, 400) * 0.01);
  }
  double field[4];
  const double variance = fit_rows(across.data(), down.data(), rows.data(), 90, 0.5, 2, 1e-6, field);
  CHECK(std::fabs(field[0] - 0.5) < 0.01 && std::fabs(field[1] - 0.25) < 0.02 && std::fabs(field[2] + 0.75) < 0.02,
        std::to_string(field[0]) + " " + std::to_string(field[1]) + " " + std::to_string(field[2]));
  CHECK(std::fabs(field[3] - 1.5) < 0.1, std::to_string(field[3]));
  CHECK(variance > 0 && variance < 1e-3, std::to_string(variance));
  CHECK(fit_rows(across.data(), down.data(), rows.data(), 1, 0.5, 0.5, 1e-6, field) > 0 && std::isfinite(field[3]), "one point");
}

void test_unbow() {
  Random random{28};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 9), W = random.between(1, 40);
    std::vector<float> disparity(static_cast<size_t>(H) * W);
    for (float& d : disparity) d = random.below(5) ? random.between(-20, 60) * 0.5f : std::numeric_limits<float>::quiet_NaN();
    const std::vector<float> before = disparity;
    const Bow bow{random.between(-8, 8) * 0.001f, 0.5f * static_cast<float>(W - 1), -4, 20, round % 2 == 0};
    unbow(disparity.data(), H, W, bow, {random.between(1, 4), [] { return false; }});
    bool right = true;
    for (int k = 0; k < H * W; ++k) {
      if (std::isnan(before[k])) {
        right = right && std::isnan(disparity[k]);
        continue;
      }
      const double x = k % W - bow.middle - (bow.of_right ? 0 : before[k]), after = before[k] + bow.bow * x * x;
      const double low = std::min<double>(before[k], -4), high = std::max<double>(before[k], 20);
      right = right && std::fabs(disparity[k] - std::min(std::max(after, low), high)) < 1e-4;
    }
    CHECK(right, text(H) + "x" + text(W));
  }
}

void test_merging() {
  Random random{23};
  for (int round = 0; round < 60; ++round) {
    const int H = random.between(1, 6), W = random.between(1, 30), margin = random.below(9), wide = W + 2 * margin;
    const size_t size = static_cast<size_t>(H) * W, padded = static_cast<size_t>(H) * wide;
    const auto numbers = [&](size_t n, float unit) {
      std::vector<float> made(n);
      for (float& v : made) v = static_cast<float>(random.between(-8, 8)) * unit;
      return made;
    };
    const std::vector<float> disparity = numbers(padded, 0.5f), confidence = numbers(padded, 0.1f), cost = numbers(padded, 0.1f);
    const std::vector<uint8_t> flags(padded, 4);
    std::vector<float> best[5];
    for (auto& array : best) array.assign(size, std::numeric_limits<float>::infinity());
    std::vector<uint8_t> best_flags(size, 32), best_plane(size, 0);
    const Hypothesis into{best[0].data(), best[1].data(), best[2].data(), best[3].data(), best_flags.data(), best_plane.data()};
    const Pass pass{disparity.data(), confidence.data(), cost.data(), flags.data(), CostKind::zncc, margin,
                    {{0.25, 0.5, 0}, -1e300}, 0.9, -2.5, 5.5, false, 7};
    const Workers workers{random.between(1, 4), [] { return false; }};
    merge_pass(pass, H, W, into, workers);
    bool right = true;
    for (int y = 0; y < H; ++y)
      for (int x = 0; x < W; ++x) {
        const size_t from = static_cast<size_t>(y) * wide + margin + x, to = static_cast<size_t>(y) * W + x;
        const double d = disparity[from] + 0.25 * (x - disparity[from]) + 0.5 * y;
        const bool taken = x - d >= 0 && x - d <= W - 1 && d >= -2.5 && d <= 5.5;
        right = right && (taken ? best[0][to] == static_cast<float>(d) && best_plane[to] == 7 && best_flags[to] == 4
                                : best_flags[to] == 32 && best_plane[to] == 0);
      }
    CHECK(right, text(H) + "x" + text(W) + " margin " + text(margin));
    std::vector<float> chosen(size, -1), other[3];
    for (auto& array : other) array.assign(size, -1);
    std::vector<uint8_t> chosen_flags(size, 255), chosen_plane(size, 255);
    merge_window(into, CostKind::zncc, H, W,
                 {chosen.data(), other[0].data(), other[1].data(), other[2].data(), chosen_flags.data(), chosen_plane.data()},
                 best[4].data(), workers);
    for (size_t at = 0; at < size; ++at)
      right = right && (best_flags[at] == 4 ? chosen[at] == best[0][at] && std::isfinite(best[4][at]) : chosen[at] == -1);
    CHECK(right, text(H) + "x" + text(W));
  }
}

// Who asks for the cost gets every winner as it was found, beside the flags that the checks would have set.
void test_winning_costs() {
  Random random{24};
  for (int round = 0; round < 24; ++round) {
    const Problem p = problem(random, Pixels::bytes, random.between(1, 9), random.between(1, 40), 1, random.between(-9, 9),
                              random.between(1, 30), {random.between(1, 9), random.between(1, 9)});
    for (const CostKind kind : kCosts)
      for (const FusedKernel* kernel : available_kernels()) {
        const bool narrow = p.fits() && kind != CostKind::zsad;
        const FusedSettings checked{kind, p.window, Subpixel::parabola, true, 1, true, 1.05};
        const FusedSettings plain{kind, p.window, Subpixel::parabola, false, 0, false, 1};
        const size_t size = static_cast<size_t>(p.height) * p.width;
        Answer with(size), without(size), refused(size);
        std::vector<float> cost(size, -9);
        FusedOutput out = with.out();
        out.cost = cost.data();
        match(narrow ? p.narrow() : p.wide(), checked, narrow, *kernel, out, kAlone);
        match(narrow ? p.narrow() : p.wide(), plain, narrow, *kernel, without.out(), kAlone);
        match(narrow ? p.narrow() : p.wide(), checked, narrow, *kernel, refused.out(), kAlone);
        bool right = with.flags == refused.flags;
        for (size_t at = 0; at < size; ++at) {
          const bool seen = !(without.flags[at] & 32);
          right = right && std::isinf(cost[at]) == !seen && (!seen || with.disparity[at] == without.disparity[at]);
        }
        CHECK(right, p.told() + " " + name(kind) + " " + kernel->name);
      }
  }
}

void test_interruption() {
  Random random{12};
  const Problem p = problem(random, Pixels::bytes, 200, 700, 3, 0, 400, {61, 61});
  for (const CostKind cost : kCosts)
    for (const FusedKernel* kernel : available_kernels()) {
      const FusedSettings s{cost, p.window, Subpixel::parabola, true, 1, true, 1.05};
      Answer answer(static_cast<size_t>(p.height) * p.width);
      const auto start = std::chrono::steady_clock::now();
      bool interrupted = false;
      try {
        match(p.wide(), s, false, *kernel, answer.out(), {3, [] { return true; }});
      } catch (const Interrupted&) {
        interrupted = true;
      }
      const double seconds = seconds_since(start);
      CHECK(interrupted && seconds < 5, std::string(kernel->name) + " " + name(cost) + " took " + std::to_string(seconds));
      // A cancelled band leaves at once and touches nothing.
      const Cancel cancel{true};
      Answer untouched(answer.flags.size());
      const Scratch scratch(kernel->scratch_bytes(p.wide(), s, false));
      RowsToTake rows(0, p.height);
      kernel->rows(p.wide(), s, false, untouched.out(), rows, scratch.memory, cancel);
      CHECK(std::count(untouched.flags.begin(), untouched.flags.end(), 255) == static_cast<ptrdiff_t>(untouched.flags.size()),
            std::string(kernel->name) + " " + name(cost));
    }
}

// ---- windows weighted by a Gaussian ----------------------------------------------------------------------------------

struct Taps {
  int stride;
  std::vector<double> taps;
  GaussianFilter filter() const { return {stride, static_cast<int>(taps.size()) - 1, taps.data()}; }
};

// Bell-shaped taps of sum 1.
Taps bell(int stride, int reach) {
  Taps t{stride, {}};
  double sum = 0;
  for (int k = 0; k <= reach; ++k) {
    t.taps.push_back(std::exp(-2.0 * k * k / (0.1 + reach * reach)));
    sum += t.taps.back() * (k ? 2 : 1);
  }
  for (double& tap : t.taps) tap /= sum;
  return t;
}

// What pixel `x` weighs its neighbourhood with: pairs of position and weight.
std::vector<std::pair<int, double>> weights_at(const Taps& t, int x) {
  const int s = t.stride, reach = static_cast<int>(t.taps.size()) - 1, spread = 2 * (s - 1);
  std::vector<double> spline{1};
  for (int pass = 0; pass < 4; ++pass) {
    std::vector<double> sum(spline.size() + s - 1, 0);
    for (size_t k = 0; k < spline.size(); ++k)
      for (int j = 0; j < s; ++j) sum[k + j] += spline[k] / s;
    spline = sum;
  }
  std::map<int, double> weights;
  const int own = x / s;
  for (int knot = own - 1; knot <= own + 2; ++knot) {
    const int away = x - s * knot + spread;
    if (away < 0 || away > 2 * spread) continue;
    for (int j = -reach; j <= reach; ++j)
      for (int k = -spread; k <= spread; ++k)
        weights[s * (knot + j) + k] += s * spline[away] * t.taps[std::abs(j)] * spline[k + spread];
  }
  return {weights.begin(), weights.end()};
}

template <class Value>
double weighted(const std::vector<std::pair<int, double>>& rows, const std::vector<std::pair<int, double>>& columns, Value value) {
  double sum = 0;
  for (const auto& [y, wy] : rows) {
    double row = 0;
    for (const auto& [x, wx] : columns) row += wx * value(y, x);
    sum += wy * row;
  }
  return sum;
}

double naive_gaussian_cost(const Problem& p, CostKind kind, const Taps& t, int y, int x, int i) {
  const auto rows = weights_at(t, y), columns = weights_at(t, x);
  const int d = p.first + i;
  double total = 0, left = 0, right = 0;
  for (int c = 0; c < p.channels; ++c) {
    const auto l = [&](int v, int u) { return static_cast<double>(p.at(p.left, v, u, c)); };
    const auto r = [&](int v, int u) { return static_cast<double>(p.at(p.right, v, u - d, c)); };
    const auto mean = [&](auto value) { return weighted(rows, columns, value); };
    const double ml = mean(l), mr = mean(r);
    switch (kind) {
      case CostKind::sad:
        total += mean([&](int v, int u) { return std::abs(l(v, u) - r(v, u)); });
        break;
      case CostKind::ssd:
      case CostKind::zssd:
        total += mean([&](int v, int u) { return (l(v, u) - r(v, u)) * (l(v, u) - r(v, u)); });
        if (kind == CostKind::zssd) total -= (ml - mr) * (ml - mr);
        break;
      default: {
        const double centre = kind == CostKind::zncc ? 1 : 0;
        total -= mean([&](int v, int u) { return l(v, u) * r(v, u); }) - centre * ml * mr;
        left += mean([&](int v, int u) { return l(v, u) * l(v, u); }) - centre * ml * ml;
        right += mean([&](int v, int u) { return r(v, u) * r(v, u); }) - centre * mr * mr;
      }
    }
  }
  if (kind != CostKind::ncc && kind != CostKind::zncc) return total;
  return left > 1e-5 && right > 1e-5 ? total / std::sqrt(left * right) : 0;
}

Answer stream_gaussian(const FusedKernel& kernel, const Problem& p, const FusedSettings& s, const Taps& t) {
  Answer answer(static_cast<size_t>(p.height) * p.width);
  match_gaussian(p.narrow(), s, t.filter(), kernel, answer.out(), kAlone);
  return answer;
}

const CostKind kGaussianCosts[] = {CostKind::sad, CostKind::ssd, CostKind::zssd, CostKind::ncc, CostKind::zncc};

void test_gaussian() {
  Random random{21};
  for (const CostKind cost : kGaussianCosts)
    for (const int stride : {1, 2, 3, 7, 12})
      for (const int channels : {1, 3}) {
        const Pixels pixels = random.below(2) ? Pixels::bytes : Pixels::extreme;
        const Problem p = problem(random, pixels, random.between(1, stride < 4 ? 6 : 3), random.between(1, stride < 4 ? 20 : 8),
                                  channels, random.between(-2, 0), random.between(3, 5), {1, 1});
        const Taps t = bell(stride, random.between(1, 2));
        const FusedSettings s{cost, {1, 1}, Subpixel::none, false, 0, false, 1};
        const std::string told = std::string(name(cost)) + " stride " + text(stride) + " " + p.told();
        const Answer first = stream_gaussian(*available_kernels().front(), p, s, t);
        for (const FusedKernel* kernel : available_kernels())
          CHECK(same(stream_gaussian(*kernel, p, s, t), first), std::string(kernel->name) + " " + told);
        const bool correlation = cost == CostKind::ncc || cost == CostKind::zncc;
        // Direct weights are 15 bits; else only sums of floats are rounded.
        const double tolerance = (correlation ? 1.0 : cost == CostKind::sad ? 255.0 : 65025.0) * (stride == 1 ? 5e-4 : 2e-5);
        bool least = true, seen = true;
        for (int y = 0; y < p.height; ++y)
          for (int x = 0; x < p.width; ++x) {
            std::vector<double> costs(p.count, worst_cost<double>());
            for (int i = 0; i < p.count; ++i)
              if (p.in_view(x, i)) costs[i] = naive_gaussian_cost(p, cost, t, y, x, i);
            const size_t at = static_cast<size_t>(y) * p.width + x;
            const int best = naive_winner(costs);
            seen = seen && (best < 0) == std::isnan(first.disparity[at]);
            if (best < 0 || std::isnan(first.disparity[at])) continue;
            least = least && costs[static_cast<int>(first.disparity[at]) - p.first] <= costs[best] + tolerance;
          }
        CHECK(seen && least, told);
      }
}

void test_gaussian_threads_and_interruption() {
  Random random{22};
  const Problem p = problem(random, Pixels::bytes, 300, 40, 1, -2, 20, {1, 1});
  for (const CostKind cost : kGaussianCosts)
    for (const Taps& t : {bell(1, 4), bell(3, 4)}) {
      const FusedSettings s{cost, {1, 1}, Subpixel::parabola, true, 1, true, 1.05};
      for (const FusedKernel* kernel : available_kernels()) {
        const Answer alone = stream_gaussian(*kernel, p, s, t);
        for (const int threads : {2, 7, 300}) {
          Answer answer(alone.flags.size());
          match_gaussian(p.narrow(), s, t.filter(), *kernel, answer.out(), {threads, [] { return false; }});
          CHECK(same(answer, alone), std::string(kernel->name) + " " + name(cost) + " on " + text(threads));
        }
      }
    }
  const Problem large = problem(random, Pixels::bytes, 600, 1000, 1, 0, 600, {1, 1});
  for (const FusedKernel* kernel : available_kernels())
    for (const Taps& t : {bell(1, 9), bell(2, 9)}) {
      const FusedSettings s{CostKind::zncc, {1, 1}, Subpixel::parabola, true, 1, true, 1.05};
      Answer answer(static_cast<size_t>(large.height) * large.width);
      const auto start = std::chrono::steady_clock::now();
      bool interrupted = false;
      try {
        match_gaussian(large.narrow(), s, t.filter(), *kernel, answer.out(), {2, [] { return true; }});
      } catch (const Interrupted&) {
        interrupted = true;
      }
      const double seconds = seconds_since(start);
      CHECK(interrupted && seconds < 5, std::string(kernel->name) + " took " + std::to_string(seconds));
    }
}

// With the crew at hand, if there is one.
void test_bands_of_any_crew() {
  for (const int rows : {1, 2, 7, 100})
    for (const int threads : {1, 2, 3, 7, 200}) {
      std::vector<std::atomic<int>> visits(rows);
      parallel_rows(rows, threads, [] { return false; }, [&](int begin, int end, const Cancel&) {
        for (int y = begin; y < end; ++y) ++visits[y];
      });
      CHECK(std::all_of(visits.begin(), visits.end(), [](int n) { return n == 1; }), text(rows) + " on " + text(threads));
    }
  bool thrown = false;
  try {
    parallel_rows(9, 4, [] { return false; }, [](int begin, int, const Cancel&) {
      if (begin > 0) throw std::runtime_error("band");
    });
  } catch (const std::runtime_error& error) {
    thrown = std::string(error.what()) == "band";
  }
  CHECK(thrown, "what a band throws reaches the caller");
}

void test_bands() {
  test_bands_of_any_crew();
  Crew crew;
  const AtHand lent(&crew);
  test_bands_of_any_crew();
  test_bands_of_any_crew();  // by threads that are there already, and that have seen a band throw
}

void test_bands_wait_for_one_another() {
  Crew crew;
  const AtHand lent(&crew);
  for (int round = 0; round < 200; ++round) {
    const int bands = 1 + round % 7;
    std::atomic<int> begun{0};
    parallel_rows(bands, bands, [] { return false; }, [&](int, int, const Cancel&) {
      ++begun;
      while (begun < bands) std::this_thread::yield();
    });
    CHECK(begun == bands, text(bands));
  }
}

void test_bands_within_bands() {
  Crew crew;
  const AtHand lent(&crew);
  std::atomic<int> visits{0}, lent_on{0};
  parallel_rows(3, 3, [] { return false; }, [&](int, int, const Cancel&) {
    lent_on += crew_at_hand() != nullptr;
    parallel_rows(5, 2, [] { return false; }, [&](int begin, int end, const Cancel&) { visits += end - begin; });
  });
  CHECK(visits == 15 && lent_on == 0, text(visits) + ", " + text(lent_on));
  CHECK(crew_at_hand() == &crew, "the crew is at hand again");
}

void test_crews_of_many_threads() {
  std::vector<std::thread> callers;
  std::atomic<int> wrong{0};
  for (int caller = 0; caller < 6; ++caller)
    callers.emplace_back([&wrong, caller] {
      for (int turn = 0; turn < 5; ++turn) {
        Crew crew;
        const AtHand lent(&crew);
        for (int section = 0; section < 40; ++section) {
          std::vector<int> rows(50, -1);
          parallel_rows(50, 1 + (caller + section) % 4, [] { return false; }, [&](int begin, int end, const Cancel&) {
            for (int y = begin; y < end; ++y) rows[y] = y * section;
          });
          for (int y = 0; y < 50; ++y) wrong += rows[y] != y * section;
          // Long enough for the others to go to sleep.
          if (section % 20 == 19) std::this_thread::sleep_for(2 * kSoon);
        }
      }
    });
  for (auto& caller : callers) caller.join();
  CHECK(wrong == 0, text(wrong));
}

void test_a_crew_is_interrupted() {
  Crew crew;
  const AtHand lent(&crew);
  for (const bool own : {true, false}) {
    const auto start = std::chrono::steady_clock::now();
    bool interrupted = false;
    const auto caller = std::this_thread::get_id();
    std::atomic<int> begun{0};
    try {
      // Bands that end once they are told to: this thread's, or the others' while this one waits.
      parallel_rows(3, 3, [] { return true; }, [&](int, int, const Cancel& cancel) {
        ++begun;
        while (begun < 3) std::this_thread::yield();
        while ((std::this_thread::get_id() == caller) == own && !cancel.load(std::memory_order_relaxed)) std::this_thread::yield();
      });
    } catch (const Interrupted&) {
      interrupted = true;
    }
    CHECK(interrupted && seconds_since(start) < 5, own ? "its own" : "another's");
    int rows = 0;
    parallel_rows(3, 1, [] { return false; }, [&](int begin, int end, const Cancel&) { rows += end - begin; });
    CHECK(rows == 3, "what comes after it");
  }
}

void test_dispatch() {
  const auto kernels = available_kernels();
  CHECK(std::string(kernels.back()->name) == "generic", "the plain build comes last");
  CHECK(&choose_kernel("") == kernels.front(), "no name: the best");
  for (const FusedKernel* kernel : kernels) CHECK(&choose_kernel(kernel->name) == kernel, kernel->name);
  bool refused = false;
  try {
    choose_kernel("mmx");
  } catch (const std::invalid_argument& error) {
    refused = std::string(error.what()).find("generic") != std::string::npos;
  }
  CHECK(refused, "an unknown name");
}

// ---- optimize -------------------------------------------------------------------------------------------------------

struct Field {
  int height, width, count;
  std::vector<float> costs;
  std::vector<int32_t> start;
  Grid grid() const { return {costs.data(), height, width, count}; }
};

// Small whole costs, whose least is 0; some labels, and some pixels, are not possible.
Field field(Random& random, int height, int width, int count) {
  Field f{height, width, count, {}, {}};
  for (int p = 0; p < height * width; ++p) {
    const bool possible = random.below(8) > 0;
    const int best = random.below(count);
    for (int l = 0; l < count; ++l)
      f.costs.push_back(!possible || (l != best && random.below(6) == 0) ? worst_cost<float>()
                                                                           : static_cast<float>(l == best ? 0 : random.below(9)));
    const auto* costs = f.costs.data() + static_cast<size_t>(p) * count;
    f.start.push_back(possible ? static_cast<int>(std::min_element(costs, costs + count) - costs) : -1);
  }
  return f;
}

double penalty(const Smoothness& s, int a) {
  const double step = std::min<double>(std::abs(a), s.truncation);
  return s.weight * (s.power == 2 ? step * step : step);
}

double energy(const Field& f, const Smoothness& s, const std::vector<int32_t>& labels) {
  double sum = 0;
  for (int y = 0; y < f.height; ++y)
    for (int x = 0; x < f.width; ++x) {
      const int p = y * f.width + x;
      if (labels[p] < 0) continue;
      sum += f.costs[static_cast<size_t>(p) * f.count + labels[p]];
      if (x + 1 < f.width && labels[p + 1] >= 0) sum += penalty(s, labels[p] - labels[p + 1]);
      if (y + 1 < f.height && labels[p + f.width] >= 0) sum += penalty(s, labels[p] - labels[p + f.width]);
    }
  return sum;
}

const std::vector<Smoothness> kSmoothness{{1, 0.5, HUGE_VAL}, {1, 2, 2.5},  {2, 0.25, HUGE_VAL}, {2, 1, 3},
                                          {1, 0, HUGE_VAL},   {2, 0, 1},    {2, 0.001, HUGE_VAL}, {1, 1, 1000}};

void test_distance_transform() {
  Random random{11};
  for (const Smoothness& s : kSmoothness)
    for (const int count : {1, 2, 3, 8, 25, 26, 51, 64, 130}) {
      std::vector<float> h(static_cast<size_t>(3) * count), best(h.size());
      for (auto& v : h) v = random.below(4) == 0 ? worst_cost<float>() : static_cast<float>(random.below(1000));
      for (int row = 0; row < 3; ++row) h[static_cast<size_t>(row) * count + random.below(count)] = 7;
      distance_transform(h.data(), 3, count, s, best.data());
      double worst = 0;
      for (int row = 0; row < 3; ++row)
        for (int l = 0; l < count; ++l) {
          double least = HUGE_VAL;
          for (int k = 0; k < count; ++k) least = std::min(least, h[row * count + k] + penalty(s, k - l));
          worst = std::max(worst, std::abs(least - best[row * count + l]));
        }
      CHECK(worst < 1e-2, text(s.power) + " of " + text(count) + " labels: " + std::to_string(worst));
    }
}

void test_solvers() {
  Random random{5};
  for (const auto& [height, width, count] : {std::tuple{1, 1, 1}, {1, 9, 4}, {9, 1, 5}, {5, 7, 1}, {6, 17, 30}, {17, 5, 33}})
    for (const Smoothness& s : kSmoothness) {
      const Field f = field(random, height, width, count);
      const double start = energy(f, s, f.start);
      const std::string told = text(height) + "x" + text(width) + "x" + text(count);
      std::vector<int32_t> first[3];
      for (const int threads : {1, 3, 40}) {
        const Workers workers{threads, [] { return false; }};
        std::vector<int32_t> labels[3] = {f.start, f.start, f.start};
        iterated_conditional_modes(f.grid(), s, 5, labels[0].data(), workers);
        const double bound = tree_reweighted(f.grid(), s, 5, labels[1].data(), workers);
        belief_propagation(f.grid(), s, 3, 4, labels[2].data(), workers);
        CHECK(energy(f, s, labels[0]) <= start, told);
        for (int k = 0; k < 3; ++k) {
          CHECK(bound <= energy(f, s, labels[k]) + 1e-3, told);
          if (threads == 1) first[k] = labels[k];
          CHECK(labels[k] == first[k], told + ": " + text(threads) + " threads");
        }
      }
    }
}

template <class T>
void test_second_pass() {
  Random random{3};
  for (const Window window : {Window{1, 1}, Window{2, 3}, Window{9, 4}, Window{30, 31}}) {
    const int height = 5, width = 7, count = 6;
    std::vector<T> volume(static_cast<size_t>(height) * width * count);
    for (auto& v : volume) v = random.below(5) == 0 ? worst_cost<T>() : static_cast<T>(random.below(100));
    std::vector<int32_t> guide(static_cast<size_t>(height) * width);
    for (auto& v : guide) v = random.between(-1, count - 1);
    std::vector<int64_t> penalties;
    for (int a = 1 - count; a < count; ++a) penalties.push_back(int64_t{a} * a);
    std::vector<float> total(volume.size());
    second_pass(volume.data(), height, width, count, guide.data(), window, penalties.data(), 0.5, 2.0, total.data(),
                {3, [] { return false; }});
    bool equal = true;
    for (int y = 0; y < height; ++y)
      for (int x = 0; x < width; ++x)
        for (int l = 0; l < count; ++l) {
          double sum = 0;
          int drawn = 0;
          for (int j = 0; j < window.height; ++j)
            for (int i = 0; i < window.width; ++i) {
              const int g = guide[clamp(y + j - window.height / 2, 0, height - 1) * width +
                                  clamp(x + i - window.width / 2, 0, width - 1)];
              if (g < 0) continue;
              ++drawn;
              sum += (g - l) * (g - l);
            }
          const size_t at = (static_cast<size_t>(y) * width + x) * count + l;
          const double expected = 0.5 * static_cast<double>(volume[at]) + (drawn ? 2 * sum / drawn : 0);
          equal &= volume[at] == worst_cost<T>() ? std::isinf(total[at]) : std::abs(total[at] - expected) < 1e-3;
        }
    CHECK(equal, text(window.width) + "x" + text(window.height));
    // The right view and back is the volume again, but for what the right image does not hold.
    for (const int first : {-9, -2, 0, 3}) {
      std::vector<T> right(volume.size());
      right_volume(volume.data(), height, width, count, first, right.data(), kAlone);
      bool same = true;
      for (int y = 0; y < height; ++y)
        for (int x = 0; x < width; ++x)
          for (int i = 0; i < count; ++i) {
            const int there = x + first + i;
            const T seen = there < 0 || there >= width ? worst_cost<T>() : volume[(y * width + there) * count + i];
            same &= right[(y * width + x) * count + i] == seen;
          }
      CHECK(same, text(first));
    }
  }
}

void test_solvers_are_interrupted() {
  Random random{1};
  const Field f = field(random, 200, 300, 64);
  const Smoothness s{2, 0.01, HUGE_VAL};
  const Workers impatient{3, [] { return true; }};
  const auto stops = [&](const char* name, auto solve) {
    auto labels = f.start;
    const auto start = std::chrono::steady_clock::now();
    bool interrupted = false;
    try {
      solve(labels.data());
    } catch (const Interrupted&) {
      interrupted = true;
    }
    CHECK(interrupted && seconds_since(start) < 5, name);
  };
  stops("belief propagation", [&](int32_t* labels) { belief_propagation(f.grid(), s, 1000, 3, labels, impatient); });
  // Work of which no step lasts long enough to be asked while it is waited for.
  const Field small = field(random, 3, 4, 5);
  auto small_labels = small.start;
  const Workers patient{1, [asked = 0]() mutable { return ++asked > 100; }};
  bool stopped = false;
  try {
    tree_reweighted(small.grid(), s, 1 << 30, small_labels.data(), patient);
  } catch (const Interrupted&) {
    stopped = true;
  }
  CHECK(stopped, "many short iterations");
  stops("tree-reweighted", [&](int32_t* labels) { tree_reweighted(f.grid(), s, 1000, labels, impatient); });
}

// ---- costs of pixels ---------------------------------------------------------------------------------------------------

template <class T>
void test_census() {
  Random random{61};
  for (int trial = 0; trial < 40; ++trial) {
    const int H = random.between(1, 5), W = trial % 8 ? random.between(1, 9) : random.between(255, 300);
    const int n = random.between(1, 128), most = sizeof(T) == 1 ? 4 : 1 << 21;
    std::vector<T> image(static_cast<size_t>(H) * W);
    for (T& pixel : image) pixel = static_cast<T>(sizeof(T) == 1 ? random.below(most) : random.between(-most, most));
    std::vector<CensusPoint> points;
    for (int k = 0; k < 2 * n; ++k) points.push_back({random.between(-6, 6), random.between(-5, 5)});
    const auto at = [&](int y, int x) { return image[static_cast<size_t>(clamp(y, 0, H - 1)) * W + clamp(x, 0, W - 1)]; };
    const size_t plane = image.size(), planes = (n + 63) / 64;
    std::vector<uint64_t> expected(planes * plane);
    for (int k = 0; k < n; ++k)
      for (int y = 0; y < H; ++y)
        for (int x = 0; x < W; ++x) {
          const CensusPoint &a = points[2 * k], &b = points[2 * k + 1];
          const uint64_t darker = at(y + a.dy, x + a.dx) < at(y + b.dy, x + b.dx);
          expected[k / 64 * plane + static_cast<size_t>(y) * W + x] |= darker << k % 64;
        }
    for (const FusedKernel* kernel : available_kernels())
      for (const int threads : {1, 3}) {
        std::vector<uint64_t> got(expected.size(), ~uint64_t{0});
        census<T>(image.data(), H, W, points.data(), n, got.data(), choose_pixelwise(kernel->name),
                  {threads, [] { return false; }});
        CHECK(got == expected, text(H) + "x" + text(W) + " " + text(n) + " comparisons " + kernel->name);
      }
  }
}

// A pixel's features, whatever their type.
using Features = std::vector<int64_t>;

int naive_cost(PixelCost cost, const Features& l, const Features& r, const std::vector<uint8_t>& table) {
  const auto outside = [](int64_t v, int64_t low, int64_t high) { return std::max({int64_t{0}, v - high, low - v}); };
  switch (cost) {
    case PixelCost::census: {
      int sum = 0;
      for (size_t p = 0; p < l.size(); ++p)
        for (int k = 0; k < 64; ++k) sum += ((l[p] ^ r[p]) >> k & 1) != 0;
      return sum;
    }
    case PixelCost::absolute:
      return static_cast<int>(std::abs(l[0] - r[0]));
    case PixelCost::vector:
      return static_cast<int>(std::abs(l[0] - r[0]) + std::abs(l[1] - r[1]));
    case PixelCost::interval:
      return static_cast<int>(std::min(outside(l[0], r[1], r[2]), outside(r[0], l[1], l[2])));
    case PixelCost::table:
      return table[l[0] * 256 + r[0]];
  }
  return 0;
}

template <class T>
void test_pixel_costs(Random& random, PixelCost cost, int planes, int bits) {
  const int H = random.between(1, 5), W = random.between(1, 9), first = random.between(-W - 2, W + 1);
  const int D = random.below(4) ? random.between(1, 20) : random.between(60, 70);
  const Window box{2 * random.below(4) + 1, 2 * random.below(3) + 1};
  const bool add = random.below(2) == 0;
  const int most = cost == PixelCost::census ? bits : cost == PixelCost::table ? 255 : random.between(1, 255);
  const size_t plane = static_cast<size_t>(H) * W;
  std::vector<T> sides[2];
  for (auto& side : sides) {
    side.resize(planes * plane);
    for (size_t k = 0; k < side.size(); ++k) {
      const uint64_t word = static_cast<uint64_t>(random.next()) << 33 ^ static_cast<uint64_t>(random.next()) << 2 ^ random.next();
      const int width = cost == PixelCost::census ? std::min(64, bits - static_cast<int>(k / plane) * 64) : 0;
      side[k] = cost == PixelCost::census ? static_cast<T>(width == 64 ? word : word & ((uint64_t{1} << width) - 1))
                                          : static_cast<T>(sizeof(T) == 1 ? random.below(256) : random.between(-510, 510));
    }
    if (cost == PixelCost::interval)  // the value lies between the bounds
      for (size_t k = 0; k < plane; ++k) {
        side[plane + k] = std::min(side[k], side[plane + k]);
        side[2 * plane + k] = std::max(side[k], side[2 * plane + k]);
      }
  }
  std::vector<uint8_t> table(256 * 256);
  for (uint8_t& entry : table) entry = static_cast<uint8_t>(random.below(256));
  std::vector<uint16_t> before(plane * D), expected(plane * D, 65535);
  for (uint16_t& value : before) value = static_cast<uint16_t>(random.below(1000));
  const auto features = [&](const std::vector<T>& side, int y, int x) {
    Features values;
    for (int p = 0; p < planes; ++p)
      values.push_back(static_cast<int64_t>(side[p * plane + static_cast<size_t>(clamp(y, 0, H - 1)) * W + clamp(x, 0, W - 1)]));
    return values;
  };
  for (int y = 0; y < H; ++y)
    for (int x = 0; x < W; ++x)
      for (int i = 0; i < D; ++i) {
        const int xr = x - first - i;
        if (xr < 0 || xr >= W) continue;
        const size_t at = (static_cast<size_t>(y) * W + x) * D + i;
        int sum = add ? before[at] : 0;
        for (int dy = -box.above(); dy <= box.below(); ++dy)
          for (int dx = -box.left(); dx <= box.right(); ++dx)
            sum += std::min(most, naive_cost(cost, features(sides[0], y + dy, x + dx), features(sides[1], y + dy, xr + dx), table));
        expected[at] = static_cast<uint16_t>(sum);
      }
  for (const FusedKernel* kernel : available_kernels())
    for (const int threads : {1, 3}) {
      std::vector<uint16_t> got = before;
      const PixelJob job{cost,  sides[0].data(), sides[1].data(), H,   W,   planes,    bits, first, D, most, table.data(), box,
                         add, got.data()};
      pixel_costs(job, choose_pixelwise(kernel->name), {threads, [] { return false; }});
      CHECK(got == expected, text(H) + "x" + text(W) + " cost " + text(static_cast<int>(cost)) + " first " + text(first) +
                                 " count " + text(D) + " box " + text(box.width) + "x" + text(box.height) + " " + kernel->name);
    }
}

void test_pixel_costs() {
  Random random{62};
  for (int trial = 0; trial < 30; ++trial) {
    for (const int bits : {1, 31, 32, 33, 64, 65, 128})
      test_pixel_costs<uint64_t>(random, PixelCost::census, (bits + 63) / 64, bits);
    test_pixel_costs<uint8_t>(random, PixelCost::absolute, 1, 0);
    test_pixel_costs<int16_t>(random, PixelCost::vector, 2, 0);
    test_pixel_costs<int16_t>(random, PixelCost::interval, 3, 0);
    test_pixel_costs<uint8_t>(random, PixelCost::table, 1, 0);
  }
}

void test_combined_costs() {
  Random random{63};
  std::vector<uint16_t> costs, other, expected;
  for (int k = 0; k < 3 * 35; ++k) {
    const bool out = random.below(5) == 0;
    costs.push_back(static_cast<uint16_t>(out ? 65535 : random.below(3) ? random.below(65535) : 65534));
    other.push_back(static_cast<uint16_t>(out ? 65535 : random.below(3) ? random.below(1001) : 1000));
    const uint64_t sum = uint64_t{costs[k]} * 2047 + uint64_t{other[k]} * 134000 + (1 << 15);
    expected.push_back(static_cast<uint16_t>(out ? 65535 : sum >> 16));
  }
  for (const int threads : {1, 3}) {
    std::vector<uint16_t> got = costs;
    combine(got.data(), other.data(), 3, 35, 2047, 134000, {threads, [] { return false; }});
    CHECK(got == expected, text(threads) + " threads");
  }
}

// ---- semi-global matching ---------------------------------------------------------------------------------------------

// Sums over the paths, from the formula.
std::vector<uint16_t> naive_path_sums(const Pair& pair, const std::vector<uint16_t>& costs, const SgmSettings& settings) {
  const int H = pair.height, W = pair.width, D = pair.count;
  std::vector<std::pair<int, int>> steps{{1, 0}, {-1, 0}};
  if (settings.paths >= 4) steps.push_back({0, 1});
  if (settings.paths >= 5) steps.insert(steps.end(), {{1, 1}, {-1, 1}});
  if (settings.paths == 4) steps.push_back({0, -1});
  if (settings.paths >= 8) steps.insert(steps.end(), {{0, -1}, {1, -1}, {-1, -1}});
  if (settings.paths == 16)
    for (const int a : {-1, 1})
      for (const int b : {-1, 1}) steps.insert(steps.end(), {{a, 2 * b}, {2 * a, b}});
  std::vector<uint16_t> sums(costs.size(), 0);
  std::vector<int> path(costs.size());
  for (const auto& [dx, dy] : steps) {
    for (int n = 0; n < H * W; ++n) {
      const int k = dy > 0 || (dy == 0 && dx > 0) ? n : H * W - 1 - n, y = k / W, x = k % W, v = y - dy, u = x - dx;
      const bool inside = 0 <= v && v < H && 0 <= u && u < W;
      const int* before = path.data() + static_cast<size_t>(inside ? v * W + u : 0) * D;
      const int least = inside ? *std::min_element(before, before + D) : 0;
      const int p2 = settings.p2[settings.guide && inside ? std::abs(settings.guide[k] - settings.guide[v * W + u]) : 0];
      for (int i = 0; i < D; ++i) {
        int told = inside ? std::min(before[i], least + p2) : 0;
        if (inside && i > 0) told = std::min(told, before[i - 1] + settings.p1);
        if (inside && i + 1 < D) told = std::min(told, before[i + 1] + settings.p1);
        const size_t at = static_cast<size_t>(k) * D + i;
        path[at] = costs[at] + told - least;
        sums[at] = static_cast<uint16_t>(sums[at] + path[at]);
      }
    }
  }
  return sums;
}

void test_path_sums() {
  Random random{83};
  for (int n = 0; n < 60; ++n) {
    const int counts[] = {1, 2, 31, 33, 64, 65, 128, 129}, paths[] = {2, 4, 5, 8, 16};
    const int H = random.between(1, 20), W = random.between(1, 14), D = counts[random.below(8)];
    const Pair pair{nullptr, nullptr, H, W, 1, random.between(-D, W), D};
    const int most = n % 2 ? 60 : 400, p1 = random.between(0, 20);
    std::vector<int32_t> p2(256);
    for (auto& v : p2) v = p1 + random.below(n % 4 ? 100 : 170);  // twice that is more than a byte, or not
    std::vector<uint8_t> guide(static_cast<size_t>(H) * W);
    for (auto& v : guide) v = static_cast<uint8_t>(random.below(256));
    std::vector<uint16_t> costs(guide.size() * D);
    for (auto& v : costs) v = static_cast<uint16_t>(random.below(most + 1));
    const SgmSettings settings{paths[n % 5], most, p1, p2.data(), n % 3 ? guide.data() : nullptr};
    const auto wanted = naive_path_sums(pair, costs, settings);
    for (const FusedKernel* kernel : available_kernels())
      for (const int threads : {1, 2, 7}) {
        std::vector<uint16_t> sums(costs.size());
        sgm_sums(pair, costs.data(), settings, sums.data(), choose_sgm(kernel->name), Workers{threads, [] { return false; }});
        CHECK(sums == wanted, std::string(kernel->name) + " " + text(settings.paths) + " paths " + text(D));
      }
  }
}

void test_census_matching() {
  Random random{89};
  for (int n = 0; n < 48; ++n) {
    const bool wide = n % 6 == 5;  // enough for pixels whose candidates are all in view, and for many pixels at a time
    const int widths[] = {7, 40, 64, 120}, rows[] = {1, 9, 24};
    const int bits = widths[n / 6 % 4], planes = (bits + 63) / 64, H = rows[n % 3] / (wide ? 4 : 1) + wide;
    const int W = wide ? random.between(150, 190) : random.between(1, 40);
    const bool aggregated = n % 2 && bits <= kMostAggregatedBits;
    const int unit = aggregated ? 3 : 0, most = ((aggregated ? 9 : 1) * bits + (1 << unit >> 1)) >> unit;
    const size_t pixels = static_cast<size_t>(H) * W;
    std::vector<uint64_t> left(planes * pixels), right(left.size());
    for (size_t k = 0; k < left.size(); ++k) {
      const int kept = std::min(64, bits - 64 * static_cast<int>(k / pixels));
      left[k] = (static_cast<uint64_t>(random.next()) << 33 ^ random.next()) >> (64 - kept);
      right[k] = random.below(3) ? left[k] : left[k] >> 1;
    }
    std::vector<int16_t> shift(pixels);
    for (auto& v : shift) v = static_cast<int16_t>(random.between(-30, 30));
    const std::vector<int32_t> p2(256, n % 8 ? 80 : 130);
    const Pair pair{nullptr, nullptr, H, W, 1, random.between(-9, 9), wide ? 128 : random.between(1, 90)};
    const CensusCosts costs{left.data(), right.data(), bits, aggregated, unit, n % 3 || wide ? nullptr : shift.data()};
    const SgmSettings settings{n % 7 ? 8 : 4, most, 9, p2.data(), nullptr};
    const FusedSettings select{CostKind::sad, {1, 1}, Subpixel::parabola, n % 5 != 0, 1.0, n % 4 == 0, 1.1};
    std::vector<float> wanted;
    for (const FusedKernel* kernel : available_kernels())
      for (const int threads : {1, 3}) {
        std::vector<float> disparity(pixels), confidence(pixels);
        std::vector<uint8_t> flags(pixels);
        const FusedOutput out{disparity.data(), confidence.data(), flags.data()};
        sgm_census(pair, costs, settings, select, out, choose_sgm(kernel->name), Workers{threads, [] { return false; }});
        disparity.insert(disparity.end(), confidence.begin(), confidence.end());
        disparity.insert(disparity.end(), flags.begin(), flags.end());
        if (wanted.empty()) wanted = disparity;
        CHECK(std::memcmp(wanted.data(), disparity.data(), wanted.size() * sizeof(float)) == 0, std::string(kernel->name) + " " + text(n));
      }
  }
}

// What a process has in memory, in bytes; 0 where the system does not say.
int64_t resident() {
  long pages = 0;
  if (std::FILE* file = std::fopen("/proc/self/statm", "r")) {
    if (std::fscanf(file, "%*d %ld", &pages) != 1) pages = 0;
    std::fclose(file);
  }
  return pages * int64_t{4096};
}

// Memory that is taken between two asks keeps a call from being stopped: a second for some gigabytes.
void test_memory_is_taken_between_asks() {
  int64_t most = 0, before = 0;
  const Workers workers{1, [&] {
                          const int64_t now = resident();
                          most = std::max(most, now - before);
                          before = now;
                          return false;
                        }};
  const auto check_most = [&](const char* name, int64_t megabytes, auto run) {
    most = 0, before = resident();
    run();
    CHECK(most <= megabytes << 20, std::string(name) + " took " + std::to_string(most >> 20) + " MiB at once");
  };
  const int H = 600, W = 1000, D = 256, bits = 24;  // 55 MiB of notes
  Random random{101};
  std::vector<uint64_t> left(static_cast<size_t>(H) * W), right(left.size());
  for (auto& v : left) v = random.next() & 0xffffff;
  for (auto& v : right) v = random.next() & 0xffffff;
  std::vector<float> disparity(left.size()), confidence(left.size());
  std::vector<uint8_t> flags(left.size());
  const std::vector<int32_t> p2(256, 80);
  check_most("semi-global matching", 16, [&] {
    sgm_census({nullptr, nullptr, H, W, 1, 0, D}, {left.data(), right.data(), bits, false, 0, nullptr}, {8, bits, 9, p2.data(), nullptr},
               {CostKind::sad, {1, 1}, Subpixel::parabola, false, 1.0, false, 1.1},
               {disparity.data(), confidence.data(), flags.data()}, choose_sgm(available_kernels().front()->name), workers);
  });
  Field f = field(random, 200, 300, 64);  // messages of 4 times 15 MiB
  const Smoothness s{2, 0.01, HUGE_VAL};
  check_most("tree-reweighted", 8, [&] { tree_reweighted(f.grid(), s, 1, f.start.data(), workers); });
  check_most("belief propagation", 8, [&] { belief_propagation(f.grid(), s, 1, 3, f.start.data(), workers); });
}

// ---- planar filter -----------------------------------------------------------------------------------------------------

void test_planar() {
  Random random{97};
  for (int n = 0; n < 60; ++n) {
    const int H = random.between(1, 30), W = random.between(1, 50);
    const Window window{random.between(1, 60), random.between(1, 40)};
    std::vector<float> map(static_cast<size_t>(H) * W), wanted, whole(map.size());
    for (float& v : map) v = random.below(8) ? 0.125f * random.below(40) : std::numeric_limits<float>::quiet_NaN();
    for (const FusedKernel* kernel : available_kernels())
      for (const int threads : {1, 3}) {
        planar(map.data(), H, W, window, 1.5f, 3, whole.data(), choose_planar(kernel->name), {threads, [] { return false; }});
        if (wanted.empty()) wanted = whole;
        bool same = true;
        for (size_t k = 0; k < map.size(); ++k)
          same = same && (std::isnan(map[k]) ? std::isnan(whole[k]) : whole[k] == wanted[k]);
        CHECK(same, std::string(kernel->name) + " " + text(H) + "x" + text(W));
      }
  }
}

void test_segments() {
  Random random{23};
  const SegmentModel model{5, 6, 0.6, 1.5, 400, 2000, 300, 2, 2, 6};
  for (int round = 0; round < 40; ++round) {
    const int H = random.between(1, 24), W = random.between(1, 24), C = round % 2 ? 1 : 3;
    const int rows = random.between(1, std::min(H, 5)), columns = random.between(1, std::min(W, 5)), count = rows * columns;
    const size_t pixels = static_cast<size_t>(H) * W;
    std::vector<float> image(pixels * C), disparity(pixels), weight(pixels);
    for (float& value : image) value = static_cast<float>(random.below(256));
    for (size_t p = 0; p < pixels; ++p) {
      weight[p] = random.below(4) ? random.below(8) / 7.0f : 0;
      // What counts nothing may be anything.
      disparity[p] = weight[p] > 0 ? random.below(64) / 4.0f : std::nanf("");
    }
    const Observed seen{image.data(), disparity.data(), weight.data(), H, W, C};
    const auto solved = [&](int threads) {
      const Workers workers{threads, [] { return false; }};
      std::vector<int32_t> label(pixels);
      for (int y = 0; y < H; ++y)
        for (int x = 0; x < W; ++x) label[y * W + x] = y * rows / H * columns + x * columns / W;
      std::vector<double> planes(static_cast<size_t>(count) * 3, std::nan(""));
      for (int turn = 0; turn < 2; ++turn) {
        fit_planes(seen, model, label.data(), count, 5, planes.data(), workers);
        move_boundaries(seen, model, planes.data(), count, 3, label.data(), workers);
      }
      smooth_planes(seen, model, label.data(), count, columns, 3, planes.data(), workers);
      std::vector<float> flat(pixels);
      render_planes(label.data(), H, W, planes.data(), 0, 15, flat.data(), workers);
      return std::make_pair(label, flat);
    };
    const auto one = solved(1), three = solved(3);
    const std::string told = text(H) + "x" + text(W);
    CHECK(one.first == three.first, told);
    CHECK(std::memcmp(one.second.data(), three.second.data(), pixels * sizeof(float)) == 0, told);
    std::vector<int> sizes(count);
    for (const int32_t l : one.first) ++sizes[l];
    CHECK(*std::min_element(sizes.begin(), sizes.end()) > 0, told);
    for (const float value : one.second) CHECK(std::isnan(value) || (value >= 0 && value <= 15), told);
  }
  // Both loops of short steps ask before each.
  const std::vector<float> grey(64 * 64), ones(64 * 64, 1);
  const Observed seen{grey.data(), ones.data(), ones.data(), 64, 64, 1};
  std::vector<int32_t> label(64 * 64);
  std::vector<double> planes(3, 0);
  const Workers impatient{2, [] { return true; }};
  int stopped = 0;
  try {
    move_boundaries(seen, model, planes.data(), 1, 60, label.data(), impatient);
  } catch (const Interrupted&) {
    ++stopped;
  }
  try {
    smooth_planes(seen, model, label.data(), 1, 1, 1 << 19, planes.data(), impatient);
  } catch (const Interrupted&) {
    ++stopped;
  }
  CHECK(stopped == 2, "segments");
}

}  // namespace

int main() {
  const auto timed = [](const char* what, void (*test)()) {
    const auto start = std::chrono::steady_clock::now();
    test();
    std::fprintf(stderr, "%-40s %6.2f s\n", what, seconds_since(start));
  };
  timed("dispatch", test_dispatch);
  timed("bands", test_bands);
  timed("bands that wait for one another", test_bands_wait_for_one_another);
  timed("bands within bands", test_bands_within_bands);
  timed("crews of many threads", test_crews_of_many_threads);
  timed("a crew is interrupted", test_a_crew_is_interrupted);
  timed("grey", test_grey);
  timed("halving", test_halving);
  timed("stretching", test_stretching);
  timed("terms and box", test_terms_and_box);
  timed("supports", test_supports);
  timed("census, bytes", test_census<uint8_t>);
  timed("census, words", test_census<int32_t>);
  timed("costs of pixels", test_pixel_costs);
  timed("combined costs", test_combined_costs);
  timed("select, whole costs", test_select<int64_t>);
  timed("select, 16-bit costs", test_select<uint16_t>);
  timed("select, float costs", test_select<float>);
  timed("distance transform", test_distance_transform);
  timed("solvers", test_solvers);
  timed("second pass, whole costs", test_second_pass<int64_t>);
  timed("second pass, 16-bit costs", test_second_pass<uint16_t>);
  timed("second pass, float costs", test_second_pass<float>);
  timed("solvers are interrupted", test_solvers_are_interrupted);
  timed("path sums", test_path_sums);
  timed("planar filter", test_planar);
  timed("semi-global matching of a census", test_census_matching);
  timed("memory is taken between asks", test_memory_is_taken_between_asks);
  timed("texture", test_texture);
  timed("speckle", test_speckle);
  timed("left and right of maps", test_left_right_of_maps);
  timed("relief", test_relief);
  timed("flood", test_flood);
  timed("regions", test_keep_regions);
  timed("noise", test_noise_means);
  timed("median", test_median);
  timed("after the checks", test_after_the_checks);
  timed("refinement from the images", test_refinement_from_images);
  timed("ties", test_ties_go_to_the_first_candidate);
  timed("small problems", test_small_problems);
  timed("sizes around those of vectors", test_sizes_around_those_of_vectors);
  timed("threads", test_threads_do_not_matter);
  timed("planes", test_planes);
  timed("warp, bytes", test_warp<uint8_t>);
  timed("warp, words", test_warp<int32_t>);
  timed("moving rows, bytes", test_move_rows<uint8_t>);
  timed("moving rows, words", test_move_rows<int32_t>);
  timed("borders", test_borders);
  timed("sharpening, bytes", test_sharpen<uint8_t>);
  timed("sharpening, words", test_sharpen<int32_t>);
  timed("corners and tracks", test_corners_and_tracks);
  timed("fitting rows", test_fit_rows);
  timed("bowed disparities", test_unbow);
  timed("merging", test_merging);
  timed("winning costs", test_winning_costs);
  timed("interruption", test_interruption);
  timed("Gaussian windows", test_gaussian);
  timed("Gaussian windows, threads", test_gaussian_threads_and_interruption);
  timed("bounds of sums", test_bounds_of_sums);
  timed("segments", test_segments);
  std::printf("%d passed, %d failed\n", passed, failed);
  return failed ? EXIT_FAILURE : EXIT_SUCCESS;
}
