// Several samples a pixel; see surrogate/splatting/samples.py.

/** Means (height, width, 4) of squares of `samples` pixels a side. */
export function averaged(picture, width, height, samples) {
  if (samples === 1) return picture;
  const small = new Float32Array(4 * width * height), share = 1 / samples ** 2;
  for (let row = 0; row < height * samples; ++row) {
    for (let column = 0; column < width * samples; ++column) {
      const from = 4 * (row * width * samples + column), to = 4 * (Math.floor(row / samples) * width + Math.floor(column / samples));
      for (let k = 0; k < 4; ++k) small[to + k] += share * picture[from + k];
    }
  }
  return small;
}
