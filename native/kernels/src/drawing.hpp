// One picture of Gaussians and everything that its gradient needs.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <vector>

#include "buffer.hpp"
#include "kernels.hpp"

namespace gs {

struct DepthKey {
    uint32_t depth;  // the bits of a positive float, which sort as the numbers do
    uint32_t index;
};

// A run of Gaussians that one task projects.
struct Portion {
    Buffer<Touch> touches;
    Buffer<uint32_t> begin;  // [Gaussians + 1], where each one's begin in `touches`
    uint64_t first_slot = 0;
};

// Memory that one drawing hands to the next: fresh pages would cost as much as the projection.
struct Workspace {
    Buffer<Splat> splats;
    Buffer<float> depths;
    std::vector<Portion> portions;
    Buffer<DepthKey> order, spare;
    Buffer<uint32_t> counts;      // [runs of the sorted Gaussians, tiles]
    Buffer<uint64_t> starts;      // [tiles + 1]
    Buffer<Entry> entries;
    Buffer<float> states;         // [tiles, 4 x pixels of a tile]
    Buffer<float> moments;        // [entries, kMoments], Gaussian by Gaussian
};

class Drawing {
public:
    // Draws into `picture` [H, W, 4].  The Gaussians must stay as they are until the last `backward`.
    Drawing(const Gaussians&, const View&, const Kernels&, int threads, float* picture);
    ~Drawing();
    Drawing(const Drawing&) = delete;
    Drawing& operator=(const Drawing&) = delete;

    // Gradients, by the Gaussians, of a loss with this gradient by the picture; `out` must hold zeros.
    void backward(const float* gradient, int threads, const GaussianGradients& out, bool edges = false);

    int64_t drawn() const { return drawn_; }      // Gaussians that reach the picture
    int64_t touches() const { return touches_; }  // (Gaussian, tile) pairs

    const Gaussians gaussians;
    const View view;

private:
    void project(int threads);
    void sort();
    void list(int threads);

    const Kernels& kernels_;
    Tiling tiling_;
    int64_t portion_size_ = 1, portions_ = 0;  // Gaussians, number
    int64_t drawn_ = 0, touches_ = 0;
    std::unique_ptr<Workspace> memory_;
    std::mutex in_backward_;
};

}  // namespace gs
