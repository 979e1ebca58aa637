// Values that Gaussians carry, blended where one asks, and the derivatives of that.
#pragma once

#include <cstdint>
#include <vector>

#include "buffer.hpp"
#include "kernels.hpp"

namespace gs {

// At each place x the mean of the values u, weighted by w G(x), over the Gaussians whose Mahalanobis distance from x is at
// most `reach`; not a number where there is none of weight above zero.
struct Blend {
    Buffer<Pair> pairs;           // one Gaussian's after the other's
    size_t number = 0;            // of pairs
    std::vector<double> weights;  // at each place, the sum of w G
    std::vector<double> values;   // at each place, the mean
};

Blend blend(const Carriers&, const float* places, int64_t count, float reach, const Kernels&);

// Derivatives of a loss that has these by the blended values, `gradient` [places].  Those by means, scales and quaternions are
// null where not asked for; all others hold zeros before.
struct CarrierGradients {
    float* means;
    float* scales;
    float* quats;
    float* weights;
    float* values;
};

void blend_gradients(const Carriers&, const float* places, const Blend&, const float* gradient, const CarrierGradients&);

}  // namespace gs
