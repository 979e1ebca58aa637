// A stored surrogate: its Gaussians, its emulated fields, and how they follow the parameters.

import { Fields } from "draw/field.js";
import { figuresOf } from "draw/figures.js";
import { decoded, parsed } from "draw/tensors.js";

/** The model of safetensors' bytes, null without, and the record beside them: {record, figures, fields}.  Throws for damage. */
export const modelOf = (gaussians, emulation, record) => ({
  record,
  figures: gaussians ? figuresOf(decoded(parsed(gaussians)), record) : [],
  fields: emulation ? new Fields(decoded(parsed(emulation)), record.emulation, record.parameters) : null,
});

/** The figure that shows visualization parameters by name, or any function: the base's, or that of one of its visualizations. */
export function figureFor({ record, figures }, visualization, byFunction = false) {
  const number = numberOf(record, visualization, byFunction);
  if (number < 0 || visualization.appearance === record.visualizations[number].variation.base) return figures[0];
  return figures[number + 1] ?? figures[0];
}

/** True where the Gaussians follow visualization parameters, or any function. */
export function follows({ record, figures }, visualization, byFunction) {
  if (!figures.length) return false;
  if (byFunction) return Boolean(figureFor({ record, figures }, visualization, true).base);
  return numberOf(record, visualization, false) >= 0 || !Object.keys(visualization).length;
}

function numberOf({ visualizations }, visualization, byFunction) {
  const shows = variation => byFunction ? variation.kind === "transfer_function" : argumentsOf(variation).some(name => name in visualization);
  return visualizations.findIndex(({ variation }) => shows(variation));
}

const argumentsOf = ({ kind, parameters }) => kind === "field" ? ["appearance"] : parameters.map(({ name }) => name);
