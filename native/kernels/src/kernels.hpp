// What every instruction set implements, and the plain data that passes between the phases.
#pragma once

#include <cstddef>
#include <cstdint>

#include "cast_data.hpp"

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

constexpr double kCell = 0.7;   // spreads: how wide the cells of a table of averages are
constexpr int kCellTerms = 8;   // of the polynomial in a cell
constexpr int kPlaceTerms = 4;  // of an average at a place: derivatives 0 to 3, times the cell's width to that power

// The normal distribution's cumulative function Phi at kAround places z = m + d around 0 that are kCell apart: for each of some
// ranges of d, one after the other, the middles m and the Taylor series about them.
constexpr int kAround = 20, kAroundPadded = 24, kNormalParts = 8, kNormalTerms = 9;

struct NormalTable {
    double middle[kNormalParts][kAroundPadded];
    double series[kNormalParts][kNormalTerms][kAroundPadded];  // zeros beyond kAround
};

// A piecewise-linear function of four columns: its value at the far left, and at each place a change of its slope, or a step.
struct AveragedChange {
    double place, size[kChanges];
    bool step;
};

struct AveragedChanges {
    const AveragedChange* data;
    int64_t count;
    double left[kChanges];
};

constexpr int kMostLevels = 64;

// What a table of averages [cells, kCellTerms, kChanges] covers: values from lowest to highest, and at equal steps of their logarithm
// `count` spreads, one level after the other.
struct AverageLevels {
    double lowest, highest, log_least, log_most, per_step;
    double per_spread[kMostLevels], per_cell[kMostLevels];  // 1 / spread, 1 / width of a cell
    int64_t first[kMostLevels + 1];  // the first cell of each, and behind the last
    float step;
    int count;
};

// The number of doubles that an average_level with this number of cells needs, and the length of a row.
constexpr int64_t average_stride(int64_t cells) { return cells + 1 + 2 * kAround + kWidest; }
constexpr int64_t average_scratch(int64_t cells) { return kPlaceTerms * kChanges * average_stride(cells) + 2 * kChanges * (cells + 1); }

// Gaussians that carry values, and the function that they are seen under, see averages.inc.
struct Averaged {
    const float* table;
    const float* logits;  // [N]
    const float* values;  // [N, 2] mean, logarithm of the spread
    float low[3], high[3];  // the range of the function's colours
    float dark, least_depth, most_depth;
    AverageLevels levels;
};

// Gaussians that carry values: means and scales [count, 3], quaternions [count, 4], weights >= 0 and values [count].
struct Carriers {
    const float* means;
    const float* scales;
    const float* quats;
    const float* weights;
    const float* values;
    int64_t count;
};

// Gaussians of a medium, and where they are seen from, see rays.inc: means and logarithms of scales [count, 3], quaternions
// [count, 4], logits [count].
struct Media {
    const float* means;
    const float* log_scales;
    const float* quats;
    const float* logits;
    double position[3];
    double shortest_quaternion;
};

struct MediaGradients {
    float* means;
    float* log_scales;
    float* quats;
    float* logits;
};

// Gaussians whose colours depend on the place they are seen from, see directional.inc: means [count, 3], coefficients [count, 12].
struct Directional {
    const float* means;
    const float* colors;
    double position[3];
};

// Gaussians on surfaces, see lit.inc: means and normals [count, 3], the light, and where they are seen from.
struct Lit {
    const float* means;
    const float* normals;
    double position[3];
    float color[3];
    float ambient, diffuse, specular, power;
};

// Places sorted into the cells of a grid around them: x varies fastest, and one cell's places follow another's.  kWidest more
// numbers may be read behind the last place.
struct PlaceGrid {
    const float *x, *y, *z;
    const uint32_t* numbers;  // of the places, as the caller counts
    const uint32_t* starts;   // where each cell's begin, and at the end their number
    float low[3], high[3], per_unit[3];  // the box; cells in a unit
    int number[3];
};

// The cell along axis k.  Static: compiled with one instruction set and shared, it would crash machines that lack it.
static inline int cell_along(const PlaceGrid& grid, int k, float at) {
    const float cells = (at - grid.low[k]) * grid.per_unit[k], last = float(grid.number[k] - 1);
    return int(cells > 0.0f ? (cells < last ? cells : last) : 0.0f);
}

// Of a Gaussian and a place within its reach.
struct Pair {
    uint32_t gaussian, place;
    float density;  // of the Gaussian there, 1 at its mean
};

constexpr int kCorrections = 40'000;  // steps, after which Adam's bias corrections are 1 in single precision

// A tensor [rows, width] that Adam moves, its moments, and how many steps each row has seen [rows].
struct RowStep {
    float* tensor;
    const float* gradient;
    float *first, *second, *steps;
    int64_t rows, width;
    float rate;
    const float* corrections;  // [kCorrections], factors of the rate by the number of steps
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
    // The same with the derivative of what passes the alpha floor.
    void (*backward_tile_with_edges)(const Splat*, const Entry*, int64_t count, const View&, int left, int top,
                                     const float* state, const float* gradient, float* moments);
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
    // One level of a table of averages, Gaussians [first, last) under such a table, and the derivative by both, see averages.inc.
    void (*average_level)(const NormalTable&, const AveragedChanges&, double low, double spread, int64_t count, double* places,
                          float* cells);
    void (*averages)(const Averaged&, int64_t first, int64_t last, float* logits, float* colors);
    void (*averages_backward)(const Averaged&, int64_t first, int64_t last, const float* by_logits, const float* by_colors,
                              float* by_old_logits, float* by_values);
    // The pairs of Gaussians [first, last) with places, see blending.inc: at most one for each two; returns how many.
    int64_t (*blend_pairs)(const Carriers&, const PlaceGrid&, float reach, int64_t first, int64_t last, Pair*);
    // The opacities of Gaussians [first, last) along rays, and the derivatives of a loss with this gradient by them, see rays.inc.
    void (*ray_opacities)(const Media&, int64_t first, int64_t last, float* opacities);
    void (*ray_opacities_backward)(const Media&, int64_t first, int64_t last, const float* by_opacities, const MediaGradients&);
    // The colours [.., 3] of Gaussians [first, last) as they are seen, and the derivatives of a loss with this gradient by them, see
    // directional.inc.
    void (*directional_colors)(const Directional&, int64_t first, int64_t last, float* colors);
    void (*directional_colors_backward)(const Directional&, int64_t first, int64_t last, const float* upstream, float* by_means,
                                        float* by_colors);
    // The colours [.., 3] of Gaussians [first, last) on lit surfaces, and the derivatives by means and normals, see lit.inc.
    void (*lit_colors)(const Lit&, int64_t first, int64_t last, float* colors);
    void (*lit_colors_backward)(const Lit&, int64_t first, int64_t last, const float* upstream, float* by_means, float* by_normals);
    // A step of Adam for the rows that have a gradient, see row_steps.inc.
    void (*step_rows)(const RowStep&);
    // Pixels of a volume rendering [H, W, 4] in a box of left, top, right and bottom, the first two multiples of 4, see casting.inc.
    void (*cast_tile)(const CastField&, const CastFunction&, const CastRays&, const int box[4], float* picture);
    // The derivative of such pixels, see casting_gradient.inc.
    void (*tile_backward)(const CastField&, const CastFunction&, const CastRays&, const int box[4], const CastGradient&);
    // Adds a tile of samples, whose rays are given, to the picture of a surface by the triangles that lie there, see surfaces.inc.
    void (*surface_tile)(const CastSurface&, const CastRays&, const int32_t* triangles, int64_t count, const int box[4], float* picture);
};

extern const Kernels kernels_baseline;
#if defined(GS_X86)
extern const Kernels kernels_avx2;
extern const Kernels kernels_avx512;
#endif

}  // namespace gs
