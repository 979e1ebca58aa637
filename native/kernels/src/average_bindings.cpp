// Arrays in, arrays out: transfer functions averaged under normal distributions.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <tuple>

#include "arrays.hpp"
#include "averages.hpp"
#include "instruction_sets.hpp"

namespace gs {
namespace {

using Doubles = nb::ndarray<const double, nb::c_contig, nb::device::cpu>;
using Ranges = std::array<double, 4>;  // lowest and highest value, least and most spread
using Color = std::array<float, 3>;

AverageLevels checked_levels(const Ranges& ranges) {
    const auto [lowest, highest, least, most] = ranges;
    require(std::all_of(ranges.begin(), ranges.end(), [](double x) { return std::isfinite(x); }) && lowest < highest &&
                least > 0 && least < most && (highest - lowest) / least <= 1e5 && most / least <= 1e5,
            "ranges must be two increasing values and two increasing positive spreads, all of them within a factor of 1e5");
    return levels_of(lowest, highest, least, most);
}

Output bound_averages(Doubles places, Doubles columns, const Ranges& ranges, const std::string& instruction_set) {
    require(places.ndim() == 1 && places.shape(0) >= 1, "places must have shape [1 or more]");
    const size_t count = places.shape(0);
    require(columns.ndim() == 2 && columns.shape(0) == count && columns.shape(1) == size_t(kChanges),
            "columns must have shape [" + std::to_string(count) + ", " + std::to_string(kChanges) + "]");
    const auto finite = [](double x) { return std::isfinite(x); };
    require(std::all_of(places.data(), places.data() + count, finite) && std::is_sorted(places.data(), places.data() + count),
            "places must be finite and never decrease");
    require(std::all_of(columns.data(), columns.data() + columns.size(), finite), "columns must be finite");
    const AverageLevels levels = checked_levels(ranges);
    const Kernels& kernels = kernels_named(instruction_set);
    Output table = unset_array({size_t(levels.first[levels.count]), size_t(kCellTerms), size_t(kChanges)});
    float* data = table.data();
    nb::gil_scoped_release released;
    average_table(places.data(), columns.data(), int64_t(count), levels, kernels, data);
    return table;
}

Averaged averaged_of(const Input& table, const Ranges& ranges, const Input& logits, const Input& values, const Color& low,
                     const Color& high, const std::array<float, 3>& least) {
    Averaged a{};
    a.levels = checked_levels(ranges);
    require_shape(table, "table", {size_t(a.levels.first[a.levels.count]), size_t(kCellTerms), size_t(kChanges)});
    require(logits.ndim() == 1, "logits must have shape [N], got " + shape_of(logits));
    require_shape(values, "values", {logits.shape(0), 2});
    a.table = table.data(), a.logits = logits.data(), a.values = values.data();
    std::copy(low.begin(), low.end(), a.low);
    std::copy(high.begin(), high.end(), a.high);
    a.dark = least[0], a.least_depth = least[1], a.most_depth = least[2];
    require(a.dark > 0 && a.least_depth >= 1e-30f && a.least_depth <= a.most_depth && a.most_depth <= 80.0f,
            "dark must be positive, and depths increase and lie in 1e-30 to 80");
    return a;
}

std::tuple<Output, Output> bound_apply(Input table, const Ranges& ranges, Input logits, Input values, Color low, Color high,
                                       std::array<float, 3> limits, int threads, const std::string& instruction_set) {
    const Averaged a = averaged_of(table, ranges, logits, values, low, high, limits);
    const Kernels& kernels = kernels_named(instruction_set);
    const size_t count = logits.shape(0);
    std::tuple<Output, Output> made{unset_array({count}), unset_array({count, 3})};
    float *new_logits = std::get<0>(made).data(), *colors = std::get<1>(made).data();
    nb::gil_scoped_release released;
    apply_averages(a, int64_t(count), kernels, threads, new_logits, colors);
    return made;
}

std::tuple<Output, Output> bound_gradient(Input table, const Ranges& ranges, Input logits, Input values, Color low, Color high,
                                          std::array<float, 3> limits, Input by_logits, Input by_colors, int threads,
                                          const std::string& instruction_set) {
    const Averaged a = averaged_of(table, ranges, logits, values, low, high, limits);
    const size_t count = logits.shape(0);
    require_shape(by_logits, "by_logits", {count});
    require_shape(by_colors, "by_colors", {count, 3});
    const Kernels& kernels = kernels_named(instruction_set);
    std::tuple<Output, Output> made{unset_array({count}), unset_array({count, 2})};
    float *by_old_logits = std::get<0>(made).data(), *by_values = std::get<1>(made).data();
    nb::gil_scoped_release released;
    averages_gradient(a, int64_t(count), by_logits.data(), by_colors.data(), kernels, threads, by_old_logits, by_values);
    return made;
}

}  // namespace

void bind_averages(nb::module_& m) {
    using namespace nb::literals;
    m.def("averages", &bound_averages, "places"_a, "columns"_a, "ranges"_a, "instruction_set"_a = "");
    m.def("apply_averages", &bound_apply, "table"_a, "ranges"_a, "logits"_a, "values"_a, "low"_a, "high"_a, "limits"_a, "threads"_a,
          "instruction_set"_a = "");
    m.def("apply_averages_gradient", &bound_gradient, "table"_a, "ranges"_a, "logits"_a, "values"_a, "low"_a, "high"_a, "limits"_a,
          "by_logits"_a, "by_colors"_a, "threads"_a, "instruction_set"_a = "");
}

}  // namespace gs
