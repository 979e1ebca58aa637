// What the ray caster reads: a field, a transfer function, and the rays of a camera.
#pragma once

#include <cstdint>

namespace gs {

constexpr int kBrickBits = 2, kBrick = 1 << kBrickBits;  // grid cells along an edge of a brick
constexpr int kSegmentColumns = 12;   // of a segment, see CastFunction
constexpr int kShortFunction = 32;    // segments that AVX-512 keeps in registers
constexpr int kTriangleColumns = 24;  // see CastSurface
constexpr int kSurfaceTile = 64;      // samples along a side, a multiple of 4 and of GS_WIDTH

// Samples [z + 1, y + 2, x + 2] of a field with one more, a repetition, at either end of each axis, so that a place has its cell at
// its coordinates + 1, rounded down.  A sample lies beside the next along z: four numbers in a row are the corners of a cell's side.
struct CastField {
    const float* pairs;      // [z + 1, y + 2, x + 2, 2]
    const uint8_t* hidden;   // [z + 1, y + 2, x + 2] of cells by their first corner; null where none is
    int size[3];             // x, y, z samples of the field itself
    int row, slice;          // pairs from one to the next along y and z
    int bricks[3], brick_row, brick_slice;
};

// A two-sided headlight (Blinn-Phong).
struct CastLight {
    float ambient, diffuse, specular, power;
};

// Triangles as they meet the samples of a picture.  A row has, for each corner, its share of a place over the place's distance along
// the view: by column, by row, and at the first sample of the box, followed by that sample's column, its row, and 0.  Then, for each
// corner, its normal, followed by what is added to one over the distance by column, by row, and at the first sample.
struct CastSurface {
    const float* rows;       // [count, kTriangleColumns]
    const int32_t* boxes;    // [count, 4]: left, top, right and bottom of the samples that may lie in it
    float color[3];
    CastLight light;
    int samples;             // along each side of a pixel: 1, 2 or 4
};

// Opacities and colours over values from 0 to 1: segments that begin at increasing places, the first at 0.
// A row is place, opacity, its slope, 0; red, green, blue, 0; their slopes, 0.
struct CastFunction {
    const float* rows;       // [count, kSegmentColumns]
    const float* columns;    // [kSegmentColumns, kShortFunction], the same, of a short function
    const float* begins;     // [count + 1], the last beyond 1
    const int32_t* first;    // [cells + 1]: the segment in which each of equal parts of 0 to 1 begins
    const uint8_t* clear;    // [z, y, x] of bricks: 0 where something is seen, else bricks to the nearest such; null where none is clear
    int count, cells;
    int most;                // places inside of one part, the most
    double distance, unit;   // world units: the longest step, and the length that opacities are of
    bool shaded;
    CastLight light;
    bool every;              // steps count in which nothing is seen, too: opacities of 0 have derivatives
};

// A picture and a gradient by it [height, width, 4], and what is added to: the gradients by the values drawn [z, y, x], and by
// opacity, red, green and blue where each segment begins and by their slopes [segments, 8].
struct CastGradient {
    const float *picture, *gradient;
    float* by_values;
    double* by_segments;
};

// Rays from `eye` along across * column + down * row + corner, in samples; `spacing` has world units.  Rays through a volume begin
// and end at the box from `low` to `high`, inside of the field; nothing is seen where these are the same.
struct CastRays {
    double eye[3], across[3], down[3], corner[3], spacing[3], low[3], high[3];
    int width, height;
};

}  // namespace gs
