// Pictures by plain scripts, for machines without a graphics card: the same as surrogate/splatting/reference.py defines.

import { AverageTable } from "draw/averages.js";
import { finer, normalizedCamera } from "draw/camera.js";
import { moved } from "draw/deformed.js";
import { resampled } from "draw/nodes.js";
import { applied, clamped, GEOMETRY, softplus } from "draw/optics.js";
import { Order } from "draw/order.js";
import { averaged } from "draw/samples.js";

const MARGIN = 0.15, LEAST_TRANSMITTANCE = 1e-4, SHORTEST = 1e-12; // as `Constants` of the engine
const MOST_DEPTH = 80, LEAST_FACING = 1e-6; // along a ray; of a lit surface
const LIKE = 14, SPLAT = 10; // numbers of a Gaussian that is ready to be seen, and of one that is projected
const FIRST_DEGREE = 0.4886025119029199; // sqrt(3 / (4 pi))

export class Scripts {
  /** Of a figure; see figures.js. */
  constructor(figure) {
    const { count, width } = figure.columns;
    this.figure = figure;
    this.count = count;
    this.moved = new Float32Array(count * width); // columns at the parameters
    this.ready = new Float32Array(count * LIKE); // mean, optical depth, unit quaternion, scales, colour
    this.splats = new Float32Array(count * SPLAT);
    this.order = new Order(count);
    this.carried = figure.record.field !== undefined;
    if (figure.base) this.setFunction(figure.base);
  }

  /** Show another transfer function, as of `TransferFunction`; where the figure has to be made, from the next parameters on. */
  setFunction(transfer) {
    this.transfer = transfer;
    if (!this.carried) return;
    const { base, knots } = this.figure.record.field;
    this.nodes = resampled(transfer, base.opacity_unit_distance, knots);
    this.table = new AverageTable(this.nodes);
    this.stale = true;
  }

  /** Show other parameters, by name. */
  setParameters(values) {
    const { figure } = this, point = figure.pointOf(values);
    if (figure.made) figure.columns.table = figure.made(point, this.transfer);
    moved(figure, point, this.moved);
    this.stale = true;
  }

  /** Make Gaussians ready to be seen from anywhere: unit quaternions, scales, and what the transfer function makes of their values. */
  prepare() {
    const { moved: columns, ready, count, carried, nodes } = this, { width } = this.figure.columns, look = new Float64Array(4);
    for (let i = 0; i < count; ++i) {
      const from = i * width, to = i * LIKE;
      ready.set(columns.subarray(from, from + 3), to);
      const length = Math.hypot(columns[from + 6], columns[from + 7], columns[from + 8], columns[from + 9]);
      for (let k = 0; k < 4; ++k) ready[to + 4 + k] = length > SHORTEST ? columns[from + 6 + k] / length : 0;
      for (let k = 0; k < 3; ++k) ready[to + 8 + k] = Math.exp(columns[from + 3 + k]);
      if (carried) {
        applied(this.table, nodes, columns, from, look);
        for (let k = 0; k < 3; ++k) ready[to + 11 + k] = look[k + 1];
      }
      ready[to + 3] = carried ? look[0] : softplus(columns[from + 10]);
    }
    this.stale = false;
  }

  /** The picture of a world camera: premultiplied RGBA (H, W, 4) float32. */
  draw(camera) {
    const { normalization, samples } = this.figure.record;
    if (this.stale) this.prepare();
    const seen = finer(normalizedCamera(camera, normalization), samples);
    const picture = this.composite(this.order.sorted(this.project(seen)), seen);
    return averaged(picture, camera.width, camera.height, samples);
  }

  /** Project all Gaussians that can be seen, with their depths; returns how many. */
  project(camera) {
    const { ready, splats, order, count, figure: { record, columns: { width } } } = this;
    const { rotation: R, translation, position, fx, fy, cx, cy, width: across, height: down } = camera;
    const { near, dilation, alpha_floor: floor } = record.rasterizer, medium = this.carried && record.field.medium;
    const left = (-cx - MARGIN * across) / fx, right = (across - cx + MARGIN * across) / fx;
    const top = (-cy - MARGIN * down) / fy, bottom = (down - cy + MARGIN * down) / fy;
    let drawn = 0;
    for (let i = 0; i < count; ++i) {
      const at = i * LIKE, x = ready[at], y = ready[at + 1], z = ready[at + 2];
      const depth = R[6] * x + R[7] * y + R[8] * z + translation[2];
      if (!(depth > near)) continue;
      const [w, qx, qy, qz] = [ready[at + 4], ready[at + 5], ready[at + 6], ready[at + 7]];
      const [s0, s1, s2] = [ready[at + 8], ready[at + 9], ready[at + 10]];
      const q00 = 1 - 2 * (qy * qy + qz * qz), q01 = 2 * (qx * qy - w * qz), q02 = 2 * (qx * qz + w * qy);
      const q10 = 2 * (qx * qy + w * qz), q11 = 1 - 2 * (qx * qx + qz * qz), q12 = 2 * (qy * qz - w * qx);
      const q20 = 2 * (qx * qz - w * qy), q21 = 2 * (qy * qz + w * qx), q22 = 1 - 2 * (qx * qx + qy * qy);
      const dx = x - position[0], dy = y - position[1], dz = z - position[2], square = dx * dx + dy * dy + dz * dz;
      let optical = ready[at + 3];
      if (medium && square > 0) { // opacity along the ray; see surrogate/splatting/along_rays.py
        const a = (q00 * dx + q10 * dy + q20 * dz) / s0, b = (q01 * dx + q11 * dy + q21 * dz) / s1;
        const c = (q02 * dx + q12 * dy + q22 * dz) / s2, local = (a * a + b * b + c * c) / square;
        if (local > 0) optical = Math.min(optical / (Math.cbrt(s0 * s1 * s2) * Math.sqrt(local)), MOST_DEPTH);
      }
      const opacity = -Math.expm1(-optical);
      if (!(opacity > floor)) continue;
      const ratioX = (R[0] * x + R[1] * y + R[2] * z + translation[0]) / depth;
      const ratioY = (R[3] * x + R[4] * y + R[5] * z + translation[1]) / depth;
      const limitedX = clamped(ratioX, left, right), limitedY = clamped(ratioY, top, bottom), perX = fx / depth, perY = fy / depth;
      const j0 = perX * (R[0] - limitedX * R[6]), j1 = perX * (R[1] - limitedX * R[7]), j2 = perX * (R[2] - limitedX * R[8]);
      const k0 = perY * (R[3] - limitedY * R[6]), k1 = perY * (R[4] - limitedY * R[7]), k2 = perY * (R[5] - limitedY * R[8]);
      const a0 = (j0 * q00 + j1 * q10 + j2 * q20) * s0, a1 = (j0 * q01 + j1 * q11 + j2 * q21) * s1, a2 = (j0 * q02 + j1 * q12 + j2 * q22) * s2;
      const b0 = (k0 * q00 + k1 * q10 + k2 * q20) * s0, b1 = (k0 * q01 + k1 * q11 + k2 * q21) * s1, b2 = (k0 * q02 + k1 * q12 + k2 * q22) * s2;
      const n0 = a1 * b2 - a2 * b1, n1 = a2 * b0 - a0 * b2, n2 = a0 * b1 - a1 * b0;
      const xx = a0 * a0 + a1 * a1 + a2 * a2, yy = b0 * b0 + b1 * b1 + b2 * b2 + dilation, xy = a0 * b0 + a1 * b1 + a2 * b2;
      const determinant = n0 * n0 + n1 * n1 + n2 * n2 + dilation * (xx + yy); // by Cauchy and Binet
      if (!(determinant > 0)) continue;
      const ux = Math.sqrt(yy / determinant), to = drawn * SPLAT; // d S^-1 d = (ux dx + uy dy)² + (vy dy)²
      splats[to] = ratioX * fx + cx;
      splats[to + 1] = ratioY * fy + cy;
      splats[to + 2] = ux;
      splats[to + 3] = -ux * xy / yy;
      splats[to + 4] = 1 / Math.sqrt(yy);
      splats[to + 5] = opacity;
      splats[to + 6] = 2 * Math.log(opacity / floor);
      if (this.carried) splats.set(ready.subarray(at + 11, at + 14), to + 7);
      else if (record.lighting) lit(record.lighting, this.moved, i * width + GEOMETRY, dx, dy, dz, Math.sqrt(square), splats, to + 7);
      else this.colorOf(i * width + GEOMETRY, width - GEOMETRY, dx, dy, dz, Math.sqrt(square), splats, to + 7);
      order.depths[drawn++] = depth;
    }
    return drawn;
  }

  /** The colour of a Gaussian from a direction, by spherical harmonics of degree 0 or 1; see surrogate/splatting/directional.py. */
  colorOf(at, columns, dx, dy, dz, length, output, to) {
    const c = this.moved, turn = columns === 12 && length > 0 ? FIRST_DEGREE / length : 0;
    for (let k = 0; k < 3; ++k) {
      output[to + k] = c[at + k] + (turn && turn * (-dy * c[at + 3 + k] + dz * c[at + 6 + k] - dx * c[at + 9 + k]));
    }
  }

  /** Composite splats by their numbers, nearest first. */
  composite(numbers, { width, height }) {
    const { splats } = this, { alpha_cap: cap } = this.figure.record.rasterizer;
    const picture = new Float32Array(4 * width * height); // the last of four is the transmittance until the end
    for (let at = 3; at < picture.length; at += 4) picture[at] = 1;
    for (const number of numbers) {
      const at = number * SPLAT, x = splats[at], y = splats[at + 1], ux = splats[at + 2], uy = splats[at + 3], vy = splats[at + 4];
      const opacity = splats[at + 5], square = splats[at + 6], [red, green, blue] = splats.subarray(at + 7, at + 10);
      const reach = Math.sqrt(square) / vy, fall = Math.exp(-ux * ux);
      const last = Math.min(Math.floor(y + reach - 0.5), height - 1);
      for (let row = Math.max(Math.ceil(y - reach - 0.5), 0); row <= last; ++row) {
        const dy = row + 0.5 - y, v = vy * dy, rest = square - v * v;
        if (rest < 0) continue;
        const half = Math.sqrt(rest) / ux, middle = x - uy * dy / ux - 0.5;
        const from = Math.max(Math.ceil(middle - half), 0), to = Math.min(Math.floor(middle + half), width - 1);
        const u = ux * (from + 0.5 - x) + uy * dy; // the next pixel's exponential follows from this one's
        let alpha = opacity * Math.exp(-0.5 * (u * u + v * v)), step = Math.exp(-u * ux - 0.5 * ux * ux);
        for (let pixel = 4 * (row * width + from), end = 4 * (row * width + to); pixel <= end; pixel += 4) {
          const through = picture[pixel + 3];
          if (through >= LEAST_TRANSMITTANCE) {
            const weight = through * Math.min(alpha, cap);
            picture[pixel] += weight * red;
            picture[pixel + 1] += weight * green;
            picture[pixel + 2] += weight * blue;
            picture[pixel + 3] = through - weight;
          }
          alpha *= step;
          step *= fall;
        }
      }
    }
    for (let at = 3; at < picture.length; at += 4) picture[at] = 1 - picture[at];
    return picture;
  }
}

/** The colour of a lit surface of the normal at `at` from a direction; see surrogate/lighting.py. */
function lit({ color, ambient, diffuse, specular, specular_power: power }, normals, at, dx, dy, dz, length, output, to) {
  const along = length > 0 ? (normals[at] * dx + normals[at + 1] * dy + normals[at + 2] * dz) / length : 0;
  const facing = clamped(Math.abs(along), LEAST_FACING, 1), gloss = specular * facing ** power;
  for (let k = 0; k < 3; ++k) output[to + k] = Math.min((ambient + diffuse * facing) * color[k] + gloss, 1);
}
