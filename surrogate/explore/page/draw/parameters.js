// Parameters as deformations take them: from -1 to 1 over their bounds; see catalogs/vocabulary/parameters.py.

const scaled = (parameter, value) => parameter.scale === "log" ? Math.log(value) : value;

/** Values of all `parameters`, by name, as a point (P,). */
export function normalized(parameters, values) {
  return Float64Array.from(parameters, parameter => {
    const low = scaled(parameter, parameter.low), high = scaled(parameter, parameter.high);
    return 2 * (scaled(parameter, values[parameter.name]) - low) / (high - low) - 1;
  });
}

/** Visualization parameters by name as a point (V,): isovalues with the trained ones at even steps, appearances by a 1 in their place. */
export function normalizedVariation({ kind, parameters, trained }, values) {
  if (kind === "field") return parameters.map(({ name }) => name === values.appearance ? 1 : 0);
  if (kind !== "isovalue") return [...normalized(parameters, values)];
  const value = values.isovalue, steps = trained.length - 1;
  let low = 0;
  while (low < steps - 1 && value >= trained[low + 1]) ++low;
  return [2 * (low + (value - trained[low]) / (trained[low + 1] - trained[low])) / steps - 1];
}

/** The point, then all sines, then all cosines, each coordinate by coordinate; see surrogate/deformation/positional.py. */
export function encoded(point, frequencies) {
  const turned = [...point].flatMap(x => Array.from({ length: frequencies }, (_, k) => Math.PI * 2 ** k * x));
  return Float64Array.from([...point, ...turned.map(Math.sin), ...turned.map(Math.cos)]);
}
