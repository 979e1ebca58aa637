// Python's arrays: what comes in, with checks of its shape, and what goes out.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <new>
#include <stdexcept>
#include <string>
#include <vector>

namespace nb = nanobind;

namespace gs {

using Input = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<nb::numpy, float, nb::c_contig>;

inline size_t numbers_of(const std::vector<size_t>& shape) {
    size_t count = 1;
    for (size_t extent : shape) count *= extent;
    return std::max<size_t>(count, 1);
}

template <class Array>
Array owned_array(void* data, const std::vector<size_t>& shape) {
    if (!data) throw std::bad_alloc();
    nb::capsule owner(data, [](void* p) noexcept { std::free(p); });
    return Array(data, shape.size(), shape.data(), owner);
}

// Of zeros.
inline Output new_array(const std::vector<size_t>& shape) {
    return owned_array<Output>(std::calloc(numbers_of(shape), sizeof(float)), shape);
}

// Of whatever was there before, for a kernel that writes every number.
template <class Array = Output>
Array unset_array(const std::vector<size_t>& shape) {
    return owned_array<Array>(std::malloc(numbers_of(shape) * sizeof(typename Array::Scalar)), shape);
}

inline void require(bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument(what);
}

inline std::string shape_of(const Input& array) {
    std::string text = "[";
    for (size_t k = 0; k < array.ndim(); ++k) text += (k ? ", " : "") + std::to_string(array.shape(k));
    return text + "]";
}

inline void require_shape(const Input& array, const char* name, const std::vector<size_t>& shape) {
    bool fits = array.ndim() == shape.size();
    std::string wanted;
    for (size_t k = 0; k < shape.size(); ++k) {
        fits = fits && array.shape(k) == shape[k];
        wanted += (k ? ", " : "") + std::to_string(shape[k]);
    }
    require(fits, std::string(name) + " must have shape [" + wanted + "], got " + shape_of(array));
}

inline void require_finite(const Input& array, const char* name, size_t columns, const char* of = "Gaussian") {
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
            throw std::invalid_argument(std::string(name) + " of " + of + " " + std::to_string(i / columns) + " is " +
                                        std::to_string(values[i]) + ": every number must be finite");
}

}  // namespace gs
