// Values that follow an emulated field: what Gaussian processes expect at a point, and what that adds to each Gaussian's value.
// See surrogate/deformation/emulated_values.py.

import { onScale } from "draw/nodes.js";

const BEYOND = 0.2; // of the scale, by which values may lie outside its ends

export class EmulatedValues {
  /** `tensors` by name, with `prefix`; `record` is the deformation's "emulated". */
  constructor(tensors, record, prefix = "deformation.emulated_") {
    const tensor = name => tensors.get(prefix + name);
    this.share = record.share;
    this.knots = record.knots;
    this.groups = record.groups;
    this.means = tensor("means").data; // [N]
    this.modes = tensor("modes").data; // [N, K]
    [this.points, this.coefficients, this.lengths, this.noises] =
      ["points", "coefficients", "lengths", "noises"].map(name => Float64Array.from(tensor(name).data));
    [this.members, this.parameters] = tensor("points").shape;
    this.count = this.groups.length; // K
    this.weights = this.predictor();
    this.still = Float64Array.from(this.means, value => this.carried(value)); // [N]
  }

  /** The weights (M, K) of the processes' means (Rasmussen & Williams 2006, equation 2.25). */
  predictor() {
    const { members, count } = this, weights = new Float64Array(members * count);
    for (let group = 0; group < this.noises.length; ++group) {
      const covariance = new Float64Array(members * members);
      for (let i = 0; i < members; ++i) {
        covariance.set(this.covariances(this.points.subarray(i * this.parameters, (i + 1) * this.parameters), group), i * members);
        covariance[i * members + i] += this.noises[group];
      }
      const factor = cholesky(covariance, members);
      for (let k = 0; k < count; ++k) {
        if (this.groups[k] !== group) continue;
        const solution = solved(factor, Float64Array.from({ length: members }, (_, i) => this.coefficients[i * count + k]));
        for (let i = 0; i < members; ++i) weights[i * count + k] = solution[i];
      }
    }
    return weights;
  }

  /** Matérn 5/2 covariances (M,) of a point (P,) with the members, of a group's length scales (equation 4.17). */
  covariances(point, group) {
    return Float64Array.from({ length: this.members }, (_, i) => {
      let square = 0;
      for (let p = 0; p < this.parameters; ++p) {
        square += ((point[p] - this.points[i * this.parameters + p]) / this.lengths[group * this.parameters + p]) ** 2;
      }
      const distance = Math.sqrt(5 * square);
      return (1 + distance + distance ** 2 / 3) * Math.exp(-distance);
    });
  }

  /** The means (K,) of the processes at a normalized point (P,). */
  expected(point) {
    const means = new Float64Array(this.count);
    const near = Array.from(this.noises, (_, group) => this.covariances(point, group));
    for (let i = 0; i < this.members; ++i) {
      for (let k = 0; k < this.count; ++k) means[k] += near[this.groups[k]][i] * this.weights[i * this.count + k];
    }
    return means;
  }

  /** The changes of the values (N,) at a normalized point (P,). */
  shifts(point) {
    const expected = Float32Array.from(this.expected(point)), { count, modes, means } = this;
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

/** The lower Cholesky factor of a symmetric positive matrix (n, n). */
function cholesky(matrix, n) {
  const factor = new Float64Array(n * n);
  for (let i = 0; i < n; ++i) {
    for (let j = 0; j <= i; ++j) {
      let rest = matrix[i * n + j];
      for (let k = 0; k < j; ++k) rest -= factor[i * n + k] * factor[j * n + k];
      factor[i * n + j] = i === j ? Math.sqrt(rest) : rest / factor[j * n + j];
    }
  }
  return factor;
}

/** x of L Lᵀ x = b, by the factor L (n, n). */
function solved(factor, b) {
  const n = b.length, x = b.slice();
  for (let i = 0; i < n; ++i) {
    for (let k = 0; k < i; ++k) x[i] -= factor[i * n + k] * x[k];
    x[i] /= factor[i * n + i];
  }
  for (let i = n - 1; i >= 0; --i) {
    for (let k = i + 1; k < n; ++k) x[i] -= factor[k * n + i] * x[k];
    x[i] /= factor[i * n + i];
  }
  return x;
}
