// Shaders of the picture: from columns and latents to Gaussians that are ready to be seen, to splats, to pixels.
// Data lie in textures of `ACROSS` texels a row; texel i is Gaussian i.  Definitions: surrogate/splatting/reference.py.

export const ACROSS = 1024;

export const HEAD = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D; precision highp usampler2D;
precision highp sampler3D; precision highp usampler3D;
const int ACROSS = ${ACROSS};
ivec2 texel(int i) { return ivec2(i % ACROSS, i / ACROSS); }
`;
const DATA = `${HEAD}
int here() { return int(gl_FragCoord.x) + ACROSS * int(gl_FragCoord.y); }
`;

/** A triangle over the whole target. */
export const WHOLE = `${HEAD}
void main() { gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0); }`;

const outputs = count => Array.from({ length: count }, (_, k) => `layout(location = ${k}) out vec4 out${k};`).join(" ");

/**
 * Columns `first` to `first + count`, four to each: base + constant + latents times modes.
 * With `codes` latents are integers of 8 bits, whose step is in the modes and whose low in the constant.
 */
export const deform = ({ first, count, latents, codes }) => `${DATA}
uniform sampler2D base, modes; uniform ${codes ? "usampler2D" : "sampler2D"} latents; uniform int rows;
${outputs(count)}
void main() {
  int i = here(); ivec2 at = texel(i);
  vec4 sums[${count}];
  for (int k = 0; k < ${count}; ++k) {
    sums[k] = texelFetch(base, ivec2(at.x, at.y + rows * (${first} + k)), 0) + texelFetch(modes, ivec2(${first} + k, ${latents}), 0);
  }
  for (int four = 0; four < ${Math.ceil(latents / 4)}; ++four) {
    vec4 z = vec4(texelFetch(latents, ivec2(at.x, at.y + rows * four), 0));
    for (int part = 0; part < 4; ++part) {
      int l = 4 * four + part;
      if (l >= ${latents}) break;
      for (int k = 0; k < ${count}; ++k) sums[k] += z[part] * texelFetch(modes, ivec2(${first} + k, l), 0);
    }
  }
  ${Array.from({ length: count }, (_, k) => `out${k} = sums[${k}];`).join(" ")}
}`;

/** Averages of a transfer function in closed form; see surrogate/appearance/averages.py. */
const AVERAGES = `
uniform sampler2D nodes; uniform int nodeCount;
float complementary(float x) { // erfc for x >= 0 (Press et al. 1992, section 6.2: erfcc)
  float t = 1.0 / (1.0 + 0.5 * x);
  return t * exp(-x * x - 1.26551223 + t * (1.00002368 + t * (0.37409196 + t * (0.09678418 + t * (-0.18628806 + t * (0.27886807
    + t * (-1.13520398 + t * (1.48851587 + t * (-0.82215223 + t * 0.17087277)))))))));
}
float density(float z) { return 0.3989422804014327 * exp(-0.5 * z * z); }
float cumulative(float z) { float below = 0.5 * complementary(abs(z) * 0.7071067811865476); return z > 0.0 ? 1.0 - below : below; }
float tail(float z) { float size = abs(z); return density(size) - size * 0.5 * complementary(size * 0.7071067811865476); }
float meanCumulative(float upper, float lower, float width) {
  if (width < 0.1) {
    float z = clamp(0.5 * (upper + lower), -40.0, 40.0), square = width * width;
    return cumulative(z) + density(z) * square * (-z / 24.0 + square * (3.0 * z - z * z * z) / 1920.0);
  }
  return ((lower > 0.0 ? width : max(upper, 0.0)) + tail(upper) - tail(lower)) / width;
}
vec4 average(float value, float logSpread) {
  float perSpread = exp(-logSpread);
  vec4 before = texelFetch(nodes, ivec2(0, 1), 0), sum = before;
  float upper = (value - texelFetch(nodes, ivec2(0, 0), 0).x) * perSpread;
  for (int k = 1; k < nodeCount; ++k) {
    vec2 node = texelFetch(nodes, ivec2(k, 0), 0).xy; // place and distance from the node before
    vec4 column = texelFetch(nodes, ivec2(k, 1), 0);
    float lower = (value - node.x) * perSpread;
    if (column != before) sum += meanCumulative(upper, lower, node.y * perSpread) * (column - before);
    before = column; upper = lower;
  }
  return sum;
}`;

/** Gaussians that are ready to be seen: mean and optical depth; unit quaternion; scales and their mean logarithm; colour. */
export const ready = ({ carried }) => `${DATA}
uniform sampler2D columns0, columns1, columns2, columns3, shifts; uniform vec3 low, high; uniform float dark;
${outputs(4)}
${carried ? AVERAGES : ""}
float softplus(float x) { return max(x, 0.0) + log(1.0 + exp(-abs(x))); }
void main() {
  ivec2 at = texel(here());
  vec4 a = texelFetch(columns0, at, 0), b = texelFetch(columns1, at, 0), c = texelFetch(columns2, at, 0), d = texelFetch(columns3, at, 0);
  vec3 logs = vec3(a.w, b.xy); vec4 quaternion = vec4(b.zw, c.xy);
  float size = length(quaternion), depth = softplus(c.z);
  vec3 color = vec3(c.w, d.xy);
  ${carried ? `
  float value = c.w + texelFetch(shifts, at, 0).x;
  vec4 seen = average(clamp(value, -0.5, 1.5), clamp(d.x, -5.521460917862246, -0.5108256237659907));
  depth = clamp(depth * seen.x, 1e-4, 12.0);
  color = clamp(seen.yzw / max(seen.x, dark), low, high);` : ""}
  out0 = vec4(a.xyz, depth);
  out1 = size > 1e-12 ? quaternion / size : vec4(0.0);
  out2 = vec4(exp(logs), (logs.x + logs.y + logs.z) / 3.0);
  out3 = vec4(color, 0.0);
}`;

/** Splats: centre and opacity; the map from pixels to units of the Gaussian with its reach; colour. */
export const project = ({ medium, degree, lit }) => `${DATA}
uniform sampler2D ready0, ready1, ready2, ready3, columns3, columns4, columns5;
uniform mat3 rotation; uniform vec3 translation, position; uniform vec2 focal, principal, size; uniform int count;
uniform float near, dilation, floorAlpha; uniform vec3 surface; uniform vec4 light;
${outputs(3)}
void main() {
  int i = here(); ivec2 at = texel(i);
  out0 = out1 = out2 = vec4(0.0);
  if (i >= count) return;
  vec4 a = texelFetch(ready0, at, 0), q = texelFetch(ready1, at, 0), s = texelFetch(ready2, at, 0);
  vec3 local = rotation * a.xyz + translation;
  if (!(local.z > near)) return;
  float w = q.x, x = q.y, y = q.z, z = q.w;
  mat3 turn = mat3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
  vec3 ray = a.xyz - position; float far = length(ray), depth = a.w;
  ${medium ? `
  if (far > 0.0) { // see surrogate/splatting/along_rays.py
    vec3 own = (ray / far) * turn * exp(s.w) / s.xyz; float stretch = length(own);
    if (stretch > 0.0) depth = min(depth / stretch, 80.0);
  }` : ""}
  float opacity = depth < 0.01 ? depth * (1.0 - depth * (0.5 - depth / 6.0)) : 1.0 - exp(-depth);
  if (!(opacity > floorAlpha)) return;
  vec2 ratio = local.xy / local.z, margin = 0.15 * size;
  vec2 limited = clamp(ratio, (-principal - margin) / focal, (size - principal + margin) / focal), per = focal / local.z;
  vec3 across = (vec3(per.x, 0.0, -per.x * limited.x) * rotation) * turn * s.xyz; // rows of the projected principal axes
  vec3 down = (vec3(0.0, per.y, -per.y * limited.y) * rotation) * turn * s.xyz;
  vec3 normal = cross(across, down);
  float xx = dot(across, across), yy = dot(down, down) + dilation, xy = dot(across, down);
  float determinant = dot(normal, normal) + dilation * (xx + yy); // by Cauchy and Binet
  if (!(determinant > 0.0)) return;
  float u = sqrt(yy / determinant);
  vec3 color = texelFetch(ready3, at, 0).rgb;
  ${degree ? `
  if (far > 0.0) {
    vec4 d = texelFetch(columns3, at, 0), e = texelFetch(columns4, at, 0), f = texelFetch(columns5, at, 0);
    vec3 by = 0.4886025119029199 * ray / far;
    color += -by.y * vec3(d.zw, e.x) + by.z * e.yzw - by.x * f.xyz;
  }` : ""}
  ${lit ? `
  float facing = clamp(far > 0.0 ? abs(dot(color, ray)) / far : 0.0, 1e-6, 1.0); // see surrogate/lighting.py
  color = min((light.x + light.y * facing) * surface + light.z * pow(facing, light.w), 1.0);` : ""}
  out0 = vec4(ratio * focal + principal, opacity, 0.0);
  out1 = vec4(u, -u * xy / yy, inversesqrt(yy), sqrt(2.0 * log(opacity / floorAlpha)));
  out2 = vec4(color, 1.0);
}`;

/** A parallelogram for each splat, the image of the square round the circle that it reaches, and an eighth of a pixel more. */
export const SPLAT = `${HEAD}
uniform usampler2D order; uniform sampler2D splats0, splats1, splats2; uniform vec2 size;
flat out vec3 place; flat out vec4 shape; flat out vec3 color;
void main() {
  int i = int(texelFetch(order, texel(gl_VertexID >> 2), 0).x); ivec2 at = texel(i);
  vec4 a = texelFetch(splats0, at, 0);
  place = a.xyz; shape = texelFetch(splats1, at, 0); color = texelFetch(splats2, at, 0).rgb;
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
  if (!(a.z > 0.0)) return;
  vec2 corner = vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
  vec2 uv = corner * (shape.w + 0.125 * shape.xz);
  float dy = uv.y / shape.z, dx = (uv.x - shape.y * dy) / shape.x;
  gl_Position = vec4((a.xy + vec2(dx, dy)) / size * 2.0 - 1.0, 0.0, 1.0);
}`;

export const BLEND = `${HEAD}
uniform float floorAlpha, capAlpha;
flat in vec3 place; flat in vec4 shape; flat in vec3 color; layout(location = 0) out vec4 pixel;
void main() {
  vec2 d = gl_FragCoord.xy - place.xy;
  vec2 uv = vec2(shape.x * d.x + shape.y * d.y, shape.z * d.y);
  float alpha = place.z * exp(-0.5 * dot(uv, uv));
  if (alpha < floorAlpha) discard;
  alpha = min(alpha, capAlpha);
  pixel = vec4(color * alpha, alpha);
}`;

/** The picture on the canvas: means of samples, over a background, its first row on top. */
export const SHOW = `${HEAD}
uniform sampler2D picture; uniform vec3 background; uniform int samples, height; layout(location = 0) out vec4 pixel;
void main() {
  ivec2 at = samples * ivec2(int(gl_FragCoord.x), height - 1 - int(gl_FragCoord.y));
  vec4 sum = vec4(0.0);
  for (int y = 0; y < samples; ++y) for (int x = 0; x < samples; ++x) sum += texelFetch(picture, at + ivec2(x, y), 0);
  sum /= float(samples * samples);
  pixel = vec4(sum.rgb + (1.0 - sum.a) * background, 1.0);
}`;
