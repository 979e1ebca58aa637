// Gaussian processes through coefficients; see surrogate/emulation/processes.py.

export class Processes {
  /** `tensor` gives points (M, P), coefficients (M, K), lengths (G, P) and noises (G,) by these names; `groups` (K,) of the processes. */
  constructor(tensor, groups) {
    [this.points, this.coefficients, this.lengths, this.noises] =
      ["points", "coefficients", "lengths", "noises"].map(name => Float64Array.from(tensor(name).data));
    [this.members, this.parameters] = tensor("points").shape;
    this.groups = groups;
    this.count = groups.length; // K
    this.factors = Array.from(this.noises, (_, group) => this.factor(group));
    this.weights = this.predictor();
  }

  /** The Cholesky factor (M, M) of the covariance of the members. */
  factor(group) {
    const { members } = this, covariance = new Float64Array(members * members);
    for (let i = 0; i < members; ++i) {
      covariance.set(this.covariances(this.points.subarray(i * this.parameters, (i + 1) * this.parameters), group), i * members);
      covariance[i * members + i] += this.noises[group];
    }
    return cholesky(covariance, members);
  }

  /** The weights (M, K) of the processes' means (Rasmussen & Williams 2006, equation 2.25). */
  predictor() {
    const { members, count } = this, weights = new Float64Array(members * count);
    for (let group = 0; group < this.noises.length; ++group) {
      const factor = this.factors[group];
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

  /** The share of a group's variance that the members leave open at a normalized point (P,), from 0 to 1 (equation 2.26). */
  open(point, group) {
    const explained = forward(this.factors[group], this.covariances(point, group));
    return Math.min(1, Math.max(0, 1 - explained.reduce((sum, x) => sum + x * x, 0)));
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

/** x of L x = b, by the factor L (n, n). */
function forward(factor, b) {
  const n = b.length, x = b.slice();
  for (let i = 0; i < n; ++i) {
    for (let k = 0; k < i; ++k) x[i] -= factor[i * n + k] * x[k];
    x[i] /= factor[i * n + i];
  }
  return x;
}

/** x of L Lᵀ x = b. */
function solved(factor, b) {
  const n = b.length, x = forward(factor, b);
  for (let i = n - 1; i >= 0; --i) {
    for (let k = i + 1; k < n; ++k) x[i] -= factor[k * n + i] * x[k];
    x[i] /= factor[i * n + i];
  }
  return x;
}
