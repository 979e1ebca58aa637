"""C++ kernels behind plain arrays, with gradients: splatting, image loss, bilinear offsets, transfer functions, blended values,
opacities along rays, colours by direction and light, fields along rays, steps of Adam.

No torch or logic.  Arrays are float32 and C-contiguous (others are
copied); the same input gives bitwise the same output for any number of threads.

    forward(gaussians, world_to_camera, intrinsics, size, constants, threads, instruction_set="", background=(0, 0, 0))
            -> Drawing, with its picture (H, W, 4): colours over the background, and alpha
            gaussians: means, scales, quats, opacities, colors; intrinsics: fx, fy, cx, cy; size: width, height; constants:
            those of `surrogate.splatting.Constants`, in its order
    backward(drawing, gradient, threads, edges=False)
            -> gradients by means, scales, quats, opacities, colors
    image_loss(image, target, ssim_weight, threads, instruction_set="")
            -> mean absolute difference, mean SSIM, gradient of difference - ssim_weight SSIM by image (H, W, C)
            target: floats, or bytes that are 255 times as large; channels that only the image has are not compared
    add_bilinear(factors, rows, threads, instruction_set="") -> (rows + latents @ modes) + latents @ modes ...
            factors: one or two pairs of latents (N, L) and modes (L, columns), added one after the other
            rows: five arrays (N, width) or (N,), side by side; the last one, and the modes, end in zeros where they are narrower
    bilinear_gradients(latents, modes, gradients, threads, instruction_set="")
            -> gradients by latents (N, L) and by modes (L, columns), from those by the five arrays
    transfer(weights, changes, logits, colors, low, high, least_depth, threads, instruction_set="")
            -> logits (N,) and colors (N, 3 or more) of Gaussians under a changed transfer function
            weights (N, B), of which the absolute values count; changes (B, 4); low and high: three numbers each
    transfer_gradient(weights, changes, logits, colors, low, high, least_depth, by_logits, by_colors, threads, instruction_set="")
            -> gradient by the weights (N, B)
    extinction_table(values, color_points, opacity_points, samples, most_opaque)
            -> extinctions, and those times colours (B, 4), float64
            values (B,) increasing; control points (P, 4) and (Q, 2), a field value first, increasing
    averages(places, columns, ranges, instruction_set="") -> table (cells, 8, 4)
            of the function that is linear between places (K,), never decreasing, with columns (K, 4), both float64: its average
            under N(u, s²).  ranges: lowest and highest u, least and most s.  One level follows the other, at equal steps of
            ln s, 0.15 at most; a level has cells 0.7 s wide; a cell has the coefficients of a polynomial in 0 to 1
    apply_averages(table, ranges, logits, values, low, high, limits, threads, instruction_set="")
            -> logits (N,) and colors (N, 3) of Gaussians with logits (N,) of thickness and values (N, 2), u and ln s
            limits: the least extinction that a colour is divided by, the least and the most optical depth
    apply_averages_gradient(table, ranges, logits, values, low, high, limits, by_logits, by_colors, threads, instruction_set="")
            -> gradients by logits (N,) and values (N, 2)
    blend(gaussians, places, reach, instruction_set="") -> Blend, with its values (Q,), float64, and the number of its pairs
            gaussians: means, scales, quats, weights (N,), values (N,); places (Q, 3); a value is not a number where no Gaussian of
            any weight is in reach
    blend_gradients(blend, gradient, shapes)
            -> gradients by weights and values (N,) from those by the blended values (Q,); with `shapes`, by means, scales and
            quats before
    ray_opacities(gaussians, position, shortest_quaternion, threads, instruction_set="")
            -> opacities (N,) along the rays from a position (3,) through the centres
            gaussians: means, log_scales, quats, logits (N,); quaternions not longer than the shortest stand for the identity
    ray_opacities_gradient(gaussians, position, shortest_quaternion, by_opacities, threads, instruction_set="")
            -> gradients by means, log_scales, quats, logits
    directional_colors(means, colors, position, threads, instruction_set="")
            -> colours (N, 3) as seen from a position (3,), of means (N, 3) and coefficients (N, 12)
    directional_colors_gradient(means, colors, position, by_seen, threads, instruction_set="")
            -> gradients by means and coefficients, from those by the colours that are seen (N, 3)
    lit_colors(means, normals, light, position, threads, instruction_set="")
            -> colours (N, 3) as seen from a position (3,), of means (N, 3) on surfaces of normals (N, 3)
            light: red, green, blue, ambient, diffuse, specular, specular power, as `surrogate.lighting.Lighting` has them
    lit_colors_gradient(means, normals, light, position, by_colors, threads, instruction_set="")
            -> gradients by means and normals, from those by the colours (N, 3)
    cast_field(values, holes, low, high, threads) -> CastField
            values (nz, ny, nx), of which low and high become 0 and 1; holes: bool, of the same shape, or None
    cast_volume(field, knots, distances, light, rays, size, threads, bounds=None, instruction_set="") -> picture (H, W, 4)
            knots (K, 5): places increasing from 0 to 1, opacity, red, green, blue; distances: between samples, and of opacities
            light: None, or ambient, diffuse, specular, power; rays (5, 3): see `native.ray_casting.fields`; size: width, height
            bounds (2, 3): the lowest and highest place in samples where rays begin and end
    cast_gradient(field, knots, distances, rays, picture, gradient, every, threads, instruction_set="")
            -> gradients by the values drawn (nz, ny, nx) and by opacity, red, green and blue of the knots (K, 4), of a picture
            without a light and from a gradient by it (H, W, 4); without every, that by knots lacks steps of opacity 0
    draw_surface(places, normals, corners, color, light, samples, rays, size, threads, instruction_set="")
            -> picture (H, W, 4) of triangles with these corners (T, 3), rows of the places (V, 3), in the field's samples, and of
            normals (V, 3); samples: along each side of a pixel, 1, 2 or 4; rays and size: of the samples
    step_rows(tensor, gradient, first, second, steps, rate, instruction_set="")
            changes tensor, both moments, of one shape (N, ...), and steps (N,) in place, where a row of the gradient is not zero
    instruction_sets() -> names, the best of this machine first; "" stands for what the environment variable
            GS_SURROGATE_INSTRUCTION_SET names, else for the best

Arguments mean what `surrogate.splatting.render`, `surrogate.training.losses.image_loss`, the modules of `surrogate.deformation` and
`surrogate.appearance`, `surrogate.training.value_loss.blended_values` and `surrogate.training.optimizer` say.  A drawing and a
blend read the Gaussians' arrays again in the backward pass: they must not have changed in between.
"""

try:
    from native.kernels._kernels import *  # noqa: F403, names and types: _kernels.pyi
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "the C++ kernels of gs-surrogate were not built, for lack of a C++ compiler or of Python's headers: install g++ and "
        "python3-dev, and gs-surrogate once more with pip install --force-reinstall --no-deps --no-cache-dir"
    ) from error
