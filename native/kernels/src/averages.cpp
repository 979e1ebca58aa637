#include "averages.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "buffer.hpp"
#include "parallel.hpp"

namespace gs {
namespace {

constexpr double kLevelStep = 0.15;  // of ln s, at most
constexpr double kShortestLine = 0.02;  // least spreads: what is shorter counts as a step in its middle, wrong by 4e-6 of it
constexpr int64_t kGaussiansPerTask = 512;

NormalTable normal_table() {
    NormalTable table{};
    for (int part = 0; part < kNormalParts; ++part)
        for (int k = 0; k < kAround; ++k) {
            const double z = kCell * (k - kAround / 2 + (part + 0.5) / kNormalParts);
            table.middle[part][k] = z;
            table.series[part][0][k] = 0.5 * std::erfc(-z * std::sqrt(0.5));
            // derivatives of the density phi: phi^(n) = -z phi^(n-1) - (n - 1) phi^(n-2)
            double derivative = std::exp(-0.5 * z * z) / std::sqrt(2.0 * std::acos(-1.0)), before = 0.0, factorial = 1.0;
            for (int n = 1; n < kNormalTerms; ++n) {
                factorial *= n;
                table.series[part][n][k] = derivative / factorial;
                const double next = -z * derivative - (n - 1) * before;
                before = derivative, derivative = next;
            }
        }
    return table;
}

std::vector<AveragedChange> changes_of(const double* places, const double* columns, int64_t count, double shortest) {
    std::vector<AveragedChange> bends(static_cast<size_t>(count)), steps;
    for (int64_t k = 0; k < count; ++k) bends[size_t(k)].place = places[k];
    for (int64_t k = 0; k + 1 < count; ++k) {
        const double width = places[k + 1] - places[k];
        const bool step = width < shortest;
        AveragedChange change{places[k] + 0.5 * width, {}, true};
        for (int c = 0; c < kChanges; ++c) {
            const double size = columns[(k + 1) * kChanges + c] - columns[k * kChanges + c];
            change.size[c] = size;
            bends[size_t(k)].size[c] += step ? 0.0 : size / width;
            bends[size_t(k + 1)].size[c] -= step ? 0.0 : size / width;
        }
        if (step) steps.push_back(change);
    }
    bends.insert(bends.end(), steps.begin(), steps.end());
    return bends;
}

}  // namespace

AverageLevels levels_of(double lowest, double highest, double least, double most) {
    AverageLevels levels{};
    levels.lowest = lowest, levels.highest = highest;
    levels.log_least = std::log(least), levels.log_most = std::log(most);
    const double range = levels.log_most - levels.log_least;
    levels.count = std::clamp(1 + int(std::ceil(range / kLevelStep)), 2, kMostLevels);
    levels.step = float(range / (levels.count - 1));
    levels.per_step = (levels.count - 1) / range;
    for (int j = 0; j < levels.count; ++j) {
        levels.per_spread[j] = std::exp(-levels.log_least - range * j / (levels.count - 1));
        levels.per_cell[j] = levels.per_spread[j] / kCell;
        levels.first[j + 1] = levels.first[j] + int64_t(std::ceil((highest - lowest) * levels.per_cell[j]));
    }
    return levels;
}

void average_table(const double* places, const double* columns, int64_t count, const AverageLevels& levels, const Kernels& kernels,
                   float* table) {
    static const NormalTable normal = normal_table();
    const double least = 1.0 / levels.per_spread[0];
    const std::vector<AveragedChange> changes = changes_of(places, columns, count, kShortestLine * least);
    AveragedChanges averaged{changes.data(), int64_t(changes.size()), {}};
    std::copy_n(columns, kChanges, averaged.left);
    Buffer<double> scratch;
    for (int j = 0; j < levels.count; ++j) {
        const int64_t cells = levels.first[j + 1] - levels.first[j];
        scratch.resize(average_scratch(cells));
        kernels.average_level(normal, averaged, levels.lowest, 1.0 / levels.per_spread[j], cells, scratch.data(),
                              table + levels.first[j] * kCellTerms * kChanges);
    }
}

void apply_averages(const Averaged& a, int64_t count, const Kernels& kernels, int threads, float* logits, float* colors) {
    parallel((count + kGaussiansPerTask - 1) / kGaussiansPerTask, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        kernels.averages(a, first, std::min(count, first + kGaussiansPerTask), logits, colors);
    });
}

void averages_gradient(const Averaged& a, int64_t count, const float* by_logits, const float* by_colors, const Kernels& kernels,
                       int threads, float* by_old_logits, float* by_values) {
    parallel((count + kGaussiansPerTask - 1) / kGaussiansPerTask, threads, [&](int64_t task) {
        const int64_t first = task * kGaussiansPerTask;
        kernels.averages_backward(a, first, std::min(count, first + kGaussiansPerTask), by_logits, by_colors, by_old_logits, by_values);
    });
}

}  // namespace gs
