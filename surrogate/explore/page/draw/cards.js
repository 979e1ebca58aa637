// Pictures by the graphics card.

import { finer, normalizedCamera } from "draw/camera.js";
import { Graphics } from "draw/graphics.js";
import { resampled } from "draw/nodes.js";
import { Order } from "draw/order.js";
import { normalized } from "draw/parameters.js";
import { averaged } from "draw/samples.js";
import * as shaders from "draw/shaders.js";

const { ACROSS } = shaders, AT_ONCE = 4; // columns of four that a pass writes: WebGL2 promises as many targets

export class Cards {
  constructor(model, graphics) {
    const { count, width } = model.columns;
    this.model = model;
    this.graphics = graphics;
    this.count = count;
    this.rows = Graphics.rows(count);
    this.fours = Math.ceil(width / 4);
    this.carried = model.record.field !== undefined;
    this.order = new Order(count);
    this.means = new Float32Array(3 * count);
    this.reversed = new Uint32Array(ACROSS * this.rows);
    this.build();
    if (this.carried) this.setFunction(model.record.field.base);
  }

  /** Everything that lies on the card. */
  build() {
    const { graphics, model, rows, fours, carried } = this, { columns, embedding } = model, { codes, data } = embedding.latents;
    const length = ACROSS * rows, base = new Float32Array(4 * length * fours), size = Math.ceil(embedding.size / 4);
    const latents = new (codes ? Uint8Array : Float32Array)(4 * length * size), from = codes ?? data;
    for (let i = 0; i < columns.count; ++i) {
      for (let c = 0; c < columns.width; ++c) base[4 * ((c >> 2) * length + i) + (c & 3)] = columns.table[i * columns.width + c];
      for (let l = 0; l < embedding.size; ++l) latents[4 * ((l >> 2) * length + i) + (l & 3)] = from[i * embedding.size + l];
    }
    this.textures = {
      base: graphics.texture("numbers", ACROSS, rows * fours, base),
      latents: graphics.texture(codes ? "codes" : "numbers", ACROSS, rows * size, latents),
      modes: graphics.texture("numbers", fours, embedding.size + 1),
      shifts: graphics.texture("single", ACROSS, rows, new Float32Array(length)),
      order: graphics.texture("order", ACROSS, rows, this.reversed),
    };
    this.moved = [];
    for (let first = 0; first < fours; first += AT_ONCE) {
      const count = Math.min(AT_ONCE, fours - first), what = { first, count, latents: embedding.size, codes: Boolean(codes) };
      this.moved.push({ program: graphics.program(shaders.deform(what)), target: graphics.target("numbers", ACROSS, rows, count) });
    }
    this.ready = graphics.target("numbers", ACROSS, rows, 4);
    this.splats = graphics.target("numbers", ACROSS, rows, 3);
    this.programs = {
      ready: graphics.program(shaders.ready({ carried })),
      project: graphics.program(shaders.project({ medium: carried && model.record.field.medium, degree: columns.width === 23 ? 1 : 0 })),
      splat: graphics.program(shaders.BLEND, shaders.SPLAT),
      show: graphics.program(shaders.SHOW),
    };
    this.list = this.triangles();
    this.picture = null;
  }

  /** Two triangles a splat, of vertices 4 n to 4 n + 3. */
  triangles() {
    const { gl } = this.graphics, corners = [0, 1, 2, 2, 1, 3], list = new Uint32Array(6 * this.count), array = gl.createVertexArray();
    for (let k = 0; k < list.length; ++k) list[k] = 4 * Math.floor(k / 6) + corners[k % 6];
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, list, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
    return array;
  }

  /** Show another transfer function, as of `TransferFunction`. */
  setFunction(transfer) {
    const { base, knots } = this.model.record.field, nodes = resampled(transfer, base.opacity_unit_distance, knots);
    const count = nodes.places.length, data = new Float32Array(8 * count);
    for (let k = 0; k < count; ++k) {
      data.set([nodes.places[k], k ? nodes.places[k] - nodes.places[k - 1] : 0], 4 * k);
      data.set(nodes.columns.subarray(4 * k, 4 * k + 4), 4 * (count + k));
    }
    this.graphics.gl.deleteTexture(this.textures.nodes ?? null);
    this.textures.nodes = this.graphics.texture("numbers", count, 2, data);
    this.nodes = { ...nodes, count };
    this.stale = true;
  }

  /** Show other simulation parameters, by name. */
  setParameters(values) {
    const { graphics, textures, model: { record, embedding, emulated }, rows, fours, moved } = this;
    const point = normalized(record.parameters, values), modes = embedding.modes(point);
    graphics.write(textures.modes, "numbers", fours, embedding.size + 1, this.modesForLatents(modes));
    const shifts = emulated?.shifts(point);
    if (shifts) {
      const whole = new Float32Array(ACROSS * rows);
      whole.set(shifts);
      graphics.write(textures.shifts, "single", ACROSS, rows, whole);
    }
    for (const { program, target } of moved) graphics.run(program, target, { ...textures, rows });
    this.moveMeans(modes);
    this.stale = true;
  }

  /** Modes (L + 1, fours, 4) for latents as they are stored: with the steps of codes, and in the last row what their lows add. */
  modesForLatents(modes) {
    const { embedding: { size, columns, latents: { codes, low, step } } } = this.model, rows = new Float64Array(4 * this.fours * (size + 1));
    for (let l = 0; l < size; ++l) {
      for (let c = 0; c < columns; ++c) {
        const mode = modes[l * columns + c];
        rows[4 * this.fours * l + c] = codes ? mode * step[l] : mode;
        if (codes) rows[4 * this.fours * size + c] += mode * low[l];
      }
    }
    return Float32Array.from(rows);
  }

  /** The means (N, 3) for the order, here: three columns. */
  moveMeans(modes) {
    const { columns: { width, table }, embedding: { size, columns, latents: { data } } } = this.model, { means, count } = this;
    const own = Float64Array.from({ length: 3 * size }, (_, k) => modes[Math.floor(k / 3) * columns + k % 3]);
    for (let i = 0, at = 0; i < count; ++i) {
      let x = table[i * width], y = table[i * width + 1], z = table[i * width + 2];
      for (let l = 0; l < 3 * size; l += 3) {
        const latent = data[at++];
        x += latent * own[l];
        y += latent * own[l + 1];
        z += latent * own[l + 2];
      }
      means[3 * i] = x;
      means[3 * i + 1] = y;
      means[3 * i + 2] = z;
    }
  }

  /** Draw what a world camera sees into numbers, premultiplied RGBA. */
  render(camera) {
    const { graphics, textures, model: { record }, moved, programs, count } = this, { rasterizer } = record;
    const columns = moved.flatMap(({ target }) => target.textures);
    const named = Object.fromEntries(columns.map((texture, k) => [`columns${k}`, texture]));
    if (this.stale) graphics.run(programs.ready, this.ready, { ...textures, ...named, ...this.nodes, nodeCount: this.nodes?.count });
    this.stale = false;
    const seen = finer(normalizedCamera(camera, record.normalization), rasterizer.samples);
    this.sort(seen);
    const ready = Object.fromEntries(this.ready.textures.map((texture, k) => [`ready${k}`, texture]));
    const { near, dilation, alpha_floor: floorAlpha, alpha_cap: capAlpha } = rasterizer, size = [seen.width, seen.height];
    graphics.run(programs.project, this.splats, {
      ...named, ...ready, ...seen, focal: [seen.fx, seen.fy], principal: [seen.cx, seen.cy], size, count, near, dilation, floorAlpha,
    });
    if (this.picture?.width !== seen.width || this.picture?.height !== seen.height) {
      graphics.release(this.picture);
      this.picture = graphics.target(graphics.blends, seen.width, seen.height);
    }
    const splats = Object.fromEntries(this.splats.textures.map((texture, k) => [`splats${k}`, texture]));
    graphics.run(programs.splat, this.picture, { ...splats, order: textures.order, size, floorAlpha, capAlpha }, gl => {
      gl.clearColor(0, 0, 0, 0);
      gl.clear(gl.COLOR_BUFFER_BIT);
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.bindVertexArray(this.list);
      gl.drawElements(gl.TRIANGLES, 6 * count, gl.UNSIGNED_INT, 0);
      gl.bindVertexArray(null);
      gl.disable(gl.BLEND);
    });
  }

  /** The order of this very frame, farthest first. */
  sort({ rotation, translation }) {
    const { order, means, count, reversed, rows } = this;
    for (let i = 0; i < count; ++i) {
      const depth = rotation[6] * means[3 * i] + rotation[7] * means[3 * i + 1] + rotation[8] * means[3 * i + 2] + translation[2];
      order.depths[i] = depth > 0 ? depth : 0;
    }
    const numbers = order.sorted();
    for (let i = 0; i < count; ++i) reversed[i] = numbers[count - 1 - i];
    this.graphics.write(this.textures.order, "order", ACROSS, rows, reversed);
  }

  /** A bitmap of what a world camera sees, over a background [red, green, blue]; no number leaves the card. */
  bitmap(camera, background) {
    this.render(camera);
    const { graphics, programs, picture, model: { record: { rasterizer: { samples } } } } = this, { width, height } = camera;
    Object.assign(graphics.canvas, { width, height });
    graphics.run(programs.show, null, { picture: picture.textures[0], background, samples, height });
    return createImageBitmap(graphics.canvas);
  }

  /** The picture of a world camera: premultiplied RGBA (H, W, 4) float32. */
  draw(camera) {
    this.render(camera);
    const { gl } = this.graphics, { frame, width, height } = this.picture, numbers = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, numbers);
    return averaged(numbers, camera.width, camera.height, width / camera.width);
  }
}
