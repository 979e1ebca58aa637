"""The fragment shader code that VTK's volume mapper is given in place of its own sampling loop.

VTK's stock loop looks colours up in tables of 1024 entries that span the range of the *data*, ends rays at the
last whole step, stops at 254/255 and starts one whole step late.  These pieces evaluate the transfer function
exactly, cut each ray into equal steps from entry to exit and sample each in its middle: the midpoint rule, as in
`render.raymarch`.  VTK's tags (//VTK::...) are the documented interface for replacing parts of its shaders.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

from catalogs.appearance import TransferFunction

# Shaded volumes: Phong weights of a headlight at the eye (the values of VTK's volume property).
AMBIENT, DIFFUSE, SPECULAR, SPECULAR_POWER = 0.1, 0.7, 0.2, 10.0

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


def replacements(transfer: TransferFunction, scale: float, *, shaded: bool, holes: bool) -> dict[str, str]:
    """VTK tag -> GLSL that takes its place, for a texture that holds `render.volume.texture_values`.

    The texture's first component is the value with the transfer function's bounds mapped to 0 and 1 (not
    clamped: trilinear interpolation comes first); with `holes` a second one is 1 at holes and 0 elsewhere.
    `scale` is the number of world units in one unit of the scene (see `render.placement`).
    """
    low, high = transfer.bounds
    opacity = [((v - low) / (high - low), (o,)) for v, o in transfer.opacity_points]
    color = [((p[0] - low) / (high - low), p[1:]) for p in transfer.color_points]
    functions = _piecewise("float opacityAt", opacity) + _piecewise("vec3 colorAt", color)
    unused = ("ComputeColor::Dec", "ComputeGradient::Dec", "ComputeGradientOpacity1D::Dec", "ComputeLighting::Dec")
    return {
        "//VTK::ComputeOpacity::Dec": functions + (LIGHTING if shaded else ""),
        **{f"//VTK::{part}": "" for part in (*unused, "Shading::Init")},
        "//VTK::Terminate::Init": EQUAL_STEPS,
        "//VTK::Terminate::Impl": (
            f"if (++g_currentT >= g_terminatePointMax || g_fragColor.a > {_number(OPAQUE)}) break;\n"
        ),
        "//VTK::Shading::Impl": _sample(scale / transfer.opacity_unit_distance, shaded, holes),
    }


def _sample(exponent: float, shaded: bool, holes: bool) -> str:
    visible = "opacity > 1e-6 && sampled.g <= 0.0" if holes else "opacity > 1e-6"
    lit = "lit(color)" if shaded else "color"
    return f"""
    vec4 sampled = texture3D(in_volume[0], g_dataPos);
    float value = clamp(sampled.r, 0.0, 1.0);
    float opacity = opacityAt(value);
    if ({visible})
      {{
      float alpha = 1.0 - pow(max(1.0 - opacity, 0.0), g_lengthStep * {_number(exponent)});
      vec3 color = colorAt(value);
      g_fragColor += (1.0 - g_fragColor.a) * alpha * vec4({lit}, 1.0);
      }}
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
