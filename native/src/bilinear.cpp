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

// The modes as the kernels read them: padded, and transposed.
struct PaddedTables {
    Buffer<float> modes, transposed;
    BilinearTables tables{};

    explicit PaddedTables(const Product& p) {
        tables = {p.latents, nullptr, nullptr, p.latent, p.columns, padded(p.columns), padded(p.latent)};
        const size_t by_latent = size_t(p.latent) * tables.stride, by_column = size_t(p.columns) * tables.latent_stride;
        std::memset(modes.resize(by_latent), 0, by_latent * sizeof(float));
        std::memset(transposed.resize(by_column), 0, by_column * sizeof(float));
        for (int l = 0; l < p.latent; ++l)
            for (int c = 0; c < p.columns; ++c)
                modes[size_t(l) * tables.stride + c] = transposed[size_t(c) * tables.latent_stride + l] =
                    p.modes[l * p.columns + c];
        tables.modes = modes.data();
        tables.transposed = transposed.data();
    }
};

}  // namespace

void add_bilinear(const Product* products, int number, int64_t count, const ParameterTable<const float>& base,
                  const Kernels& kernels, int threads, const ParameterTable<float>& out) {
    std::vector<PaddedTables> padded_tables;
    BilinearTables tables[kMostProducts];
    for (int n = 0; n < number; ++n) tables[n] = padded_tables.emplace_back(products[n]).tables;
    parallel((count + kGaussiansPerTask - 1) / kGaussiansPerTask, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        kernels.bilinear_forward(tables, number, base, first, std::min(count, first + kGaussiansPerTask), out);
    });
}

void bilinear_gradients(const Product& product, int64_t count, const ParameterTable<const float>& gradient,
                        const Kernels& kernels, int threads, float* by_latents, float* by_modes) {
    const PaddedTables padded_tables(product);
    const BilinearTables& tables = padded_tables.tables;
    const int64_t tasks = (count + kGaussiansPerTask - 1) / kGaussiansPerTask;
    const size_t each = size_t(product.latent) * tables.stride;
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
    for (int l = 0; l < product.latent; ++l)
        for (int c = 0; c < product.columns; ++c) by_modes[l * product.columns + c] = float(totals[size_t(l) * tables.stride + c]);
}

}  // namespace gs
