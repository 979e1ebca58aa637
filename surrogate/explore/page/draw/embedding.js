// The embedding network of a bilinear deformation: modes E(p) that all Gaussians share; see surrogate/deformation/bilinear.py.

import { encoded } from "draw/parameters.js";

const silu = x => x / (1 + Math.exp(-x));

export class Embedding {
  /** `tensors` by name, of which the deformation's begin with `prefix`; `record` is what it says of itself. */
  constructor(tensors, record, prefix = "deformation.") {
    const tensor = name => tensors.get(prefix + name);
    this.units = Float64Array.from(record.units);
    this.frequencies = record.frequencies ?? 0;
    this.latents = tensor("latents");
    this.size = this.latents.shape[1]; // L
    this.columns = this.units.length; // C
    this.first = [tensor("weights_in").data, tensor("biases_in").data];
    this.middle = [tensor("weights_middle").data, tensor("biases_middle").data];
    this.last = [tensor("weights_out").data, tensor("biases_out").data];
    this.used = [...this.units.keys()].filter(column => this.units[column] !== 0); // others are not stored
  }

  /** The modes (L, C) at a normalized point (P,), float64. */
  modes(point) {
    const hidden = product(this.first, encoded(point, this.frequencies)).map(silu);
    const more = product(this.middle, hidden).map(silu);
    const last = product(this.last, hidden.map((x, i) => x + more[i])); // [L, used]
    const modes = new Float64Array(this.size * this.columns);
    this.used.forEach((column, at) => {
      for (let l = 0; l < this.size; ++l) modes[l * this.columns + column] = last[l * this.used.length + at] * this.units[column];
    });
    return modes;
  }
}

/** Weights (M, N) times an input (N,), plus biases (M,). */
function product([weights, biases], input) {
  const output = Float64Array.from(biases), width = input.length;
  for (let row = 0, k = 0; row < output.length; ++row) {
    for (let column = 0; column < width; ++column) output[row] += weights[k++] * input[column];
  }
  return output;
}
