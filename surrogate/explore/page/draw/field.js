// An ensemble's fields at any parameters, and how they are shown; see surrogate/emulation and surrogate/model/field_model.py.

import { normalized } from "draw/parameters.js";
import { Processes } from "draw/processes.js";

const NEIGHBOURS = around(); // offsets (z, y, x)

/** The emulated fields of a record and its tensors; all numbers are made when they are first asked for. */
export class Fields {
  constructor(tensors, record, parameters) {
    Object.assign(this, { tensors, record, parameters, emulators: [] });
  }

  /** The field of that number at parameters by name: {values, holes, shape, spacing, origin, size}. */
  at(number, values) {
    const emulator = this.emulators[number] ??= new Emulator(this.tensors, this.record.fields[number], `${number}.`);
    return emulator.at(normalized(this.parameters, values));
  }

  /** The appearance of visualization parameters: { appearance, distance }, the second along rays, undefined for what fits. */
  appearance(visualization, transfer) {
    const { base, surface, named, distances } = this.record;
    if ("isovalue" in visualization) return { appearance: { ...surface, isovalue: visualization.isovalue } };
    const shown = named[visualization.appearance] ?? base, distance = distances[shown.name];
    return transfer ? { appearance: { ...shown, transfer_function: transfer.function }, distance: transfer.free ? undefined : distance }
      : { appearance: shown, distance };
  }
}

/** Principal components of the members' fields, and a process through the coefficients of each. */
class Emulator {
  constructor(tensors, record, prefix) {
    const tensor = name => tensors.get(prefix + name);
    this.record = record;
    this.mean = tensor("mean").data;
    this.modes = ["modes", "weak_modes"].map(tensor);
    this.processes = new Processes(tensor, record.groups);
    this.solid = tensors.has(`${prefix}solid`) ? tensor("solid").codes ?? tensor("solid").data : null;
    this.outline = record.outline ? new Emulator(tensors, record.outline, `${prefix}outline.`) : null;
  }

  at(point) {
    const { shape, spacing, origin } = this.record;
    return { values: this.values(point), holes: this.holes(point), shape, spacing, origin, size: [...shape].reverse() };
  }

  /** The samples (V,) in the field's unit. */
  values(point) {
    const { mean, modes, processes, record: { scale } } = this, weights = Float32Array.from(processes.expected(point)), sums = new Float64Array(mean);
    let first = 0;
    for (const tensor of modes) {
      const count = tensor.shape[1] ?? 0, own = weights.subarray(first, first + count);
      addProducts(tensor, own, sums);
      first += count;
    }
    for (let i = 0; scale && i < sums.length; ++i) sums[i] = valueAt(sums[i], scale);
    return new Float32Array(sums);
  }

  /** Samples without a value, as 1 of (V,); null where there are none. */
  holes(point) {
    const { solid, outline } = this;
    if (!solid && !outline) return null;
    const holes = new Uint8Array(this.mean.length), moving = outline?.values(point);
    for (let i = 0; i < holes.length; ++i) holes[i] = solid && solid[i >> 3] >> 7 - (i & 7) & 1 || moving && moving[i] < 0 ? 1 : 0;
    return holes.some(Boolean) ? holes : null;
  }
}

/** Modes (V, K) times weights (K,), added to sums (V,): of codes at once. */
function addProducts({ codes, data, low, step }, weights, sums) {
  const count = weights.length, numbers = codes ?? data, own = Float64Array.from(weights, (weight, k) => codes ? weight * step[k] : weight);
  const constant = codes ? weights.reduce((sum, weight, k) => sum + weight * low[k], 0) : 0;
  for (let i = 0, at = 0; i < sums.length; ++i) {
    let sum = constant;
    for (let k = 0; k < count; ++k) sum += own[k] * numbers[at++];
    sums[i] += sum;
  }
}

/** The field value at a place on a scale of knots, which goes on as evenly beyond its ends. */
function valueAt(place, knots) {
  const steps = Math.fround(place) * (knots.length - 1), low = Math.min(Math.max(Math.floor(steps), 0), knots.length - 2);
  return knots[low] + (steps - low) * (knots[low + 1] - knots[low]);
}

/** Smallest and largest value of a field. */
export function rangeOf({ values, holes }) {
  let low = Infinity, high = -Infinity;
  for (let i = 0; i < values.length; ++i) {
    if (holes?.[i]) continue;
    low = Math.min(low, values[i]);
    high = Math.max(high, values[i]);
  }
  return [low, high];
}

/** Values whose holes are filled by the nearest of the 26 samples around that has one; see catalogs/vocabulary/holes.py. */
export function continued({ values, holes, size: [nx, ny, nz] }) {
  if (!holes) return values;
  const filled = values.slice(), any = values[holes.indexOf(0)];
  for (let k = 0, at = 0; k < nz; ++k) {
    for (let j = 0; j < ny; ++j) {
      for (let i = 0; i < nx; ++i, ++at) {
        if (!holes[at]) continue;
        const near = NEIGHBOURS.map(([z, y, x]) => [k + z, j + y, i + x]).find(([z, y, x]) =>
          z >= 0 && z < nz && y >= 0 && y < ny && x >= 0 && x < nx && !holes[(z * ny + y) * nx + x]);
        filled[at] = near ? values[(near[0] * ny + near[1]) * nx + near[2]] : any;
      }
    }
  }
  return filled;
}

function around() {
  const all = [-1, 0, 1].flatMap(z => [-1, 0, 1].flatMap(y => [-1, 0, 1].map(x => [z, y, x]))).filter(offset => offset.some(Boolean));
  const far = ([z, y, x]) => Math.abs(z) + Math.abs(y) + Math.abs(x);
  return all.sort((a, b) => far(a) - far(b) || a[2] - b[2] || a[1] - b[1] || a[0] - b[0]);
}
