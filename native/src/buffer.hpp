#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <new>
#include <type_traits>

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

}  // namespace gs
