// The Python face of what moves and changes Gaussians.
#pragma once

#include <nanobind/nanobind.h>

namespace gs {

// Adds add_bilinear, bilinear_gradients, transfer, transfer_gradient and hat_means.
void bind_deformations(nanobind::module_& m);

}  // namespace gs
