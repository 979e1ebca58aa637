// Volumes drawn along rays by plain scripts: emission and absorption by the midpoint rule; see surrogate/ray_casting/reference.py.

import { OPAQUE, SLACK } from "draw/rays.js";

const ROUNDING = 2 ** -22; // of values: a smaller difference of two interpolated ones is none
const MOST_DEPTH = 100; // where nothing passes

/**
 * Premultiplied RGBA (H, W, 4) of `volume`: {values of which 0 to 1 is drawn, hidden, size, low, high, spacing, knots, unit, light},
 * from low to high (samples), by samples a world `distance` apart at most.
 */
export function castVolume(volume, rays, distance) {
  const { values, size, unit, light, hidden } = volume, { width, height } = rays, picture = new Float32Array(4 * width * height);
  const nx = size[0], slice = nx * size[1], [endX, endY, endZ] = size.map(n => n - 2), field = light && fieldOf(volume);
  const { places, inverses, columns, rises } = piecesOf(volume.knots), lastSegment = inverses.length - 1;
  const cut = { begin: [0, 0, 0], step: [0, 0, 0], steps: 0, length: 0 }, shown = [0, 0, 0];
  for (let row = 0, pixel = 0; row < height; ++row) {
    for (let column = 0; column < width; ++column, pixel += 4) {
      if (!enters(volume, rays, column + 0.5, row + 0.5, distance, cut)) continue;
      const { begin, step, steps } = cut, units = cut.length / unit;
      const [beginX, beginY, beginZ] = begin, [stepX, stepY, stepZ] = step;
      let through = 1, red = 0, green = 0, blue = 0, segment = 0;
      for (let s = 0.5; s < steps && through >= OPAQUE; ++s) { // without calls, which take as long as all else
        const x = beginX + s * stepX, y = beginY + s * stepY, z = beginZ + s * stepZ;
        const i = x < endX ? x | 0 : endX, j = y < endY ? y | 0 : endY, k = z < endZ ? z | 0 : endZ, at = k * slice + j * nx + i, up = at + slice;
        const a = x - i, b = y - j, near = values[at] + a * (values[at + 1] - values[at]), above = values[up] + a * (values[up + 1] - values[up]);
        const low = near + b * (values[at + nx] + a * (values[at + nx + 1] - values[at + nx]) - near);
        const high = above + b * (values[up + nx] + a * (values[up + nx + 1] - values[up + nx]) - above);
        const free = low + (z - k) * (high - low), value = free > 0 ? free < 1 ? free : 1 : 0;
        while (value >= places[segment + 1] && segment < lastSegment) ++segment;
        while (value < places[segment]) --segment;
        const four = 4 * segment, share = (value - places[segment]) * inverses[segment], opacity = columns[four] + share * rises[four];
        if (!(opacity > 0) || hidden && hidden[at]) continue;
        const depth = (opacity < 1 ? -Math.log1p(-opacity) : MOST_DEPTH) * units;
        const weight = through * (depth < 0.01 ? depth * (1 - depth * (0.5 - depth * (1 / 6 - depth / 24))) : 1 - Math.exp(-depth));
        if (light) {
          for (let c = 0; c < 3; ++c) shown[c] = columns[four + c + 1] + share * rises[four + c + 1];
          shine(field, volume, [x, y, z], step, shown);
          red += weight * shown[0];
          green += weight * shown[1];
          blue += weight * shown[2];
        } else {
          red += weight * (columns[four + 1] + share * rises[four + 1]);
          green += weight * (columns[four + 2] + share * rises[four + 2]);
          blue += weight * (columns[four + 3] + share * rises[four + 3]);
        }
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

/** Cut the ray of a pixel's middle in a volume into equal steps of a world length, into `cut`; false where it misses. */
function enters({ low, high, spacing }, { eye, across, down, corner }, column, row, distance, cut) {
  let enter = 0, leave = Infinity, squared = 0;
  for (let k = 0; k < 3; ++k) {
    const d = across[k] * column + down[k] * row + corner[k] || 1e-200, first = (low[k] - eye[k]) / d, second = (high[k] - eye[k]) / d;
    enter = Math.max(enter, Math.min(first, second));
    leave = Math.min(leave, Math.max(first, second));
    squared += (d * spacing[k] / distance) ** 2;
    cut.step[k] = d;
  }
  if (!(leave > enter)) return false;
  const length = (leave - enter) * Math.sqrt(squared), steps = Math.max(Math.ceil(length - SLACK), 1);
  for (let k = 0; k < 3; ++k) {
    const d = cut.step[k];
    cut.begin[k] = Math.min(Math.max(eye[k] + enter * d, low[k]), high[k]);
    cut.step[k] = (Math.min(Math.max(eye[k] + leave * d, low[k]), high[k]) - cut.begin[k]) / steps;
  }
  cut.steps = steps;
  cut.length = length / steps * distance;
  return true;
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

/** The pieces of a function between knots: their places, one over their lengths, and four columns with what these rise by. */
function piecesOf(knots) {
  const places = Float64Array.from(knots, knot => knot[0]), columns = Float64Array.from(knots.flatMap(knot => knot.slice(1)));
  const inverses = places.subarray(1).map((place, k) => 1 / (place - places[k])), rises = columns.subarray(4).map((x, k) => x - columns[k]);
  return { places, inverses, columns, rises };
}

/** A colour under a two-sided headlight, in place, by central differences over one sample to either side. */
function shine(field, { spacing, light }, place, step, color) {
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
  lit(light, color, squared > 0 ? Math.min(Math.abs(along) / Math.sqrt(squared * length), 1) : 0).forEach((channel, k) => { color[k] = channel; });
}

/** A colour under a headlight, by the cosine between the view and the normal. */
export const lit = ([ambient, diffuse, specular, power], color, facing) =>
  color.map(channel => Math.min(Math.max((ambient + diffuse * facing) * channel + specular * facing ** power, 0), 1));
