// Pictures by the graphics card.

import { finer, normalizedCamera } from "draw/camera.js";
import { Graphics } from "draw/graphics.js";
import { resampled } from "draw/nodes.js";
import { Order } from "draw/order.js";
import { averaged } from "draw/samples.js";
import * as shaders from "draw/shaders.js";
import { isBytes } from "draw/tensors.js";

const { ACROSS } = shaders, AT_ONCE = 4; // columns of four that a pass writes: WebGL2 promises as many targets

export class Cards {
  /** Of a figure; see figures.js. */
  constructor(figure, graphics) {
    const { count, width } = figure.columns;
    this.figure = figure;
    this.graphics = graphics;
    this.count = count;
    this.rows = Graphics.rows(count);
    this.fours = Math.ceil(width / 4);
    this.carried = figure.record.field !== undefined;
    this.order = new Order(count);
    this.means = new Float32Array(3 * count);
    this.reversed = new Uint32Array(ACROSS * this.rows);
    this.build();
    if (figure.base) this.setFunction(figure.base);
  }

  /** Everything that lies on the card. */
  build() {
    const { graphics, figure: { columns, embedding, record }, rows, fours, carried } = this;
    const { latents: stored } = embedding, codes = isBytes(stored);
    const length = ACROSS * rows, size = Math.ceil(embedding.size / 4);
    const latents = new (codes ? Uint8Array : Float32Array)(4 * length * Math.max(size, 1)), from = codes ? stored.codes : stored.data;
    for (let i = 0; i < columns.count; ++i) {
      for (let l = 0; l < embedding.size; ++l) latents[4 * ((l >> 2) * length + i) + (l & 3)] = from[i * embedding.size + l];
    }
    this.textures = {
      base: graphics.texture("numbers", ACROSS, rows * fours, columns.table && this.inFours(columns.table)),
      latents: graphics.texture(codes ? "codes" : "numbers", ACROSS, rows * Math.max(size, 1), latents),
      modes: graphics.texture("numbers", fours, embedding.size + 1),
      shifts: graphics.texture("single", ACROSS, rows, new Float32Array(length)),
      order: graphics.texture("order", ACROSS, rows, this.reversed),
    };
    this.moved = [];
    for (let first = 0; first < fours; first += AT_ONCE) {
      const count = Math.min(AT_ONCE, fours - first), what = { first, count, latents: embedding.size, codes };
      this.moved.push({ program: graphics.program(shaders.deform(what)), target: graphics.target("numbers", ACROSS, rows, count) });
    }
    this.ready = graphics.target("numbers", ACROSS, rows, 4);
    this.splats = graphics.target("numbers", ACROSS, rows, 3);
    const looks = { medium: carried && record.field.medium, degree: columns.width === 23 ? 1 : 0, lit: Boolean(record.lighting) };
    this.programs = {
      ready: graphics.program(shaders.ready({ carried })),
      project: graphics.program(shaders.project(looks)),
      splat: graphics.program(shaders.BLEND, shaders.SPLAT),
      show: graphics.program(shaders.SHOW),
    };
    this.list = this.triangles();
    this.picture = null;
  }

  /** Columns (N, width) as a texture has them, four by four. */
  inFours(table) {
    const { count, width } = this.figure.columns, length = ACROSS * this.rows, whole = new Float32Array(4 * length * this.fours);
    for (let i = 0; i < count; ++i) {
      for (let c = 0; c < width; ++c) whole[4 * ((c >> 2) * length + i) + (c & 3)] = table[i * width + c];
    }
    return whole;
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

  /** Show another transfer function, as of `TransferFunction`; where the figure has to be made, from the next parameters on. */
  setFunction(transfer) {
    this.transfer = transfer;
    if (!this.carried) return;
    const { base, knots } = this.figure.record.field, nodes = resampled(transfer, base.opacity_unit_distance, knots);
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

  /** Show other parameters, by name. */
  setParameters(values) {
    const { graphics, textures, figure, rows, fours, moved } = this, { embedding, emulated, columns } = figure;
    const point = figure.pointOf(values), modes = embedding.modes(point);
    if (figure.made) {
      columns.table = figure.made(point, this.transfer);
      graphics.write(textures.base, "numbers", ACROSS, rows * fours, this.inFours(columns.table));
    }
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
    const { embedding: { size, columns, latents } } = this.figure, { low, step } = latents, codes = isBytes(latents);
    const rows = new Float64Array(4 * this.fours * (size + 1));
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
    const { columns: { width, table }, embedding: { size, columns, latents: { data } } } = this.figure, { means, count } = this;
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
    const { graphics, textures, figure: { record }, moved, programs, count } = this, { rasterizer, samples } = record;
    const columns = moved.flatMap(({ target }) => target.textures);
    const named = Object.fromEntries(columns.map((texture, k) => [`columns${k}`, texture]));
    if (this.stale) graphics.run(programs.ready, this.ready, { ...textures, ...named, ...this.nodes, nodeCount: this.nodes?.count });
    this.stale = false;
    const seen = finer(normalizedCamera(camera, record.normalization), samples);
    this.sort(seen);
    const ready = Object.fromEntries(this.ready.textures.map((texture, k) => [`ready${k}`, texture]));
    const { near, dilation, alpha_floor: floorAlpha, alpha_cap: capAlpha } = rasterizer, size = [seen.width, seen.height];
    graphics.run(programs.project, this.splats, {
      ...named, ...ready, ...seen, ...lightOf(record.lighting), focal: [seen.fx, seen.fy], principal: [seen.cx, seen.cy], size, count, near, dilation, floorAlpha,
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
    const { graphics, programs, picture, figure: { record: { samples } } } = this, { width, height } = camera;
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

/** A light's numbers, as its shader takes them. */
const lightOf = light => light && { surface: light.color, light: [light.ambient, light.diffuse, light.specular, light.specular_power] };
