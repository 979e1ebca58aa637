// The difference of two pictures, as a coloured map and in numbers; see surrogate/explore/exporting/difference.py.

const RANGES = [0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1], SHOWN = 0.995, MOST_DECIBELS = 60;
// Control points of matplotlib's "inferno", between which it differs by less than 0.02.
const COLORS = [[0, 0, 0.01], [0.09, 0.05, 0.27], [0.26, 0.04, 0.41], [0.42, 0.09, 0.43], [0.58, 0.15, 0.4], [0.74, 0.21, 0.33],
  [0.87, 0.32, 0.23], [0.95, 0.46, 0.1], [0.99, 0.65, 0.04], [0.96, 0.84, 0.27], [0.99, 1, 0.64]];

/** Of two pictures (H, W, 3) in [0, 1] of one size: { picture, psnr, maximum, high }. */
export function differenceOf(first, second) {
  const errors = new Float32Array(first.length / 3);
  let squares = 0;
  for (let i = 0; i < first.length; ++i) {
    const apart = Math.abs(cut(first[i]) - cut(second[i])), pixel = Math.floor(i / 3);
    squares += apart * apart;
    errors[pixel] = Math.max(errors[pixel], apart);
  }
  const ordered = errors.slice().sort(), reached = ordered[Math.floor(SHOWN * (ordered.length - 1))];
  const high = RANGES.find(range => range >= reached) ?? 1, picture = new Float32Array(first.length);
  errors.forEach((error, pixel) => { picture.set(colorOf(error / high), 3 * pixel); });
  const psnr = Math.min(MOST_DECIBELS, -10 * Math.log10(squares / first.length));
  return { picture, psnr, maximum: ordered.at(-1), high };
}

const cut = x => Math.min(Math.max(x, 0), 1);

function colorOf(share) {
  const place = Math.min(share, 1) * (COLORS.length - 1), low = Math.min(Math.floor(place), COLORS.length - 2);
  return COLORS[low].map((x, k) => x + (place - low) * (COLORS[low + 1][k] - x));
}
