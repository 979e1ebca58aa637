#include "bilinear.hpp"

#include <algorithm>
#include <cstring>
#include <vector>

#include "buffer.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

// Each task sums its part of the derivative by the modes in floats; the parts are then summed in doubles, in order.
constexpr int64_t kGaussiansPerTask = 512;
constexpr int kPadding = 16;  // the widest vector

int padded(int count) { return (count + kPadding - 1) / kPadding * kPadding; }

// The modes as the kernels read them: padded, and transposed.
struct PaddedTables {
    Buffer<float> modes, transposed;
    BilinearTables tables;

    PaddedTables(const float* latents, int latent, const float* given, int columns) {
        tables = {latents, nullptr, nullptr, latent, columns, padded(columns), padded(latent)};
        const size_t by_latent = size_t(latent) * tables.stride, by_column = size_t(columns) * tables.latent_stride;
        std::memset(modes.resize(by_latent), 0, by_latent * sizeof(float));
        std::memset(transposed.resize(by_column), 0, by_column * sizeof(float));
        for (int l = 0; l < latent; ++l)
            for (int c = 0; c < columns; ++c)
                modes[size_t(l) * tables.stride + c] = transposed[size_t(c) * tables.latent_stride + l] = given[l * columns + c];
        tables.modes = modes.data();
        tables.transposed = transposed.data();
    }
};

template <class Float>
int width_of(const ParameterTable<Float>& table) {
    int total = 0;
    for (int width : table.widths) total += width;
    return total;
}

}  // namespace

void add_bilinear(const float* latents, int latent, const float* modes, int64_t count, const ParameterTable<const float>& base,
                  const Kernels& kernels, int threads, const ParameterTable<float>& out) {
    const PaddedTables padded_tables(latents, latent, modes, width_of(base));
    parallel((count + kGaussiansPerTask - 1) / kGaussiansPerTask, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        kernels.bilinear_forward(padded_tables.tables, base, first, std::min(count, first + kGaussiansPerTask), out);
    });
}

void bilinear_gradients(const float* latents, int latent, const float* modes, int64_t count,
                        const ParameterTable<const float>& gradient, const Kernels& kernels, int threads, float* by_latents,
                        float* by_modes) {
    const int columns = width_of(gradient);
    const PaddedTables padded_tables(latents, latent, modes, columns);
    const BilinearTables& tables = padded_tables.tables;
    const int64_t tasks = (count + kGaussiansPerTask - 1) / kGaussiansPerTask;
    const size_t each = size_t(latent) * tables.stride;
    Buffer<float> sums;
    std::memset(sums.resize(each * size_t(tasks)), 0, each * size_t(tasks) * sizeof(float));
    parallel(tasks, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        kernels.bilinear_backward(tables, gradient, first, std::min(count, first + kGaussiansPerTask), by_latents,
                                  sums.data() + each * size_t(task));
    });
    std::vector<double> totals(each, 0.0);
    for (int64_t task = 0; task < tasks; ++task)
        for (size_t k = 0; k < each; ++k) totals[k] += sums[each * size_t(task) + k];
    for (int l = 0; l < latent; ++l)
        for (int c = 0; c < columns; ++c) by_modes[l * columns + c] = float(totals[size_t(l) * tables.stride + c]);
}

}  // namespace gs
