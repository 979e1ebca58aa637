// Arrays in, arrays out: the phases of splatting and of the image loss, put together and bound to Python.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/unique_ptr.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstring>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <tuple>
#include <vector>

#include "kernels.hpp"

namespace nb = nanobind;

namespace gs {
namespace {

using Input = nb::ndarray<const float, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::shape<4, 4>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<nb::numpy, float, nb::c_contig>;

std::vector<const Kernels*> available() {
    std::vector<const Kernels*> found;
#if defined(GS_X86)
    if (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
        __builtin_cpu_supports("avx512vl"))
        found.push_back(&kernels_avx512);
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) found.push_back(&kernels_avx2);
#endif
    found.push_back(&kernels_baseline);
    return found;
}

const Kernels& kernels_named(const std::string& name) {
    for (const Kernels* kernels : available())
        if (name.empty() || name == kernels->name) return *kernels;
    throw std::invalid_argument("this machine has no instruction set '" + name + "'");
}

// Runs work(task) for every task; which thread runs which does not matter, because no two write to the same place.
template <class Work>
void parallel(int64_t tasks, int threads, const Work& work) {
    std::atomic<int64_t> next{0};
    const auto run = [&] {
        for (int64_t task; (task = next.fetch_add(1, std::memory_order_relaxed)) < tasks;) work(task);
    };
    std::vector<std::thread> others;
    for (int k = 1; k < std::min<int64_t>(threads, tasks); ++k) others.emplace_back(run);
    run();
    for (std::thread& other : others) other.join();
}

Output new_array(std::vector<size_t> shape) {
    size_t count = 1;
    for (size_t extent : shape) count *= extent;
    float* data = new float[std::max<size_t>(count, 1)]();
    nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<float*>(p); });
    return Output(data, shape.size(), shape.data(), owner);
}

void require(bool holds, const std::string& what) {
    if (!holds) throw std::invalid_argument(what);
}

void require_shape(const Input& array, const char* name, int64_t rows, int64_t columns) {
    const bool fits = columns == 0 ? array.ndim() == 1 && int64_t(array.shape(0)) == rows
                                   : array.ndim() == 2 && int64_t(array.shape(0)) == rows && int64_t(array.shape(1)) == columns;
    require(fits, std::string(name) + " must have shape [" + std::to_string(rows) +
                      (columns ? ", " + std::to_string(columns) : std::string()) + "]");
}

void require_finite(const Input& array, const char* name, int64_t columns) {
    const float* values = array.data();
    const int64_t count = int64_t(array.size());
    float probe = 0;
    for (int64_t i = 0; i < count; ++i) probe += values[i] * 0.0f;
    if (probe == 0) return;
    for (int64_t i = 0; i < count; ++i)
        if (!std::isfinite(values[i]))
            throw std::invalid_argument(std::string(name) + " of Gaussian " + std::to_string(i / columns) + " is " +
                                        std::to_string(values[i]) + ": every number must be finite");
}

// Indices of the drawn Gaussians, nearest first, equal depths in order of index: three passes of a radix sort on the
// bits of the depth, whose order is that of the numbers because they are positive.
std::vector<int32_t> depth_order(const std::vector<float>& depths) {
    std::vector<int32_t> order, sorted;
    std::vector<uint32_t> keys(depths.size());
    std::memcpy(keys.data(), depths.data(), depths.size() * sizeof(float));
    for (size_t i = 0; i < depths.size(); ++i)
        if (depths[i] > 0) order.push_back(int32_t(i));
    sorted.resize(order.size());
    for (int shift = 0; shift < 33; shift += 11) {
        std::vector<int64_t> start(2049, 0);
        for (int32_t i : order) ++start[((keys[i] >> shift) & 2047) + 1];
        for (int k = 0; k < 2048; ++k) start[k + 1] += start[k];
        for (int32_t i : order) sorted[start[(keys[i] >> shift) & 2047]++] = i;
        order.swap(sorted);
    }
    return order;
}

// Largest value of the splat's exponent over the pixel centres' rectangle of a tile: on the edges that face its centre.
bool reaches(const Splat& s, int tile_x, int tile_y, float floor) {
    const float x0 = float(tile_x * kTile) + 0.5f - s.x, x1 = x0 + float(kTile - 1);
    const float y0 = float(tile_y * kTile) + 0.5f - s.y, y1 = y0 + float(kTile - 1);
    const float x = std::min(std::max(0.0f, x0), x1), y = std::min(std::max(0.0f, y0), y1);
    const auto power = [&](float dx, float dy) { return s.peak + s.xx * dx * dx + s.xy * dx * dy + s.yy * dy * dy; };
    if (x == 0 && y == 0) return true;
    float best = -INFINITY;
    if (x != 0) best = std::max(best, power(x, std::min(std::max(-s.xy * x / (2 * s.yy), y0), y1)));
    if (y != 0) best = std::max(best, power(std::min(std::max(-s.xy * y / (2 * s.xx), x0), x1), y));
    return !(best < floor - 1e-3f);
}

// Everything that the backward pass needs of a forward pass.
struct Drawing {
    Input means, scales, quats, opacities, colors;
    View view;
    const Kernels* kernels;
    std::vector<Splat> splats;      // [N]
    std::vector<int32_t> order;     // drawn Gaussians, front to back
    std::vector<int64_t> first_slot;  // per entry of `order`, and the end
    std::vector<int64_t> starts;    // per tile, and the end
    std::vector<int32_t> list;      // Gaussians of each tile, front to back
    std::vector<int64_t> slots;     // where each entry's moments go: Gaussian by Gaussian
    int tiles_x, tiles_y;
    Output color, alpha;

    Gaussians gaussians() const {
        return {means.data(), scales.data(), quats.data(), opacities.data(), colors.data(), int64_t(means.shape(0))};
    }
};

void assign_tiles(Drawing& d) {
    const float floor = std::log2(d.view.alpha_floor);
    const auto clamp = [](float value, int most) { return int(std::min(std::max(value, 0.0f), float(most))); };
    std::vector<int32_t> tile_of;
    d.starts.assign(size_t(d.tiles_x) * d.tiles_y + 1, 0);
    d.first_slot.reserve(d.order.size() + 1);
    for (int32_t i : d.order) {
        const Splat& s = d.splats[i];
        d.first_slot.push_back(int64_t(tile_of.size()));
        const int x0 = clamp(std::floor((s.x - s.half_width) / kTile), d.tiles_x);
        const int x1 = clamp(std::floor((s.x + s.half_width) / kTile) + 1, d.tiles_x);
        const int y0 = clamp(std::floor((s.y - s.half_height) / kTile), d.tiles_y);
        const int y1 = clamp(std::floor((s.y + s.half_height) / kTile) + 1, d.tiles_y);
        for (int y = y0; y < y1; ++y)
            for (int x = x0; x < x1; ++x)
                if (reaches(s, x, y, floor)) {
                    tile_of.push_back(y * d.tiles_x + x);
                    ++d.starts[size_t(y) * d.tiles_x + x + 1];
                }
    }
    d.first_slot.push_back(int64_t(tile_of.size()));
    for (size_t tile = 1; tile < d.starts.size(); ++tile) d.starts[tile] += d.starts[tile - 1];
    d.list.resize(tile_of.size());
    d.slots.resize(tile_of.size());
    std::vector<int64_t> next(d.starts.begin(), d.starts.end() - 1);
    for (size_t k = 0; k < d.order.size(); ++k)
        for (int64_t slot = d.first_slot[k]; slot < d.first_slot[k + 1]; ++slot) {
            const int64_t at = next[tile_of[slot]]++;
            d.list[at] = d.order[k];
            d.slots[at] = slot;
        }
}

constexpr int64_t kBlock = 1024;  // Gaussians per task

std::unique_ptr<Drawing> forward(Input means, Input scales, Input quats, Input opacities, Input colors, Matrix world_to_camera,
                                 double fx, double fy, double cx, double cy, int width, int height, double near,
                                 double dilation, float alpha_floor, int threads, const std::string& instruction_set) {
    require(means.ndim() == 2 && means.shape(1) == 3, "means must have shape [N, 3]");
    const int64_t count = int64_t(means.shape(0));
    require_shape(scales, "scales", count, 3);
    require_shape(quats, "quats", count, 4);
    require_shape(opacities, "opacities", count, 0);
    require_shape(colors, "colors", count, 3);
    require(width > 0 && height > 0 && fx > 0 && fy > 0, "image size and focal lengths must be positive");
    require(near > 0 && dilation >= 0 && alpha_floor > 0 && alpha_floor < 1,
            "near must be positive, dilation not negative, alpha_floor in (0, 1)");
    require_finite(means, "means", 3);
    require_finite(scales, "scales", 3);
    require_finite(quats, "quats", 4);
    require_finite(opacities, "opacities", 1);
    require_finite(colors, "colors", 3);
    View view{};
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) view.rotation[3 * r + c] = world_to_camera(r, c);
        view.translation[r] = world_to_camera(r, 3);
    }
    view.fx = fx; view.fy = fy; view.cx = cx; view.cy = cy;
    view.width = width; view.height = height;
    view.near = near; view.dilation = dilation; view.alpha_floor = alpha_floor;
    auto drawing = std::make_unique<Drawing>();
    Drawing& d = *drawing;
    d.means = means; d.scales = scales; d.quats = quats; d.opacities = opacities; d.colors = colors;
    d.view = view;
    d.kernels = &kernels_named(instruction_set);
    d.tiles_x = (width + kTile - 1) / kTile;
    d.tiles_y = (height + kTile - 1) / kTile;
    d.color = new_array({size_t(height), size_t(width), 3});
    d.alpha = new_array({size_t(height), size_t(width)});
    nb::gil_scoped_release released;
    d.splats.resize(size_t(count));
    std::vector<float> depths(size_t(count), -1.0f);
    const Gaussians gaussians = d.gaussians();
    parallel((count + kBlock - 1) / kBlock, threads, [&](int64_t task) {
        d.kernels->project(gaussians, view, task * kBlock, std::min(count, (task + 1) * kBlock), d.splats.data(), depths.data());
    });
    d.order = depth_order(depths);
    assign_tiles(d);
    parallel(int64_t(d.tiles_x) * d.tiles_y, threads, [&](int64_t tile) {
        d.kernels->forward_tile(d.splats.data(), d.list.data() + d.starts[tile], d.starts[tile + 1] - d.starts[tile], view,
                                int(tile % d.tiles_x), int(tile / d.tiles_x), d.color.data(), d.alpha.data());
    });
    return drawing;
}

using Gradients = std::tuple<Output, Output, Output, Output, Output, Output>;

Gradients backward(const Drawing& d, Input grad_color, Input grad_alpha, int threads) {
    require(grad_color.ndim() == 3 && int(grad_color.shape(0)) == d.view.height && int(grad_color.shape(1)) == d.view.width &&
                grad_color.shape(2) == 3,
            "grad_color must have shape [H, W, 3]");
    require_shape(grad_alpha, "grad_alpha", d.view.height, d.view.width);
    const size_t count = d.means.shape(0);
    Gradients out{new_array({count, 3}), new_array({count, 3}), new_array({count, 4}),
                  new_array({count}),    new_array({count, 3}), new_array({count})};
    const GaussianGradients gradients{std::get<0>(out).data(), std::get<1>(out).data(), std::get<2>(out).data(),
                                      std::get<3>(out).data(), std::get<4>(out).data(), std::get<5>(out).data()};
    nb::gil_scoped_release released;
    std::unique_ptr<float[]> moments(new float[std::max<size_t>(d.list.size(), 1) * kMoments]);
    parallel(int64_t(d.tiles_x) * d.tiles_y, threads, [&](int64_t tile) {
        d.kernels->backward_tile(d.splats.data(), d.list.data() + d.starts[tile], d.slots.data() + d.starts[tile],
                                 d.starts[tile + 1] - d.starts[tile], d.view, int(tile % d.tiles_x), int(tile / d.tiles_x),
                                 d.color.data(), d.alpha.data(), grad_color.data(), grad_alpha.data(), moments.get());
    });
    const Gaussians gaussians = d.gaussians();
    const int64_t drawn = int64_t(d.order.size());
    parallel((drawn + kBlock - 1) / kBlock, threads, [&](int64_t task) {
        for (int64_t k = task * kBlock; k < std::min(drawn, (task + 1) * kBlock); ++k) {
            double total[kMoments] = {};
            for (int64_t slot = d.first_slot[k]; slot < d.first_slot[k + 1]; ++slot)
                for (int m = 0; m < kMoments; ++m) total[m] += moments[slot * kMoments + m];
            d.kernels->project_backward(gaussians, d.view, d.order[k], d.splats[d.order[k]], total, gradients);
        }
    });
    return out;
}

constexpr int kRows = 32;  // rows per task of the image loss

std::tuple<double, double, Output> image_loss(Input image, Input target, double ssim_weight, int threads,
                                              const std::string& instruction_set) {
    require(image.ndim() == 3 && target.ndim() == 3, "image and target must have shape [H, W, C]");
    for (int k = 0; k < 3; ++k) require(image.shape(k) == target.shape(k), "image and target must have the same shape");
    const Kernels& kernels = kernels_named(instruction_set);
    const int height = int(image.shape(0)), width = int(image.shape(1)), channels = int(image.shape(2));
    require(height > 0 && width > 0 && channels > 0, "an image must have pixels");
    Output gradient = new_array({size_t(height), size_t(width), size_t(channels)});
    const int stride = (width + kTile - 1) / kTile * kTile;
    const int64_t plane = int64_t(stride) * height, bands = (height + kRows - 1) / kRows;
    const double pixels = double(height) * width * channels;
    std::vector<double> similarity(size_t(channels * bands)), difference(size_t(channels * bands));
    nb::gil_scoped_release released;
    std::vector<float> store(size_t(6 * plane * channels), 0.0f);
    const auto planes = [&](int channel) {
        float* base = store.data() + 6 * plane * channel;
        return Planes{base, base + plane, base + 2 * plane, base + 3 * plane, base + 4 * plane, base + 5 * plane, width, height, stride};
    };
    parallel(channels, threads, [&](int64_t channel) {
        float* base = store.data() + 6 * plane * channel;
        for (int y = 0; y < height; ++y)
            for (int x = 0; x < width; ++x) {
                const int64_t from = (int64_t(y) * width + x) * channels + channel;
                base[int64_t(y) * stride + x] = image.data()[from];
                base[plane + int64_t(y) * stride + x] = target.data()[from];
            }
    });
    parallel(channels * bands, threads, [&](int64_t task) {
        const int first = int(task % bands) * kRows;
        kernels.ssim_maps(planes(int(task / bands)), first, std::min(height, first + kRows), &similarity[task]);
    });
    parallel(channels * bands, threads, [&](int64_t task) {
        const int channel = int(task / bands), first = int(task % bands) * kRows, last = std::min(height, first + kRows);
        const Planes p = planes(channel);
        kernels.loss_gradient(p, first, last, float(1.0 / pixels), float(-ssim_weight / pixels), &difference[task]);
        for (int y = first; y < last; ++y)
            for (int x = 0; x < width; ++x)
                gradient.data()[(int64_t(y) * width + x) * channels + channel] = p.gradient[int64_t(y) * stride + x];
    });
    double total_similarity = 0, total_difference = 0;
    for (double s : similarity) total_similarity += s;
    for (double s : difference) total_difference += s;
    return {total_difference / pixels, total_similarity / pixels, gradient};
}

}  // namespace
}  // namespace gs

NB_MODULE(_kernels, m) {
    nb::set_leak_warnings(false);  // a drawing that a global holds at exit is no leak
    using namespace gs;
    using namespace nb::literals;
    nb::class_<Drawing>(m, "Drawing")
        .def_prop_ro("color", [](const Drawing& d) { return d.color; }, nb::rv_policy::automatic)
        .def_prop_ro("alpha", [](const Drawing& d) { return d.alpha; }, nb::rv_policy::automatic)
        .def_prop_ro("drawn", [](const Drawing& d) { return d.order.size(); })
        .def_prop_ro("pairs", [](const Drawing& d) { return d.list.size(); });
    m.def("instruction_sets", [] {
        std::vector<std::string> names;
        for (const Kernels* kernels : available()) names.push_back(kernels->name);
        return names;
    });
    m.def("forward", &forward, "means"_a, "scales"_a, "quats"_a, "opacities"_a, "colors"_a, "world_to_camera"_a, "fx"_a, "fy"_a,
          "cx"_a, "cy"_a, "width"_a, "height"_a, "near"_a, "dilation"_a, "alpha_floor"_a, "threads"_a, "instruction_set"_a = "");
    m.def("backward", &backward, "drawing"_a, "grad_color"_a, "grad_alpha"_a, "threads"_a);
    m.def("image_loss", &image_loss, "image"_a, "target"_a, "ssim_weight"_a, "threads"_a, "instruction_set"_a = "");
}
