// The instruction sets of this machine that there are kernels for.
#pragma once

#include <string>
#include <vector>

#include "kernels.hpp"

namespace gs {

// The best first.
std::vector<const Kernels*> available();

// Those of this name; an empty one stands for what the environment says, else for the best.  Throws std::invalid_argument for
// a name that is none of this machine's.
const Kernels& kernels_named(const std::string& asked);

}  // namespace gs
