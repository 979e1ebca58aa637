// Offsets bilinear in a latent vector per Gaussian and a table of modes, on all cores.
#pragma once

#include "kernels.hpp"

namespace gs {

// out = base + latents modes, with latents [N, latent] and modes [latent, columns].
void add_bilinear(const float* latents, int latent, const float* modes, int64_t count, const ParameterTable<const float>& base,
                  const Kernels&, int threads, const ParameterTable<float>& out);

// Derivatives of a loss with this gradient by `out`: by the latents [N, latent] and by the modes [latent, columns].
void bilinear_gradients(const float* latents, int latent, const float* modes, int64_t count,
                        const ParameterTable<const float>& gradient, const Kernels&, int threads, float* by_latents, float* by_modes);

}  // namespace gs
