// The Python face of what moves and changes Gaussians.
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <array>
#include <tuple>
#include <utility>

#include "arrays.hpp"
#include "deformation.hpp"
#include "instruction_sets.hpp"

namespace gs {
namespace {

using Five = std::array<Input, kParts>;

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

nb::ndarray<nb::numpy, double, nb::c_contig> bound_extinction_table(Doubles values, Doubles color_points, Doubles opacity_points,
                                                             int samples, double most_opaque) {
    require(values.ndim() == 1 && values.shape(0) >= 2, "values must have shape [2 or more]");
    const ControlPoints colors = control_points(color_points, "color_points", 3);
    const ControlPoints opacities = control_points(opacity_points, "opacity_points", 1);
    require(samples >= 1 && samples <= 65536, "samples must lie in 1 to 65536, got " + std::to_string(samples));
    require(most_opaque >= 0 && most_opaque < 1, "most_opaque must lie in 0 to 1, and not be 1, got " + std::to_string(most_opaque));
    const size_t count = values.shape(0), shape[2] = {count, 4};
    double* data = static_cast<double*>(std::malloc(4 * count * sizeof(double)));
    if (!data) throw std::bad_alloc();
    nb::capsule owner(data, [](void* p) noexcept { std::free(p); });
    extinction_table(values.data(), int64_t(count), colors, opacities, samples, most_opaque, data);
    return {data, 2, shape, owner};
}

}  // namespace

void bind_deformations(nb::module_& m) {
    using namespace nb::literals;
    m.def("add_bilinear", &bound_add_bilinear, "factors"_a, "rows"_a, "threads"_a, "instruction_set"_a = "");
    m.def("bilinear_gradients", &bound_bilinear_gradients, "latents"_a, "modes"_a, "gradients"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("transfer", &bound_transfer, "weights"_a, "changes"_a, "logits"_a, "colors"_a, "low"_a, "high"_a, "least_depth"_a,
          "threads"_a, "instruction_set"_a = "");
    m.def("transfer_gradient", &bound_transfer_gradient, "weights"_a, "changes"_a, "logits"_a, "colors"_a, "low"_a, "high"_a,
          "least_depth"_a, "by_logits"_a, "by_colors"_a, "threads"_a, "instruction_set"_a = "");
    m.def("extinction_table", &bound_extinction_table, "values"_a, "color_points"_a, "opacity_points"_a, "samples"_a, "most_opaque"_a);
}

}  // namespace gs
