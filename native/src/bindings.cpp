// Arrays in, arrays out: the Python face of drawing, of the image loss and of all the rest, with the checks of what comes in.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <tuple>
#include <vector>

#include "arrays.hpp"
#include "drawing.hpp"
#include "instruction_sets.hpp"
#include "loss.hpp"

namespace gs {
namespace {

using Matrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<const uint8_t, nb::c_contig, nb::device::cpu>;

void require_finite(const Input& array, const char* name, size_t columns) {
    constexpr uint32_t kExponent = 0x7f800000;
    const float* values = array.data();
    const size_t count = array.size();
    uint32_t found = 0;
    for (size_t i = 0; i < count; ++i) {  // integer arithmetic, which compilers turn into vectors
        uint32_t bits;
        std::memcpy(&bits, values + i, sizeof bits);
        found |= uint32_t((bits & kExponent) == kExponent);
    }
    if (!found) return;
    for (size_t i = 0; i < count; ++i)
        if (!std::isfinite(values[i]))
            throw std::invalid_argument(std::string(name) + " of Gaussian " + std::to_string(i / columns) + " is " +
                                        std::to_string(values[i]) + ": every number must be finite");
}

// A drawing, with the arrays that it reads again in the backward pass.
struct BoundDrawing {
    Input means, scales, quats, opacities, colors;
    std::optional<std::array<float, 3>> background;
    std::optional<Output> color, alpha;  // without a background
    std::optional<Output> over;          // with one
    std::unique_ptr<Drawing> drawing;

    template <class Float>
    Frame<Float> frame(Float* color_data, Float* alpha_data, Float* over_data) const {
        Frame<Float> f{color_data, alpha_data, over_data, {}};
        if (background) std::copy(background->begin(), background->end(), f.background);
        return f;
    }
};

View view_of(const Matrix& world_to_camera, const std::array<double, 4>& intrinsics, const std::array<int, 2>& size,
             const std::array<double, 7>& constants) {
    const auto [near, dilation, alpha_floor, alpha_cap, min_transmittance, frame_margin, shortest_quaternion] = constants;
    View view{{near, dilation, float(alpha_floor), float(alpha_cap), float(min_transmittance), frame_margin, shortest_quaternion},
              {}, {}, intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3], size[0], size[1]};
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) view.rotation[3 * r + c] = world_to_camera(r, c);
        view.translation[r] = world_to_camera(r, 3);
    }
    require(view.width > 0 && view.height > 0 && view.fx > 0 && view.fy > 0, "image size and focal lengths must be positive");
    require(std::all_of(intrinsics.begin(), intrinsics.end(), [](double x) { return std::isfinite(x); }),
            "the camera must be finite");
    require(near > 0 && std::isfinite(near), "near must be positive, got " + std::to_string(near));
    require(dilation >= 0 && std::isfinite(dilation), "dilation must not be negative, got " + std::to_string(dilation));
    require(view.alpha_floor > 0 && view.alpha_floor < 1,
            "alpha_floor must lie between 0 and 1, got " + std::to_string(alpha_floor));
    require(view.alpha_cap > view.alpha_floor && view.alpha_cap < 1,
            "alpha_cap must lie above alpha_floor and below 1, got " + std::to_string(alpha_cap));
    return view;
}

std::unique_ptr<BoundDrawing> forward(Input means, Input scales, Input quats, Input opacities, Input colors,
                                      Matrix world_to_camera, std::array<double, 4> intrinsics, std::array<int, 2> size,
                                      const std::array<double, 7>& constants, int threads, const std::string& instruction_set,
                                      std::optional<std::array<float, 3>> background) {
    require(means.ndim() == 2 && means.shape(1) == 3, "means must have shape [N, 3], got " + shape_of(means));
    const size_t count = means.shape(0);
    require_shape(scales, "scales", {count, 3});
    require_shape(quats, "quats", {count, 4});
    require_shape(opacities, "opacities", {count});
    require_shape(colors, "colors", {count, 3});
    const View view = view_of(world_to_camera, intrinsics, size, constants);
    require_finite(means, "means", 3);
    require_finite(scales, "scales", 3);
    require_finite(quats, "quats", 4);
    require_finite(opacities, "opacities", 1);
    require_finite(colors, "colors", 3);
    const Kernels& kernels = kernels_named(instruction_set);
    const size_t rows = size_t(view.height), columns = size_t(view.width);
    auto bound = std::make_unique<BoundDrawing>();
    bound->means = means;
    bound->scales = scales;
    bound->quats = quats;
    bound->opacities = opacities;
    bound->colors = colors;
    bound->background = background;
    if (background) {
        bound->over = new_array({rows, columns, 4});
    } else {
        bound->color = new_array({rows, columns, 3});
        bound->alpha = new_array({rows, columns});
    }
    const auto data = [](const std::optional<Output>& array) { return array ? array->data() : nullptr; };
    const Frame<float> frame = bound->frame(data(bound->color), data(bound->alpha), data(bound->over));
    const Gaussians gaussians{means.data(), scales.data(), quats.data(), opacities.data(), colors.data(), int64_t(count)};
    nb::gil_scoped_release released;
    bound->drawing = std::make_unique<Drawing>(gaussians, view, kernels, threads, frame);
    return bound;
}

using Gradients = std::tuple<Output, Output, Output, Output, Output, Output>;

Gradients gradients_of(const BoundDrawing& bound, const Frame<const float>& gradient, int threads) {
    const size_t count = bound.means.shape(0);
    Gradients out{new_array({count, 3}), new_array({count, 3}), new_array({count, 4}),
                  new_array({count}),    new_array({count, 3}), new_array({count})};
    const GaussianGradients gradients{std::get<0>(out).data(), std::get<1>(out).data(), std::get<2>(out).data(),
                                      std::get<3>(out).data(), std::get<4>(out).data(), std::get<5>(out).data()};
    nb::gil_scoped_release released;
    bound.drawing->backward(gradient, threads, gradients);
    return out;
}

Gradients backward(const BoundDrawing& bound, Input grad_color, Input grad_alpha, int threads) {
    const View& view = bound.drawing->view;
    require(!bound.background, "this drawing is over a background: use backward_over");
    require_shape(grad_color, "grad_color", {size_t(view.height), size_t(view.width), 3});
    require_shape(grad_alpha, "grad_alpha", {size_t(view.height), size_t(view.width)});
    return gradients_of(bound, bound.frame<const float>(grad_color.data(), grad_alpha.data(), nullptr), threads);
}

Gradients backward_over(const BoundDrawing& bound, Input gradient, int threads) {
    const View& view = bound.drawing->view;
    require(bound.background.has_value(), "this drawing has no background: use backward");
    require_shape(gradient, "gradient", {size_t(view.height), size_t(view.width), 4});
    return gradients_of(bound, bound.frame<const float>(nullptr, nullptr, gradient.data()), threads);
}

using Loss = std::tuple<double, double, Output>;

template <class Target>
Loss bound_image_loss(Input image, Target target, double ssim_weight, int threads, const std::string& instruction_set) {
    require(image.ndim() == 3 && target.ndim() == 3, "image and target must have shape [H, W, C]");
    require(image.shape(0) == target.shape(0) && image.shape(1) == target.shape(1) && image.shape(2) >= target.shape(2),
            "image and target must have the same shape, or the image more channels, got [" + std::to_string(image.shape(0)) +
                ", " + std::to_string(image.shape(1)) + ", " + std::to_string(image.shape(2)) + "] and [" +
                std::to_string(target.shape(0)) + ", " + std::to_string(target.shape(1)) + ", " +
                std::to_string(target.shape(2)) + "]");
    require(target.size() > 0, "an image must have pixels");
    const Kernels& kernels = kernels_named(instruction_set);
    Output gradient = new_array({image.shape(0), image.shape(1), image.shape(2)});
    ImagePair images{image.data(), nullptr, nullptr, int(image.shape(0)), int(image.shape(1)), int(image.shape(2)),
                     int(target.shape(2))};
    if constexpr (std::is_same_v<Target, Bytes>)
        images.target_bytes = target.data();
    else
        images.target = target.data();
    nb::gil_scoped_release released;
    const ImageLoss loss = image_loss(images, ssim_weight, kernels, threads, gradient.data());
    return {loss.difference, loss.similarity, gradient};
}

}  // namespace
}  // namespace gs

NB_MODULE(_kernels, m) {
    nb::set_leak_warnings(false);  // a drawing that a global holds at exit is no leak
    using namespace gs;
    using namespace nb::literals;
    nb::class_<BoundDrawing>(m, "Drawing")
        .def_prop_ro("color", [](const BoundDrawing& d) { return d.color; }, nb::rv_policy::automatic)
        .def_prop_ro("alpha", [](const BoundDrawing& d) { return d.alpha; }, nb::rv_policy::automatic)
        .def_prop_ro("over", [](const BoundDrawing& d) { return d.over; }, nb::rv_policy::automatic)
        .def_prop_ro("drawn", [](const BoundDrawing& d) { return d.drawing->drawn(); })
        .def_prop_ro("touches", [](const BoundDrawing& d) { return d.drawing->touches(); });
    m.def("instruction_sets", [] {
        std::vector<std::string> names;
        for (const Kernels* kernels : available()) names.push_back(kernels->name);
        return names;
    });
    m.def("forward", &forward, "means"_a, "scales"_a, "quats"_a, "opacities"_a, "colors"_a, "world_to_camera"_a,
          "intrinsics"_a, "size"_a, "constants"_a, "threads"_a, "instruction_set"_a = "", "background"_a = nb::none());
    m.def("backward", &backward, "drawing"_a, "grad_color"_a, "grad_alpha"_a, "threads"_a);
    m.def("backward_over", &backward_over, "drawing"_a, "gradient"_a, "threads"_a);
    bind_deformations(m);
    // Bytes first, and not converted: floats would be cut to them.
    m.def("image_loss", &bound_image_loss<Bytes>, "image"_a, nb::arg("target").noconvert(), "ssim_weight"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("image_loss", &bound_image_loss<Input>, "image"_a, "target"_a, "ssim_weight"_a, "threads"_a, "instruction_set"_a = "");
}
