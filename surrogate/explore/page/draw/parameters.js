// Parameters as deformations take them: from -1 to 1 over their bounds; see catalogs/vocabulary/parameters.py.

const scaled = (parameter, value) => parameter.scale === "log" ? Math.log(value) : value;

/** Values of all `parameters`, by name, as a point (P,). */
export function normalized(parameters, values) {
  return Float64Array.from(parameters, parameter => {
    const low = scaled(parameter, parameter.low), high = scaled(parameter, parameter.high);
    return 2 * (scaled(parameter, values[parameter.name]) - low) / (high - low) - 1;
  });
}

/** The point, then all sines, then all cosines, each coordinate by coordinate; see surrogate/deformation/positional.py. */
export function encoded(point, frequencies) {
  const turned = [...point].flatMap(x => Array.from({ length: frequencies }, (_, k) => Math.PI * 2 ** k * x));
  return Float64Array.from([...point, ...turned.map(Math.sin), ...turned.map(Math.cos)]);
}
