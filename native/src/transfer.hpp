// Gaussians under a changed transfer function, on all cores.
#pragma once

#include "kernels.hpp"

namespace gs {

// What `count` Gaussians become, see transfer.inc.  `changes` [values, kChanges] are as the caller has them; those of `t` are not
// read, nor its stride.
void apply_transfer(Transfer t, const float* changes, int64_t count, const Kernels&, int threads, float* logits, float* colors);

// The derivative by the weights [count, values] of a loss with these gradients by logits [count] and colours
// [count, color_columns].
void transfer_gradient(Transfer t, const float* changes, int64_t count, const float* by_logits, const float* by_colors,
                       const Kernels&, int threads, float* by_weights);

}  // namespace gs
