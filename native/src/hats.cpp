#include "hats.hpp"

#include <algorithm>
#include <cmath>

namespace gs {
namespace {

// Reads control points at places that never decrease.
class Interpolation {
public:
    explicit Interpolation(const ControlPoints& points) : points_(points) {}

    void read(double place, double* out) {
        const int width = points_.columns + 1;
        while (last_ + 1 < points_.count && points_.rows[(last_ + 1) * width] <= place) ++last_;
        const double* below = points_.rows + std::max<int64_t>(last_, 0) * width;
        const bool outside = last_ < 0 || last_ + 1 == points_.count;
        const double* above = outside ? below : below + width;
        const double share = outside ? 0.0 : (place - below[0]) / (above[0] - below[0]);
        for (int c = 1; c < width; ++c) out[c - 1] = below[c] + share * (above[c] - below[c]);
    }

private:
    ControlPoints points_;
    int64_t last_ = -1;  // of the points that are not above the place
};

}  // namespace

void hat_means(const double* values, int64_t count, const ControlPoints& colors, const ControlPoints& opacities, int samples,
               double most_opaque, double* out) {
    Interpolation color_at(colors), opacity_at(opacities);
    std::fill_n(out, 4 * count, 0.0);
    for (int64_t b = 0; b + 1 < count; ++b) {
        const double length = values[b + 1] - values[b];
        for (int s = 0; s < samples; ++s) {
            const double inside = (s + 0.5) / samples, place = values[b] + length * inside, share = length / samples;
            double opacity, color[3];
            opacity_at.read(place, &opacity);
            color_at.read(place, color);
            const double extinction = -std::log1p(-std::min(opacity, most_opaque));
            for (int c = 0; c < 4; ++c) {
                const double value = (c ? color[c - 1] : 1.0) * extinction * share;
                out[4 * b + c] += (1.0 - inside) * value;
                out[4 * (b + 1) + c] += inside * value;
            }
        }
    }
    for (int64_t b = 0; b < count; ++b) {
        const double area = (values[std::min(b + 1, count - 1)] - values[std::max<int64_t>(b - 1, 0)]) / 2.0;
        for (int c = 0; c < 4; ++c) out[4 * b + c] /= area;
    }
}

}  // namespace gs
