"""The fragment shader code that VTK's volume mapper is given in place of its own sampling loop.

VTK's stock loop looks colours up in tables of 1024 entries that span the range of the *data*, ends rays at the
last whole step, stops at 254/255 and starts one whole step late.  These pieces evaluate the transfer function
exactly, cut each ray into equal steps from entry to exit and sample each in its middle: the midpoint rule, as in
`render.raymarch`.  VTK's tags (//VTK::...) are the documented interface for replacing parts of its shaders.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from catalogs.appearance import TransferFunction

# Shaded volumes: Phong weights of a headlight at the eye (the values of VTK's volume property).
AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER = 0.1, 0.7, 0.2, 10.0

DEEP = 50.0  # unit distances in the radius of a box from which on opacities below 1e-6 can be seen in the picture
OPAQUE = 1.0 - 1.0 / 8192.0  # where a ray ends early: what is left changes no 8-bit value

# Steps, in units of g_dirStep, from the entry to the slab exit (Kay & Kajiya 1986), made a whole number.
EQUAL_STEPS = """
  vec3 toExit = mix(in_texMin[0], in_texMax[0], greaterThan(g_dirStep, vec3(0.0))) - ip_textureCoords;
  vec3 stepsToExit = mix(vec3(1e30), toExit / g_dirStep, greaterThan(abs(g_dirStep), vec3(1e-12)));
  float inside = max(min(stepsToExit.x, min(stepsToExit.y, stepsToExit.z)), 0.0);
  float steps = max(ceil(inside - 1e-3), 1.0);
  g_dirStep *= inside / steps;
  g_rayOrigin = ip_textureCoords + 0.5 * g_dirStep;
  g_dataPos = g_rayOrigin;
  g_terminatePointMax = steps;
  g_currentT = 0.0;
  g_lengthStep = in_sampleDistance * inside / steps;
"""


def replacements(
    transfer: TransferFunction, drawn: tuple[float, float], scale: float, *, shaded: bool, holes: bool
) -> dict[str, str]:
    """VTK tag -> GLSL that takes its place, for a texture that holds `render.volume.texture_values`.

    That is the value with the `drawn` range mapped to 0 and 1 (not clamped: trilinear interpolation comes first); with
    `holes` there is a mask besides, `render.volume.hidden_cells`.
    `scale` is the number of world units in one unit of the scene (see `render.placement`).
    """
    opacity = _points_within(transfer.opacity_points, drawn)
    color = _points_within(transfer.color_points, drawn)
    functions = _piecewise("float opacityAt", opacity) + _piecewise("vec3 colorAt", color)
    unused = ("ComputeColor::Dec", "ComputeGradient::Dec", "ComputeGradientOpacity1D::Dec", "ComputeLighting::Dec")
    return {
        "//VTK::ComputeOpacity::Dec": (
            functions + DEEP_FUNCTION + (LIGHTING if shaded else "") + (HIDDEN if holes else "")
        ),
        "//VTK::BinaryMask::Impl": "",
        **{f"//VTK::{part}": "" for part in (*unused, "Shading::Init")},
        "//VTK::Terminate::Init": EQUAL_STEPS,
        "//VTK::Terminate::Impl": (
            f"if (++g_currentT >= g_terminatePointMax || g_fragColor.a > {_number(OPAQUE)}) break;\n"
        ),
        "//VTK::Shading::Impl": _sample(scale / transfer.opacity_unit_distance, shaded, holes),
    }


def _sample(exponent: float, shaded: bool, holes: bool) -> str:
    """`exponent` is the number of unit distances in one unit of the scene, which has a radius of 1."""
    deep = exponent > DEEP
    visible = f"opacity > {'0.0' if deep else '1e-6'}" + (" && !hidden()" if holes else "")
    alpha = DEEP_ALPHA if deep else "1.0 - pow(max(1.0 - opacity, 0.0), g_lengthStep * {exponent})"
    lit = "lit(color)" if shaded else "color"
    return f"""
    float value = clamp(texture3D(in_volume[0], g_dataPos).r, 0.0, 1.0);
    float opacity = opacityAt(value);
    if ({visible})
      {{
      float alpha = {alpha.format(exponent=_number(exponent))};
      vec3 color = colorAt(value);
      g_fragColor += (1.0 - g_fragColor.a) * alpha * vec4({lit}, 1.0);
      }}
"""


# 1 - (1 - opacity)**(step / unit) where rays are so many units long that single precision loses 1 - opacity: by the series
# of -log(1 - opacity) and of 1 - exp(-depth) where these are small.
DEEP_ALPHA = "alphaOf(opacity, g_lengthStep * {exponent})"
DEEP_FUNCTION = """
float alphaOf(float opacity, float steps)
{
  float absorbed = opacity < 0.01 ? opacity * (1.0 + opacity * (0.5 + opacity * (1.0 / 3.0 + opacity * 0.25)))
    : -log(max(1.0 - opacity, 1e-30));
  float depth = absorbed * steps;
  return depth < 0.01 ? depth * (1.0 - depth * (0.5 - depth * (1.0 / 6.0 - depth / 24.0))) : 1.0 - exp(-depth);
}
"""

# Whether the grid cell at g_dataPos is hidden.
HIDDEN = """
bool hidden()
{
  ivec3 size = textureSize(in_mask, 0);
  ivec3 cell = clamp(ivec3(floor(g_dataPos * vec3(size) - 0.5)), ivec3(0), size - 2);
  return texelFetch(in_mask, cell, 0).r > 0.0;
}
"""

LIGHTING = f"""
vec3 lit(vec3 color)
{{
  vec3 cell = 1.0 / vec3(textureSize(in_volume[0], 0));
  vec3 gradient = vec3(
    texture3D(in_volume[0], g_dataPos + vec3(cell.x, 0.0, 0.0)).r -
    texture3D(in_volume[0], g_dataPos - vec3(cell.x, 0.0, 0.0)).r,
    texture3D(in_volume[0], g_dataPos + vec3(0.0, cell.y, 0.0)).r -
    texture3D(in_volume[0], g_dataPos - vec3(0.0, cell.y, 0.0)).r,
    texture3D(in_volume[0], g_dataPos + vec3(0.0, 0.0, cell.z)).r -
    texture3D(in_volume[0], g_dataPos - vec3(0.0, 0.0, cell.z)).r) / in_cellSpacing[0];
  float steepness = length(gradient);
  vec3 towardsEye = normalize(in_eyePosObjs[0].xyz - ip_vertexPos);
  float facing = steepness > 0.0 ? min(abs(dot(gradient, towardsEye)) / steepness, 1.0) : 0.0;
  vec3 shade = ({AMBIENT} + {DIFFUSE} * facing) * color + vec3({SPECULAR} * pow(facing, {SPECULAR_POWER}));
  return clamp(shade, 0.0, 1.0);
}}
"""


def _points_within(
    points: Sequence[tuple[float, ...]], drawn: tuple[float, float]
) -> list[tuple[float, tuple[float, ...]]]:
    """Control points (value, y...) as (x, y), x from 0 to 1 over the `drawn` range of values; none lies outside."""
    low, high = drawn
    inside = [p for p in points if low <= p[0] <= high]
    if len(inside) < len(points):
        values, *columns = zip(*points, strict=True)
        ends = [(v, *(float(np.interp(v, values, column)) for column in columns)) for v in drawn]
        inside = [ends[0], *(p for p in inside if low < p[0] < high), ends[1]]
    return [((p[0] - low) / (high - low), p[1:]) for p in inside]


def _piecewise(signature: str, points: Sequence[tuple[float, Sequence[float]]]) -> str:
    """A GLSL function of x in [0, 1] through `points` (x, y), constant beyond them: y0 + sum of clamped ramps."""
    terms = [_vector(points[0][1])]
    for (x, y), (x_next, y_next) in pairwise(points):
        slope = [(b - a) / (x_next - x) for a, b in zip(y, y_next, strict=True)]
        if any(slope):
            terms.append(f"{_vector(slope)} * clamp(x - {_number(x)}, 0.0, {_number(x_next - x)})")
    return f"{signature}(float x)\n{{\n  return {' + '.join(terms)};\n}}\n"


def _vector(values: Sequence[float]) -> str:
    numbers = ", ".join(map(_number, values))
    return numbers if len(values) == 1 else f"vec{len(values)}({numbers})"


def _number(value: float) -> str:
    return f"({value:.9e})"
