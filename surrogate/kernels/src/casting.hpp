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
    // Of the values in each brick, and whether all of its cells are hidden.
    const float* least() const { return least_.data(); }
    const float* most() const { return most_.data(); }

private:
    Buffer<float> pairs_, least_, most_;
    Buffer<uint8_t> hidden_;
};

// What a function through knots [count, 5], place in 0 to 1, opacity, red, green, blue, shows of a field: constant beyond them.
class SegmentedFunction {
public:
    SegmentedFunction(const double* knots, int64_t count, const PaddedField&);

    CastFunction function{};

private:
    void add(const double* from, const double* to);
    void divide();
    void find_clear(const PaddedField&);
    float most_opacity(float low, float high) const;

    std::vector<float> rows_, begins_;
    Buffer<float> columns_;
    std::vector<int32_t> first_;
    std::vector<uint8_t> clear_;
};

// The volume rendering [height, width, 4].
void cast_volume(const CastField&, const CastFunction&, const CastRays&, const Kernels&, int threads, float* picture);

}  // namespace gs
