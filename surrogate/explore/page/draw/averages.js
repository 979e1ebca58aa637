// A transfer function averaged over normally distributed values, in closed form; see surrogate/appearance/averages.py.
// The table is for scripts: averages and their derivatives by the value, at places a third of a spread apart.

import { SPREADS, VALUES } from "draw/nodes.js";

const CELL = 1 / 3, FAR = 8; // of a spread; spreads beyond which a bend is a bend
const ROOT = Math.sqrt(2 * Math.PI);

/** The normal distribution's cumulative function, to 2e-7 relative in its lower tail (Press et al. 1992, section 6.2: erfcc). */
export function cumulative(z) {
  const x = Math.abs(z) * Math.SQRT1_2, t = 1 / (1 + 0.5 * x);
  const terms = [1.00002368, 0.37409196, 0.09678418, -0.18628806, 0.27886807, -1.13520398, 1.48851587, -0.82215223, 0.17087277];
  const lower = 0.5 * t * Math.exp(-x * x - 1.26551223 + t * terms.reduceRight((sum, term) => sum * t + term));
  return z > 0 ? 1 - lower : lower;
}

/** H(z) = z Phi(z) + phi(z), whose derivative is Phi. */
const ramp = z => z * cumulative(z) + Math.exp(-0.5 * z * z) / ROOT;

/** Averages of nodes at any value and spread, by cubic interpolation along values and linear along logarithms of spreads. */
export class AverageTable {
  /** With as many `levels` of spreads. */
  constructor({ places, columns }, levels = 64) {
    this.lowest = Math.log(SPREADS[0]);
    this.step = (Math.log(SPREADS[1]) - this.lowest) / (levels - 1);
    this.levels = Array.from({ length: levels }, (_, level) => levelOf(places, columns, Math.exp(this.lowest + level * this.step)));
  }

  /** The four columns at a value and the logarithm of a spread, into `output` (4,). */
  at(value, logSpread, output) {
    const last = this.levels.length - 1, place = Math.min(Math.max((logSpread - this.lowest) / this.step, 0), last);
    const level = Math.min(Math.floor(place), last - 1), share = place - level;
    output.fill(0);
    this.levels[level].add(value, 1 - share, output);
    this.levels[level + 1].add(value, share, output);
  }
}

/** One spread: averages and derivatives by value at even places. */
function levelOf(places, columns, spread) {
  const count = Math.ceil((VALUES[1] - VALUES[0]) / (CELL * spread)) + 1, cell = (VALUES[1] - VALUES[0]) / (count - 1);
  const table = new Float64Array(8 * count), bends = bendsOf(places, columns);
  const slopes = new Float64Array(4 * (count + 1)), levels = new Float64Array(4 * (count + 1));
  for (const { place, jumps, turns } of bends) {
    const near = Math.max(0, Math.ceil((place - FAR * spread - VALUES[0]) / cell));
    const beyond = Math.max(0, Math.min(count, Math.ceil((place + FAR * spread - VALUES[0]) / cell)));
    for (let i = near; i < beyond; ++i) {
      const z = (VALUES[0] + i * cell - place) / spread, below = cumulative(z), density = Math.exp(-0.5 * z * z) / ROOT;
      const rise = spread * ramp(z);
      for (let c = 0; c < 4; ++c) {
        table[8 * i + c] += turns[c] * rise + jumps[c] * below;
        table[8 * i + 4 + c] += turns[c] * below + jumps[c] * density / spread;
      }
    }
    for (let c = 0; c < 4; ++c) { // from there on the bend is a line and the step is whole
      slopes[4 * beyond + c] += turns[c];
      levels[4 * beyond + c] += jumps[c] - turns[c] * place;
    }
  }
  for (let c = 0; c < 4; ++c) {
    let slope = 0, level = columns[c];
    for (let i = 0; i < count; ++i) {
      slope += slopes[4 * i + c];
      level += levels[4 * i + c];
      table[8 * i + c] += level + slope * (VALUES[0] + i * cell);
      table[8 * i + 4 + c] += slope;
    }
  }
  return { add: (value, weight, output) => addCubic(table, count, cell, value, weight, output) };
}

/** The places where nodes' lines change their slope, or step: [{place, jumps (4,), turns (4,)}]. */
function bendsOf(places, columns) {
  const bends = Array.from(places, place => ({ place, jumps: [0, 0, 0, 0], turns: [0, 0, 0, 0] }));
  for (let k = 0; k + 1 < places.length; ++k) {
    const width = places[k + 1] - places[k];
    for (let c = 0; c < 4; ++c) {
      const change = columns[4 * k + 4 + c] - columns[4 * k + c];
      if (width < 1e-12) bends[k].jumps[c] += change;
      else {
        bends[k].turns[c] += change / width;
        bends[k + 1].turns[c] -= change / width;
      }
    }
  }
  return bends;
}

/** Cubic Hermite interpolation in a row of values and derivatives (count, 8), times a weight. */
function addCubic(table, count, cell, value, weight, output) {
  const place = (Math.min(Math.max(value, VALUES[0]), VALUES[1]) - VALUES[0]) / cell;
  const i = Math.min(Math.floor(place), count - 2), x = place - i, at = 8 * i;
  const second = x * x * (3 - 2 * x), first = 1 - second, leaving = cell * x * (1 - x) * (1 - x), arriving = cell * x * x * (x - 1);
  for (let c = 0; c < 4; ++c) {
    output[c] += weight * (first * table[at + c] + second * table[at + 8 + c] + leaving * table[at + 4 + c] + arriving * table[at + 12 + c]);
  }
}
