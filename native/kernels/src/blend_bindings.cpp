// Arrays in, arrays out: values that Gaussians carry, blended where one asks.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "blending.hpp"
#include "instruction_sets.hpp"

namespace gs {
namespace {

using Five = std::array<Input, 5>;
using Values = nb::ndarray<nb::numpy, double, nb::c_contig>;

// A blend, with the arrays that it reads again in the backward pass.
struct BoundBlend {
    Five gaussians;
    Input places;
    Values values;
    Blend blend;

    Carriers carriers() const {
        return {gaussians[0].data(), gaussians[1].data(), gaussians[2].data(),
                gaussians[3].data(), gaussians[4].data(), int64_t(gaussians[0].shape(0))};
    }
};

std::unique_ptr<BoundBlend> bound_blend(Five gaussians, Input places, float reach, const std::string& instruction_set) {
    constexpr const char* kNames[] = {"means", "scales", "quats", "weights", "values"};
    constexpr size_t kColumns[] = {3, 3, 4, 1, 1};
    require(gaussians[0].ndim() == 2 && gaussians[0].shape(1) == 3,
            "means must have shape [N, 3], got " + shape_of(gaussians[0]));
    const size_t count = gaussians[0].shape(0);
    require(places.ndim() == 2 && places.shape(1) == 3, "places must have shape [Q, 3], got " + shape_of(places));
    require(std::max(count, places.shape(0)) < UINT32_MAX, "there are too many Gaussians or places");
    require(reach > 0 && std::isfinite(reach), "reach must be positive, got " + std::to_string(reach));
    for (int k = 0; k < 5; ++k) {
        require_shape(gaussians[k], kNames[k], kColumns[k] == 1 ? std::vector<size_t>{count} : std::vector<size_t>{count, kColumns[k]});
        require_finite(gaussians[k], kNames[k], kColumns[k]);
    }
    require_finite(places, "coordinates", 3, "place");
    const float* weights = gaussians[3].data();
    for (size_t i = 0; i < count; ++i)
        if (weights[i] < 0)
            throw std::invalid_argument("weights of Gaussian " + std::to_string(i) + " is " + std::to_string(weights[i]) +
                                        ": it must not be negative");
    const Kernels& kernels = kernels_named(instruction_set);
    auto bound = std::make_unique<BoundBlend>(BoundBlend{gaussians, places, unset_array<Values>({places.shape(0)}), {}});
    {
        nb::gil_scoped_release released;
        bound->blend = blend(bound->carriers(), places.data(), int64_t(places.shape(0)), reach, kernels);
        std::copy(bound->blend.values.begin(), bound->blend.values.end(), bound->values.data());
    }
    return bound;
}

std::vector<Output> bound_blend_gradients(const BoundBlend& bound, Input gradient, bool shapes) {
    require_shape(gradient, "gradient", {bound.places.shape(0)});
    const size_t count = bound.gaussians[0].shape(0);
    std::vector<Output> out;
    if (shapes)
        for (size_t columns : {3, 3, 4}) out.push_back(new_array({count, columns}));
    for (int k = 0; k < 2; ++k) out.push_back(new_array({count}));
    float* const last[] = {out[out.size() - 2].data(), out[out.size() - 1].data()};
    const CarrierGradients gradients{shapes ? out[0].data() : nullptr, shapes ? out[1].data() : nullptr,
                                     shapes ? out[2].data() : nullptr, last[0], last[1]};
    nb::gil_scoped_release released;
    blend_gradients(bound.carriers(), bound.places.data(), bound.blend, gradient.data(), gradients);
    return out;
}

}  // namespace

void bind_blends(nb::module_& m) {
    using namespace nb::literals;
    nb::class_<BoundBlend>(m, "Blend")
        .def_prop_ro("values", [](const BoundBlend& b) { return b.values; }, nb::rv_policy::automatic)
        .def_prop_ro("pairs", [](const BoundBlend& b) { return b.blend.number; });
    m.def("blend", &bound_blend, "gaussians"_a, "places"_a, "reach"_a, "instruction_set"_a = "");
    m.def("blend_gradients", &bound_blend_gradients, "blend"_a, "gradient"_a, "shapes"_a);
}

}  // namespace gs
