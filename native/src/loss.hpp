// Mean absolute difference and structural similarity of two images, and the gradient of their sum.
#pragma once

#include "kernels.hpp"

namespace gs {

struct ImageLoss {
    double difference;  // mean |image - target|
    double similarity;  // mean SSIM
};

// Images are [height, width, channels].  `gradient`, of the same shape, is that of difference - ssim_weight * similarity
// by `image`.
ImageLoss image_loss(const float* image, const float* target, int height, int width, int channels, double ssim_weight,
                     const Kernels&, int threads, float* gradient);

}  // namespace gs
