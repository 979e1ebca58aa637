#include "blending.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

namespace gs {
namespace {

constexpr double kShortestQuaternion = 1e-12;
constexpr int kMostCells = 64;             // along an axis
constexpr int64_t kPairsAtOnce = 1 << 15;  // that there is room for

// The principal axes of a Gaussian, the columns of R(q), and one over its standard deviations along them.
struct Axes {
    double q[4];  // w, x, y, z of unit length, or zeros
    double per_length;
    double axis[3][3];
    double per_scale[3];

    Axes(const Carriers& g, int64_t i) {
        double squared = 0;
        for (int k = 0; k < 4; ++k) squared += double(g.quats[4 * i + k]) * g.quats[4 * i + k];
        const double length = std::sqrt(squared);
        per_length = length > kShortestQuaternion ? 1.0 / length : 0.0;
        for (int k = 0; k < 4; ++k) q[k] = g.quats[4 * i + k] * per_length;
        for (int k = 0; k < 3; ++k) per_scale[k] = 1.0 / g.scales[3 * i + k];
        const double w = q[0], x = q[1], y = q[2], z = q[3];
        const double columns[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)},
                                      {2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)},
                                      {2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)}};
        std::copy(&columns[0][0], &columns[0][0] + 9, &axis[0][0]);
    }

    // Along the axes, in standard deviations.
    void local(const double d[3], double out[3]) const {
        for (int k = 0; k < 3; ++k) out[k] = (axis[k][0] * d[0] + axis[k][1] * d[1] + axis[k][2] * d[2]) * per_scale[k];
    }

    // Of a loss with this derivative by `axis`, that by the quaternion as it is stored.
    void by_quaternion(const double d[3][3], float* out) const {
        const double w = q[0], x = q[1], y = q[2], z = q[3];
        const double by[4] = {
            2 * (z * (d[0][1] - d[1][0]) + y * (d[2][0] - d[0][2]) + x * (d[1][2] - d[2][1])),
            2 * (y * (d[1][0] + d[0][1]) + z * (d[2][0] + d[0][2]) + w * (d[1][2] - d[2][1]) - 2 * x * (d[1][1] + d[2][2])),
            2 * (x * (d[1][0] + d[0][1]) + z * (d[2][1] + d[1][2]) + w * (d[2][0] - d[0][2]) - 2 * y * (d[0][0] + d[2][2])),
            2 * (x * (d[2][0] + d[0][2]) + y * (d[2][1] + d[1][2]) + w * (d[0][1] - d[1][0]) - 2 * z * (d[0][0] + d[1][1]))};
        const double along = w * by[0] + x * by[1] + y * by[2] + z * by[3];
        for (int k = 0; k < 4; ++k) out[k] = float((by[k] - q[k] * along) * per_length);
    }
};

// Places as the kernels read them.
class SortedPlaces {
public:
    PlaceGrid grid{};

    SortedPlaces(const float* places, int64_t count) : numbers_(size_t(count)) {
        const double root = std::cbrt(double(count));
        const int finer = std::min(kMostCells, int(2.0 * root) + 1), rows = std::min(kMostCells, int(0.35 * root) + 1);
        const int along[3] = {finer, rows, rows};  // few long rows, which vectors run along
        for (int k = 0; k < 3; ++k) {
            grid.low[k] = grid.high[k] = places[k];
            for (int64_t p = 1; p < count; ++p) {
                grid.low[k] = std::min(grid.low[k], places[3 * p + k]);
                grid.high[k] = std::max(grid.high[k], places[3 * p + k]);
            }
            const float per_unit = float(along[k]) / (grid.high[k] - grid.low[k]);
            grid.per_unit[k] = std::isfinite(per_unit) ? per_unit : 0.0f;
            grid.number[k] = grid.per_unit[k] > 0 ? along[k] : 1;
        }
        sort(places, count);
        for (int k = 0; k < 3; ++k) {
            std::memset(coordinates_[k].resize(size_t(count) + kWidest), 0, (size_t(count) + kWidest) * sizeof(float));
            for (int64_t p = 0; p < count; ++p) coordinates_[k][p] = places[3 * numbers_[p] + k];
        }
        grid.x = coordinates_[0].data();
        grid.y = coordinates_[1].data();
        grid.z = coordinates_[2].data();
        grid.numbers = numbers_.data();
        grid.starts = starts_.data();
    }

private:
    void sort(const float* places, int64_t count) {
        starts_.assign(size_t(grid.number[0]) * grid.number[1] * grid.number[2] + 1, 0);
        std::vector<uint32_t> cells(static_cast<size_t>(count));
        for (int64_t p = 0; p < count; ++p) {
            const float* at = places + 3 * p;
            const int row = cell_along(grid, 2, at[2]) * grid.number[1] + cell_along(grid, 1, at[1]);
            cells[p] = uint32_t(row * grid.number[0] + cell_along(grid, 0, at[0]));
            ++starts_[cells[p] + 1];
        }
        for (size_t c = 1; c < starts_.size(); ++c) starts_[c] += starts_[c - 1];
        std::vector<uint32_t> next(starts_.begin(), starts_.end() - 1);
        for (int64_t p = 0; p < count; ++p) numbers_[next[cells[p]]++] = uint32_t(p);
    }

    std::vector<uint32_t> numbers_, starts_;
    Buffer<float> coordinates_[3];
};

}  // namespace

Blend blend(const Carriers& g, const float* places, int64_t count, float reach, const Kernels& kernels) {
    Blend found;
    found.weights.assign(size_t(count), 0.0);
    found.values.assign(size_t(count), std::numeric_limits<double>::quiet_NaN());
    if (!count) return found;
    const SortedPlaces sorted(places, count);
    const int64_t block = std::clamp<int64_t>(kPairsAtOnce / count, 16, 1024);
    for (int64_t first = 0; first < g.count; first += block) {
        const int64_t last = std::min(first + block, g.count);
        const size_t room = found.number + size_t((last - first) * count);
        if (room > found.pairs.capacity()) found.pairs.grow(2 * room, found.number);
        found.number += size_t(kernels.blend_pairs(g, sorted.grid, reach, first, last, found.pairs.data() + found.number));
    }
    std::vector<double> sums(size_t(count), 0.0);
    for (size_t n = 0; n < found.number; ++n) {
        const auto [i, p, density] = found.pairs[n];
        const double share = double(g.weights[i]) * density;
        found.weights[p] += share;
        sums[p] += share * g.values[i];
    }
    for (int64_t p = 0; p < count; ++p)
        if (found.weights[p] > 0) found.values[p] = sums[p] / found.weights[p];
    return found;
}

void blend_gradients(const Carriers& g, const float* places, const Blend& blended, const float* gradient,
                     const CarrierGradients& out) {
    const Buffer<Pair>& pairs = blended.pairs;
    for (size_t first = 0; first < blended.number;) {
        const int64_t i = pairs[first].gaussian;
        const Axes axes(g, i);
        double by_weight = 0, by_value = 0, by_local[3] = {}, by_scale[3] = {}, by_axis[3][3] = {};
        size_t n = first;
        for (; n < blended.number && pairs[n].gaussian == i; ++n) {
            const auto [gaussian, p, density] = pairs[n];
            if (!(blended.weights[p] > 0)) continue;
            const double share = gradient[p] * density / blended.weights[p];
            const double above = g.values[i] - blended.values[p];
            by_value += share * g.weights[i];
            by_weight += share * above;
            if (!out.means) continue;
            const double d[3] = {double(places[3 * p]) - g.means[3 * i], double(places[3 * p + 1]) - g.means[3 * i + 1],
                                 double(places[3 * p + 2]) - g.means[3 * i + 2]};
            double y[3];
            axes.local(d, y);
            const double by_squared = -0.5 * share * g.weights[i] * above;
            for (int k = 0; k < 3; ++k) {
                const double by = 2 * by_squared * y[k] * axes.per_scale[k];  // by the place along axis k
                by_local[k] += by;
                by_scale[k] -= by * y[k];
                for (int c = 0; c < 3; ++c) by_axis[k][c] += by * d[c];
            }
        }
        out.values[i] = float(by_value);
        out.weights[i] = float(by_weight);
        if (out.means) {
            for (int k = 0; k < 3; ++k) {
                out.means[3 * i + k] = float(-(by_local[0] * axes.axis[0][k] + by_local[1] * axes.axis[1][k] + by_local[2] * axes.axis[2][k]));
                out.scales[3 * i + k] = float(by_scale[k]);
            }
            axes.by_quaternion(by_axis, out.quats + 4 * i);
        }
        first = n;
    }
}

}  // namespace gs
