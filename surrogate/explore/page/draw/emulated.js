// Values that follow an emulated field: what Gaussian processes expect at a point, and what that adds to each Gaussian's value.
// See surrogate/deformation/emulated_values.py.

import { onScale } from "draw/nodes.js";
import { Processes } from "draw/processes.js";

const BEYOND = 0.2; // of the scale, by which values may lie outside its ends

export class EmulatedValues {
  /** `tensors` by name, with `prefix`; `record` is the deformation's "emulated". */
  constructor(tensors, record, prefix) {
    const tensor = name => tensors.get(prefix + name);
    this.share = record.share;
    this.knots = record.knots;
    this.means = tensor("means").data; // [N]
    this.modes = tensor("modes").data; // [N, K]
    this.processes = new Processes(tensor, record.groups);
    this.still = Float64Array.from(this.means, value => this.carried(value)); // [N]
  }

  /** The changes of the values (N,) at a normalized point (P,). */
  shifts(point) {
    const expected = Float32Array.from(this.processes.expected(point)), count = expected.length, { modes, means } = this;
    return Float32Array.from(means, (mean, i) => {
      let value = mean;
      for (let k = 0, at = i * count; k < count; ++k) value += expected[k] * modes[at + k];
      return this.share * (this.carried(value) - this.still[i]);
    });
  }

  /** A value on the scale of carried ones, cut beyond its ends. */
  carried(value) {
    const place = this.knots ? onScale(value, this.knots) : value;
    return Math.min(Math.max(place, -BEYOND), 1 + BEYOND);
  }
}
