// A stored surrogate: its Gaussians and how they follow the parameters.

import { Embedding } from "draw/embedding.js";
import { EmulatedValues } from "draw/emulated.js";
import { decoded, parsed } from "draw/tensors.js";

export const GEOMETRY = 11; // columns of a Gaussian before its colour or values: mean 3, logarithms of scales 3, quaternion 4, logit

/** The model of safetensors' bytes and the record beside them. Throws for damage, and for what only the server can draw. */
export function modelOf(bytes, record) {
  const tensors = decoded(parsed(bytes));
  if (record.deformation.kind !== "bilinear") {
    throw new Error(`a deformation of kind ${record.deformation.kind} is not drawn here: explore the run with its server`);
  }
  const { emulated } = record.deformation;
  return {
    record,
    columns: columnsOf(tensors),
    embedding: new Embedding(tensors, record.deformation),
    emulated: emulated ? new EmulatedValues(tensors, emulated) : null,
  };
}

/** All columns of the Gaussians: {count, width, table (N, width) float32}. */
function columnsOf(tensors) {
  const parts = ["means", "log_scales", "quats", "opacity_logits"].map(name => tensors.get(`gaussians.${name}`));
  parts.push(tensors.get("gaussians.values") ?? tensors.get("gaussians.colors"));
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
