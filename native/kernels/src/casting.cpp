#include "casting.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "parallel.hpp"

namespace gs {
namespace {

constexpr int kTile = 32;             // pixels along a side, a multiple of a packet's
constexpr double kFarthest = 1e6;     // of values, so that single precision never overflows
constexpr int kFewestCells = 64, kMostParts = 4096;
constexpr int kFarthestBrick = 16;
constexpr int64_t kMostGradientParts = 8, kMostPartBytes = int64_t(1) << 28;  // all parts together

// Distances by the largest difference of coordinates, from those of the bricks that are 0: one axis after the other.
void spread_distances(const int bricks[3], std::vector<uint8_t>& distances) {
    const int64_t strides[3] = {1, bricks[0], int64_t(bricks[0]) * bricks[1]};
    std::vector<uint8_t> line;
    for (int axis = 0; axis < 3; ++axis) {
        const int length = bricks[axis];
        for (size_t k = 0; k < distances.size(); ++k) {
            if ((int64_t(k) / strides[axis]) % length) continue;
            uint8_t* first = distances.data() + k;
            line.assign(size_t(length), kFarthestBrick);
            for (int i = 0; i < length; ++i)
                for (int j = std::max(0, i - kFarthestBrick); j < std::min(length, i + kFarthestBrick + 1); ++j)
                    line[size_t(i)] = std::min(line[size_t(i)], std::max(first[j * strides[axis]], uint8_t(std::abs(i - j))));
            for (int i = 0; i < length; ++i) first[i * strides[axis]] = line[size_t(i)];
        }
    }
}

int64_t tiles_of(const CastRays& rays) {
    return int64_t((rays.width + kTile - 1) / kTile) * ((rays.height + kTile - 1) / kTile);
}

void box_of(const CastRays& rays, int64_t tile, int box[4]) {
    const int across = (rays.width + kTile - 1) / kTile;
    box[0] = int(tile % across) * kTile, box[1] = int(tile / across) * kTile;
    box[2] = std::min(box[0] + kTile, rays.width), box[3] = std::min(box[1] + kTile, rays.height);
}

template <class Draw>
void in_tiles(const CastRays& rays, int threads, const Draw& draw) {
    parallel(tiles_of(rays), threads, [&](int64_t tile) {
        int box[4];
        box_of(rays, tile, box);
        draw(box);
    });
}

}  // namespace

PaddedField::PaddedField(const float* values, const bool* holes, const int size[3], double low, double high,
                         int threads) {
    CastField& f = field;
    std::copy(size, size + 3, f.size);
    f.row = size[0] + 2;
    f.slice = f.row * (size[1] + 2);
    for (int k = 0; k < 3; ++k) f.bricks[k] = (size[k] + kBrick) / kBrick;  // of size + 1 cells
    f.brick_row = f.bricks[0];
    f.brick_slice = f.bricks[0] * f.bricks[1];
    const int64_t cells = int64_t(f.slice) * (size[2] + 1), bricks = int64_t(f.brick_slice) * f.bricks[2];
    float* pairs = pairs_.resize(size_t(2 * cells));
    uint8_t* hidden = holes ? hidden_.resize(size_t(cells)) : nullptr;
    float *least = least_.resize(size_t(bricks)), *most = most_.resize(size_t(bricks));
    const int64_t row = size[0], slice = int64_t(size[0]) * size[1];
    const double per_unit = 1.0 / (high - low);
    const auto drawn = [&](float value) { return float(std::clamp((double(value) - low) * per_unit, -kFarthest, kFarthest)); };
    parallel(size[2], threads, [&](int64_t z) {  // every slice is the first of one's pairs and the second of another's
        for (int64_t y = 0; y < size[1]; ++y) {
            const float* from = values + z * slice + y * row;
            float* first = pairs + 2 * ((z + 1) * f.slice + (y + 1) * f.row + 1);
            for (int64_t x = 0; x < size[0]; ++x) first[2 * x] = first[2 * x - 2 * int64_t(f.slice) + 1] = drawn(from[x]);
        }
    });
    const auto put = [&](int64_t at, float value) {
        if (at < cells) pairs[2 * at] = value;
        if (at >= f.slice) pairs[2 * (at - f.slice) + 1] = value;
    };
    const auto sample = [&](int64_t at) { return at < cells ? pairs[2 * at] : pairs[2 * (at - f.slice) + 1]; };
    // repetitions beyond the ends of each axis, those of the axes before included
    const int64_t steps[3] = {1, f.row, f.slice}, lengths[3] = {f.row, size[1] + 2, size[2] + 2};
    for (int axis = 0; axis < 3; ++axis) {
        const int u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;  // those before this axis have their ends
        for (int64_t j = v < axis ? 0 : 1; j < lengths[v] - (v < axis ? 0 : 1); ++j)
            for (int64_t i = u < axis ? 0 : 1; i < lengths[u] - (u < axis ? 0 : 1); ++i) {
                const int64_t line = i * steps[u] + j * steps[v], step = steps[axis], last = line + (lengths[axis] - 1) * step;
                put(line, sample(line + step));
                put(last, sample(last - step));
            }
    }
    if (hidden) {
        const auto corner = [&](int k, int64_t at) { return std::clamp<int64_t>(at - 1, 0, size[k] - 2); };
        parallel(size[2] + 1, threads, [&](int64_t z) {
            for (int64_t y = 0; y < size[1] + 2; ++y)
                for (int64_t x = 0; x < f.row; ++x) {
                    const bool* at = holes + corner(2, z) * slice + corner(1, y) * row + corner(0, x);
                    bool found = false;
                    for (const bool* side : {at, at + slice})
                        found = found || side[0] || side[1] || side[row] || side[row + 1];
                    hidden[z * f.slice + y * f.row + x] = found;
                }
        });
    }
    f.pairs = pairs;
    f.hidden = hidden;
    parallel(f.bricks[2], threads, [&](int64_t bz) {
        float *low_of = least + bz * f.brick_slice, *high_of = most + bz * f.brick_slice;
        std::fill(low_of, low_of + f.brick_slice, std::numeric_limits<float>::infinity());
        std::fill(high_of, high_of + f.brick_slice, -std::numeric_limits<float>::infinity());
        const int64_t end = std::min<int64_t>(kBrick * (bz + 1), size[2] + 1);
        for (int64_t z = kBrick * bz; z < end; ++z)
            for (int64_t y = 0; y < size[1] + 2; ++y)
                for (int64_t by = std::max<int64_t>(0, (y - 1) / kBrick); by <= y / kBrick && by < f.bricks[1]; ++by)
                    for (int64_t bx = 0; bx < f.bricks[0]; ++bx) {
                        const float* at = pairs + 2 * (z * f.slice + y * f.row + kBrick * bx);
                        const int64_t count = 2 * std::min<int64_t>(kBrick + 1, f.row - kBrick * bx);
                        float &l = low_of[by * f.brick_row + bx], &h = high_of[by * f.brick_row + bx];
                        for (int64_t k = 0; k < count; ++k) l = std::min(l, at[k]), h = std::max(h, at[k]);
                    }
    });
}

template <class Seen>
std::vector<uint8_t> PaddedField::clear_bricks(const Seen& seen) const {
    std::vector<uint8_t> clear(size_t(field.brick_slice) * size_t(field.bricks[2]));
    bool found = false;
    for (size_t k = 0; k < clear.size(); ++k) {
        clear[k] = seen(least_[k], most_[k]) ? 0 : kFarthestBrick;
        found = found || clear[k];
    }
    if (found)
        spread_distances(field.bricks, clear);
    else
        clear.clear();
    return clear;
}

SegmentedFunction::SegmentedFunction(const double* knots, int64_t count, const PaddedField& padded) {
    const double* last = knots + 5 * (count - 1);
    const double before[5] = {std::min(knots[0], 0.0), knots[1], knots[2], knots[3], knots[4]};
    const double behind[5] = {std::max(last[0], 2.0), last[1], last[2], last[3], last[4]};
    add(before, knots, {0, 0});
    for (int64_t k = 0; k + 1 < count; ++k) add(knots + 5 * k, knots + 5 * (k + 1), {k, k + 1});
    add(last, behind, {count - 1, count - 1});
    function.count = int(begins_.size());
    begins_.push_back(std::numeric_limits<float>::infinity());
    if (function.count <= kShortFunction) {
        float* columns = columns_.resize(size_t(kSegmentColumns * kShortFunction));
        std::fill(columns, columns + kShortFunction, std::numeric_limits<float>::infinity());  // places that no value reaches
        std::fill(columns + kShortFunction, columns + kSegmentColumns * kShortFunction, 0.0f);
        for (int s = 0; s < function.count; ++s)
            for (int k = 0; k < kSegmentColumns; ++k) columns[k * kShortFunction + s] = rows_[size_t(s * kSegmentColumns + k)];
        function.columns = columns;
    }
    divide();
    clear_ = padded.clear_bricks([this](float low, float high) { return most_opacity(low, high) > 0.0f; });
    function.rows = rows_.data();
    function.begins = begins_.data();
    function.first = first_.data();
    function.clear = clear_.empty() ? nullptr : clear_.data();
}

// A segment between two knots, none where single precision does not tell them apart.
void SegmentedFunction::add(const double* from, const double* to, Ends ends) {
    const float begin = float(from[0]), end = float(to[0]);
    if (!(begin < end)) return;
    begins_.push_back(begin);
    const double length = double(end) - begin;
    lengths_.push_back(length);
    ends_.push_back(ends);
    double slopes[5];
    for (int k = 1; k < 5; ++k) slopes[k] = (to[k] - from[k]) / length;
    const double row[kSegmentColumns] = {begin,   from[1], slopes[1], 0, from[2],   from[3],
                                         from[4], 0,       slopes[2], slopes[3], slopes[4], 0};
    for (double number : row) rows_.push_back(float(number));
}

void SegmentedFunction::by_knots(const double* by_segments, double* out) const {
    for (size_t s = 0; s < ends_.size(); ++s)
        for (int k = 0; k < 4; ++k) {
            const double by_end = by_segments[8 * s + 4 + size_t(k)] / lengths_[s];
            out[4 * ends_[s].from + k] += by_segments[8 * s + size_t(k)] - by_end;
            out[4 * ends_[s].to + k] += by_end;
        }
}

// Equal parts of 0 to 1, fine enough that few have a second place inside.
void SegmentedFunction::divide() {
    for (function.cells = kFewestCells; ; function.cells *= 2) {
        first_.assign(size_t(function.cells) + 1, 0);
        function.most = 0;
        int segment = 0;
        for (int cell = 0; cell <= function.cells; ++cell) {
            const float low = float(cell) / float(function.cells), high = float(cell + 1) / float(function.cells);
            while (begins_[size_t(segment) + 1] <= low) ++segment;
            first_[size_t(cell)] = segment;
            int inside = 0;
            while (begins_[size_t(segment + inside) + 1] < high) ++inside;
            function.most = std::max(function.most, inside);
        }
        if (function.most <= 1 || function.cells >= kMostParts) return;
    }
}

float SegmentedFunction::most_opacity(float low, float high) const {
    low = std::clamp(low, 0.0f, 1.0f), high = std::clamp(high, 0.0f, 1.0f);
    float most = 0.0f;
    for (int s = 0; s < function.count; ++s) {
        const float begin = begins_[size_t(s)], end = begins_[size_t(s) + 1];
        if (begin > high || end < low) continue;
        const float* row = rows_.data() + size_t(s) * kSegmentColumns;
        for (float at : {std::max(begin, low), std::min(end, high)}) most = std::max(most, row[1] + (at - begin) * row[2]);
    }
    return most;
}

void cast_volume(const CastField& field, const CastFunction& function, const CastRays& rays, const Kernels& kernels, int threads,
                 float* picture) {
    in_tiles(rays, threads, [&](const int box[4]) { kernels.cast_tile(field, function, rays, box, picture); });
}

// Tiles are dealt to a number of parts that does not depend on the threads; each adds to its own memory.
void cast_gradient(const CastField& field, const CastFunction& function, const CastRays& rays, const float* picture,
                   const float* gradient, const Kernels& kernels, int threads, float* by_values, double* by_segments) {
    const size_t samples = size_t(field.size[0]) * size_t(field.size[1]) * size_t(field.size[2]), segments = 8 * size_t(function.count);
    const int64_t parts = std::clamp<int64_t>(kMostPartBytes / int64_t(samples * sizeof(float)), 1, kMostGradientParts);
    std::vector<float> values(samples * size_t(parts));
    std::vector<double> tables(segments * size_t(parts));
    const int64_t tiles = tiles_of(rays);
    parallel(parts, threads, [&](int64_t part) {
        const CastGradient out{picture, gradient, values.data() + samples * size_t(part), tables.data() + segments * size_t(part)};
        for (int64_t tile = part; tile < tiles; tile += parts) {
            int box[4];
            box_of(rays, tile, box);
            kernels.tile_backward(field, function, rays, box, out);
        }
    });
    std::fill_n(by_segments, segments, 0.0);
    for (size_t k = 0; k < tables.size(); ++k) by_segments[k % segments] += tables[k];
    const int64_t slices = field.size[2], slice = int64_t(samples) / slices;
    parallel(slices, threads, [&](int64_t z) {
        for (int64_t k = z * slice; k < (z + 1) * slice; ++k) {
            float total = 0.0f;
            for (int64_t part = 0; part < parts; ++part) total += values[samples * size_t(part) + size_t(k)];
            const int64_t y = k % slice / field.size[0], x = k % field.size[0];
            const float value = field.pairs[2 * ((z + 1) * field.slice + (y + 1) * field.row + x + 1)];
            by_values[k] = std::abs(value) < float(kFarthest) ? total : 0.0f;  // those further out are held
        }
    });
}

}  // namespace gs
