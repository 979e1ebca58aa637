// Optical depths of Gaussians, and what a transfer function makes of the values that they carry; see surrogate/appearance/transferred.py.

export const GEOMETRY = 11; // columns of a Gaussian before its colour or values: mean 3, logarithms of scales 3, quaternion 4, logit
export const DEPTHS = [1e-4, 12]; // of a Gaussian

export const clamped = (x, low, high) => Math.min(Math.max(x, low), high);
export const softplus = x => Math.max(x, 0) + Math.log1p(Math.exp(-Math.abs(x)));

/** The logit of the opacity of an optical depth. */
export const logitOf = depth => depth + Math.log(-Math.expm1(-depth));

/** Optical depth and colour, into `output` (4,), of the Gaussian whose columns begin at `from`, by a function's averages and nodes. */
export function applied(averages, { low, high, dark }, columns, from, output) {
  averages.at(columns[from + GEOMETRY], columns[from + GEOMETRY + 1], output);
  const extinction = output[0];
  output[0] = clamped(softplus(columns[from + GEOMETRY - 1]) * extinction, DEPTHS[0], DEPTHS[1]);
  for (let k = 0; k < 3; ++k) output[k + 1] = clamped(output[k + 1] / Math.max(extinction, dark), low[k], high[k]);
}
