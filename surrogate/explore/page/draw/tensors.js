// Tensors of a stored model: safetensors, whose columns may be in few bits; see surrogate/storage/encoding.py.

const TYPES = { F32: Float32Array, U16: Uint16Array, U8: Uint8Array, F16: Uint16Array };

/** The stored tensors of safetensors' bytes, by name: {shape, type, data}. Throws for damage. */
export function parsed(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  const length = Number(view.getBigUint64(0, true)), start = 8 + length;
  if (start > bytes.length) throw new Error("the model is damaged: its header is longer than it");
  const header = JSON.parse(new TextDecoder().decode(bytes.subarray(8, start))), stored = new Map();
  for (const [name, { shape, dtype, data_offsets: [from, to] }] of Object.entries(header)) {
    if (name === "__metadata__") continue;
    const type = TYPES[dtype], count = shape.reduce((product, n) => product * n, 1);
    if (!type || to - from !== count * type.BYTES_PER_ELEMENT || from < 0 || start + to > bytes.length) {
      throw new Error(`the model is damaged: tensor ${name}`);
    }
    const own = bytes.slice(start + from, start + to).buffer; // a copy begins where any type may
    stored.set(name, { shape, type: dtype, data: new type(own) });
  }
  return stored;
}

/** The tensors that these decode to, by name: {shape, data}; those of levels keep their `codes` with `low` and `step` of a column. */
export function decoded(stored) {
  const tensors = new Map();
  for (const [name, tensor] of stored) {
    if (!name.includes("/")) tensors.set(name, { shape: tensor.shape, data: tensor.data });
    if (!name.endsWith("/codes")) continue;
    const own = name.slice(0, -"/codes".length), low = stored.get(`${own}/low`), step = stored.get(`${own}/step`);
    tensors.set(own, low ? levels({ shape: tensor.shape, codes: tensor.data, low: low.data, step: step.data }) : { shape: tensor.shape, data: halves(tensor.data) });
  }
  return tensors;
}

/** A tensor of levels, whose numbers are computed when they are first asked for. */
function levels({ shape, codes, low, step }) {
  let numbers = null;
  return { shape, codes, low, step, get data() { return numbers ??= numbersOf(codes, low, step); } };
}

function numbersOf(codes, low, step) {
  const columns = low.length, data = new Float32Array(codes.length);
  for (let i = 0, column = 0; i < codes.length; ++i) {
    data[i] = Math.fround(low[column] + Math.fround(codes[i] * step[column]));
    if (++column === columns) column = 0;
  }
  return data;
}

/** True of a tensor whose codes have 8 bits. */
export const isBytes = ({ codes }) => codes instanceof Uint8Array;

/** Numbers of half precision (IEEE 754-2008, binary16). */
function halves(bits) {
  return Float32Array.from(bits, half => {
    const sign = half & 0x8000 ? -1 : 1, exponent = half >> 10 & 31, fraction = half & 1023;
    return sign * (exponent ? 2 ** (exponent - 15) * (1 + fraction / 1024) : 2 ** -14 * fraction / 1024);
  });
}
