// A stored surrogate: its Gaussians and how they follow the parameters.

import { figuresOf } from "draw/figures.js";
import { decoded, parsed } from "draw/tensors.js";

/** The model of safetensors' bytes and the record beside them: {record, figures}.  Throws for damage. */
export const modelOf = (bytes, record) => ({ record, figures: figuresOf(decoded(parsed(bytes)), record) });

/** The figure that shows visualization parameters by name, or any function: the base's, or that of one of its visualizations. */
export function figureFor({ record, figures }, visualization, byFunction = false) {
  const shows = variation => byFunction ? variation.kind === "transfer_function" : argumentsOf(variation).some(name => name in visualization);
  const number = record.visualizations.findIndex(({ variation }) => shows(variation));
  if (number < 0 || visualization.appearance === record.visualizations[number].variation.base) return figures[0];
  return figures[number + 1] ?? figures[0];
}

const argumentsOf = ({ kind, parameters }) => kind === "field" ? ["appearance"] : parameters.map(({ name }) => name);
