// What moves and changes Gaussians, on all cores: bilinear offsets, and changed transfer functions.
#pragma once

#include <cstdint>

#include "kernels.hpp"

namespace gs {

// A product: latents [N, latent] times modes [latent, columns].
struct Product {
    const float* latents;
    const float* modes;
    int latent, columns;
};

// out = base + the products, 1 to kMostProducts of them, one after the other.  The last tensor of `base` may be narrower than
// that of `out`, and a product narrower than all of it: the rest is zero.
void add_bilinear(const Product* products, int number, int64_t count, const ParameterTable<const float>& base, const Kernels&,
                  int threads, const ParameterTable<float>& out);

// Derivatives of a loss with this gradient by `out`: by the product's latents [N, latent] and by its modes [latent, columns].
void bilinear_gradients(const Product&, int64_t count, const ParameterTable<const float>& gradient, const Kernels&, int threads,
                        float* by_latents, float* by_modes);

// What `count` Gaussians become, see transfer.inc.  `changes` [values, kChanges] are as the caller has them; those of the
// transfer are not read, nor its stride.
void apply_transfer(const Transfer&, const float* changes, int64_t count, const Kernels&, int threads, float* logits, float* colors);

// The derivative by the weights [count, values] of a loss with these gradients by logits [count] and colours
// [count, color_columns].
void transfer_gradient(const Transfer&, const float* changes, int64_t count, const float* by_logits, const float* by_colors,
                       const Kernels&, int threads, float* by_weights);

// Control points of a piecewise-linear function, constant beyond the end points: rows of a place and `columns` numbers.
struct ControlPoints {
    const double* rows;
    int64_t count;
    int columns;
};

// Extinction, and extinction times each colour, at each of `count` increasing values: the mean over the values around, weighted
// by the hat function that is 1 there and 0 at the neighbours, from `samples` places between two values.  out is [count, 4].
void extinction_table(const double* values, int64_t count, const ControlPoints& colors, const ControlPoints& opacities,
                      int samples, double most_opaque, double* out);

}  // namespace gs
