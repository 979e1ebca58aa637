// The embedding network of a bilinear deformation: modes E(p) that all Gaussians share; see surrogate/deformation/bilinear.py.

import { encoded } from "draw/parameters.js";
import { isBytes } from "draw/tensors.js";

const silu = x => x / (1 + Math.exp(-x));

export class Embedding {
  /** `tensors` by name, of which the deformation's begin with `prefix`; `record` is what it says of itself. */
  constructor(tensors, record, prefix) {
    const tensor = name => tensors.get(prefix + name);
    this.units = Float64Array.from(record.units);
    this.frequencies = record.frequencies ?? 0;
    this.latents = tensor("latents");
    this.size = this.latents.shape[1]; // L
    this.columns = this.units.length; // C
    this.inputs = tensor("weights_in").shape[1] / (1 + 2 * this.frequencies); // P
    this.first = [tensor("weights_in").data, tensor("biases_in").data];
    this.middle = [tensor("weights_middle").data, tensor("biases_middle").data];
    this.last = [tensor("weights_out").data, tensor("biases_out").data];
    this.used = [...this.units.keys()].filter(column => this.units[column] !== 0); // others are not stored
  }

  /** The modes (L, C) at a normalized point, of which the first P parameters count, float64. */
  modes(point) {
    const hidden = product(this.first, encoded(point.subarray(0, this.inputs), this.frequencies)).map(silu);
    const more = product(this.middle, hidden).map(silu);
    const last = product(this.last, hidden.map((x, i) => x + more[i])); // [L, used]
    const modes = new Float64Array(this.size * this.columns);
    this.used.forEach((column, at) => {
      for (let l = 0; l < this.size; ++l) modes[l * this.columns + column] = last[l * this.used.length + at] * this.units[column];
    });
    return modes;
  }
}

/** The embedding of what nothing moves. */
export const NOTHING = { size: 0, columns: 0, latents: { data: new Float32Array(0) }, modes: () => new Float64Array(0) };

/** Two embeddings as one, whose offsets are the sum of theirs. */
export function summed(first, second) {
  const columns = Math.max(first.columns, second.columns), both = [first, second], size = first.size + second.size;
  const count = first.latents.data.length / first.size, coded = both.every(({ latents }) => isBytes(latents));
  const latents = { data: sideBySide(both, Float32Array, "data", count) };
  if (coded) {
    latents.codes = sideBySide(both, Uint8Array, "codes", count);
    for (const name of ["low", "step"]) latents[name] = Float32Array.from(both.flatMap(one => [...one.latents[name]]));
  }
  const modes = point => {
    const whole = new Float64Array(size * columns);
    both.forEach((one, which) => {
      const own = one.modes(point), start = which ? first.size : 0;
      for (let l = 0; l < one.size; ++l) whole.set(own.subarray(l * one.columns, (l + 1) * one.columns), (start + l) * columns);
    });
    return whole;
  };
  return { size, columns, latents, modes };
}

/** Rows of two tables (N, L) one after the other: (N, L + L'). */
function sideBySide([first, second], Type, name, count) {
  const size = first.size + second.size, whole = new Type(count * size);
  for (let i = 0; i < count; ++i) {
    whole.set(first.latents[name].subarray(i * first.size, (i + 1) * first.size), i * size);
    whole.set(second.latents[name].subarray(i * second.size, (i + 1) * second.size), i * size + first.size);
  }
  return whole;
}

/** Weights (M, N) times an input (N,), plus biases (M,). */
function product([weights, biases], input) {
  const output = Float64Array.from(biases), width = input.length;
  for (let row = 0, k = 0; row < output.length; ++row) {
    for (let column = 0; column < width; ++column) output[row] += weights[k++] * input[column];
  }
  return output;
}
