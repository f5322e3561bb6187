// Which build of the kernels this machine runs.
#pragma once

#include <string>
#include <vector>

#include "fused.hpp"

namespace stereopsis {

// The builds that this machine can run, best first; the last is the plain one.
std::vector<const FusedKernel*> available_kernels();

// The named build, or the best one for an empty name. Throws std::invalid_argument for one that is not available.
const FusedKernel& choose_kernel(const std::string& name);

}  // namespace stereopsis
