// Numbers of an emulated field all over the parameters, a prediction at a time; see surrogate/explore/server/predictions.py.

const PREDICTIONS = 500, LEVELS = 129, AWHILE = 30, PAUSE = 4; // the last two in milliseconds, of work and for hands
const ABANDONED = 5000; // milliseconds without a question after which the work stops

export class Measured {
  /** Of the field of a number, with its name and unit, and the knots of its scale, null for none. */
  constructor(fields, number, { knots, ...quantity }) {
    Object.assign(this, { fields, number, knots, quantity, rows: [], isWorking: false });
    this.parameters = points(PREDICTIONS, fields.parameters.length).map(place => place.map((share, i) => valueAt(fields.parameters[i], share)));
  }

  /** The share that is `done`, or all: see `predictions` in connection.js. */
  answer() {
    this.wanted = performance.now();
    if (this.rows.length < PREDICTIONS) {
      if (!this.isWorking) this.work();
      return { done: this.rows.length / PREDICTIONS };
    }
    const numbers = new Float32Array(this.rows.flat());
    return { parameters: this.parameters, runs: 0, levels: this.levels, ...this.quantity, pictures: [new Uint8Array(numbers.buffer)] };
  }

  async work() {
    this.isWorking = true;
    if (!this.levels) {
      const { values } = this.at(Object.fromEntries(this.fields.parameters.map(p => [p.name, valueAt(p, 0.5)])));
      const knots = this.knots ?? [values.reduce((a, b) => Math.min(a, b)), values.reduce((a, b) => Math.max(a, b))], last = knots.length - 1;
      this.levels = Array.from({ length: LEVELS }, (_, i) => {
        const step = i / (LEVELS - 1) * last, low = Math.min(Math.floor(step), last - 1);
        return knots[low] + (step - low) * (knots[low + 1] - knots[low]);
      });
    }
    let until = performance.now() + AWHILE;
    while (this.rows.length < PREDICTIONS && performance.now() - this.wanted < ABANDONED) {
      const values = this.parameters[this.rows.length];
      this.rows.push(this.measured(this.at(Object.fromEntries(this.fields.parameters.map((p, i) => [p.name, values[i]])))));
      if (performance.now() < until) continue;
      await new Promise(resolve => { setTimeout(resolve, PAUSE); });
      until = performance.now() + AWHILE;
    }
    this.isWorking = false;
  }

  at(parameters) { return this.fields.at(this.number, parameters); }

  /** Mean, minimum, maximum, and the shares of samples above each of the levels. */
  measured({ values, holes }) {
    const { levels } = this, above = new Float64Array(LEVELS + 1);
    let sum = 0, low = Infinity, high = -Infinity, count = 0;
    for (let i = 0; i < values.length; ++i) {
      if (holes?.[i]) continue;
      const value = values[i];
      let from = 0, to = LEVELS; // as many levels lie below the value
      while (from < to) {
        const middle = from + to >> 1;
        if (value > levels[middle]) from = middle + 1;
        else to = middle;
      }
      above[from] += 1;
      sum += value;
      count += 1;
      if (value < low) low = value;
      if (value > high) high = value;
    }
    for (let i = LEVELS - 1; i > 0; --i) above[i] += above[i + 1];
    return [sum / count, low, high, ...above.subarray(1).map(samples => samples / count)];
  }
}

const valueAt = ({ low, high, scale }, share) => scale === "log" ? low * (high / low) ** share : low + (high - low) * share;

/** Places (count, P) in the unit cube, evenly all over: an additive recurrence (Roberts 2018, "The unreasonable effectiveness of quasirandom sequences"). */
function points(count, dimensions) {
  let root = 2;
  for (let i = 0; i < 40; ++i) root = (1 + root) ** (1 / (dimensions + 1));
  return Array.from({ length: count }, (_, i) => Array.from({ length: dimensions }, (_, k) => (0.5 + (i + 1) * root ** -(k + 1)) % 1));
}
