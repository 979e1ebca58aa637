// Fields and transfer functions as the ray caster reads them, and pictures of them on all cores.
#pragma once

#include <cstdint>
#include <vector>

#include "buffer.hpp"
#include "kernels.hpp"

namespace gs {

// A field [size z, y, x] of which the values `low` and `high` become 0 and 1.
class PaddedField {
public:
    // Cells with a hole at a corner are hidden; `holes` may be null.
    PaddedField(const float* values, const bool* holes, const int size[3], double low, double high, int threads);

    CastField field{};
    // For bricks in which nothing is seen the distance to the nearest of the others, see CastFunction; nothing where there are none.
    template <class Seen>
    std::vector<uint8_t> clear_bricks(const Seen& seen) const;

private:
    Buffer<float> pairs_, least_, most_;
    Buffer<uint8_t> hidden_;
};

// What a function through knots [count, 5], place in 0 to 1, opacity, red, green, blue, shows of a field: constant beyond them.
class SegmentedFunction {
public:
    SegmentedFunction(const double* knots, int64_t count, const PaddedField&);

    CastFunction function{};

    // From the derivatives by segments [count, 8], see CastGradient, those by opacity, red, green and blue of the knots [knots, 4].
    void by_knots(const double* by_segments, double* out) const;

private:
    struct Ends {
        int64_t from, to;  // knots
    };

    void add(const double* from, const double* to, Ends ends);
    void divide();
    float most_opacity(float low, float high) const;

    std::vector<float> rows_, begins_;
    std::vector<double> lengths_;
    std::vector<Ends> ends_;
    Buffer<float> columns_;
    std::vector<int32_t> first_;
    std::vector<uint8_t> clear_;
};

// The volume rendering [height, width, 4].
void cast_volume(const CastField&, const CastFunction&, const CastRays&, const Kernels&, int threads, float* picture);

// From the picture and a gradient by it [height, width, 4], those by the values drawn [z, y, x], and by segments [segments, 8].
void cast_gradient(const CastField&, const CastFunction&, const CastRays&, const float* picture, const float* gradient,
                   const Kernels&, int threads, float* by_values, double* by_segments);

}  // namespace gs
