// Gaussians of colours under a changed transfer function, by weights of field values; see surrogate/deformation/values.py.

import { interpolated } from "draw/nodes.js";
import { clamped, DEPTHS, GEOMETRY, logitOf, softplus } from "draw/optics.js";

const OPAQUE = 0.999, SAMPLES = 32; // of a function between two values

export class WeighedValues {
  /** `weights` is a tensor (N, B), `record` what the deformation says of itself. */
  constructor({ data }, { base, values }) {
    this.weights = data;
    this.base = base;
    this.values = values;
    this.still = extinctions(base, values);
  }

  /** Put logits and colours of Gaussians (N, width) under a transfer function, in place. */
  apply(transfer, table, width) {
    const count = this.values.length, scale = this.base.opacity_unit_distance / transfer.opacity_unit_distance;
    const changes = extinctions(transfer, this.values).map((x, k) => scale * x - this.still[k]), sums = new Float64Array(4);
    const channels = [1, 2, 3].map(c => transfer.color_points.map(point => point[c]));
    const low = channels.map(own => Math.min(...own)), high = channels.map(own => Math.max(...own));
    for (let row = 0, at = GEOMETRY; at < table.length; row += count, at += width) {
      sums.fill(0);
      for (let b = 0; b < count; ++b) {
        const weight = Math.abs(this.weights[row + b]);
        for (let c = 0; c < 4; ++c) sums[c] += weight * changes[4 * b + c];
      }
      const before = softplus(table[at - 1]), after = Math.max(before + sums[0], DEPTHS[0]);
      table[at - 1] += logitOf(after) - logitOf(Math.max(before, DEPTHS[0]));
      for (let c = 0; c < 3; ++c) {
        const own = table[at + c], free = own + (sums[c + 1] - own * sums[0]) / after;
        table[at + c] = clamped(free, Math.min(own, low[c]), Math.max(own, high[c]));
      }
    }
  }
}

/** Extinction, and extinction times colour, at increasing values, averaged over the hats of linear interpolation: (B, 4). */
function extinctions({ color_points: colors, opacity_points: opacities }, values) {
  const sums = new Float64Array(4 * values.length), weights = new Float64Array(values.length);
  for (let b = 0; b + 1 < values.length; ++b) {
    const length = values[b + 1] - values[b];
    for (let s = 0; s < SAMPLES; ++s) {
      const inside = (s + 0.5) / SAMPLES, value = values[b] + length * inside;
      const extinction = -Math.log1p(-Math.min(interpolated(opacities, value), OPAQUE)) * length / SAMPLES;
      const columns = [extinction, ...[1, 2, 3].map(channel => extinction * interpolated(colors, value, channel))];
      for (let c = 0; c < 4; ++c) {
        sums[4 * b + c] += (1 - inside) * columns[c];
        sums[4 * b + 4 + c] += inside * columns[c];
      }
    }
    weights[b] += length / 2;
    weights[b + 1] += length / 2;
  }
  return sums.map((sum, k) => sum / weights[k >> 2]);
}
