// Draws the scene of standard input by the 4-wide kernels and writes pictures and gradients to standard output: what
// test_neon.py runs on an emulated ARM processor.  Everything is little-endian float32 but the camera (float64) and counts (int32).
#include <cstdio>
#include <cstdlib>
#include <vector>

#include "averages.hpp"
#include "deformation.hpp"
#include "drawing.hpp"
#include "loss.hpp"

namespace {

template <class T>
std::vector<T> read(size_t count) {
    std::vector<T> values(count);
    if (std::fread(values.data(), sizeof(T), count, stdin) != count) std::exit(2);
    return values;
}

void write(const std::vector<float>& values) {
    if (std::fwrite(values.data(), sizeof(float), values.size(), stdout) != values.size()) std::exit(3);
}

}  // namespace

int main() {
    const auto sizes = read<int32_t>(6);  // Gaussians, width, height, threads, latent, field values
    const size_t count = size_t(sizes[0]), pixels = size_t(sizes[1]) * size_t(sizes[2]);
    const int threads = sizes[3], latent = sizes[4], values = sizes[5];
    const auto camera = read<double>(18);  // rotation, translation, fx, fy, cx, cy, near, dilation
    gs::View view{};
    for (int k = 0; k < 9; ++k) view.rotation[k] = camera[size_t(k)];
    for (int k = 0; k < 3; ++k) view.translation[k] = camera[9 + size_t(k)];
    view.fx = camera[12], view.fy = camera[13], view.cx = camera[14], view.cy = camera[15];
    view.near = camera[16], view.dilation = camera[17];
    view.width = sizes[1], view.height = sizes[2], view.alpha_floor = 1.0f / 255.0f, view.alpha_cap = 0.999f;
    view.min_transmittance = 1e-4f, view.frame_margin = 0.15, view.shortest_quaternion = 1e-12;
    view.background[0] = 1.0f, view.background[1] = 0.5f, view.background[2] = 0.25f;
    const auto means = read<float>(3 * count), scales = read<float>(3 * count), quats = read<float>(4 * count);
    const auto opacities = read<float>(count), colors = read<float>(3 * count);
    const auto gradient = read<float>(4 * pixels), target = read<float>(4 * pixels);
    const auto latents = read<float>(count * size_t(latent)), modes = read<float>(size_t(latent) * 14);
    const auto other_latents = read<float>(count * size_t(latent)), other_modes = read<float>(size_t(latent) * 23);
    const auto weights = read<float>(count * size_t(values)), changes = read<float>(4 * size_t(values)), logits = read<float>(count);
    const auto by_logits = read<float>(count), by_new_colors = read<float>(3 * count);
    const auto carried = read<float>(2 * count);

    std::vector<float> picture(4 * pixels);
    const gs::Gaussians gaussians{means.data(), scales.data(), quats.data(), opacities.data(), colors.data(), int64_t(count)};
    gs::Drawing drawing(gaussians, view, gs::kernels_baseline, threads, picture.data());
    write(picture);

    std::vector<float> by_means(3 * count), by_scales(3 * count), by_quats(4 * count), by_opacities(count), by_colors(3 * count);
    drawing.backward(gradient.data(), threads,
                     {by_means.data(), by_scales.data(), by_quats.data(), by_opacities.data(), by_colors.data()});
    for (const auto* values : {&by_means, &by_scales, &by_quats, &by_opacities, &by_colors}) write(*values);

    std::vector<float> by_picture(4 * pixels);
    const gs::ImagePair pair{picture.data(), target.data(), nullptr, sizes[2], sizes[1], 4, 4};
    const gs::ImageLoss loss = gs::image_loss(pair, 0.2, gs::kernels_baseline, threads, by_picture.data());
    write({float(loss.difference), float(loss.similarity)});
    write(by_picture);

    std::vector<float> moved[5];
    gs::ParameterTable<const float> base{{means.data(), scales.data(), quats.data(), opacities.data(), colors.data()}, {3, 3, 4, 1, 3}};
    gs::ParameterTable<float> out{{}, {3, 3, 4, 1, 12}};
    for (int k = 0; k < 5; ++k) {
        moved[k].resize(count * size_t(out.widths[k]));
        out.parts[k] = moved[k].data();
    }
    const gs::Product products[2] = {{latents.data(), modes.data(), latent, 14},
                                     {other_latents.data(), other_modes.data(), latent, 23}};
    gs::add_bilinear(products, 2, int64_t(count), base, gs::kernels_baseline, threads, out);
    for (const auto& numbers : moved) write(numbers);

    std::vector<float> new_logits(count), new_colors(3 * count), by_weights(count * size_t(values));
    const gs::Transfer transfer{weights.data(), logits.data(), colors.data(), values, 3, {0.1f, 0.0f, 0.3f}, {0.8f, 0.9f, 0.5f}, 1e-4f,
                                nullptr, 0};
    gs::apply_transfer(transfer, changes.data(), int64_t(count), gs::kernels_baseline, threads, new_logits.data(), new_colors.data());
    gs::transfer_gradient(transfer, changes.data(), int64_t(count), by_logits.data(), by_new_colors.data(), gs::kernels_baseline,
                          threads, by_weights.data());
    for (const auto* numbers : {&new_logits, &new_colors, &by_weights}) write(*numbers);

    // the function that is 0.5 up to 0.2 and falls to 0.1 at 0.8, in two colours
    const double places[2] = {0.2, 0.8}, columns[8] = {0.5, 0.1, 0.2, 0.3, 0.1, 0.08, 0.02, 0.05};
    gs::Averaged averaged{};
    averaged.levels = gs::levels_of(-0.5, 1.5, 0.004, 0.6);
    std::vector<float> table(size_t(averaged.levels.first[averaged.levels.count]) * gs::kCellTerms * gs::kChanges);
    gs::average_table(places, columns, 2, averaged.levels, gs::kernels_baseline, table.data());
    averaged.table = table.data(), averaged.logits = logits.data(), averaged.values = carried.data();
    averaged.dark = 1e-6f, averaged.least_depth = 1e-4f, averaged.most_depth = 12.0f;
    for (float& high : averaged.high) high = 1.0f;
    std::vector<float> shown(count), shown_colors(3 * count), by_thickness(count), by_carried(2 * count);
    gs::apply_averages(averaged, int64_t(count), gs::kernels_baseline, threads, shown.data(), shown_colors.data());
    gs::averages_gradient(averaged, int64_t(count), by_logits.data(), by_new_colors.data(), gs::kernels_baseline, threads,
                          by_thickness.data(), by_carried.data());
    for (const auto* numbers : {&shown, &shown_colors, &by_thickness, &by_carried}) write(*numbers);
    return 0;
}
