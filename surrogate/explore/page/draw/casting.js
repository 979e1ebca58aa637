// Volumes drawn along rays by plain scripts: emission and absorption by the midpoint rule; see surrogate/ray_casting/reference.py.

import { OPAQUE, SLACK } from "draw/rays.js";

const ROUNDING = 2 ** -22; // of values: a smaller difference of two interpolated ones is none
const MOST_DEPTH = 100; // where nothing passes

/**
 * Premultiplied RGBA (H, W, 4) of `volume`: {values of which 0 to 1 is drawn, hidden, size, spacing, knots, unit, light},
 * by samples a world `distance` apart at most.
 */
export function castVolume(volume, { eye, across, down, corner, width, height }, distance) {
  const { size, spacing, unit, light, hidden } = volume, picture = new Float32Array(4 * width * height), last = size.map(n => n - 1);
  const nx = size[0], slice = nx * size[1], [endX, endY, endZ] = size.map(n => n - 2), field = fieldOf(volume), look = functionOf(volume.knots);
  const direction = [0, 0, 0], begin = [0, 0, 0], step = [0, 0, 0], shown = new Float64Array(4);
  for (let row = 0, pixel = 0; row < height; ++row) {
    for (let column = 0; column < width; ++column, pixel += 4) {
      let enter = 0, leave = Infinity, squared = 0;
      for (let k = 0; k < 3; ++k) {
        const d = across[k] * (column + 0.5) + down[k] * (row + 0.5) + corner[k] || 1e-200;
        const first = -eye[k] / d, second = (last[k] - eye[k]) / d;
        enter = Math.max(enter, Math.min(first, second));
        leave = Math.min(leave, Math.max(first, second));
        direction[k] = d;
        squared += (d * spacing[k] / distance) ** 2;
      }
      if (!(leave > enter)) continue;
      const length = (leave - enter) * Math.sqrt(squared), steps = Math.max(Math.ceil(length - SLACK), 1), units = length / steps * distance / unit;
      for (let k = 0; k < 3; ++k) {
        const from = Math.min(Math.max(eye[k] + enter * direction[k], 0), last[k]), to = Math.min(Math.max(eye[k] + leave * direction[k], 0), last[k]);
        begin[k] = from;
        step[k] = (to - from) / steps;
      }
      const [beginX, beginY, beginZ] = begin, [stepX, stepY, stepZ] = step;
      let through = 1, red = 0, green = 0, blue = 0;
      for (let s = 0.5; s < steps && through >= OPAQUE; ++s) {
        const x = beginX + s * stepX, y = beginY + s * stepY, z = beginZ + s * stepZ;
        if (!look(Math.min(Math.max(field(x, y, z), 0), 1), shown)) continue;
        if (hidden && hidden[Math.min(Math.floor(z), endZ) * slice + Math.min(Math.floor(y), endY) * nx + Math.min(Math.floor(x), endX)]) continue;
        const absorbed = shown[0] < 1 ? -Math.log1p(-shown[0]) : MOST_DEPTH, weight = -through * Math.expm1(-absorbed * units);
        if (light) shine(field, volume, [x, y, z], step, shown);
        red += weight * shown[1];
        green += weight * shown[2];
        blue += weight * shown[3];
        through -= weight;
      }
      picture[pixel] = red;
      picture[pixel + 1] = green;
      picture[pixel + 2] = blue;
      picture[pixel + 3] = 1 - through;
    }
  }
  return picture;
}

/** The field at a place in samples, beyond the box that on its face. */
function fieldOf({ values, size: [nx, ny, nz] }) {
  const slice = nx * ny;
  return (x, y, z) => {
    x = Math.min(Math.max(x, 0), nx - 1);
    y = Math.min(Math.max(y, 0), ny - 1);
    z = Math.min(Math.max(z, 0), nz - 1);
    const i = Math.min(Math.floor(x), nx - 2), j = Math.min(Math.floor(y), ny - 2), k = Math.min(Math.floor(z), nz - 2);
    const a = x - i, b = y - j, at = (k * ny + j) * nx + i, up = at + slice;
    const near = values[at] + a * (values[at + 1] - values[at]), far = values[at + nx] + a * (values[at + nx + 1] - values[at + nx]);
    const above = values[up] + a * (values[up + 1] - values[up]), beyond = values[up + nx] + a * (values[up + nx + 1] - values[up + nx]);
    const low = near + b * (far - near);
    return low + (z - k) * (above + b * (beyond - above) - low);
  };
}

/** Opacity and colour of knots at a value, into an output (4,); false where nothing is seen. */
function functionOf(knots) {
  const places = Float64Array.from(knots, knot => knot[0]), columns = Float64Array.from(knots.flatMap(knot => knot.slice(1)));
  const inverses = places.map((place, k) => 1 / (places[k + 1] - place));
  return (value, output) => {
    let low = 0, high = places.length - 1;
    while (high - low > 1) {
      const middle = low + high >> 1;
      if (value >= places[middle]) low = middle;
      else high = middle;
    }
    const share = (value - places[low]) * inverses[low];
    for (let c = 0, at = 4 * low; c < 4; ++c, ++at) output[c] = columns[at] + share * (columns[at + 4] - columns[at]);
    return output[0] > 0;
  };
}

/** The last three of `shown` under a two-sided headlight, by central differences over one sample to either side. */
function shine(field, { spacing, light }, place, step, shown) {
  let largest = 0, along = 0, squared = 0, length = 0;
  const slopes = [0, 1, 2].map(axis => {
    const [ahead, behind] = [1, -1].map(side => field(...place.map((x, k) => k === axis ? x + side : x)));
    const slope = Math.abs(ahead - behind) > ROUNDING * Math.max(Math.abs(ahead), Math.abs(behind)) ? (ahead - behind) / spacing[axis] : 0;
    largest = Math.max(largest, Math.abs(slope));
    return slope;
  });
  for (let k = 0; k < 3; ++k) {
    const slope = largest > 0 ? slopes[k] / largest : 0, ray = step[k] * spacing[k];
    along += slope * ray;
    squared += slope * slope;
    length += ray * ray;
  }
  const colors = lit(light, Array.from(shown.subarray(1)), squared > 0 ? Math.min(Math.abs(along) / Math.sqrt(squared * length), 1) : 0);
  for (let k = 0; k < 3; ++k) shown[k + 1] = colors[k];
}

/** A colour under a headlight, by the cosine between the view and the normal. */
export const lit = ([ambient, diffuse, specular, power], color, facing) =>
  color.map(channel => Math.min(Math.max((ambient + diffuse * facing) * channel + specular * facing ** power, 0), 1));
