// Figures: the sets of Gaussians that a model shows, each with how it follows the parameters.  The base, and one for each
// visualization that has a deformation or Gaussians of its own; see surrogate/deformation/visualization.py.
//
// { record: {normalization, rasterizer, samples, field, lighting}, columns: {count, width, table}, embedding, emulated, base,
//   pointOf(values), made(point, transfer) }: `field` is there where the Gaussians carry values, `base` where they follow
// transfer functions.  `made` makes the table of columns, (N, width), where it depends on more than the embedding says.

import { AverageTable } from "draw/averages.js";
import { EmulatedValues } from "draw/emulated.js";
import { Embedding, NOTHING, summed } from "draw/embedding.js";
import { moved } from "draw/deformed.js";
import { resampled } from "draw/nodes.js";
import { normalized, normalizedVariation } from "draw/parameters.js";
import { applied, GEOMETRY, logitOf } from "draw/optics.js";
import { WeighedValues } from "draw/weighed.js";

const NAMES = ["means", "log_scales", "quats", "opacity_logits"];
const FINE = 512; // levels of averages that are made once

/** All figures of a model's tensors: the base, and those of the visualizations, null where these are the base under a function. */
export function figuresOf(tensors, record) {
  const { normalization, rasterizer, field, parameters } = record, { samples, surface_samples: finer } = rasterizer;
  const simulated = values => normalized(parameters, values);
  const base = {
    record: { normalization, rasterizer, samples, field }, columns: columnsOf(tensors, "gaussians."), pointOf: simulated,
    ...movingOf(tensors, record.deformation, "deformation."), base: field?.base,
  };
  return [base, ...record.visualizations.map((one, number) => {
    const prefix = `visualization${number}.`, { deformation: own, simulation: tuned, lighting } = one;
    if (!own) return null;
    const moving = tuned ? { ...base, ...movingOf(tensors, tuned, `${prefix}simulation.`) } : base;
    if (own.kind === "values") return weighed(moving, new WeighedValues(tensors.get(`${prefix}deformation.weights`), own));
    const pointOf = values => Float64Array.from([...simulated(values), ...normalizedVariation(one.variation, values)]);
    const embedding = new Embedding(tensors, own, `${prefix}deformation.`), plain = { normalization, rasterizer, samples };
    if (tensors.has(`${prefix}gaussians.means`)) {
      const lit = lighting ? { lighting, samples: finer } : {};
      return { record: { ...plain, ...lit }, columns: columnsOf(tensors, `${prefix}gaussians.`), embedding, pointOf };
    }
    const width = GEOMETRY + (one.color_degree || !field && base.columns.width > GEOMETRY + 3 ? 12 : 3);
    if (field) return coloured(moving, width, embedding, plain, pointOf);
    return { record: plain, columns: widened(base.columns, width), embedding: summed(moving.embedding, embedding), pointOf };
  })];
}

/** How a deformation of the simulation's parameters moves: { embedding, emulated }. */
function movingOf(tensors, record, prefix) {
  const { emulated } = record;
  return { embedding: new Embedding(tensors, record, prefix), emulated: emulated ? new EmulatedValues(tensors, emulated, `${prefix}emulated_`) : null };
}

/** All columns of the Gaussians: {count, width, table (N, width) float32}. */
function columnsOf(tensors, prefix) {
  const parts = NAMES.map(name => tensors.get(prefix + name));
  parts.push(tensors.get(`${prefix}values`) ?? tensors.get(`${prefix}colors`));
  const widths = parts.map(part => part.shape[1] ?? 1), count = parts[0].shape[0];
  const width = widths.reduce((sum, own) => sum + own, 0), table = new Float32Array(count * width);
  let first = 0;
  parts.forEach(({ data }, number) => {
    for (let i = 0; i < count; ++i) {
      for (let c = 0; c < widths[number]; ++c) table[i * width + first + c] = data[i * widths[number] + c];
    }
    first += widths[number];
  });
  return { count, width, table };
}

/** The same with `width` columns, of zeros where there were none. */
function widened({ count, width: before, table }, width) {
  const wide = new Float32Array(count * width);
  for (let i = 0; i < count; ++i) wide.set(table.subarray(i * before, (i + 1) * before), i * width);
  return { count, width, table: wide };
}

/** Gaussians that carry values under the base's function, as Gaussians of colours that a deformation moves further. */
function coloured(base, width, embedding, record, pointOf) {
  const { count } = base.columns, { base: transfer, knots } = base.record.field;
  const nodes = resampled(transfer, transfer.opacity_unit_distance, knots), averages = new AverageTable(nodes, FINE);
  const inner = new Float32Array(count * base.columns.width), look = new Float64Array(4);
  const made = point => {
    moved(base, point, inner);
    const table = new Float32Array(count * width);
    for (let i = 0; i < count; ++i) {
      const from = i * base.columns.width, to = i * width;
      table.set(inner.subarray(from, from + GEOMETRY - 1), to);
      applied(averages, nodes, inner, from, look);
      table[to + GEOMETRY - 1] = logitOf(look[0]);
      table.set(look.subarray(1), to + GEOMETRY);
    }
    return table;
  };
  return { record, columns: { count, width, table: null }, embedding, pointOf, made };
}

/** Gaussians of colours under a transfer function, by their weights of values. */
function weighed(base, weights) {
  const { count, width } = base.columns;
  const made = (point, transfer) => {
    const table = new Float32Array(count * width);
    moved(base, point, table);
    weights.apply(transfer, table, width);
    return table;
  };
  return { ...base, columns: { count, width, table: null }, embedding: NOTHING, emulated: null, base: weights.base, made };
}
