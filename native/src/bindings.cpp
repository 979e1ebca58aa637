// Arrays in, arrays out: the Python face of drawing, of the image loss and of all the rest, with the checks of what comes in.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
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

using Five = std::array<Input, 5>;

constexpr const char* kAttributes[] = {"means", "scales", "quats", "opacities", "colors"};

std::vector<size_t> shape_for(int attribute, size_t count) {
    constexpr size_t kColumns[] = {3, 3, 4, 0, 3};
    return kColumns[attribute] ? std::vector<size_t>{count, kColumns[attribute]} : std::vector<size_t>{count};
}

// A drawing, with the arrays that it reads again in the backward pass.
struct BoundDrawing {
    Five gaussians;
    Output picture;
    std::unique_ptr<Drawing> drawing;
};

View view_of(const Matrix& world_to_camera, const std::array<double, 4>& intrinsics, const std::array<int, 2>& size,
             const std::array<double, 7>& constants, const std::array<float, 3>& background) {
    const auto [near, dilation, alpha_floor, alpha_cap, min_transmittance, frame_margin, shortest_quaternion] = constants;
    View view{{near, dilation, float(alpha_floor), float(alpha_cap), float(min_transmittance), frame_margin, shortest_quaternion},
              {}, {}, intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3], size[0], size[1],
              {background[0], background[1], background[2]}};
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

std::unique_ptr<BoundDrawing> forward(Five arrays, Matrix world_to_camera, std::array<double, 4> intrinsics,
                                      std::array<int, 2> size, std::array<double, 7> constants, int threads,
                                      const std::string& instruction_set, std::array<float, 3> background) {
    const Input& means = arrays[0];
    require(means.ndim() == 2 && means.shape(1) == 3, "means must have shape [N, 3], got " + shape_of(means));
    const size_t count = means.shape(0);
    for (int k = 1; k < 5; ++k) require_shape(arrays[k], kAttributes[k], shape_for(k, count));
    const View view = view_of(world_to_camera, intrinsics, size, constants, background);
    for (int k = 0; k < 5; ++k) require_finite(arrays[k], kAttributes[k], count ? arrays[k].size() / count : 1);
    const Kernels& kernels = kernels_named(instruction_set);
    auto bound = std::make_unique<BoundDrawing>();
    bound->gaussians = arrays;
    bound->picture = new_array({size_t(view.height), size_t(view.width), 4});
    const Gaussians gaussians{means.data(),     arrays[1].data(), arrays[2].data(),
                              arrays[3].data(), arrays[4].data(), int64_t(count)};
    nb::gil_scoped_release released;
    bound->drawing = std::make_unique<Drawing>(gaussians, view, kernels, threads, bound->picture.data());
    return bound;
}

std::vector<Output> backward(const BoundDrawing& bound, Input gradient, int threads) {
    const View& view = bound.drawing->view;
    require_shape(gradient, "gradient", {size_t(view.height), size_t(view.width), 4});
    const size_t count = bound.gaussians[0].shape(0);
    std::vector<Output> out;
    for (int k = 0; k < 5; ++k) out.push_back(new_array(shape_for(k, count)));
    out.push_back(new_array({count}));
    const GaussianGradients gradients{out[0].data(), out[1].data(), out[2].data(),
                                      out[3].data(), out[4].data(), out[5].data()};
    nb::gil_scoped_release released;
    bound.drawing->backward(gradient.data(), threads, gradients);
    return out;
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
        .def_prop_ro("picture", [](const BoundDrawing& d) { return d.picture; }, nb::rv_policy::automatic)
        .def_prop_ro("drawn", [](const BoundDrawing& d) { return d.drawing->drawn(); })
        .def_prop_ro("touches", [](const BoundDrawing& d) { return d.drawing->touches(); });
    m.def("instruction_sets", [] {
        std::vector<std::string> names;
        for (const Kernels* kernels : available()) names.push_back(kernels->name);
        return names;
    });
    m.def("forward", &forward, "gaussians"_a, "world_to_camera"_a, "intrinsics"_a, "size"_a, "constants"_a, "threads"_a,
          "instruction_set"_a = "", "background"_a = std::array<float, 3>{});
    m.def("backward", &backward, "drawing"_a, "gradient"_a, "threads"_a);
    bind_deformations(m);
    // Bytes first, and not converted: floats would be cut to them.
    m.def("image_loss", &bound_image_loss<Bytes>, "image"_a, nb::arg("target").noconvert(), "ssim_weight"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("image_loss", &bound_image_loss<Input>, "image"_a, "target"_a, "ssim_weight"_a, "threads"_a, "instruction_set"_a = "");
}
