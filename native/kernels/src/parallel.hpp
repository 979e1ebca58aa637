// Work spread over threads that sleep between calls.  Which thread runs which task is left to chance, so tasks must not
// share what they write; then the result does not depend on the number of threads.
#pragma once

#include <cstdint>

namespace gs {

using Task = void (*)(const void* work, int64_t task);

// Calls task(work, k) for every k in [0, tasks) on at most `threads` threads, this one among them, and returns when all
// are done.  Rethrows the first exception of a task.  Several calls at once are safe: the later ones run alone.
void parallel(int64_t tasks, int threads, Task task, const void* work);

template <class Work>
void parallel(int64_t tasks, int threads, const Work& work) {
    parallel(tasks, threads, [](const void* w, int64_t k) { (*static_cast<const Work*>(w))(k); }, &work);
}

}  // namespace gs
