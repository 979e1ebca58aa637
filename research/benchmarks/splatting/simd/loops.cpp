// The inner loops of splatting, forward and backward, written once and compiled with different vector libraries:
//     g++ -std=c++17 -O3 -march=... -DWITH_VECTOR_EXTENSIONS loops.cpp        (or WITH_STD_SIMD, _XSIMD, _HIGHWAY, _ARRAYS)
// Prints nanoseconds per (pixel, Gaussian) pair forward and backward, and a sum of all results, which must agree.
// `python research/benchmarks/splatting/simd/compare.py` runs them all.  The loops are those of native/kernels/src/tiles.inc, without the lists.
#include <chrono>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstring>
#include <vector>

#if defined(WITH_VECTOR_EXTENSIONS)
#include <immintrin.h>
#if defined(__AVX512F__)
#define GS_WIDTH 16
#else
#define GS_WIDTH 8
#endif
namespace {
#include "../../native/kernels/src/vectors.inc"
}
constexpr int kWidth = GS_WIDTH;
static inline V set(float x) { return splat(x); }
#elif defined(WITH_STD_SIMD)
#include <experimental/simd>
namespace stdx = std::experimental;
using V = stdx::native_simd<float>;
using VI = stdx::rebind_simd_t<int32_t, V>;
using M = V::mask_type;
constexpr int kWidth = int(V::size());
static inline V load(const float* p) { return V(p, stdx::element_aligned); }
static inline void store(float* p, V v) { v.copy_to(p, stdx::element_aligned); }
static inline V set(float x) { return V(x); }
static inline M at_least(V a, V b) { return a >= b; }
static inline M at_least(M within, V a, V b) { return within && a >= b; }
static inline V keep(M m, V v) {
    V zero(0.0f);
    stdx::where(m, zero) = v;
    return zero;
}
static inline V smaller(V a, V b) { return stdx::min(a, b); }
static inline V exp2_fraction(V);
static inline V exp2(V x) {
    x = stdx::max(x, V(-126.0f));
    const V whole = stdx::floor(x), y = exp2_fraction(x - whole);
    VI bits;
    static_assert(sizeof bits == sizeof y, "bits of floats");
    std::memcpy(&bits, &y, sizeof y);
    bits += stdx::static_simd_cast<VI>(whole) << 23;
    V out;
    std::memcpy(&out, &bits, sizeof out);
    return out;
}
#elif defined(WITH_XSIMD)
#include <xsimd/xsimd.hpp>
using V = xsimd::batch<float>;
using VI = xsimd::batch<int32_t>;
using M = V::batch_bool_type;
constexpr int kWidth = int(V::size);
static inline V load(const float* p) { return V::load_unaligned(p); }
static inline void store(float* p, V v) { v.store_unaligned(p); }
static inline V set(float x) { return V(x); }
static inline M at_least(V a, V b) { return a >= b; }
static inline M at_least(M within, V a, V b) { return within & (a >= b); }
static inline V keep(M m, V v) { return xsimd::select(m, v, V(0.0f)); }
static inline V smaller(V a, V b) { return xsimd::min(a, b); }
static inline V exp2_fraction(V);
static inline V exp2(V x) {
    x = xsimd::max(x, V(-126.0f));
    const V whole = xsimd::floor(x);
    return xsimd::bitwise_cast<V>(xsimd::bitwise_cast<VI>(exp2_fraction(x - whole)) + (xsimd::to_int(whole) << 23));
}
#elif defined(WITH_HIGHWAY)
#include <hwy/highway.h>
namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::ScalableTag<float>;
using TagI = hn::RebindToSigned<Tag>;
using Raw = hn::Vec<Tag>;
using M = hn::Mask<Tag>;
constexpr int kWidth = int(hn::MaxLanes(Tag()));
struct V {
    Raw raw;
};
static inline V operator+(V a, V b) { return {hn::Add(a.raw, b.raw)}; }
static inline V operator-(V a, V b) { return {hn::Sub(a.raw, b.raw)}; }
static inline V operator*(V a, V b) { return {hn::Mul(a.raw, b.raw)}; }
static inline V operator/(V a, V b) { return {hn::Div(a.raw, b.raw)}; }
static inline V load(const float* p) { return {hn::LoadU(Tag(), p)}; }
static inline void store(float* p, V v) { hn::StoreU(v.raw, Tag(), p); }
static inline V set(float x) { return {hn::Set(Tag(), x)}; }
static inline M at_least(V a, V b) { return hn::Ge(a.raw, b.raw); }
static inline M at_least(M within, V a, V b) { return hn::And(within, hn::Ge(a.raw, b.raw)); }
static inline V keep(M m, V v) { return {hn::IfThenElseZero(m, v.raw)}; }
static inline V smaller(V a, V b) { return {hn::Min(a.raw, b.raw)}; }
static inline V exp2_fraction(V);
static inline V exp2(V x) {
    x = {hn::Max(x.raw, hn::Set(Tag(), -126.0f))};
    const V whole = {hn::Floor(x.raw)};
    const auto bits = hn::BitCast(TagI(), exp2_fraction(x - whole).raw);
    return {hn::BitCast(Tag(), hn::Add(bits, hn::ShiftLeft<23>(hn::ConvertTo(TagI(), whole.raw))))};
}
#elif defined(WITH_ARRAYS)
// Plain loops over arrays, which the compiler is to turn into vectors by itself.
#if defined(__AVX512F__)
constexpr int kWidth = 16;
#else
constexpr int kWidth = 8;
#endif
struct V {
    float lane[kWidth];
};
struct M {
    bool lane[kWidth];
};
#define EACH(type, expression)                             \
    type out;                                              \
    for (int k = 0; k < kWidth; ++k) out.lane[k] = expression; \
    return out;
static inline V operator+(V a, V b) { EACH(V, a.lane[k] + b.lane[k]) }
static inline V operator-(V a, V b) { EACH(V, a.lane[k] - b.lane[k]) }
static inline V operator*(V a, V b) { EACH(V, a.lane[k] * b.lane[k]) }
static inline V operator/(V a, V b) { EACH(V, a.lane[k] / b.lane[k]) }
static inline V load(const float* p) { EACH(V, p[k]) }
static inline void store(float* p, V v) { std::memcpy(p, &v, sizeof v); }
static inline V set(float x) { EACH(V, x) }
static inline M at_least(V a, V b) { EACH(M, a.lane[k] >= b.lane[k]) }
static inline M at_least(M within, V a, V b) { EACH(M, within.lane[k] && a.lane[k] >= b.lane[k]) }
static inline V keep(M m, V v) { EACH(V, m.lane[k] ? v.lane[k] : 0.0f) }
static inline V smaller(V a, V b) { EACH(V, a.lane[k] < b.lane[k] ? a.lane[k] : b.lane[k]) }
static inline V exp2(V x) { EACH(V, std::exp2f(x.lane[k])) }
#endif

#if defined(WITH_STD_SIMD) || defined(WITH_XSIMD) || defined(WITH_HIGHWAY)
static inline V exp2_fraction(V f) {
    V y = set(0.0018775768970527018f);
    for (float c : {0.00898934030763715f, 0.05582631707035901f, 0.24015361777363614f, 0.6931530730252006f, 0.9999999250739131f})
        y = y * f + set(c);
    return y;
}
#endif

namespace {

constexpr int kBlocks = 32, kGaussians = 2048;
constexpr float kFloor = -7.994353f, kCap = 0.999f, kDark = 1e-4f;  // log2(1/255), ...

struct Splat {
    float u, v, peak, color[3], block_u[kBlocks], block_v[kBlocks];
};

void forward(const std::vector<Splat>& splats, const float* lanes, float* state) {
    const V floor = set(kFloor), cap = set(kCap), dark = set(kDark), x = load(lanes);
    for (const Splat& s : splats) {
        const V u0 = set(s.u) + x, v0 = set(s.v) + x, peak = set(s.peak);
        const V r = set(s.color[0]), g = set(s.color[1]), b = set(s.color[2]);
        for (int block = 0; block < kBlocks; ++block) {
            float* at = state + block * 4 * kWidth;
            const V u = u0 + set(s.block_u[block]), v = v0 + set(s.block_v[block]);
            const V power = (peak - u * u) - v * v, t = load(at);
            const V w = keep(at_least(at_least(power, floor), t, dark), smaller(exp2(power), cap)) * t;
            store(at, t - w);
            store(at + kWidth, load(at + kWidth) + w * r);
            store(at + 2 * kWidth, load(at + 2 * kWidth) + w * g);
            store(at + 3 * kWidth, load(at + 3 * kWidth) + w * b);
        }
    }
}

void backward(const std::vector<Splat>& splats, const float* lanes, float* state, float* moments) {
    const V floor = set(kFloor), cap = set(kCap), dark = set(kDark), x = load(lanes), one = set(1.0f);
    for (const Splat& s : splats) {
        const V u0 = set(s.u) + x, v0 = set(s.v) + x, peak = set(s.peak);
        const V r = set(s.color[0]), g = set(s.color[1]), b = set(s.color[2]);
        V total[9];
        for (V& sum : total) sum = set(0.0f);
        for (int block = 0; block < kBlocks; ++block) {
            float* at = state + block * 6 * kWidth;
            const V u = u0 + set(s.block_u[block]), v = v0 + set(s.block_v[block]);
            const V power = (peak - u * u) - v * v, t = load(at), e = exp2(power);
            const V a = keep(at_least(at_least(power, floor), t, dark), smaller(e, cap)), w = a * t;
            const V g_r = load(at + 2 * kWidth), g_g = load(at + 3 * kWidth), g_b = load(at + 4 * kWidth);
            const V worth = r * g_r + (g * g_g + (b * g_b + load(at + 5 * kWidth)));
            const V gain = w * worth, after = load(at + kWidth) - gain;
            store(at, t - w);
            store(at + kWidth, after);
            const V h = keep(at_least(cap, e), gain - a * after / (one - a));
            const V hu = h * u, hv = h * v;
            const V terms[9] = {h, hu, hv, hu * u, hu * v, hv * v, w * g_r, w * g_g, w * g_b};
            for (int k = 0; k < 9; ++k) total[k] = total[k] + terms[k];
        }
        for (int k = 0; k < 9; ++k) store(moments + k * kWidth, load(moments + k * kWidth) + total[k]);
    }
}

template <class Call>
double nanoseconds_per_pair(const Call& call) {
    double best = 1e30;
    for (int repeat = 0; repeat < 60; ++repeat) {
        const auto started = std::chrono::steady_clock::now();
        call();
        best = std::min(best, std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count());
    }
    return best * 1e9 / (double(kGaussians) * kBlocks * kWidth);
}

}  // namespace

int main() {
    uint32_t seed = 1;
    const auto uniform = [&](float low, float high) {
        seed = seed * 1664525u + 1013904223u;
        return low + (high - low) * float(seed >> 8) / float(1 << 24);
    };
    std::vector<Splat> splats(kGaussians);
    for (Splat& s : splats) {
        s.u = uniform(-2, 2), s.v = uniform(-2, 2), s.peak = uniform(-10.0f, -7.0f);
        for (float& c : s.color) c = uniform(0, 1);
        for (int k = 0; k < kBlocks; ++k) s.block_u[k] = uniform(-0.5f, 0.5f), s.block_v[k] = uniform(-0.5f, 0.5f);
    }
    std::vector<float> lanes(kWidth), state(kBlocks * 6 * kWidth), moments(9 * kWidth);
    for (int k = 0; k < kWidth; ++k) lanes[size_t(k)] = 0.03f * float(k % 8);
    const auto clear = [&](int quantities) {
        for (size_t k = 0; k < state.size(); ++k) state[k] = k / kWidth % size_t(quantities) == 0 ? 1.0f : 0.25f;
    };
    const double drawing = nanoseconds_per_pair([&] { clear(4), forward(splats, lanes.data(), state.data()); });
    double sum = 0;
    for (int block = 0; block < kBlocks; ++block)
        for (int k = 0; k < 4 * kWidth; ++k) sum += state[size_t(block * 4 * kWidth + k)] / kWidth;
    const double differentiating = nanoseconds_per_pair([&] {
        clear(6), std::fill(moments.begin(), moments.end(), 0.0f);
        backward(splats, lanes.data(), state.data(), moments.data());
    });
    for (float value : moments) sum += value / kWidth;
    std::printf("%d %.5f %.5f %.6g\n", kWidth, drawing, differentiating, sum);
}
