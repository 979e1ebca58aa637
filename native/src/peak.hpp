// What the machine can do at most.
#pragma once

#include "kernels.hpp"

namespace gs {

struct Peak {
    double gigaflops;             // 10^9 float32 operations per second, two for a multiply-add
    double gigabytes_per_second;  // read and written by a triad over memory far larger than the caches
};

// The highest rates of many short bursts within `seconds` each.
Peak measure_peak(const Kernels&, int threads, double seconds);

}  // namespace gs
