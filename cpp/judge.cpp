#include <cmath>
#include <limits>

#include "parallel.hpp"
#include "simd.hpp"
#include "stages.hpp"

namespace stereopsis {

namespace {

// By selection alone, whatever is selected being read before, so that compilers make vectors of it.
void accept_row(const float* STEREOPSIS_RESTRICT disparity, const float* STEREOPSIS_RESTRICT confidence,
                const uint8_t* STEREOPSIS_RESTRICT flags, int width, float* STEREOPSIS_RESTRICT accepted,
                float* STEREOPSIS_RESTRICT trust) {
  constexpr float none = std::numeric_limits<float>::quiet_NaN();
  for (int x = 0; x < width; ++x) {
    const float d = disparity[x], c = confidence[x];
    const int32_t flag = flags[x];
    accepted[x] = flag ? none : d;
    trust[x] = flag ? 0.0f : c;
  }
}

void clamp_row(float least, float most, int width, float* STEREOPSIS_RESTRICT disparity) {
  for (int x = 0; x < width; ++x) {
    const float d = disparity[x], above = d < least ? least : d;
    disparity[x] = above > most ? most : above;
  }
}

void judge_row(const float* STEREOPSIS_RESTRICT winners, const float* STEREOPSIS_RESTRICT smooth, const Verdict& verdict, int width,
               uint8_t* STEREOPSIS_RESTRICT flags) {
  const float near = verdict.near;
  const int32_t revocable = verdict.revocable, wrong = verdict.wrong;
  for (int x = 0; x < width; ++x) {
    const int32_t flag = flags[x], others = flag & ~revocable;
    const int32_t revoked = others ? flag : 0, refused = flag ? flag : wrong;
    const float off = std::fabs(winners[x] - smooth[x]);
    flags[x] = static_cast<uint8_t>(off < near ? revoked : refused);  // NaN is not near
  }
}

}  // namespace

void accept(const float* disparity, const float* confidence, const uint8_t* flags, int height, int width, float* accepted,
            float* trust, const Workers& workers) {
  parallel_bands(height, 16, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (int y = begin; y < end; ++y) {
      const size_t at = static_cast<size_t>(y) * width;
      accept_row(disparity + at, confidence + at, flags + at, width, accepted + at, trust + at);
    }
  });
}

void judge(const Evidence& seen, const Verdict& verdict, int height, int width, float* smooth, uint8_t* flags, float* accepted,
           float* trust, const Workers& workers) {
  parallel_bands(height, 16, workers.threads, workers.interrupted, [&](int begin, int end, const Cancel&) {
    for (int y = begin; y < end; ++y) {
      const size_t row = static_cast<size_t>(y) * width;
      clamp_row(verdict.least, verdict.most, width, smooth + row);
      if (seen.winners) judge_row(seen.winners + row, smooth + row, verdict, width, flags + row);
      accept_row(smooth + row, seen.confidence + row, flags + row, width, accepted + row, trust + row);
    }
  });
}

}  // namespace stereopsis
