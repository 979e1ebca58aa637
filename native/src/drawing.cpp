#include "drawing.hpp"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>

#include "parallel.hpp"

namespace gs {
namespace {

constexpr int64_t kProjected = 1024;    // Gaussians that a task projects
constexpr int kPortionsPerThread = 4;
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

Drawing::Drawing(const Gaussians& g, const View& v, const Kernels& kernels, int threads, float* color, float* alpha)
    : gaussians(g), view(v), kernels_(kernels), memory_(take_workspace()) {
    if (g.count >= int64_t(UINT32_MAX)) throw std::length_error("more Gaussians than 32 bits can count");
    tiling_ = {int(tasks_of(v.width, kernels.tile_width)), int(tasks_of(v.height, kernels.tile_height)), kernels.tile_width,
               kernels.tile_height};
    project(threads);
    cut(threads);
    list(threads);
    Workspace& m = *memory_;
    const int64_t tiles = int64_t(tiling_.across) * tiling_.down, state = 4 * tiling_.width * tiling_.height;
    m.states.resize(size_t(tiles * state));
    parallel(tiles, threads, [&](int64_t tile) {
        kernels_.forward_tile(m.splats.data(), m.entries.data() + m.starts[tile], int64_t(m.starts[tile + 1] - m.starts[tile]),
                              view, int(tile % tiling_.across) * tiling_.width, int(tile / tiling_.across) * tiling_.height,
                              m.states.data() + tile * state, color, alpha);
    });
}

Drawing::~Drawing() { give_workspace(std::move(memory_)); }

void Drawing::project(int threads) {
    Workspace& m = *memory_;
    const int64_t count = gaussians.count;
    m.projected.resize(size_t(count));
    m.depths.resize(size_t(count));
    parallel(tasks_of(count, kProjected), threads, [&](int64_t task) {
        kernels_.project(gaussians, view, task * kProjected, std::min(count, (task + 1) * kProjected), m.projected.data(),
                         m.depths.data());
    });
    m.order.resize(size_t(count));
    m.spare.resize(size_t(count));
    drawn_ = 0;
    for (int64_t i = 0; i < count; ++i) {
        DepthKey key{0, uint32_t(i)};
        std::memcpy(&key.depth, &m.depths[i], sizeof key.depth);
        m.order[drawn_] = key;
        drawn_ += m.depths[i] > 0;
    }
    sort_by_depth(m.order, m.spare, drawn_);
}

// Finds the tiles of each drawn Gaussian, in portions of the sorted ones, and counts the tiles' entries.
void Drawing::cut(int threads) {
    Workspace& m = *memory_;
    const size_t tiles = size_t(tiling_.across) * tiling_.down;
    const int64_t most = threads > 1 ? int64_t(threads) * kPortionsPerThread : 1;
    const int64_t portions = std::min(most, tasks_of(drawn_, 256));
    m.splats.resize(size_t(drawn_));
    m.first_slot.resize(size_t(drawn_) + 1);
    m.portions.resize(size_t(std::max<int64_t>(portions, int64_t(m.portions.size()))));
    for (Portion& portion : m.portions) portion.first = portion.last = 0;
    parallel(portions, threads, [&](int64_t task) {
        Portion& p = m.portions[task];
        p.first = drawn_ * task / portions;
        p.last = drawn_ * (task + 1) / portions;
        p.touched = 0;
        p.counts.resize(tiles);
        std::memset(p.counts.data(), 0, tiles * sizeof(uint32_t));
        p.touches.resize(tiles);
        for (int64_t k = p.first; k < p.last; ++k) {
            m.splats[k] = m.projected[m.order[k].index];
            if (p.touches.capacity() < p.touched + tiles) p.touches.grow(2 * p.touches.capacity() + tiles, p.touched);
            Touch* touches = p.touches.data() + p.touched;
            const int64_t count = kernels_.touch(m.splats[k], view, tiling_, touches);
            for (int64_t t = 0; t < count; ++t) ++p.counts[touches[t].tile];
            m.first_slot[k] = p.touched;  // within the portion, so far
            p.touched += size_t(count);
        }
    });
}

// Puts each Gaussian into the lists of its tiles.  The order within a list is that of depth, whatever the portions were.
void Drawing::list(int threads) {
    Workspace& m = *memory_;
    const size_t tiles = size_t(tiling_.across) * tiling_.down;
    std::vector<Portion*> portions;
    for (Portion& portion : m.portions)
        if (portion.last > portion.first) portions.push_back(&portion);
    uint64_t total = 0;
    for (Portion* portion : portions) total += portion->touched;
    if (total >= UINT32_MAX)
        throw std::length_error("the Gaussians touch " + std::to_string(total) +
                                " tiles, more than 32 bits can count: draw fewer or smaller ones, or a smaller picture");
    m.starts.resize(tiles + 1);
    total = 0;
    for (size_t tile = 0; tile < tiles; ++tile) {
        m.starts[tile] = total;
        for (Portion* portion : portions) {
            const uint32_t here = portion->counts[tile];
            portion->counts[tile] = uint32_t(total);
            total += here;
        }
    }
    m.starts[tiles] = total;
    touches_ = int64_t(total);
    m.entries.resize(size_t(total));
    uint64_t slot = 0;
    std::vector<uint64_t> first_slots;
    for (Portion* portion : portions) {
        first_slots.push_back(slot);
        slot += portion->touched;
    }
    m.first_slot[drawn_] = total;
    parallel(int64_t(portions.size()), threads, [&](int64_t task) {
        Portion& p = *portions[task];
        size_t touch = 0;
        for (int64_t k = p.first; k < p.last; ++k) {
            const size_t end = k + 1 < p.last ? m.first_slot[k + 1] : p.touched;
            m.first_slot[k] += first_slots[task];
            for (; touch < end; ++touch) {
                const Touch& t = p.touches[touch];
                m.entries[p.counts[t.tile]++] = {uint32_t(k), uint32_t(first_slots[task] + touch), t.blocks};
            }
        }
    });
}

void Drawing::backward(const float* grad_color, const float* grad_alpha, int threads, const GaussianGradients& out) {
    const std::lock_guard<std::mutex> guard(in_backward_);
    Workspace& m = *memory_;
    const int64_t tiles = int64_t(tiling_.across) * tiling_.down, state = 4 * tiling_.width * tiling_.height;
    m.moments.resize(m.starts[tiles] * kMoments);
    parallel(tiles, threads, [&](int64_t tile) {
        kernels_.backward_tile(m.splats.data(), m.entries.data() + m.starts[tile], int64_t(m.starts[tile + 1] - m.starts[tile]),
                               view, int(tile % tiling_.across) * tiling_.width, int(tile / tiling_.across) * tiling_.height,
                               m.states.data() + tile * state, grad_color, grad_alpha, m.moments.data());
    });
    parallel(tasks_of(drawn_, kProjected), threads, [&](int64_t task) {
        for (int64_t k = task * kProjected; k < std::min(drawn_, (task + 1) * kProjected); ++k)
            kernels_.project_backward(gaussians, view, m.order[k].index, m.moments.data() + m.first_slot[k] * kMoments,
                                      int64_t(m.first_slot[k + 1] - m.first_slot[k]), out);
    });
}

}  // namespace gs
