#include "transfer.hpp"

#include <algorithm>
#include <cstring>

#include "buffer.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

constexpr int64_t kGaussiansPerTask = 512;

// Calls work(t, first, last) for all Gaussians in parts, with the changes as the kernels read them.
template <class Work>
void for_all(Transfer t, const float* changes, int64_t count, int threads, const Work& work) {
    t.stride = padded(t.values);
    Buffer<float> table;
    const size_t size = size_t(kChanges) * size_t(t.stride);
    std::memset(table.resize(size), 0, size * sizeof(float));
    for (int b = 0; b < t.values; ++b)
        for (int c = 0; c < kChanges; ++c) table[size_t(c) * t.stride + b] = changes[kChanges * b + c];
    t.changes = table.data();
    parallel((count + kGaussiansPerTask - 1) / kGaussiansPerTask, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        work(t, first, std::min(count, first + kGaussiansPerTask));
    });
}

}  // namespace

void apply_transfer(Transfer t, const float* changes, int64_t count, const Kernels& kernels, int threads, float* logits,
                    float* colors) {
    for_all(t, changes, count, threads, [&](const Transfer& whole, int64_t first, int64_t last) {
        kernels.transfer(whole, first, last, logits, colors);
    });
}

void transfer_gradient(Transfer t, const float* changes, int64_t count, const float* by_logits, const float* by_colors,
                       const Kernels& kernels, int threads, float* by_weights) {
    for_all(t, changes, count, threads, [&](const Transfer& whole, int64_t first, int64_t last) {
        kernels.transfer_backward(whole, first, last, by_logits, by_colors, by_weights);
    });
}

}  // namespace gs
