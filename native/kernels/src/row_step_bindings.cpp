// Arrays in and changed in place: a step of Adam for the rows that have a gradient.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>

#include <cmath>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "instruction_sets.hpp"
#include "kernels.hpp"

namespace gs {
namespace {

using InPlace = nb::ndarray<float, nb::c_contig, nb::device::cpu>;

std::vector<float> corrections_of(double decay_first, double decay_second) {
    std::vector<float> made(kCorrections, 1.0f);
    for (int steps = 1; steps < kCorrections; ++steps)
        made[size_t(steps)] = float(std::sqrt(1.0 - std::pow(decay_second, steps)) / (1.0 - std::pow(decay_first, steps)));
    return made;
}

void bound_step_rows(InPlace tensor, Input gradient, InPlace first, InPlace second, InPlace steps, float rate,
                     const std::string& instruction_set) {
    static const std::vector<float> corrections = corrections_of(0.9, 0.999);
    require(tensor.ndim() >= 1, "tensor must have rows, got a single number");
    std::vector<size_t> shape;
    for (size_t k = 0; k < tensor.ndim(); ++k) shape.push_back(tensor.shape(k));
    require_shape(gradient, "gradient", shape);
    require_shape(Input(first), "first", shape);
    require_shape(Input(second), "second", shape);
    require_shape(Input(steps), "steps", {shape[0]});
    const int64_t rows = int64_t(shape[0]), width = rows ? int64_t(tensor.size()) / rows : 1;
    const RowStep step{tensor.data(), gradient.data(), first.data(), second.data(), steps.data(), rows, width, rate, corrections.data()};
    const Kernels& kernels = kernels_named(instruction_set);
    nb::gil_scoped_release released;
    kernels.step_rows(step);
}

}  // namespace

void bind_row_steps(nb::module_& m) {
    using namespace nb::literals;
    m.def("step_rows", &bound_step_rows, nb::arg("tensor").noconvert(), "gradient"_a, nb::arg("first").noconvert(),
          nb::arg("second").noconvert(), nb::arg("steps").noconvert(), "rate"_a, "instruction_set"_a = "");
}

}  // namespace gs
