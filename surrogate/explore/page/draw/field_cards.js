// Pictures of an emulated field by the graphics card.

import { finer } from "draw/camera.js";
import { FieldScripts } from "draw/field_scripts.js";
import * as shaders from "draw/field_shaders.js";
import { cameraOf, raysOf, SAMPLES } from "draw/rays.js";
import { SHOW } from "draw/shaders.js";

const TILE = 256, NEAREST = 1e-3; // pixels of a surface at once along each side; of the farthest depth

export class FieldCards extends FieldScripts {
  constructor(fields, graphics) {
    super(fields);
    Object.assign(this, { graphics, programs: {}, textures: {}, picture: null });
  }

  program(name, fragment, vertex) {
    return this.programs[name] ??= this.graphics.program(fragment, vertex);
  }

  useVolume(volume, distance) {
    const { graphics } = this, { values, hidden, size, knots } = volume;
    this.forget();
    const rows = new Float32Array(8 * knots.length);
    knots.forEach(([place, opacity, ...color], k) => {
      rows.set([place, opacity], 4 * k);
      rows.set(color, 4 * (knots.length + k));
    });
    this.textures = { field: graphics.volume("numbers", size, foursOf(values, size)), knots: graphics.texture("numbers", knots.length, 2, rows) };
    if (hidden) this.textures.hidden = graphics.volume("marks", size, hidden);
    super.useVolume(volume, distance);
  }

  useSurface(field, triangles) {
    super.useSurface(field, triangles);
    const { graphics } = this, { places, normals, corners } = triangles;
    this.forget();
    this.textures = { places: graphics.packed("numbers", inFours(places)), normals: graphics.packed("numbers", inFours(normals)), corners: graphics.packed("order", corners) };
  }

  forget() {
    for (const texture of Object.values(this.textures)) this.graphics.gl.deleteTexture(texture);
  }

  /** Draw what a world camera sees into numbers, premultiplied RGBA. */
  render(camera, distance = this.distance) {
    const { graphics } = this, { width, height } = camera;
    if (this.picture?.width !== width || this.picture?.height !== height) {
      graphics.release(this.picture);
      this.picture = graphics.target("numbers", width, height);
    }
    if (this.surface) this.renderSurface(camera);
    else this.renderVolume(camera, distance);
  }

  renderVolume(camera, apart) {
    const { graphics, textures, volume } = this, { size, low, high, spacing, knots, unit, light, hidden } = volume, what = { holes: Boolean(hidden), shaded: Boolean(light) };
    const program = this.program(`volume ${JSON.stringify(what)}`, shaders.volume(what));
    graphics.run(program, this.picture, { ...textures, ...raysOf(camera, volume), last: size.map(n => n - 1), low, high, spacing, apart, unit, light, knotCount: knots.length });
  }

  renderSurface(camera) {
    const { graphics, textures, surface: { triangles, look, grid } } = this, fine = finer(camera, SAMPLES), { width, height } = camera, local = cameraOf(fine, grid);
    this.tile ??= graphics.target("numbers", SAMPLES * TILE, SAMPLES * TILE, 1, true);
    const program = this.program("surface", shaders.SURFACE, shaders.CORNERS), means = this.program("means", shaders.MEANS);
    const shared = {
      ...textures, ...local, surface: look.color, light: look.light, turn: camera.world_to_camera.slice(0, 3).flatMap(row => row.slice(0, 3)),
      focal: [fine.fx, fine.fy], principal: [fine.cx, fine.cy], ends: endsOf(grid, local), side: SAMPLES * TILE,
    };
    for (let top = 0; top < height; top += TILE) {
      for (let left = 0; left < width; left += TILE) {
        graphics.run(program, this.tile, { ...shared, tile: [SAMPLES * left, SAMPLES * top] }, gl => {
          gl.clearColor(0, 0, 0, 0);
          gl.enable(gl.DEPTH_TEST);
          gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
          gl.drawArrays(gl.TRIANGLES, 0, triangles.corners.length);
          gl.disable(gl.DEPTH_TEST);
        });
        graphics.run(means, this.picture, { samples: this.tile.textures[0], tile: [left, top] }, gl => {
          gl.viewport(left, top, Math.min(TILE, width - left), Math.min(TILE, height - top));
          gl.drawArrays(gl.TRIANGLES, 0, 3);
        });
      }
    }
  }

  castVolume(camera, distance) {
    this.render(camera, distance);
    const { gl } = this.graphics, { frame, width, height } = this.picture, numbers = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, numbers);
    return numbers;
  }

  draw(camera) {
    return this.castVolume(camera, this.distance);
  }

  /** A bitmap of what a world camera sees, over a background [red, green, blue]; no number leaves the card. */
  bitmap(camera, background) {
    this.render(camera);
    const { graphics, picture } = this, { width, height } = camera;
    Object.assign(graphics.canvas, { width, height });
    graphics.run(this.program("show", SHOW), null, { picture: picture.textures[0], background, samples: 1, height });
    return createImageBitmap(graphics.canvas);
  }
}

/** Values of each sample, of its neighbours along x and y, and of that along both. */
function foursOf(values, [nx, ny, nz]) {
  const fours = new Float32Array(4 * values.length);
  for (let at = 0, to = 0; at < nx * ny * nz; ++at) {
    fours[to++] = values[at];
    fours[to++] = values[at + 1];
    fours[to++] = values[at + nx];
    fours[to++] = values[at + nx + 1];
  }
  return fours;
}

/** Rows of three (P, 3) as texels of four. */
function inFours(threes) {
  const fours = new Float32Array(4 * threes.length / 3);
  for (let at = 0, to = 0; at < threes.length; at += 3, to += 4) fours.set(threes.subarray(at, at + 3), to);
  return fours;
}

/** One over the farthest and over the nearest depth of a field's box. */
function endsOf({ size }, { matrix, shift }) {
  const depths = Array.from({ length: 8 }, (_, corner) =>
    size.reduce((sum, n, k) => sum + (corner >> k & 1) * (n - 1) * matrix[6 + k], shift[2]));
  const far = Math.max(...depths, 1e-30);
  return [1 / (1.01 * far), 1 / Math.max(0.99 * Math.min(...depths), NEAREST * far)];
}
