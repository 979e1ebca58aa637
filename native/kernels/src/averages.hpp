// Transfer functions averaged under normal distributions: their tables, and Gaussians that carry values, on all cores.
#pragma once

#include <cstdint>

#include "kernels.hpp"

namespace gs {

// The levels of a table for values in [lowest, highest] and spreads in [least, most].
AverageLevels levels_of(double lowest, double highest, double least, double most);

// A table of the function that is linear between `count` nodes, and constant beyond: places that never decrease, columns [count, 4].
void average_table(const double* places, const double* columns, int64_t count, const AverageLevels&, const Kernels&, float* table);

// What `count` Gaussians look like, and the derivatives by their logits [count] and values [count, 2] of a loss with gradients by
// the new logits [count] and colours [count, 3].
void apply_averages(const Averaged&, int64_t count, const Kernels&, int threads, float* logits, float* colors);
void averages_gradient(const Averaged&, int64_t count, const float* by_logits, const float* by_colors, const Kernels&, int threads,
                       float* by_old_logits, float* by_values);

}  // namespace gs
