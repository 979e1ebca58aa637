// Offsets bilinear in a latent vector per Gaussian and a table of modes, on all cores.
#pragma once

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

}  // namespace gs
