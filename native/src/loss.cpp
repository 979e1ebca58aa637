#include "loss.hpp"

#include <algorithm>
#include <vector>

#include "parallel.hpp"

namespace gs {
namespace {

constexpr int kRows = 32;    // rows per task
constexpr int kPadding = 16; // floats: the widest vector

}  // namespace

ImageLoss image_loss(const float* image, const float* target, int height, int width, int channels, double ssim_weight,
                     const Kernels& kernels, int threads, float* gradient) {
    const int stride = (width + kPadding - 1) / kPadding * kPadding;
    const int64_t plane = int64_t(stride) * height, bands = (height + kRows - 1) / kRows;
    const double pixels = double(height) * width * channels;
    std::vector<double> similarity(size_t(channels * bands)), difference(size_t(channels * bands));
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
                base[int64_t(y) * stride + x] = image[from];
                base[plane + int64_t(y) * stride + x] = target[from];
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
                gradient[(int64_t(y) * width + x) * channels + channel] = p.gradient[int64_t(y) * stride + x];
    });
    double total_similarity = 0, total_difference = 0;
    for (double s : similarity) total_similarity += s;
    for (double s : difference) total_difference += s;
    return {total_difference / pixels, total_similarity / pixels};
}

}  // namespace gs
