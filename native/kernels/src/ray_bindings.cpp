// Arrays in, arrays out: what depends on where a Gaussian is seen from, its opacity along a ray and its colour.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <string>
#include <tuple>

#include "arrays.hpp"
#include "instruction_sets.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

constexpr int64_t kGaussiansPerTask = 512;

using Four = std::array<Input, 4>;  // means, log_scales, quats, logits

Media media_of(const Four& gaussians, const std::array<double, 3>& position, double shortest_quaternion) {
    const auto& [means, log_scales, quats, logits] = gaussians;
    require(logits.ndim() == 1, "logits must have shape [N], got " + shape_of(logits));
    const size_t count = logits.shape(0);
    require_shape(means, "means", {count, 3});
    require_shape(log_scales, "log_scales", {count, 3});
    require_shape(quats, "quats", {count, 4});
    Media media{means.data(), log_scales.data(), quats.data(), logits.data(), {}, shortest_quaternion};
    std::copy(position.begin(), position.end(), media.position);
    return media;
}

template <class Part>
void in_parts(int64_t count, int threads, const Part& part) {
    parallel((count + kGaussiansPerTask - 1) / kGaussiansPerTask, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        part(first, std::min(count, first + kGaussiansPerTask));
    });
}

Output bound_opacities(Four gaussians, const std::array<double, 3>& position, double shortest_quaternion, int threads,
                       const std::string& instruction_set) {
    const Media media = media_of(gaussians, position, shortest_quaternion);
    const Kernels& kernels = kernels_named(instruction_set);
    const size_t count = gaussians[3].shape(0);
    Output made = unset_array({count});
    float* opacities = made.data();
    nb::gil_scoped_release released;
    in_parts(int64_t(count), threads, [&](int64_t first, int64_t last) { kernels.ray_opacities(media, first, last, opacities); });
    return made;
}

std::tuple<Output, Output, Output, Output> bound_gradient(Four gaussians, const std::array<double, 3>& position,
                                                          double shortest_quaternion, Input by_opacities, int threads,
                                                          const std::string& instruction_set) {
    const Media media = media_of(gaussians, position, shortest_quaternion);
    const size_t count = gaussians[3].shape(0);
    require_shape(by_opacities, "by_opacities", {count});
    const Kernels& kernels = kernels_named(instruction_set);
    std::tuple<Output, Output, Output, Output> made{unset_array({count, 3}), unset_array({count, 3}), unset_array({count, 4}),
                                                    unset_array({count})};
    auto& [means, log_scales, quats, logits] = made;
    const MediaGradients gradients{means.data(), log_scales.data(), quats.data(), logits.data()};
    const float* upstream = by_opacities.data();
    nb::gil_scoped_release released;
    in_parts(int64_t(count), threads,
             [&](int64_t first, int64_t last) { kernels.ray_opacities_backward(media, first, last, upstream, gradients); });
    return made;
}

Directional directional_of(const Input& means, const Input& colors, const std::array<double, 3>& position) {
    require(means.ndim() == 2, "means must have shape [N, 3], got " + shape_of(means));
    require_shape(means, "means", {means.shape(0), 3});
    require_shape(colors, "colors", {means.shape(0), 12});
    Directional directional{means.data(), colors.data(), {}};
    std::copy(position.begin(), position.end(), directional.position);
    return directional;
}

Output bound_colors(Input means, Input colors, const std::array<double, 3>& position, int threads,
                    const std::string& instruction_set) {
    const Directional directional = directional_of(means, colors, position);
    const Kernels& kernels = kernels_named(instruction_set);
    const size_t count = means.shape(0);
    Output made = unset_array({count, 3});
    float* seen = made.data();
    nb::gil_scoped_release released;
    in_parts(int64_t(count), threads,
             [&](int64_t first, int64_t last) { kernels.directional_colors(directional, first, last, seen); });
    return made;
}

std::tuple<Output, Output> bound_colors_gradient(Input means, Input colors, const std::array<double, 3>& position, Input by_seen,
                                                 int threads, const std::string& instruction_set) {
    const Directional directional = directional_of(means, colors, position);
    const size_t count = means.shape(0);
    require_shape(by_seen, "by_seen", {count, 3});
    const Kernels& kernels = kernels_named(instruction_set);
    std::tuple<Output, Output> made{unset_array({count, 3}), unset_array({count, 12})};
    float *by_means = std::get<0>(made).data(), *by_colors = std::get<1>(made).data();
    const float* upstream = by_seen.data();
    nb::gil_scoped_release released;
    in_parts(int64_t(count), threads, [&](int64_t first, int64_t last) {
        kernels.directional_colors_backward(directional, first, last, upstream, by_means, by_colors);
    });
    return made;
}

using Light = std::array<float, 7>;  // red, green, blue, ambient, diffuse, specular, power

Lit lit_of(const Input& means, const Input& normals, const Light& light, const std::array<double, 3>& position) {
    require(means.ndim() == 2, "means must have shape [N, 3], got " + shape_of(means));
    require_shape(means, "means", {means.shape(0), 3});
    require_shape(normals, "normals", {means.shape(0), 3});
    Lit lit{means.data(), normals.data(), {}, {}, light[3], light[4], light[5], light[6]};
    std::copy(position.begin(), position.end(), lit.position);
    std::copy_n(light.begin(), 3, lit.color);
    return lit;
}

Output bound_lit(Input means, Input normals, const Light& light, const std::array<double, 3>& position, int threads,
                 const std::string& instruction_set) {
    const Lit lit = lit_of(means, normals, light, position);
    const Kernels& kernels = kernels_named(instruction_set);
    const size_t count = means.shape(0);
    Output made = unset_array({count, 3});
    float* colors = made.data();
    nb::gil_scoped_release released;
    in_parts(int64_t(count), threads, [&](int64_t first, int64_t last) { kernels.lit_colors(lit, first, last, colors); });
    return made;
}

std::tuple<Output, Output> bound_lit_gradient(Input means, Input normals, const Light& light, const std::array<double, 3>& position,
                                              Input by_colors, int threads, const std::string& instruction_set) {
    const Lit lit = lit_of(means, normals, light, position);
    const size_t count = means.shape(0);
    require_shape(by_colors, "by_colors", {count, 3});
    const Kernels& kernels = kernels_named(instruction_set);
    std::tuple<Output, Output> made{unset_array({count, 3}), unset_array({count, 3})};
    float *by_means = std::get<0>(made).data(), *by_normals = std::get<1>(made).data();
    const float* upstream = by_colors.data();
    nb::gil_scoped_release released;
    in_parts(int64_t(count), threads, [&](int64_t first, int64_t last) {
        kernels.lit_colors_backward(lit, first, last, upstream, by_means, by_normals);
    });
    return made;
}

}  // namespace

void bind_rays(nb::module_& m) {
    using namespace nb::literals;
    m.def("ray_opacities", &bound_opacities, "gaussians"_a, "position"_a, "shortest_quaternion"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("ray_opacities_gradient", &bound_gradient, "gaussians"_a, "position"_a, "shortest_quaternion"_a, "by_opacities"_a,
          "threads"_a, "instruction_set"_a = "");
    m.def("directional_colors", &bound_colors, "means"_a, "colors"_a, "position"_a, "threads"_a, "instruction_set"_a = "");
    m.def("directional_colors_gradient", &bound_colors_gradient, "means"_a, "colors"_a, "position"_a, "by_seen"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("lit_colors", &bound_lit, "means"_a, "normals"_a, "light"_a, "position"_a, "threads"_a, "instruction_set"_a = "");
    m.def("lit_colors_gradient", &bound_lit_gradient, "means"_a, "normals"_a, "light"_a, "position"_a, "by_colors"_a, "threads"_a,
          "instruction_set"_a = "");
}

}  // namespace gs
