// Pictures of triangles with normals.
#pragma once

#include <cstdint>

#include "kernels.hpp"

namespace gs {

// Places [places, 3] of corners, in samples of the field, their normals [places, 3], and the triangles' corners [count, 3].
struct Mesh {
    const double *places, *normals;
    const int32_t* corners;
    int64_t count;
};

// Adds the image [height, width, 4] of the nearest triangles to the picture; there are rays for each sample.  `surface` says how they look.
void draw_surface(const Mesh& mesh, int64_t places, CastSurface surface, const CastRays&, const Kernels&, int threads, float* picture);

}  // namespace gs
