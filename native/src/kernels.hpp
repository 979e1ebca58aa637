// What every instruction set implements, and the plain data that passes between the phases.
#pragma once

#include <cstdint>

namespace gs {

constexpr int kTile = 16;          // pixels along a tile's side; one tile row is one AVX-512 vector
constexpr int kMoments = 9;        // sums kept per (Gaussian, tile): see backward_tiles
constexpr float kAlphaCap = 0.999f;
constexpr float kMinTransmittance = 1e-4f;

struct View {
    double rotation[9];     // world -> camera, row major
    double translation[3];
    double fx, fy, cx, cy;
    int width, height;
    double near;
    double dilation;        // px^2, added to the diagonal of the projected covariance
    float alpha_floor;
};

// One Gaussian as the pixel loops need it: log2(alpha) = peak + xx dx^2 + xy dx dy + yy dy^2.
struct Splat {
    float x, y;             // centre, px
    float xx, xy, yy, peak;
    float r, g, b;
    float half_width, half_height;  // of the ellipse alpha >= floor, px
};

struct Gaussians {
    const float* means;     // [N, 3]
    const float* scales;    // [N, 3]
    const float* quats;     // [N, 4] w x y z
    const float* opacities; // [N]
    const float* colors;    // [N, 3]
    int64_t count;
};

struct GaussianGradients {
    float* means;
    float* scales;
    float* quats;
    float* opacities;
    float* colors;
    float* screen;          // [N] length of the gradient by the projected centre, px^-1
};

// One colour plane of an image pair and the maps between the two passes; rows are `stride` floats apart, the pad is zero.
struct Planes {
    const float* image;
    const float* target;
    float* by_mean;         // derivatives of the mean similarity by the local mean, square and product
    float* by_square;
    float* by_product;
    float* gradient;
    int width, height, stride;
};

struct Kernels {
    const char* name;
    // Projects Gaussians [first, last): writes splats and depths; a depth of -1 marks one that is not drawn.
    // See projection.inc.
    void (*project)(const Gaussians&, const View&, int64_t first, int64_t last, Splat*, float* depths);
    // Draws one tile; `list` holds indices into `splats`, front to back.
    void (*forward_tile)(const Splat* splats, const int32_t* list, int64_t count, const View&, int tile_x, int tile_y,
                         float* color, float* alpha);
    // Moments of one tile: entry k of `list` goes to moments + slots[k] * kMoments.
    void (*backward_tile)(const Splat* splats, const int32_t* list, const int64_t* slots, int64_t count, const View&,
                          int tile_x, int tile_y, const float* color, const float* alpha, const float* grad_color,
                          const float* grad_alpha, float* moments);
    // Chain rule of the projection for one Gaussian from its summed moments.
    void (*project_backward)(const Gaussians&, const View&, int64_t index, const Splat&, const double* moments,
                             const GaussianGradients&);
    // One plane of the image loss, rows [first, last): see image_loss.inc.
    void (*ssim_maps)(const Planes&, int first, int last, double* similarity);
    void (*loss_gradient)(const Planes&, int first, int last, float l1_weight, float ssim_weight, double* difference);
};

extern const Kernels kernels_baseline;
#if defined(GS_X86)
extern const Kernels kernels_avx2;
extern const Kernels kernels_avx512;
#endif

}  // namespace gs
