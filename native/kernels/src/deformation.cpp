#include "deformation.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "buffer.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

// Each task sums its part of the derivative by the modes in floats; the parts are then summed in doubles, in order.
constexpr int64_t kGaussiansPerTask = 512;

int64_t tasks_of(int64_t count) { return (count + kGaussiansPerTask - 1) / kGaussiansPerTask; }

// Calls work(task, first, last) for all Gaussians in parts.
template <class Work>
void in_parts(int64_t count, int threads, const Work& work) {
    parallel(tasks_of(count), threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        work(task, first, std::min(count, first + kGaussiansPerTask));
    });
}

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

// The changes of a transfer function as the kernels read them: by column, and padded.
struct PaddedTransfer {
    Buffer<float> table;
    Transfer transfer;

    PaddedTransfer(const Transfer& t, const float* changes) : transfer(t) {
        transfer.stride = padded(t.values);
        const size_t size = size_t(kChanges) * size_t(transfer.stride);
        std::memset(table.resize(size), 0, size * sizeof(float));
        for (int b = 0; b < t.values; ++b)
            for (int c = 0; c < kChanges; ++c) table[size_t(c) * transfer.stride + b] = changes[kChanges * b + c];
        transfer.changes = table.data();
    }
};

// Reads control points at places that never decrease.
class Interpolation {
public:
    explicit Interpolation(const ControlPoints& points) : points_(points) {}

    void read(double place, double* out) {
        const int width = points_.columns + 1;
        while (last_ + 1 < points_.count && points_.rows[(last_ + 1) * width] <= place) ++last_;
        const double* below = points_.rows + std::max<int64_t>(last_, 0) * width;
        const bool outside = last_ < 0 || last_ + 1 == points_.count;
        const double* above = outside ? below : below + width;
        const double share = outside ? 0.0 : (place - below[0]) / (above[0] - below[0]);
        for (int c = 1; c < width; ++c) out[c - 1] = below[c] + share * (above[c] - below[c]);
    }

private:
    ControlPoints points_;
    int64_t last_ = -1;  // of the points that are not above the place
};

}  // namespace

void add_bilinear(const Product* products, int number, int64_t count, const ParameterTable<const float>& base,
                  const Kernels& kernels, int threads, const ParameterTable<float>& out) {
    std::vector<PaddedTables> padded_tables;
    BilinearTables tables[kMostProducts];
    for (int n = 0; n < number; ++n) tables[n] = padded_tables.emplace_back(products[n]).tables;
    in_parts(count, threads, [&](int64_t, int64_t first, int64_t last) {
        kernels.bilinear_forward(tables, number, base, first, last, out);
    });
}

void bilinear_gradients(const Product& product, int64_t count, const ParameterTable<const float>& gradient,
                        const Kernels& kernels, int threads, float* by_latents, float* by_modes) {
    const PaddedTables padded_tables(product);
    const BilinearTables& tables = padded_tables.tables;
    const size_t each = size_t(product.latent) * tables.stride, all = each * size_t(tasks_of(count));
    Buffer<float> sums;
    std::memset(sums.resize(all), 0, all * sizeof(float));
    in_parts(count, threads, [&](int64_t task, int64_t first, int64_t last) {
        kernels.bilinear_backward(tables, gradient, first, last, by_latents, sums.data() + each * size_t(task));
    });
    std::vector<double> totals(each, 0.0);
    for (size_t part = 0; part < all; part += each)
        for (size_t k = 0; k < each; ++k) totals[k] += sums[part + k];
    for (int l = 0; l < product.latent; ++l)
        for (int c = 0; c < product.columns; ++c) by_modes[l * product.columns + c] = float(totals[size_t(l) * tables.stride + c]);
}

void apply_transfer(const Transfer& t, const float* changes, int64_t count, const Kernels& kernels, int threads, float* logits,
                    float* colors) {
    const PaddedTransfer whole(t, changes);
    in_parts(count, threads, [&](int64_t, int64_t first, int64_t last) {
        kernels.transfer(whole.transfer, first, last, logits, colors);
    });
}

void transfer_gradient(const Transfer& t, const float* changes, int64_t count, const float* by_logits, const float* by_colors,
                       const Kernels& kernels, int threads, float* by_weights) {
    const PaddedTransfer whole(t, changes);
    in_parts(count, threads, [&](int64_t, int64_t first, int64_t last) {
        kernels.transfer_backward(whole.transfer, first, last, by_logits, by_colors, by_weights);
    });
}

void extinction_table(const double* values, int64_t count, const ControlPoints& colors, const ControlPoints& opacities, int samples,
               double most_opaque, double* out) {
    Interpolation color_at(colors), opacity_at(opacities);
    std::fill_n(out, 4 * count, 0.0);
    for (int64_t b = 0; b + 1 < count; ++b) {
        const double length = values[b + 1] - values[b];
        for (int s = 0; s < samples; ++s) {
            const double inside = (s + 0.5) / samples, place = values[b] + length * inside, share = length / samples;
            double opacity, color[3];
            opacity_at.read(place, &opacity);
            color_at.read(place, color);
            const double extinction = -std::log1p(-std::min(opacity, most_opaque));
            for (int c = 0; c < 4; ++c) {
                const double value = (c ? color[c - 1] : 1.0) * extinction * share;
                out[4 * b + c] += (1.0 - inside) * value;
                out[4 * (b + 1) + c] += inside * value;
            }
        }
    }
    for (int64_t b = 0; b < count; ++b) {
        const double area = (values[std::min(b + 1, count - 1)] - values[std::max<int64_t>(b - 1, 0)]) / 2.0;
        for (int c = 0; c < 4; ++c) out[4 * b + c] /= area;
    }
}

}  // namespace gs
