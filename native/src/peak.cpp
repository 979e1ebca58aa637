#include "peak.hpp"

#include <algorithm>
#include <chrono>
#include <vector>

#include "buffer.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

constexpr int64_t kRounds = 200000;              // of multiply-adds in a burst
constexpr int64_t kStreamed = int64_t(16) << 20;  // floats in each of three arrays, all threads together: 192 MB

double seconds_now() {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// The least time of one call of `burst` among as many as fit into `seconds`, but at least three.
template <class Burst>
double least(double seconds, const Burst& burst) {
    burst();
    double best = 1e30;
    const double end = seconds_now() + seconds;
    for (int k = 0; k < 3 || seconds_now() < end; ++k) {
        const double started = seconds_now();
        burst();
        best = std::min(best, seconds_now() - started);
    }
    return best;
}

}  // namespace

Peak measure_peak(const Kernels& kernels, int threads, double seconds) {
    std::vector<float> results(static_cast<size_t>(threads));
    const double calculating = least(seconds, [&] {
        parallel(threads, threads, [&](int64_t task) { results[size_t(task)] = kernels.multiply_adds(kRounds, 0.999f, 1e-3f); });
    });
    Buffer<float> arrays[3];
    for (Buffer<float>& array : arrays) std::fill_n(array.resize(size_t(kStreamed)), kStreamed, results[0]);
    const int64_t each = kStreamed / threads;
    const double streaming = least(seconds, [&] {
        parallel(threads, threads, [&](int64_t task) {
            kernels.triad(arrays[0].data() + task * each, arrays[1].data() + task * each, 0.5f, each,
                          arrays[2].data() + task * each);
        });
    });
    const double operations = 2.0 * double(kRounds) * kernels.multiply_adds_per_round * threads;
    return {operations / calculating * 1e-9, 3.0 * sizeof(float) * double(each * threads) / streaming * 1e-9};
}

}  // namespace gs
