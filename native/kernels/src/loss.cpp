#include "loss.hpp"

#include <algorithm>
#include <vector>

#include "buffer.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

// Fewer rows in a task would be lost in the twenty beyond it that each needs as well.
constexpr int kFewestRows = 32;

}  // namespace

ImageLoss image_loss(const ImagePair& images, double ssim_weight, const Kernels& kernels, int threads, float* gradient) {
    const int height = images.height, tasks = std::max(1, std::min(threads, height / kFewestRows));
    const double values = double(height) * images.width * images.channels;  // that are compared
    const int64_t each = kernels.loss_scratch(images);
    std::vector<double> difference(static_cast<size_t>(height)), similarity(static_cast<size_t>(height));
    Buffer<float> scratch;
    scratch.resize(size_t(each) * tasks);
    parallel(tasks, threads, [&](int64_t task) {
        kernels.loss_rows(images, int(height * task / tasks), int(height * (task + 1) / tasks), float(1.0 / values),
                          float(-ssim_weight / values), scratch.data() + each * task, gradient, difference.data(),
                          similarity.data());
    });
    ImageLoss loss{0, 0};
    for (int y = 0; y < height; ++y) {
        loss.difference += difference[y] / values;
        loss.similarity += similarity[y] / values;
    }
    return loss;
}

}  // namespace gs
