// Arrays in, arrays out: the Python face of all kernels, with the checks of what comes in.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "deformation.hpp"
#include "drawing.hpp"
#include "instruction_sets.hpp"
#include "loss.hpp"

namespace gs {

void bind_averages(nb::module_& m);   // average_bindings.cpp
void bind_blends(nb::module_& m);     // blend_bindings.cpp
void bind_rays(nb::module_& m);       // ray_bindings.cpp
void bind_row_steps(nb::module_& m);  // row_step_bindings.cpp
void bind_casting(nb::module_& m);    // cast_bindings.cpp

namespace {

using Matrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using Bytes = nb::ndarray<const uint8_t, nb::c_contig, nb::device::cpu>;

// ---- drawing

using Five = std::array<Input, kParts>;

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

std::vector<Output> backward(const BoundDrawing& bound, Input gradient, int threads, bool edges) {
    const View& view = bound.drawing->view;
    require_shape(gradient, "gradient", {size_t(view.height), size_t(view.width), 4});
    const size_t count = bound.gaussians[0].shape(0);
    std::vector<Output> out;
    for (int k = 0; k < 5; ++k) out.push_back(new_array(shape_for(k, count)));
    const GaussianGradients gradients{out[0].data(), out[1].data(), out[2].data(), out[3].data(), out[4].data()};
    nb::gil_scoped_release released;
    bound.drawing->backward(gradient.data(), threads, gradients, edges);
    return out;
}

// ---- the image loss

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

// ---- what moves and changes Gaussians

// The tensors of `rows`, each [N, width] or, where that is 1, also [N].
ParameterTable<const float> parameter_table(const Five& rows, size_t count) {
    ParameterTable<const float> table{};
    size_t columns = 0;
    for (int part = 0; part < kParts; ++part) {
        const Input& array = rows[size_t(part)];
        require((array.ndim() == 1 || array.ndim() == 2) && array.shape(0) == count,
                "tensor " + std::to_string(part) + " must have shape [" + std::to_string(count) + "] or [" +
                    std::to_string(count) + ", columns], got " + shape_of(array));
        table.parts[part] = array.data();
        table.widths[part] = array.ndim() == 1 ? 1 : int(array.shape(1));
        columns += size_t(table.widths[part]);
    }
    require(columns <= size_t(kMostColumns), "a Gaussian has " + std::to_string(columns) + " parameters: at most " +
                                                 std::to_string(kMostColumns) + " are supported");
    return table;
}

int columns_of(const ParameterTable<const float>& table) {
    int columns = 0;
    for (int width : table.widths) columns += width;
    return columns;
}

Product product_of(const Input& latents, const Input& modes, size_t count) {
    require(latents.ndim() == 2 && latents.shape(0) == count && latents.shape(1) >= 1 && latents.shape(1) <= size_t(kMostLatent),
            "latents must have shape [" + std::to_string(count) + ", 1 to " + std::to_string(kMostLatent) + "], got " +
                shape_of(latents));
    require(modes.ndim() == 2 && modes.shape(0) == latents.shape(1) && modes.shape(1) <= size_t(kMostColumns),
            "modes must have shape [" + std::to_string(latents.shape(1)) + ", at most " + std::to_string(kMostColumns) +
                "], got " + shape_of(modes));
    return {latents.data(), modes.data(), int(latents.shape(1)), int(modes.shape(1))};
}

std::vector<Output> bound_add_bilinear(const std::vector<std::pair<Input, Input>>& factors, Five rows, int threads,
                                       const std::string& instruction_set) {
    require(!factors.empty() && factors.size() <= size_t(kMostProducts),
            "1 to " + std::to_string(kMostProducts) + " products can be added, got " + std::to_string(factors.size()));
    const size_t count = rows[0].ndim() ? rows[0].shape(0) : 0;
    const ParameterTable<const float> base = parameter_table(rows, count);
    Product products[kMostProducts];
    int more = 0;  // columns of the modes than of the rows
    for (size_t n = 0; n < factors.size(); ++n) {
        products[n] = product_of(factors[n].first, factors[n].second, count);
        more = std::max(more, products[n].columns - columns_of(base));
    }
    const Input& last = rows[kParts - 1];
    require(more == 0 || last.ndim() == 2, "only columns can be added to a tensor, got " + shape_of(last));
    const Kernels& kernels = kernels_named(instruction_set);
    std::vector<Output> made;
    ParameterTable<float> out{};
    for (int part = 0; part < kParts; ++part) {
        out.widths[part] = base.widths[part] + (part == kParts - 1 ? more : 0);
        made.push_back(rows[size_t(part)].ndim() == 1 ? unset_array({count}) : unset_array({count, size_t(out.widths[part])}));
        out.parts[part] = made.back().data();
    }
    nb::gil_scoped_release released;
    add_bilinear(products, int(factors.size()), int64_t(count), base, kernels, threads, out);
    return made;
}

std::tuple<Output, Output> bound_bilinear_gradients(Input latents, Input modes, Five gradients, int threads,
                                                    const std::string& instruction_set) {
    const size_t count = gradients[0].ndim() ? gradients[0].shape(0) : 0;
    const ParameterTable<const float> gradient = parameter_table(gradients, count);
    const Product product = product_of(latents, modes, count);
    require(product.columns <= columns_of(gradient), "the gradients must have the " + std::to_string(product.columns) +
                                                         " columns of the modes, got " + std::to_string(columns_of(gradient)));
    const Kernels& kernels = kernels_named(instruction_set);
    std::tuple<Output, Output> made{unset_array({count, latents.shape(1)}), unset_array({modes.shape(0), modes.shape(1)})};
    float *by_latents = std::get<0>(made).data(), *by_modes = std::get<1>(made).data();
    nb::gil_scoped_release released;
    bilinear_gradients(product, int64_t(count), gradient, kernels, threads, by_latents, by_modes);
    return made;
}

using Color = std::array<float, 3>;

Transfer transfer_of(const Input& weights, const Input& changes, const Input& logits, const Input& colors, const Color& low,
                     const Color& high, float least_depth) {
    require(weights.ndim() == 2 && weights.shape(1) >= 1, "weights must have shape [N, 1 or more], got " + shape_of(weights));
    const size_t count = weights.shape(0);
    require_shape(changes, "changes", {weights.shape(1), size_t(kChanges)});
    require_shape(logits, "logits", {count});
    require(colors.ndim() == 2 && colors.shape(0) == count && colors.shape(1) >= 3,
            "colors must have shape [" + std::to_string(count) + ", 3 or more], got " + shape_of(colors));
    require(least_depth >= 1e-30f && least_depth <= 1.0f,
            "least_depth must lie in 1e-30 to 1, got " + std::to_string(least_depth));
    Transfer t{};
    t.weights = weights.data();
    t.logits = logits.data();
    t.colors = colors.data();
    t.values = int(weights.shape(1));
    t.color_columns = int(colors.shape(1));
    std::copy(low.begin(), low.end(), t.low);
    std::copy(high.begin(), high.end(), t.high);
    t.least_depth = least_depth;
    return t;
}

std::tuple<Output, Output> bound_transfer(Input weights, Input changes, Input logits, Input colors, Color low, Color high,
                                          float least_depth, int threads, const std::string& instruction_set) {
    const Transfer t = transfer_of(weights, changes, logits, colors, low, high, least_depth);
    const Kernels& kernels = kernels_named(instruction_set);
    const size_t count = weights.shape(0);
    std::tuple<Output, Output> made{unset_array({count}), unset_array({count, colors.shape(1)})};
    float *new_logits = std::get<0>(made).data(), *new_colors = std::get<1>(made).data();
    nb::gil_scoped_release released;
    apply_transfer(t, changes.data(), int64_t(count), kernels, threads, new_logits, new_colors);
    return made;
}

Output bound_transfer_gradient(Input weights, Input changes, Input logits, Input colors, Color low, Color high, float least_depth,
                               Input by_logits, Input by_colors, int threads, const std::string& instruction_set) {
    const Transfer t = transfer_of(weights, changes, logits, colors, low, high, least_depth);
    const size_t count = weights.shape(0);
    require_shape(by_logits, "by_logits", {count});
    require_shape(by_colors, "by_colors", {count, colors.shape(1)});
    const Kernels& kernels = kernels_named(instruction_set);
    Output by_weights = unset_array({count, weights.shape(1)});
    float* data = by_weights.data();
    nb::gil_scoped_release released;
    transfer_gradient(t, changes.data(), int64_t(count), by_logits.data(), by_colors.data(), kernels, threads, data);
    return by_weights;
}

using Doubles = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;

ControlPoints control_points(const Doubles& points, const char* name, int columns) {
    require(points.ndim() == 2 && points.shape(0) >= 1 && points.shape(1) == size_t(columns) + 1,
            std::string(name) + " must have shape [1 or more, " + std::to_string(columns + 1) + "]");
    return {points.data(), int64_t(points.shape(0)), columns};
}

using Table = nb::ndarray<nb::numpy, double, nb::c_contig>;

Table bound_extinction_table(Doubles values, Doubles color_points, Doubles opacity_points, int samples, double most_opaque) {
    require(values.ndim() == 1 && values.shape(0) >= 2, "values must have shape [2 or more]");
    const ControlPoints colors = control_points(color_points, "color_points", 3);
    const ControlPoints opacities = control_points(opacity_points, "opacity_points", 1);
    require(samples >= 1 && samples <= 65536, "samples must lie in 1 to 65536, got " + std::to_string(samples));
    require(most_opaque >= 0 && most_opaque < 1, "most_opaque must lie in 0 to 1, and not be 1, got " + std::to_string(most_opaque));
    Table made = unset_array<Table>({values.shape(0), 4});
    extinction_table(values.data(), int64_t(values.shape(0)), colors, opacities, samples, most_opaque, made.data());
    return made;
}

}  // namespace
}  // namespace gs

NB_MODULE(_kernels, m) {
    nb::set_leak_warnings(false);  // a drawing in a global variable at exit is not a leak
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
    m.def("backward", &backward, "drawing"_a, "gradient"_a, "threads"_a, "edges"_a = false);
    m.def("add_bilinear", &bound_add_bilinear, "factors"_a, "rows"_a, "threads"_a, "instruction_set"_a = "");
    m.def("bilinear_gradients", &bound_bilinear_gradients, "latents"_a, "modes"_a, "gradients"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("transfer", &bound_transfer, "weights"_a, "changes"_a, "logits"_a, "colors"_a, "low"_a, "high"_a, "least_depth"_a,
          "threads"_a, "instruction_set"_a = "");
    m.def("transfer_gradient", &bound_transfer_gradient, "weights"_a, "changes"_a, "logits"_a, "colors"_a, "low"_a, "high"_a,
          "least_depth"_a, "by_logits"_a, "by_colors"_a, "threads"_a, "instruction_set"_a = "");
    m.def("extinction_table", &bound_extinction_table, "values"_a, "color_points"_a, "opacity_points"_a, "samples"_a, "most_opaque"_a);
    bind_averages(m);
    bind_blends(m);
    bind_rays(m);
    bind_casting(m);
    bind_row_steps(m);
    // Bytes first, and not converted: floats would be cut to them.
    m.def("image_loss", &bound_image_loss<Bytes>, "image"_a, nb::arg("target").noconvert(), "ssim_weight"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("image_loss", &bound_image_loss<Input>, "image"_a, "target"_a, "ssim_weight"_a, "threads"_a, "instruction_set"_a = "");
}
