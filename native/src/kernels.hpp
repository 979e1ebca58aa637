// What every instruction set implements, and the plain data that passes between the phases.
#pragma once

#include <cstddef>
#include <cstdint>

namespace gs {

constexpr int kMoments = 9;  // sums kept per (Gaussian, tile): see backward_tile in tiles.inc

// What surrogate.splatting.Constants describes, in its order.
struct Constants {
    double near;
    double dilation;  // px^2, added to the diagonal of the projected covariance
    float alpha_floor, alpha_cap, min_transmittance;
    double frame_margin, shortest_quaternion;
};

struct View : Constants {
    double rotation[9];  // world -> camera, row major
    double translation[3];
    double fx, fy, cx, cy;
    int width, height;
    float background[3];  // that colours are drawn over; alpha, the fourth channel, leaves it out
};

// One Gaussian as the pixel loops need it: log2(alpha) = peak - u^2 - v^2 at the pixel position (x, y), where
// u = u_0 + u_x x + u_y y and v = v_0 + v_y y.  This Cholesky form has no cancelling terms, however thin the ellipse; the
// constants are doubles so that the centre may lie far away.
struct alignas(64) Splat {
    double u_0, v_0;
    float u_x, u_y, v_y, peak;
    float color[3];
    float reach;                // peak - log2(alpha_floor): the ellipse is u^2 + v^2 <= reach
    float y_right, y_left;      // heights of the ellipse's rightmost and leftmost points
    int32_t first_row, last_row;
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

// A Gaussian in a tile: `blocks` has a bit for each block of pixels that the ellipse touches.
struct Touch {
    uint32_t tile;
    uint32_t blocks;
};

// The same in the list of its tile; `slot` is where its moments go, Gaussian by Gaussian.
struct Entry {
    uint32_t splat;
    uint32_t slot;
    uint32_t blocks;
};

// How the frame is cut: `across` x `down` tiles of `width` x `height` pixels.
struct Tiling {
    int across, down;
    int width, height;
};

// A growing array of the tiles that a run of Gaussians touches, one Gaussian after the other.
struct Touches {
    Touch* data;
    size_t count, capacity;
    void (*grow)(Touches*, size_t room);  // makes room for at least that many more
};

// An image [height, width, image_channels], whose first `channels` are compared with a target [height, width, channels],
// given as floats or, where that is null, as bytes that are 255 times as large.
struct ImagePair {
    const float* image;
    const float* target;
    const uint8_t* target_bytes;
    int height, width, image_channels, channels;
};

constexpr int kParts = 5;          // tensors that a Gaussian's parameters lie in
constexpr int kMostColumns = 64;   // of a Gaussian's parameters, all tensors together
constexpr int kMostLatent = 256;
constexpr int kMostProducts = 2;   // added at once
constexpr int kChanges = 4;        // of a transfer function at a value: the extinction, and that times red, green and blue
constexpr int kWidest = 16;        // floats in the widest vector

constexpr int padded(int count) { return (count + kWidest - 1) / kWidest * kWidest; }

// A table [N, sum of widths] whose columns lie in several tensors.
template <class Float>
struct ParameterTable {
    Float* parts[kParts];
    int widths[kParts];
};

// What the bilinear offsets are made of: latents [N, latent], modes [latent, stride] and, transposed, [columns, latent_stride].
struct BilinearTables {
    const float *latents, *modes, *transposed;
    int latent, columns, stride, latent_stride;
};

// What a changed transfer function acts on, see transfer.inc.
struct Transfer {
    const float* weights;  // [N, values]
    const float* logits;   // [N]
    const float* colors;   // [N, color_columns], of which the first three change
    int values, color_columns;
    float low[3], high[3];  // the range of the function's colours
    float least_depth;
    const float* changes;  // [kChanges, stride], zeros beyond the values
    int stride;
};

struct Kernels {
    const char* name;
    int tile_width, tile_height;
    // Projects Gaussians [first, last): writes splats, depths (-1 for one that is not drawn), what they touch, and in
    // `begin` where each one's begin in `touches`, and at its end where they end.
    void (*project)(const Gaussians&, const View&, const Tiling&, int64_t first, int64_t last, Splat*, float* depths,
                    Touches& touches, uint32_t* begin);
    // Draws one tile of the picture [H, W, 4] from its list, front to back; `state` keeps four values per pixel.
    void (*forward_tile)(const Splat*, const Entry*, int64_t count, const View&, int left, int top, float* state, float* picture);
    // Moments of one tile's entries, each written to moments + slot * kMoments.
    void (*backward_tile)(const Splat*, const Entry*, int64_t count, const View&, int left, int top, const float* state,
                          const float* gradient, float* moments);
    // Chain rule of the projection for Gaussians [first, last), with their moments in slots begin[0] to begin[last - first].
    void (*project_backward)(const Gaussians&, const View&, int64_t first, int64_t last, const float* moments,
                             const uint32_t* begin, const GaussianGradients&);
    // The image loss, see image_loss.inc: floats of scratch memory that one call needs, and the call.
    int64_t (*loss_scratch)(const ImagePair&);
    void (*loss_rows)(const ImagePair&, int first, int last, float l1_weight, float ssim_weight, float* scratch,
                      float* gradient, double* difference, double* similarity);
    // Bilinear offsets of Gaussians [first, last) and their derivatives, see bilinear.inc.
    void (*bilinear_forward)(const BilinearTables*, int number, const ParameterTable<const float>& base, int64_t first,
                             int64_t last, const ParameterTable<float>& out);
    void (*bilinear_backward)(const BilinearTables&, const ParameterTable<const float>& gradient, int64_t first, int64_t last,
                              float* by_latents, float* by_modes);
    // Gaussians [first, last) under a changed transfer function, and the derivative by the weights, see transfer.inc.
    void (*transfer)(const Transfer&, int64_t first, int64_t last, float* logits, float* colors);
    void (*transfer_backward)(const Transfer&, int64_t first, int64_t last, const float* by_logits, const float* by_colors,
                              float* by_weights);
};

extern const Kernels kernels_baseline;
#if defined(GS_X86)
extern const Kernels kernels_avx2;
extern const Kernels kernels_avx512;
#endif

}  // namespace gs
