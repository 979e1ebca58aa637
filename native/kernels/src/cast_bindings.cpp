// Arrays in, arrays out: fields drawn along rays.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>

#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "casting.hpp"
#include "instruction_sets.hpp"
#include "surfaces.hpp"

namespace gs {
namespace {

using Mask = nb::ndarray<const bool, nb::c_contig, nb::device::cpu>;
using Knots = nb::ndarray<const double, nb::shape<-1, 5>, nb::c_contig, nb::device::cpu>;
using Bounds = nb::ndarray<const double, nb::shape<2, 3>, nb::c_contig, nb::device::cpu>;
using Rays = nb::ndarray<const double, nb::shape<5, 3>, nb::c_contig, nb::device::cpu>;

using Places = nb::ndarray<const double, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;
using Corners = nb::ndarray<const int32_t, nb::shape<-1, 3>, nb::c_contig, nb::device::cpu>;

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

// Rays of which those through a volume begin and end at the field's box, or at `bounds` inside of it, in samples.
CastRays rays_through(const CastField& field, const Rays& rows, const std::array<int, 2>& size, const std::optional<Bounds>& bounds) {
    CastRays rays = rays_of(rows, size);
    for (int k = 0; k < 3; ++k) {
        const double last = field.size[k] - 1;
        rays.low[k] = bounds ? bounds->data()[k] : 0.0, rays.high[k] = bounds ? bounds->data()[3 + k] : last;
        require(rays.low[k] >= 0.0 && rays.low[k] <= rays.high[k] && rays.high[k] <= last, "bounds must lie inside of the field");
    }
    return rays;
}

CastLight light_of(const std::array<float, 4>& light) { return {light[0], light[1], light[2], light[3]}; }

Output bound_volume(const PaddedField& field, Knots knots, const std::array<double, 2>& distances,
                    std::optional<std::array<float, 4>> light, Rays rows, const std::array<int, 2>& size, int threads,
                    std::optional<Bounds> bounds, const std::string& instruction_set) {
    const Kernels& kernels = kernels_named(instruction_set);
    const CastRays rays = rays_through(field.field, rows, size, bounds);
    require(knots.shape(0) >= 1, "knots must have shape [1 or more, 5]");
    Output picture = unset_array({size_t(rays.height), size_t(rays.width), 4});
    float* data = picture.data();
    nb::gil_scoped_release released;
    SegmentedFunction segmented(knots.data(), int64_t(knots.shape(0)), field);
    CastFunction& function = segmented.function;
    function.distance = distances[0], function.unit = distances[1];
    if (light) function.shaded = true, function.light = light_of(*light);
    cast_volume(field.field, function, rays, kernels, threads, data);
    return picture;
}

using Table = nb::ndarray<nb::numpy, double, nb::c_contig>;

std::tuple<Output, Table> bound_gradient(const PaddedField& field, Knots knots, const std::array<double, 2>& distances, Rays rows,
                                         Input picture, Input gradient, bool every, int threads,
                                         const std::string& instruction_set) {
    require(picture.ndim() == 3 && picture.shape(2) == 4, "picture must have shape [H, W, 4], got " + shape_of(picture));
    require_shape(gradient, "gradient", {picture.shape(0), picture.shape(1), 4});
    const Kernels& kernels = kernels_named(instruction_set);
    const CastRays rays = rays_through(field.field, rows, {int(picture.shape(1)), int(picture.shape(0))}, std::nullopt);
    const int* size = field.field.size;
    Output by_values = unset_array({size_t(size[2]), size_t(size[1]), size_t(size[0])});
    Table by_knots = unset_array<Table>({knots.shape(0), 4});
    float* values = by_values.data();
    double* table = by_knots.data();
    nb::gil_scoped_release released;
    SegmentedFunction segmented(knots.data(), int64_t(knots.shape(0)), field);
    CastFunction& function = segmented.function;
    function.distance = distances[0], function.unit = distances[1];
    function.every = every;
    if (every) function.clear = nullptr;
    std::vector<double> by_segments(8 * size_t(function.count));
    cast_gradient(field.field, function, rays, picture.data(), gradient.data(), kernels, threads, values, by_segments.data());
    std::fill_n(table, 4 * knots.shape(0), 0.0);
    segmented.by_knots(by_segments.data(), table);
    return {by_values, by_knots};
}

Output bound_surface(Places places, Places normals, Corners corners, const std::array<float, 3>& color,
                     const std::array<float, 4>& light, int samples, Rays rows, const std::array<int, 2>& size, int threads,
                     const std::string& instruction_set) {
    const Kernels& kernels = kernels_named(instruction_set);
    require(samples == 1 || samples == 2 || samples == 4, "samples must be 1, 2 or 4, got " + std::to_string(samples));
    require(normals.shape(0) == places.shape(0), "there must be a normal for each place");
    const int32_t *first = corners.data(), *last = first + corners.size();
    require(std::all_of(first, last, [&](int32_t k) { return k >= 0 && size_t(k) < places.shape(0); }), "corners must be rows of places");
    const CastRays rays = rays_of(rows, size);
    require(rays.width % samples == 0 && rays.height % samples == 0, "size must be a multiple of samples");
    const CastSurface surface{nullptr, nullptr, {color[0], color[1], color[2]}, light_of(light), samples};
    Output picture = new_array({size_t(rays.height / samples), size_t(rays.width / samples), 4});
    float* data = picture.data();
    nb::gil_scoped_release released;
    const Mesh mesh{places.data(), normals.data(), first, int64_t(corners.shape(0))};
    draw_surface(mesh, int64_t(places.shape(0)), surface, rays, kernels, threads, data);
    return picture;
}

}  // namespace

void bind_casting(nb::module_& m) {
    using namespace nb::literals;
    nb::class_<PaddedField>(m, "CastField");
    m.def("cast_field", &bound_field, "values"_a, "holes"_a.none(), "low"_a, "high"_a, "threads"_a);
    m.def("cast_volume", &bound_volume, "field"_a, "knots"_a, "distances"_a, "light"_a.none(), "rays"_a, "size"_a, "threads"_a,
          "bounds"_a = nb::none(), "instruction_set"_a = "");
    m.def("cast_gradient", &bound_gradient, "field"_a, "knots"_a, "distances"_a, "rays"_a, "picture"_a, "gradient"_a, "every"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("draw_surface", &bound_surface, "places"_a, "normals"_a, "corners"_a, "color"_a, "light"_a, "samples"_a, "rays"_a, "size"_a, "threads"_a,
          "instruction_set"_a = "");
}

}  // namespace gs
