// Mean absolute difference and structural similarity of two images, and the gradient of their sum.
#pragma once

#include "kernels.hpp"

namespace gs {

struct ImageLoss {
    double difference;  // mean |image - target|
    double similarity;  // mean SSIM
};

// Writes the gradient of difference - ssim_weight * similarity by the image, [height, width, channels].
ImageLoss image_loss(const ImagePair&, double ssim_weight, const Kernels&, int threads, float* gradient);

}  // namespace gs
