// What the machine can do at most: `peak THREADS SECONDS` prints gigaflops and gigabytes per second.
//
// Arithmetic: float32 multiply-adds (two operations each) in a loop without memory.  Memory: what STREAM's triad
// (McCalpin 1995) reads and writes in 192 MB.  Both are the highest rate of many short bursts within SECONDS.
// GS_WIDTH is the number of floats in a vector.
#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <thread>
#include <vector>

typedef float V __attribute__((vector_size(GS_WIDTH * 4)));

constexpr int64_t kRounds = 1000000;              // of multiply-adds in a burst
constexpr int kChains = 12;                       // independent sums hide the latency of a multiply-add; 16 registers hold them
constexpr int64_t kStreamed = int64_t(16) << 20;  // floats in each of three arrays, all threads together

static float multiply_adds(float factor, float term) {
    V chains[kChains];
    for (int k = 0; k < kChains; ++k)
        for (int lane = 0; lane < GS_WIDTH; ++lane) chains[k][lane] = float(lane + k);
    const V a = factor - V{}, b = term - V{};
    for (int64_t round = 0; round < kRounds; ++round)
        for (int k = 0; k < kChains; ++k) chains[k] = chains[k] * a + b;
    float sum = 0;  // depends on every chain, so that none is left out
    for (int k = 0; k < kChains; ++k)
        for (int lane = 0; lane < GS_WIDTH; ++lane) sum += chains[k][lane];
    return sum;
}

// out = first + factor * second
static void triad(const float* first, const float* second, float factor, int64_t count, float* out) {
    for (int64_t k = 0; k + GS_WIDTH <= count; k += GS_WIDTH) {
        V x, y;
        std::memcpy(&x, first + k, sizeof x);
        std::memcpy(&y, second + k, sizeof y);
        x = x + factor * y;
        std::memcpy(out + k, &x, sizeof x);
    }
}

// Calls task(t) for each t below `threads` on a thread of its own.
template <class Task>
static void on_threads(int threads, const Task& task) {
    std::vector<std::thread> others;
    for (int t = 1; t < threads; ++t) others.emplace_back([&task, t] { task(t); });
    task(0);
    for (std::thread& other : others) other.join();
}

// The least time of one call of `burst` among as many as fit into `seconds`, but at least three.
template <class Burst>
static double least(double seconds, const Burst& burst) {
    const auto now = [] { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); };
    burst();
    double best = 1e30;
    const double end = now() + seconds;
    for (int k = 0; k < 3 || now() < end; ++k) {
        const double started = now();
        burst();
        best = std::min(best, now() - started);
    }
    return best;
}

int main(int, char** arguments) {
    const int threads = std::atoi(arguments[1]);
    const double seconds = std::atof(arguments[2]);
    volatile float factor = 0.999f;  // not known to the compiler
    std::vector<float> results(static_cast<size_t>(threads));
    const double calculating = least(seconds, [&] {
        on_threads(threads, [&](int t) { results[size_t(t)] = multiply_adds(factor, 1e-3f); });
    });
    std::vector<float> first(kStreamed, results[0]), second(first), out(first);
    const int64_t each = kStreamed / threads;
    const double streaming = least(seconds, [&] {
        on_threads(threads, [&](int t) { triad(&first[t * each], &second[t * each], factor, each, &out[t * each]); });
    });
    const double operations = 2.0 * double(kRounds) * kChains * GS_WIDTH * threads;
    std::printf("%.6g %.6g\n", operations / calculating * 1e-9, 3.0 * sizeof(float) * double(each * threads) / streaming * 1e-9);
}
