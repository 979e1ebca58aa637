// WebGL2: programs, data textures and targets.

import { ACROSS, WHOLE } from "draw/shaders.js";

const FORMATS = { // internal format, format and type, by their names in WebGL
  numbers: ["RGBA32F", "RGBA", "FLOAT"], single: ["R32F", "RED", "FLOAT"], halves: ["RGBA16F", "RGBA", "HALF_FLOAT"],
  codes: ["RGBA8UI", "RGBA_INTEGER", "UNSIGNED_BYTE"], marks: ["R8UI", "RED_INTEGER", "UNSIGNED_BYTE"], order: ["R32UI", "RED_INTEGER", "UNSIGNED_INT"],
};

export class Graphics {
  /** Throws where the browser has no WebGL2 that draws into numbers. */
  constructor(canvas) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true });
    if (!gl || !gl.getExtension("EXT_color_buffer_float")) throw new Error("this browser draws no numbers");
    this.gl = gl;
    this.canvas = canvas;
    this.blends = gl.getExtension("EXT_float_blend") ? "numbers" : "halves";
    const names = gl.getExtension("WEBGL_debug_renderer_info");
    this.renderer = String(names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : gl.getParameter(gl.RENDERER));
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.DITHER);
  }

  /** True where a processor does the work of a graphics card. */
  get software() {
    return /swiftshader|llvmpipe|softpipe|basic render/i.test(this.renderer);
  }

  /** A data texture (height, width) of a format, with `data` or empty. */
  texture(format, width, height, data = null) {
    const { gl } = this, [internal, layout, type] = FORMATS[format].map(name => gl[name]), texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage2D(gl.TEXTURE_2D, 0, internal, width, height, 0, layout, type, data);
    for (const filter of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_2D, gl[filter], gl.NEAREST);
    for (const wrap of ["TEXTURE_WRAP_S", "TEXTURE_WRAP_T"]) gl.texParameteri(gl.TEXTURE_2D, gl[wrap], gl.CLAMP_TO_EDGE);
    return texture;
  }

  /** A data texture of all texels of `data`, `ACROSS` a row. */
  packed(format, data) {
    const channels = format === "numbers" ? 4 : 1, count = data.length / channels, rows = Graphics.rows(count);
    const whole = new data.constructor(channels * ACROSS * rows);
    whole.set(data);
    return this.texture(format, ACROSS, rows, whole);
  }

  /** A data texture in space, of a size (3,), with `data`. */
  volume(format, size, data) {
    const { gl } = this, [internal, layout, type] = FORMATS[format].map(name => gl[name]), texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_3D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texImage3D(gl.TEXTURE_3D, 0, internal, ...size, 0, layout, type, data);
    for (const filter of ["TEXTURE_MIN_FILTER", "TEXTURE_MAG_FILTER"]) gl.texParameteri(gl.TEXTURE_3D, gl[filter], gl.NEAREST);
    return texture;
  }

  /** Write other data into a texture of the same size. */
  write(texture, format, width, height, data) {
    const { gl } = this, [, layout, type] = FORMATS[format].map(name => gl[name]);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, layout, type, data);
  }

  /** A target of `count` textures, perhaps with depths. */
  target(format, width, height, count = 1, depths = false) {
    const { gl } = this, frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const textures = Array.from({ length: count }, (_, k) => {
      const texture = this.texture(format, width, height);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0 + k, gl.TEXTURE_2D, texture, 0);
      return texture;
    });
    gl.drawBuffers(textures.map((_, k) => gl.COLOR_ATTACHMENT0 + k));
    if (depths) {
      gl.bindRenderbuffer(gl.RENDERBUFFER, gl.createRenderbuffer());
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT32F, width, height);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, gl.getParameter(gl.RENDERBUFFER_BINDING));
    }
    if (gl.checkFramebufferStatus(gl.FRAMEBUFFER) !== gl.FRAMEBUFFER_COMPLETE) throw new Error(`no target of ${format}`);
    return { frame, textures, width, height, format };
  }

  release(target) {
    if (!target) return;
    target.textures.forEach(texture => this.gl.deleteTexture(texture));
    this.gl.deleteFramebuffer(target.frame);
  }

  /** A program of two shaders; without a vertex shader one that fills its target. Throws with the compiler's words. */
  program(fragment, vertex = WHOLE) {
    const { gl } = this, program = gl.createProgram();
    for (const [type, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) {
      throw new Error(gl.getAttachedShaders(program).map(shader => gl.getShaderInfoLog(shader)).join(" ") + gl.getProgramInfoLog(program));
    }
    const count = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS), uniforms = new Map();
    for (let k = 0; k < count; ++k) {
      const { name, type } = gl.getActiveUniform(program, k);
      uniforms.set(name, { type, at: gl.getUniformLocation(program, name) });
    }
    return { program, uniforms };
  }

  /** Draw with a program into a target, the canvas where it is null: textures and numbers by the names of its uniforms. */
  run({ program, uniforms }, target, values, draw = gl => gl.drawArrays(gl.TRIANGLES, 0, 3)) {
    const { gl, canvas } = this, samplers = { [gl.SAMPLER_2D]: gl.TEXTURE_2D, [gl.UNSIGNED_INT_SAMPLER_2D]: gl.TEXTURE_2D,
      [gl.SAMPLER_3D]: gl.TEXTURE_3D, [gl.UNSIGNED_INT_SAMPLER_3D]: gl.TEXTURE_3D };
    gl.bindFramebuffer(gl.FRAMEBUFFER, target?.frame ?? null);
    gl.viewport(0, 0, target?.width ?? canvas.width, target?.height ?? canvas.height);
    gl.useProgram(program);
    let unit = 0;
    for (const [name, { type, at }] of uniforms) {
      const value = values[name];
      if (type in samplers) {
        gl.activeTexture(gl.TEXTURE0 + unit);
        gl.bindTexture(samplers[type], value);
        gl.uniform1i(at, unit++);
      } else if (type === gl.INT) gl.uniform1i(at, value);
      else if (type === gl.FLOAT) gl.uniform1f(at, value);
      else if (type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(at, true, value);
      else gl[`uniform${value.length}fv`](at, value);
    }
    draw(gl);
  }

  /** The rows of a data texture that hold `count` texels. */
  static rows(count) {
    return Math.max(Math.ceil(count / ACROSS), 1);
  }
}
