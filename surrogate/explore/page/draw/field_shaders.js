// Shaders of an emulated field: along rays through a volume, and of an isosurface's triangles; see surrogate/ray_casting/reference.py.

import { OPAQUE, SAMPLES, SLACK } from "draw/rays.js";
import { HEAD } from "draw/shaders.js";

const LIT = `
vec3 lit(vec4 light, vec3 color, float facing) {
  return clamp((light.x + light.y * facing) * color + light.z * pow(max(facing, 1e-30), light.w), 0.0, 1.0);
}`;

/**
 * A volume, whose texel at a sample has the values of this, of its neighbours along x and y, and of that along both; rows of
 * `knots` are places with opacities, and colours.
 */
export const volume = ({ holes, shaded }) => `${HEAD}
uniform sampler3D field; uniform sampler2D knots; ${holes ? "uniform usampler3D hidden;" : ""}
uniform vec3 last, low, high, eye, across, down, corner, spacing; uniform float apart, unit; uniform int knotCount; uniform vec4 light;
layout(location = 0) out vec4 pixel;
${LIT}
vec3 cellOf(vec3 place) { return min(floor(place), last - 1.0); }
float trilinear(vec3 place) {
  place = clamp(place, vec3(0.0), last);
  vec3 cell = cellOf(place), share = place - cell; ivec3 at = ivec3(cell);
  vec4 low = texelFetch(field, at, 0), four = low + share.z * (texelFetch(field, at + ivec3(0, 0, 1), 0) - low);
  vec2 two = four.xz + share.x * (four.yw - four.xz);
  return two.x + share.y * (two.y - two.x);
}
float slope(vec3 place, vec3 side) {
  float ahead = trilinear(place + side), behind = trilinear(place - side), difference = ahead - behind;
  return abs(difference) > exp2(-22.0) * max(abs(ahead), abs(behind)) ? difference : 0.0;
}
void main() {
  pixel = vec4(0.0);
  vec3 ray = across * gl_FragCoord.x + down * gl_FragCoord.y + corner;
  for (int k = 0; k < 3; ++k) if (abs(ray[k]) < 1e-30) ray[k] = 1e-30;
  vec3 first = (low - eye) / ray, second = (high - eye) / ray, near = min(first, second), far = max(first, second);
  float enter = max(max(near.x, near.y), max(near.z, 0.0)), leave = min(min(far.x, far.y), far.z);
  if (!(leave > enter)) return;
  float whole = (leave - enter) * length(ray * spacing) / apart, steps = max(ceil(whole - ${SLACK}), 1.0), units = whole / steps * apart / unit;
  vec3 begin = clamp(eye + enter * ray, low, high), move = (clamp(eye + leave * ray, low, high) - begin) / steps;
  vec3 color = vec3(0.0); float through = 1.0;
  for (int k = 0; float(k) < steps && through >= float(${OPAQUE}); ++k) {
    vec3 place = begin + (float(k) + 0.5) * move;
    ${holes ? "if (texelFetch(hidden, ivec3(cellOf(place)), 0).x != 0u) continue;" : ""}
    float value = clamp(trilinear(place), 0.0, 1.0);
    int left = 0, right = knotCount - 1;
    while (right - left > 1) {
      int middle = (left + right) / 2;
      if (value >= texelFetch(knots, ivec2(middle, 0), 0).x) left = middle; else right = middle;
    }
    vec4 before = texelFetch(knots, ivec2(left, 0), 0), after = texelFetch(knots, ivec2(right, 0), 0);
    float share = (value - before.x) / (after.x - before.x), opacity = before.y + share * (after.y - before.y);
    if (!(opacity > 0.0)) continue;
    float depth = (opacity < 1.0 ? -log(1.0 - opacity) : 100.0) * units;
    float alpha = depth < 0.01 ? depth * (1.0 - depth * (0.5 - depth / 6.0)) : 1.0 - exp(-depth);
    vec4 from = texelFetch(knots, ivec2(left, 1), 0);
    vec3 straight = mix(from, texelFetch(knots, ivec2(right, 1), 0), share).rgb;
    ${shaded ? `
    vec3 slopes = vec3(slope(place, vec3(1, 0, 0)), slope(place, vec3(0, 1, 0)), slope(place, vec3(0, 0, 1))) / spacing;
    float largest = max(abs(slopes.x), max(abs(slopes.y), abs(slopes.z)));
    slopes /= largest > 0.0 ? largest : 1.0;
    float size = length(slopes);
    straight = lit(light, straight, size > 0.0 ? min(abs(dot(slopes, normalize(move * spacing))) / size, 1.0) : 0.0);` : ""}
    color += through * alpha * straight;
    through -= through * alpha;
  }
  pixel = vec4(color, 1.0 - through);
}`;

/**
 * Triangles in a tile of a picture, an eighth of a sample larger: cards round corners to parts of a sample, and SURFACE looks whether a
 * ray meets a triangle (Olano & Greer 1997: edges as planes through the eye).
 */
export const CORNERS = `${HEAD}
uniform sampler2D places, normals; uniform usampler2D corners; uniform mat3 matrix; uniform vec3 shift; uniform vec2 focal, principal, tile;
uniform float side;
flat out vec3 first, second, third, across, n0, n1, n2; flat out float height;
vec2 seen(vec3 local) { return focal * local.xy / local.z + principal - tile; }
void main() {
  int triangle = gl_VertexID / 3; vec3 local[3], normal[3];
  for (int k = 0; k < 3; ++k) {
    ivec2 at = texel(int(texelFetch(corners, texel(3 * triangle + k), 0).x));
    local[k] = matrix * texelFetch(places, at, 0).xyz + shift;
    normal[k] = texelFetch(normals, at, 0).xyz;
  }
  first = cross(local[1], local[2] - local[1]); second = cross(local[2], local[0] - local[2]); third = cross(local[0], local[1] - local[0]);
  across = cross(local[1] - local[0], local[2] - local[0]); height = dot(local[0], across);
  n0 = normal[0]; n1 = normal[1]; n2 = normal[2];
  int k = gl_VertexID % 3; vec3 own = local[k], before = local[(k + 2) % 3], after = local[(k + 1) % 3];
  if (!(min(own.z, min(before.z, after.z)) > 1e-6 * length(own))) { // it reaches behind the eye
    gl_Position = vec4((focal * own.xy + (principal - tile) * own.z) / side * 2.0 - own.z, 0.0, own.z);
    return;
  }
  vec2 here = seen(own), u = here - seen(before), v = here - seen(after);
  u /= max(length(u), 1e-20); v /= max(length(v), 1e-20);
  here += 0.125 * (u + v) / max(abs(u.x * v.y - u.y * v.x), 0.01);
  gl_Position = vec4(here / side * 2.0 - 1.0, 0.0, 1.0);
}`;

export const SURFACE = `${HEAD}
uniform vec2 focal, principal, tile, ends; uniform vec3 surface; uniform vec4 light; uniform mat3 turn;
flat in vec3 first, second, third, across, n0, n1, n2; flat in float height; layout(location = 0) out vec4 pixel;
${LIT}
void main() {
  vec3 ray = vec3((gl_FragCoord.xy + tile - principal) / focal, 1.0);
  vec3 shares = vec3(dot(ray, first), dot(ray, second), dot(ray, third)) * sign(height);
  float sum = shares.x + shares.y + shares.z, closeness = dot(ray, across) / height;
  if (min(shares.x, min(shares.y, shares.z)) < 0.0 || !(closeness > 0.0)) discard;
  vec3 normal = turn * ((shares.x * n0 + shares.y * n1 + shares.z * n2) / sum); // in the camera's axes
  float size = length(normal);
  gl_FragDepth = clamp((ends.y - closeness) / (ends.y - ends.x), 0.0, 1.0);
  pixel = vec4(lit(light, surface, size > 0.0 ? min(abs(dot(normal, normalize(ray))) / size, 1.0) : 0.0), 1.0);
}`;

/** Means of the samples of a tile whose first pixel is `tile`. */
export const MEANS = `${HEAD}
uniform sampler2D samples; uniform vec2 tile; layout(location = 0) out vec4 pixel;
void main() {
  ivec2 at = ${SAMPLES} * ivec2(gl_FragCoord.xy - tile);
  pixel = vec4(0.0);
  for (int y = 0; y < ${SAMPLES}; ++y) for (int x = 0; x < ${SAMPLES}; ++x) pixel += texelFetch(samples, at + ivec2(x, y), 0);
  pixel /= float(${SAMPLES * SAMPLES});
}`;
