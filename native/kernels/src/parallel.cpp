#include "parallel.hpp"

#include <unistd.h>

#include <atomic>
#include <condition_variable>
#include <exception>
#include <mutex>
#include <system_error>
#include <thread>

namespace gs {
namespace {

// A worker looks for the next call this often before it sleeps: waking one takes as long as a small phase of a call, but
// spinning longer would steal the core from whoever shares it.
constexpr int kSpins = 2000;

inline void rest() {
#if defined(__x86_64__)
    __builtin_ia32_pause();
#elif defined(__aarch64__)
    asm volatile("yield");
#endif
}

class Pool {
public:
    void run(int64_t tasks, int threads, Task task, const void* work) {
        start(threads - 1);
        {
            std::lock_guard<std::mutex> guard(mutex_);
            task_ = task;
            work_ = work;
            tasks_ = tasks;
            next_.store(0, std::memory_order_relaxed);
            wanted_ = threads - 1 < workers_ ? threads - 1 : workers_;
            failure_ = nullptr;
            call_.fetch_add(1, std::memory_order_release);
        }
        wake_.notify_all();
        take();
        std::unique_lock<std::mutex> lock(mutex_);
        wanted_ = 0;  // who wakes now comes too late
        for (int k = 0; busy_ && k < kSpins; ++k) {
            lock.unlock();
            rest();
            lock.lock();
        }
        done_.wait(lock, [&] { return busy_ == 0; });
        if (failure_) std::rethrow_exception(failure_);
    }

    std::mutex in_use;

private:
    void start(int count) {
        try {
            for (; workers_ < count; ++workers_) std::thread([this] { serve(); }).detach();
        } catch (const std::system_error&) {
            // No more threads to be had: those there are will do.
        }
    }

    void serve() {
        uint64_t seen = 0;
        for (;;) {
            for (int k = 0; k < kSpins && call_.load(std::memory_order_acquire) == seen; ++k) rest();
            std::unique_lock<std::mutex> lock(mutex_);
            wake_.wait(lock, [&] { return call_.load(std::memory_order_relaxed) != seen; });
            seen = call_.load(std::memory_order_relaxed);
            if (wanted_ == 0) continue;
            --wanted_;
            ++busy_;
            lock.unlock();
            take();
            lock.lock();
            if (--busy_ == 0) done_.notify_one();
        }
    }

    void take() {
        try {
            for (int64_t k; (k = next_.fetch_add(1, std::memory_order_relaxed)) < tasks_;) task_(work_, k);
        } catch (...) {
            next_.store(tasks_, std::memory_order_relaxed);
            std::lock_guard<std::mutex> guard(mutex_);
            if (!failure_) failure_ = std::current_exception();
        }
    }

    std::mutex mutex_;
    std::condition_variable wake_, done_;
    std::atomic<uint64_t> call_{0};
    std::atomic<int64_t> next_{0};
    Task task_ = nullptr;
    const void* work_ = nullptr;
    int64_t tasks_ = 0;
    int workers_ = 0, wanted_ = 0, busy_ = 0;
    std::exception_ptr failure_;
};

// Never destroyed, because its threads outlive static objects.  A forked child has none of them and makes its own.
Pool& pool() {
    static std::mutex mutex;
    static Pool* current = nullptr;
    static pid_t owner = 0;
    const std::lock_guard<std::mutex> guard(mutex);
    if (owner != getpid()) {
        current = new Pool;
        owner = getpid();
    }
    return *current;
}

}  // namespace

void parallel(int64_t tasks, int threads, Task task, const void* work) {
    if (tasks > 1 && threads > 1) {
        Pool& shared = pool();
        const std::unique_lock<std::mutex> lock(shared.in_use, std::try_to_lock);
        if (lock.owns_lock()) return shared.run(tasks, threads < tasks ? threads : int(tasks), task, work);
    }
    for (int64_t k = 0; k < tasks; ++k) task(work, k);
}

}  // namespace gs
