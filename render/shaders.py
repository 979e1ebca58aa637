"""The fragment shader code that VTK's volume mapper is given in place of its own sampling loop.

VTK's stock loop looks colours up in tables of 1024 entries that span the range of the *data*.  It ends rays at the last whole
step, stops at 254/255 and starts one whole step late.  These pieces evaluate the transfer function exactly, cut each ray into
equal steps from entry to exit and sample each in its middle.  That is the midpoint rule, as in the reference implementation
beside the tests.  VTK's tags (//VTK::...) are the documented
interface for replacing parts of its shaders.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from catalogs.vocabulary.appearance import TransferFunction
from catalogs.vocabulary.cameras import Camera
from render.placement import Placement

# Shaded volumes: Phong weights of a headlight at the eye (the values of VTK's volume property).
AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER = 0.1, 0.7, 0.2, 10.0

DEEP = 50.0  # unit distances in the radius of a box from which on opacities below 1e-6 can be seen in the picture
OPAQUE = 1.0 - 1.0 / 8192.0  # where a ray ends early: what is left changes no 8-bit value


@dataclass(frozen=True)
class RaySteps:
    """The steps of a ray, as GLSL.

    Attributes
    ----------
    begin : sets the first sample's g_dataPos, g_dirStep, g_lengthStep, g_currentT and g_terminatePointMax.
    declarations : what `begin` and `sample` need outside of functions.
    sample : run before each sample.
    visible : a condition that a sample must fulfil besides.
    towards_eye : the unit vector from a sample to the eye.
    """

    begin: str
    declarations: str = ""
    sample: str = ""
    visible: str = ""
    towards_eye: str = "normalize(in_eyePosObjs[0].xyz - ip_vertexPos)"


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

# The same of a block: the ray of the pixel, the same in every block that it crosses, and of its steps through the whole those
# that may lie in the block's space, one too many at either end.  What `tell_rays` tells are uniforms.
BLOCK_DECLARATIONS = """
vec3 ray, at;
float entry;
vec2 through(vec3 low, vec3 high)
{
  vec3 slope = mix(vec3(1e-20), ray, greaterThan(abs(ray), vec3(1e-20)));
  vec3 a = (low - eye) / slope;
  vec3 b = (high - eye) / slope;
  vec3 near = min(a, b);
  vec3 far = max(a, b);
  return vec2(max(max(near.x, near.y), near.z), min(min(far.x, far.y), far.z));
}
"""
BLOCK_STEPS = """
  ray = normalize(rayAcross * gl_FragCoord.x + rayUp * gl_FragCoord.y + rayCorner);
  vec2 whole = through({low}, {high});
  entry = max(whole.x, 0.0);
  float inside = max(whole.y - entry, 0.0);
  float steps = max(ceil(inside / {distance} - 1e-3), 1.0);
  g_lengthStep = inside / steps;
  vec2 own = (through(ownLow, ownHigh) - entry) / max(g_lengthStep, 1e-20) - 0.5;
  g_currentT = max(floor(own.x) - 1.0, 0.0);
  g_terminatePointMax = min(ceil(own.y) + 1.0, steps - 1.0) + 1.0;
  g_dirStep = vec3(0.0);
"""
BLOCK_SAMPLE = """
    at = eye + ray * (entry + (g_currentT + 0.5) * g_lengthStep);
    g_dataPos = {scale} * at + {shift};
"""
OWNED = "all(greaterThanEqual(at, ownLow)) && all(lessThan(at, ownHigh))"


def equal_steps() -> RaySteps:
    """Equal steps from entry to exit of the box that is drawn."""
    return RaySteps(EQUAL_STEPS)


def steps_of_whole(shape: tuple[int, int, int], placement: Placement, distance: float) -> RaySteps:
    """The equal steps, no longer than `distance` (local units), of the box of a whole; drawn of them are those in a block's space.

    `shape` is that of the block's samples (z, y, x), which begin at the placement's origin.
    """
    counts = np.array(shape[::-1])
    scale = 1.0 / (placement.spacing * counts)  # [3]: of textures, sample i lies at (i + 1/2) / n
    shift = 0.5 / counts - placement.origin * scale
    return RaySteps(
        BLOCK_STEPS.format(low=_vector(placement.low), high=_vector(placement.high), distance=_number(distance)),
        BLOCK_DECLARATIONS,
        BLOCK_SAMPLE.format(scale=_vector(scale), shift=_vector(shift)),
        OWNED,
        "-ray",
    )


def tell_rays(shader: Any, camera: Camera, low: NDArray[np.float64], high: NDArray[np.float64]) -> None:
    """Tell a block's shader property the local `camera` and the space to draw, from `low` to before `high` (3,), local units."""
    across = np.array([1.0 / camera.fx, 0.0, 0.0])
    up = np.array([0.0, -1.0 / camera.fy, 0.0])  # OpenGL's rows start at the bottom
    corner = np.array([-camera.cx / camera.fx, (camera.height - camera.cy) / camera.fy, 1.0])
    vectors = [row @ camera.rotation for row in (across, up, corner)]
    uniforms = shader.GetFragmentCustomUniforms()
    names = ("rayAcross", "rayUp", "rayCorner", "eye", "ownLow", "ownHigh")
    for name, vector in zip(names, [*vectors, camera.position, low, high], strict=True):
        uniforms.SetUniform3f(name, vector.tolist())


def replacements(
    transfer: TransferFunction,
    value_range: tuple[float, float],
    scale: float,
    *,
    shaded: bool,
    holes: bool,
    steps: RaySteps,
) -> dict[str, str]:
    """VTK tag -> GLSL that takes its place, for a texture that holds `render.volume.texture_values`.

    That is the value with the `value_range` mapped to 0 and 1 (not clamped: trilinear interpolation comes first); with
    `holes` there is a mask besides, `render.volume.hidden_cells`.
    `scale` is the number of world units in one unit of the scene (see `render.placement`).
    """
    opacity = _points_within(transfer.opacity_points, value_range)
    color = _points_within(transfer.color_points, value_range)
    functions = _piecewise("float opacityAt", opacity) + _piecewise("vec3 colorAt", color)
    unused = ("ComputeColor::Dec", "ComputeGradient::Dec", "ComputeGradientOpacity1D::Dec", "ComputeLighting::Dec")
    return {
        "//VTK::ComputeOpacity::Dec": (
            functions
            + DEEP_FUNCTION
            + steps.declarations
            + (LIGHTING.replace("TOWARDS_EYE", steps.towards_eye) if shaded else "")
            + (HIDDEN if holes else "")
        ),
        "//VTK::BinaryMask::Impl": "",
        **{f"//VTK::{part}": "" for part in (*unused, "Shading::Init")},
        "//VTK::Terminate::Init": steps.begin,
        "//VTK::Terminate::Impl": (
            f"if (++g_currentT >= g_terminatePointMax || g_fragColor.a > {_number(OPAQUE)}) break;\n"
        ),
        "//VTK::Shading::Impl": _sample(scale / transfer.opacity_unit_distance, shaded, holes, steps),
    }


def _sample(exponent: float, shaded: bool, holes: bool, steps: RaySteps) -> str:
    """`exponent` is the number of unit distances in one unit of the scene, which has a radius of 1."""
    deep = exponent > DEEP
    visible = f"opacity > {'0.0' if deep else '1e-6'}" + (" && !hidden()" if holes else "")
    visible += f" && {steps.visible}" if steps.visible else ""
    alpha = DEEP_ALPHA if deep else "1.0 - pow(max(1.0 - opacity, 0.0), g_lengthStep * {exponent})"
    lit = "lit(color)" if shaded else "color"
    return f"""{steps.sample}
    float value = clamp(texture3D(in_volume[0], g_dataPos).r, 0.0, 1.0);
    float opacity = opacityAt(value);
    if ({visible})
      {{
      float alpha = {alpha.format(exponent=_number(exponent))};
      vec3 color = colorAt(value);
      g_fragColor += (1.0 - g_fragColor.a) * alpha * vec4({lit}, 1.0);
      }}
"""


# 1 - (1 - opacity)**(step / unit) where rays are of a length, in units, at which single precision loses 1 - opacity: by the series
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

# Differences of interpolated values that rounding alone may make are none: constant regions have no slope.
ROUNDING = 2.0**-22
LIGHTING = f"""
float slope(vec3 step)
{{
  float ahead = texture3D(in_volume[0], g_dataPos + step).r;
  float behind = texture3D(in_volume[0], g_dataPos - step).r;
  return abs(ahead - behind) > {ROUNDING!r} * max(abs(ahead), abs(behind)) ? ahead - behind : 0.0;
}}
vec3 lit(vec3 color)
{{
  vec3 cell = 1.0 / vec3(textureSize(in_volume[0], 0));
  vec3 gradient = vec3(slope(vec3(cell.x, 0.0, 0.0)), slope(vec3(0.0, cell.y, 0.0)), slope(vec3(0.0, 0.0, cell.z)))
    / in_cellSpacing[0];
  float steepness = length(gradient);
  vec3 towardsEye = TOWARDS_EYE;
  float facing = steepness > 0.0 ? min(abs(dot(gradient, towardsEye)) / steepness, 1.0) : 0.0;
  vec3 shade = ({AMBIENT} + {DIFFUSE} * facing) * color + vec3({SPECULAR} * pow(facing, {SPECULAR_POWER}));
  return clamp(shade, 0.0, 1.0);
}}
"""


def _points_within(
    points: Sequence[tuple[float, ...]], value_range: tuple[float, float]
) -> list[tuple[float, tuple[float, ...]]]:
    """Control points (value, y...) as (x, y), x from 0 to 1 over the `value_range`; none lies outside."""
    low, high = value_range
    inside = [p for p in points if low <= p[0] <= high]
    if len(inside) < len(points):
        values, *columns = zip(*points, strict=True)
        ends = [(v, *(float(np.interp(v, values, column)) for column in columns)) for v in value_range]
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


def _vector(values: Sequence[float] | NDArray[np.float64]) -> str:
    numbers = ", ".join(map(_number, values))
    return numbers if len(values) == 1 else f"vec{len(values)}({numbers})"


def _number(value: float) -> str:
    return f"({value:.9e})"
