// A transfer function's means around field values.
#pragma once

#include <cstdint>

namespace gs {

// Control points of a piecewise-linear function, constant beyond the end points: rows of a place and `columns` numbers.
struct ControlPoints {
    const double* rows;
    int64_t count;
    int columns;
};

// Extinction, and extinction times each colour, at each of `count` increasing values: the mean over the values around, weighted
// by the hat function that is 1 there and 0 at the neighbours, from `samples` places between two values.  out is [count, 4].
void hat_means(const double* values, int64_t count, const ControlPoints& colors, const ControlPoints& opacities, int samples,
               double most_opaque, double* out);

}  // namespace gs
