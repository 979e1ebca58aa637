// Compiled once per instruction set: GS_KERNELS names the table, GS_WIDTH the floats in a native vector.
#include "kernels.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>

namespace gs {
namespace {

#include "vectors.inc"
#include "projection.inc"
#include "tiles.inc"
#include "image_loss.inc"

}  // namespace

#define GS_TEXT(x) #x
#define GS_NAME(x) GS_TEXT(x)
extern const Kernels GS_KERNELS = {GS_NAME(GS_LABEL), project,   forward_tile, backward_tile,
                                   project_backward,  ssim_maps, loss_gradient};

}  // namespace gs
