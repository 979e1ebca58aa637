// Compiled once per instruction set: GS_KERNELS names the table, GS_WIDTH the floats in a native vector.
//
// Nothing here may leave the translation unit but that table: a template of the standard library, compiled with one
// instruction set and shared by the linker with the others, would crash machines that lack it.  So: no std templates.
#include "kernels.hpp"

#include <cstring>
#if GS_WIDTH > 4
#include <immintrin.h>
#elif defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace gs {
namespace {

#include "vectors.inc"
#include "doubles.inc"
#include "rotations.inc"
#include "projection.inc"
#include "touches.inc"
#include "tiles.inc"
#include "image_loss.inc"
#include "bilinear.inc"
#include "logarithms.inc"
#include "transfer.inc"
#include "averages.inc"
#include "blending.inc"
#include "bearings.inc"
#include "rays.inc"
#include "directional.inc"
#include "lit.inc"
#include "row_steps.inc"
#include "casting.inc"
#include "casting_gradient.inc"
#include "surfaces.inc"

}  // namespace

#define GS_TEXT(x) #x
#define GS_NAME(x) GS_TEXT(x)
extern const Kernels GS_KERNELS = {
    GS_NAME(GS_LABEL),
    kTileWidth,
    kTileHeight,
    project,
    forward_tile,
    backward_tile<false>,
    backward_tile<true>,
    project_backward,
    loss_scratch,
    loss_rows,
    bilinear_forward,
    bilinear_backward,
    transfer,
    transfer_backward,
    average_level,
    averages,
    averages_backward,
    blend_pairs,
    ray_opacities,
    ray_opacities_backward,
    directional_colors,
    directional_colors_backward,
    lit_colors,
    lit_colors_backward,
    step_rows,
    cast_tile,
    tile_backward,
    surface_tile,
};

}  // namespace gs
