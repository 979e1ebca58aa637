// One picture of Gaussians and everything that its gradient needs.
#pragma once

#include <cstdint>
#include <cstdlib>
#include <memory>
#include <mutex>
#include <new>
#include <type_traits>
#include <vector>

#include "kernels.hpp"

namespace gs {

// Memory for plain values, aligned to a cache line, neither initialised nor kept when it grows.
template <class T>
class Buffer {
    static_assert(std::is_trivially_copyable<T>::value, "plain values only");

public:
    Buffer() = default;
    Buffer(const Buffer&) = delete;
    Buffer& operator=(const Buffer&) = delete;
    Buffer(Buffer&& other) noexcept : data_(other.data_), capacity_(other.capacity_) {
        other.data_ = nullptr;
        other.capacity_ = 0;
    }
    ~Buffer() { std::free(data_); }

    T* data() const { return data_; }
    T& operator[](size_t k) const { return data_[k]; }
    size_t capacity() const { return capacity_; }

    // Room for `count` values, whose contents are lost if it was too small before.
    T* resize(size_t count) {
        if (count > capacity_ || !data_) {
            std::free(data_);
            data_ = nullptr;
            capacity_ = 0;
            data_ = allocate(count);
            capacity_ = count;
        }
        return data_;
    }

    // Room for `count` values, of which the first `kept` stay.
    T* grow(size_t count, size_t kept) {
        if (count <= capacity_) return data_;
        T* data = allocate(count);
        for (size_t k = 0; k < kept; ++k) data[k] = data_[k];
        std::free(data_);
        data_ = data;
        capacity_ = count;
        return data_;
    }

private:
    static T* allocate(size_t count) {
        const size_t bytes = (count * sizeof(T) + 64) / 64 * 64;
        void* data = count > SIZE_MAX / 2 / sizeof(T) ? nullptr : std::aligned_alloc(64, bytes);
        if (!data) throw std::bad_alloc();
        return static_cast<T*>(data);
    }

    T* data_ = nullptr;
    size_t capacity_ = 0;
};

struct DepthKey {
    uint32_t depth;  // the bits of a positive float, which sort as the numbers do
    uint32_t index;
};

// A run of Gaussians that one task projects.
struct Portion {
    Buffer<Touch> touches;
    size_t touched = 0;
    uint64_t first_slot = 0;
};

// Memory that one drawing hands to the next: fresh pages would cost as much as the projection.
struct Workspace {
    Buffer<Splat> splats;
    Buffer<float> depths;
    Buffer<uint32_t> begin;       // [N], where in its portion's touches each Gaussian's begin
    std::vector<Portion> portions;
    Buffer<DepthKey> order, spare;
    Buffer<uint32_t> counts;      // [runs of the sorted Gaussians, tiles]
    Buffer<uint64_t> starts;      // [tiles + 1]
    Buffer<Entry> entries;
    Buffer<float> states;         // [tiles, 4, pixels of a tile]
    Buffer<float> moments;        // [entries, kMoments], Gaussian by Gaussian
};

class Drawing {
public:
    // Draws into color [H, W, 3] and alpha [H, W].  The Gaussians must stay as they are until the last `backward`.
    Drawing(const Gaussians&, const View&, const Kernels&, int threads, float* color, float* alpha);
    ~Drawing();
    Drawing(const Drawing&) = delete;
    Drawing& operator=(const Drawing&) = delete;

    // Gradients, by the Gaussians, of a loss with these gradients by the picture; `out` must hold zeros.
    void backward(const float* grad_color, const float* grad_alpha, int threads, const GaussianGradients& out);

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
