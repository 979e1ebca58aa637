#include "drawing.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>

#include "parallel.hpp"

namespace gs {
namespace {

constexpr int kPortionsPerThread = 4;
constexpr int64_t kFewestGaussians = 512;  // in a portion: waking a thread takes as long as projecting hundreds
constexpr size_t kKeptWorkspaces = 2;

std::mutex kept_mutex;
std::vector<std::unique_ptr<Workspace>>& kept_workspaces() {
    static auto* kept = new std::vector<std::unique_ptr<Workspace>>;
    return *kept;
}

std::unique_ptr<Workspace> take_workspace() {
    const std::lock_guard<std::mutex> guard(kept_mutex);
    auto& kept = kept_workspaces();
    if (kept.empty()) return std::make_unique<Workspace>();
    auto workspace = std::move(kept.back());
    kept.pop_back();
    return workspace;
}

void give_workspace(std::unique_ptr<Workspace> workspace) {
    const std::lock_guard<std::mutex> guard(kept_mutex);
    auto& kept = kept_workspaces();
    if (kept.size() < kKeptWorkspaces) kept.push_back(std::move(workspace));
}

int64_t tasks_of(int64_t count, int64_t each) { return (count + each - 1) / each; }

// Sorts by depth, equal depths in the order of index: a radix sort of three 11-bit digits.
void sort_by_depth(Buffer<DepthKey>& order, Buffer<DepthKey>& spare, int64_t count) {
    constexpr int kDigits = 3, kBits = 11, kValues = 1 << kBits;
    uint32_t starts[kDigits][kValues] = {};
    for (int64_t k = 0; k < count; ++k)
        for (int digit = 0; digit < kDigits; ++digit) ++starts[digit][order[k].depth >> (digit * kBits) & (kValues - 1)];
    DepthKey *from = order.data(), *to = spare.data();
    for (int digit = 0; digit < kDigits; ++digit) {
        uint32_t total = 0, most = 0;
        for (uint32_t& start : starts[digit]) {
            most = std::max(most, start);
            const uint32_t here = start;
            start = total;
            total += here;
        }
        if (most == total) continue;  // all alike
        for (int64_t k = 0; k < count; ++k) to[starts[digit][from[k].depth >> (digit * kBits) & (kValues - 1)]++] = from[k];
        std::swap(from, to);
    }
    if (from != order.data()) std::memcpy(order.data(), from, size_t(count) * sizeof(DepthKey));
}

}  // namespace

Drawing::Drawing(const Gaussians& g, const View& v, const Kernels& kernels, int threads, float* picture)
    : gaussians(g), view(v), kernels_(kernels), memory_(take_workspace()) {
    if (g.count >= int64_t(UINT32_MAX)) throw std::length_error("more Gaussians than 32 bits can count");
    tiling_ = {int(tasks_of(v.width, kernels.tile_width)), int(tasks_of(v.height, kernels.tile_height)), kernels.tile_width,
               kernels.tile_height};
    project(threads);
    sort();
    list(threads);
    Workspace& m = *memory_;
    const int64_t tiles = int64_t(tiling_.across) * tiling_.down, state = 4 * tiling_.width * tiling_.height;
    m.states.resize(size_t(tiles * state));
    parallel(tiles, threads, [&](int64_t tile) {
        kernels_.forward_tile(m.splats.data(), m.entries.data() + m.starts[tile], int64_t(m.starts[tile + 1] - m.starts[tile]),
                              view, int(tile % tiling_.across) * tiling_.width, int(tile / tiling_.across) * tiling_.height,
                              m.states.data() + tile * state, picture);
    });
}

Drawing::~Drawing() { give_workspace(std::move(memory_)); }

void Drawing::project(int threads) {
    Workspace& m = *memory_;
    const int64_t count = gaussians.count;
    portion_size_ = std::max(kFewestGaussians, threads > 1 ? tasks_of(count, int64_t(threads) * kPortionsPerThread) : count);
    portions_ = tasks_of(count, portion_size_);
    m.splats.resize(size_t(count));
    m.depths.resize(size_t(count));
    if (m.portions.size() < size_t(portions_)) m.portions.resize(size_t(portions_));
    parallel(portions_, threads, [&](int64_t task) {
        struct Growing : Touches {
            Buffer<Touch>* buffer;
        } touches;
        Portion& portion = m.portions[task];
        touches.buffer = &portion.touches;
        touches.data = portion.touches.data();
        touches.count = 0;
        touches.capacity = portion.touches.capacity();
        touches.grow = [](Touches* self, size_t room) {
            Growing& t = *static_cast<Growing*>(self);
            if (t.count + room >= UINT32_MAX)
                throw std::length_error("the Gaussians touch more tiles than 32 bits can count: draw fewer or smaller ones, or a "
                                        "smaller picture");
            t.data = t.buffer->grow(2 * t.capacity + room, t.count);
            t.capacity = t.buffer->capacity();
        };
        const int64_t first = task * portion_size_, last = std::min(count, first + portion_size_);
        portion.begin.resize(size_t(last - first) + 1);
        kernels_.project(gaussians, view, tiling_, first, last, m.splats.data(), m.depths.data(), touches, portion.begin.data());
    });
    uint64_t slot = 0;
    for (int64_t task = 0; task < portions_; ++task) {
        m.portions[task].first_slot = slot;
        slot += m.portions[task].begin[std::min(portion_size_, count - task * portion_size_)];
    }
    if (slot >= UINT32_MAX)
        throw std::length_error("the Gaussians touch " + std::to_string(slot) +
                                " tiles, more than 32 bits can count: draw fewer or smaller ones, or a smaller picture");
    touches_ = int64_t(slot);
}

void Drawing::sort() {
    Workspace& m = *memory_;
    m.order.resize(size_t(gaussians.count));
    m.spare.resize(size_t(gaussians.count));
    drawn_ = 0;
    for (int64_t i = 0; i < gaussians.count; ++i) {
        DepthKey key{0, uint32_t(i)};
        std::memcpy(&key.depth, &m.depths[i], sizeof key.depth);
        m.order[drawn_] = key;
        drawn_ += m.depths[i] > 0;
    }
    sort_by_depth(m.order, m.spare, drawn_);
}

// Puts each Gaussian into the lists of its tiles, front to back: runs of the sorted Gaussians count what they will add to
// each list, and then each run writes from where those before it end.
void Drawing::list(int threads) {
    Workspace& m = *memory_;
    const size_t tiles = size_t(tiling_.across) * tiling_.down;
    const int64_t runs = std::min(threads > 1 ? int64_t(threads) * kPortionsPerThread : 1, tasks_of(drawn_, kFewestGaussians));
    m.counts.resize(size_t(runs) * tiles);
    m.starts.resize(tiles + 1);
    m.entries.resize(size_t(touches_));
    const auto each_touch = [&](int64_t run, const auto& take) {
        const int64_t last = drawn_ * (run + 1) / runs;
        for (int64_t k = drawn_ * run / runs; k < last; ++k) {
            const uint32_t i = m.order[k].index;
            const Portion& portion = m.portions[i / portion_size_];
            const uint32_t* begin = portion.begin.data() + i % portion_size_;
            for (uint32_t t = begin[0]; t < begin[1]; ++t) take(portion.touches[t], i, uint32_t(portion.first_slot + t));
        }
    };
    parallel(runs, threads, [&](int64_t run) {
        uint32_t* counts = m.counts.data() + size_t(run) * tiles;
        std::memset(counts, 0, tiles * sizeof(uint32_t));
        each_touch(run, [&](const Touch& touch, uint32_t, uint32_t) { ++counts[touch.tile]; });
    });
    uint64_t total = 0;
    for (size_t tile = 0; tile < tiles; ++tile) {
        m.starts[tile] = total;
        for (int64_t run = 0; run < runs; ++run) {
            uint32_t& count = m.counts[size_t(run) * tiles + tile];
            const uint32_t here = count;
            count = uint32_t(total);
            total += here;
        }
    }
    m.starts[tiles] = total;
    parallel(runs, threads, [&](int64_t run) {
        uint32_t* next = m.counts.data() + size_t(run) * tiles;
        each_touch(run, [&](const Touch& touch, uint32_t i, uint32_t slot) {
            m.entries[next[touch.tile]++] = {i, slot, touch.blocks};
        });
    });
}

void Drawing::backward(const float* gradient, int threads, const GaussianGradients& out, bool edges) {
    const std::lock_guard<std::mutex> guard(in_backward_);
    Workspace& m = *memory_;
    const int64_t tiles = int64_t(tiling_.across) * tiling_.down, state = 4 * tiling_.width * tiling_.height;
    m.moments.resize(size_t(touches_) * kMoments);
    const auto backward_tile = edges ? kernels_.backward_tile_with_edges : kernels_.backward_tile;
    parallel(tiles, threads, [&](int64_t tile) {
        backward_tile(m.splats.data(), m.entries.data() + m.starts[tile], int64_t(m.starts[tile + 1] - m.starts[tile]), view,
                      int(tile % tiling_.across) * tiling_.width, int(tile / tiling_.across) * tiling_.height,
                      m.states.data() + tile * state, gradient, m.moments.data());
    });
    parallel(portions_, threads, [&](int64_t task) {
        const Portion& portion = m.portions[task];
        const int64_t first = task * portion_size_, last = std::min(gaussians.count, first + portion_size_);
        kernels_.project_backward(gaussians, view, first, last, m.moments.data() + portion.first_slot * kMoments,
                                  portion.begin.data(), out);
    });
}

}  // namespace gs
