// The triangles of an isosurface: marching cubes with normals from central differences; see native/ray_casting/triangles.py.

import { continued, rangeOf } from "draw/field.js";

/**
 * The surface between samples of a field that are less than an isovalue and others: {places (P, 3) in samples, normals (P, 3) in
 * world units, corners (3 T,)}.  `cases` are the edges of triangles by which corners of a cell lie above.
 */
export function trianglesOf(field, isovalue, cases) {
  const values = continued(field), { holes, size: [nx, ny, nz] } = field, strides = [1, nx, nx * ny];
  const offsets = Array.from({ length: 8 }, (_, corner) => (corner & 1) + (corner >> 1 & 1) * strides[1] + (corner >> 2) * strides[2]);
  const edges = Array.from({ length: 12 }, (_, edge) => edgeOf(edge, strides)), cut = cases.map(word => Array.from(word, digit => parseInt(digit, 16)));
  const numbers = new Int32Array(3 * values.length).fill(-1), places = [], normals = [], corners = [], other = [0, 0, 0];
  const [low, high] = rangeOf(field);
  for (let k = 0; low < isovalue && isovalue <= high && k < nz - 1; ++k) {
    for (let j = 0; j < ny - 1; ++j) {
      for (let i = 0, at = (k * ny + j) * nx; i < nx - 1; ++i, ++at) {
        let code = 0, hidden = 0;
        for (let corner = 0; corner < 8; ++corner) {
          if (values[at + offsets[corner]] >= isovalue) code |= 1 << corner;
          if (holes) hidden |= holes[at + offsets[corner]];
        }
        if (hidden || !cut[code].length) continue;
        for (const edge of cut[code]) {
          const { axis, start } = edges[edge], from = at + start, key = 3 * from + axis;
          if (numbers[key] < 0) {
            numbers[key] = places.length / 3;
            addCorner(from, axis);
          }
          corners.push(numbers[key]);
        }
      }
    }
  }
  return { places: Float32Array.from(places), normals: Float32Array.from(normals), corners: Uint32Array.from(corners) };

  function addCorner(from, axis) {
    const before = [from % nx, Math.floor(from / nx) % ny, Math.floor(from / strides[2])], to = from + strides[axis];
    const share = (isovalue - values[from]) / (values[to] - values[from]), first = gradient(before);
    before.forEach((x, k) => { other[k] = x + (k === axis ? 1 : 0); });
    const second = gradient(other), normal = first.map((x, k) => x + share * (second[k] - x));
    const largest = Math.max(...normal.map(Math.abs)) || 1, scaled = normal.map(x => x / largest), length = Math.hypot(...scaled) || 1;
    places.push(...before.map((x, k) => k === axis ? x + share : x));
    normals.push(...scaled.map(x => x / length));
  }

  /** Central differences at a sample, one-sided on the faces. */
  function gradient(place) {
    return [0, 1, 2].map(axis => {
      const at = (place[2] * ny + place[1]) * nx + place[0], stride = strides[axis];
      const ahead = place[axis] < field.size[axis] - 1 ? 1 : 0, behind = place[axis] > 0 ? 1 : 0;
      return (values[at + ahead * stride] - values[at - behind * stride]) / ((ahead + behind) * field.spacing[axis]);
    });
  }
}

/** Of an edge of a cell, 4 times its axis plus 1 and 2 for the sides along the others: {axis, start}. */
function edgeOf(edge, strides) {
  const axis = edge >> 2, others = [0, 1, 2].filter(k => k !== axis);
  return { axis, start: (edge & 1) * strides[others[0]] + (edge >> 1 & 1) * strides[others[1]] };
}
