// Columns of Gaussians at a point of the parameters: latents times modes, and values that follow an emulated field.

import { GEOMETRY } from "draw/optics.js";

/** All columns of a figure at a point, into `output` (N, width). */
export function moved({ columns: { count, width, table }, embedding, emulated }, point, output) {
  const { columns, size, latents: { data } } = embedding, modes = embedding.modes(point), shifts = emulated?.shifts(point);
  for (let first = 0; first < width; first += 4) { // four at a time stay in registers
    const own = Float64Array.from({ length: 4 * size }, (_, k) => {
      const column = first + k % 4;
      return column < columns ? modes[Math.floor(k / 4) * columns + column] : 0;
    });
    for (let i = 0; i < count; ++i) {
      let a = 0, b = 0, c = 0, d = 0;
      for (let l = 0, at = i * size; l < 4 * size; l += 4, ++at) {
        const z = data[at];
        a += z * own[l];
        b += z * own[l + 1];
        c += z * own[l + 2];
        d += z * own[l + 3];
      }
      const at = i * width + first, sums = [a, b, c, d];
      for (let k = 0; k < 4 && first + k < width; ++k) output[at + k] = table[at + k] + sums[k];
    }
  }
  if (shifts) for (let i = 0; i < count; ++i) output[i * width + GEOMETRY] += shifts[i];
}
