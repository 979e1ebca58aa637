// Arrays in, arrays out: fields drawn along rays.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>

#include "arrays.hpp"
#include "casting.hpp"
#include "instruction_sets.hpp"

namespace gs {
namespace {

using Mask = nb::ndarray<const bool, nb::c_contig, nb::device::cpu>;
using Knots = nb::ndarray<const double, nb::shape<-1, 5>, nb::c_contig, nb::device::cpu>;
using Rays = nb::ndarray<const double, nb::shape<5, 3>, nb::c_contig, nb::device::cpu>;

constexpr int64_t kMostSamples = int64_t(1) << 29;  // so that 32 bits count numbers

std::unique_ptr<PaddedField> bound_field(Input values, std::optional<Mask> holes, double low, double high, int threads) {
    require(values.ndim() == 3 && std::min({values.shape(0), values.shape(1), values.shape(2)}) >= 2,
            "values must have shape [2 or more, 2 or more, 2 or more], got " + shape_of(values));
    int64_t samples = 1;
    for (size_t k = 0; k < 3; ++k) samples *= std::min(int64_t(values.shape(k)), kMostSamples) + 2, samples = std::min(samples, 2 * kMostSamples);
    require(samples <= kMostSamples, "a field of shape " + shape_of(values) + " has too many samples to be drawn");
    require(high > low, "low must be smaller than high");
    if (holes)
        for (size_t k = 0; k < 3; ++k)
            require(holes->ndim() == 3 && holes->shape(k) == values.shape(k), "holes must have the shape of values, " + shape_of(values));
    const int size[3] = {int(values.shape(2)), int(values.shape(1)), int(values.shape(0))};
    nb::gil_scoped_release released;
    return std::make_unique<PaddedField>(values.data(), holes ? holes->data() : nullptr, size, low, high, threads);
}

CastRays rays_of(const Rays& rows, const std::array<int, 2>& size) {
    CastRays rays{};
    double* const targets[] = {rays.eye, rays.across, rays.down, rays.corner, rays.spacing};
    for (int k = 0; k < 5; ++k) std::copy_n(rows.data() + 3 * k, 3, targets[k]);
    rays.width = size[0], rays.height = size[1];
    require(rays.width >= 1 && rays.height >= 1, "a picture must have pixels");
    return rays;
}

Output bound_volume(const PaddedField& field, Knots knots, const std::array<double, 2>& distances,
                    std::optional<std::array<float, 4>> light, Rays rows, const std::array<int, 2>& size, int threads,
                    const std::string& instruction_set) {
    const Kernels& kernels = kernels_named(instruction_set);
    const CastRays rays = rays_of(rows, size);
    require(knots.shape(0) >= 1, "knots must have shape [1 or more, 5]");
    Output picture = unset_array({size_t(rays.height), size_t(rays.width), 4});
    float* data = picture.data();
    nb::gil_scoped_release released;
    SegmentedFunction segmented(knots.data(), int64_t(knots.shape(0)), field);
    CastFunction& function = segmented.function;
    function.per_distance = 1.0 / distances[0], function.per_unit = 1.0 / distances[1];
    if (light) {
        function.shaded = true;
        function.ambient = (*light)[0], function.diffuse = (*light)[1], function.specular = (*light)[2], function.power = (*light)[3];
    }
    cast_volume(field.field, function, rays, kernels, threads, data);
    return picture;
}

}  // namespace

void bind_casting(nb::module_& m) {
    using namespace nb::literals;
    nb::class_<PaddedField>(m, "CastField");
    m.def("cast_field", &bound_field, "values"_a, "holes"_a.none(), "low"_a, "high"_a, "threads"_a);
    m.def("cast_volume", &bound_volume, "field"_a, "knots"_a, "distances"_a, "light"_a.none(), "rays"_a, "size"_a, "threads"_a,
          "instruction_set"_a = "");
}

}  // namespace gs
