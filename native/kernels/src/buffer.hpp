#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>
#include <type_traits>

namespace gs {

// Memory for plain values, aligned to a cache line, neither initialised nor kept when it grows.
template <class T>
class Buffer {
    static_assert(std::is_trivially_copyable<T>::value, "plain values only");

public:
    T* data() const { return data_.get(); }
    T& operator[](size_t k) const { return data_.get()[k]; }
    size_t capacity() const { return data_ ? capacity_ : 0; }

    // Room for `count` values, whose contents are lost if it was too small before.
    T* resize(size_t count) {
        if (count > capacity() || !data_) {
            data_.reset();
            data_.reset(allocate(count));
            capacity_ = count;
        }
        return data();
    }

    // Room for `count` values, of which the first `kept` stay.
    T* grow(size_t count, size_t kept) {
        if (count <= capacity()) return data();
        T* data = allocate(count);
        for (size_t k = 0; k < kept; ++k) data[k] = (*this)[k];
        data_.reset(data);
        capacity_ = count;
        return data;
    }

private:
    static T* allocate(size_t count) {
        const size_t bytes = (count * sizeof(T) + 64) / 64 * 64;
        void* data = count > SIZE_MAX / 2 / sizeof(T) ? nullptr : std::aligned_alloc(64, bytes);
        if (!data) throw std::bad_alloc();
        return static_cast<T*>(data);
    }

    struct Free {
        void operator()(T* data) const { std::free(data); }
    };
    std::unique_ptr<T, Free> data_;
    size_t capacity_ = 0;
};

}  // namespace gs
