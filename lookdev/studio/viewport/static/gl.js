// @ts-check
// Wrappers of WebGL 2 for the viewport: programs that compile in the background, textures of
// buffers that the server names by digests, triangles, and waiting for the GPU.

// The channels, the type and the array of texels, by WebGL's internal format of a texture.
const FORMATS = {
  R32F: ["RED", "FLOAT", Float32Array],
  RGB32F: ["RGB", "FLOAT", Float32Array],
  RGBA32F: ["RGBA", "FLOAT", Float32Array],
  RGBA16F: ["RGBA", "HALF_FLOAT", Uint16Array],
  RGBA8: ["RGBA", "UNSIGNED_BYTE", Uint8Array],
  R32I: ["RED_INTEGER", "INT", Int32Array],
};

/** Return the WebGL 2 context of a canvas; throws an Error if the browser lacks a feature. */
export function createContext(canvas) {
  const gl = canvas.getContext("webgl2", {
    alpha: false,
    antialias: false,
    preserveDrawingBuffer: true,
  });
  if (!gl)
    throw new Error("this browser has no WebGL 2, or it is switched off: the viewport cannot draw");
  if (!gl.getExtension("EXT_color_buffer_float")) {
    throw new Error(
      "this browser has no float targets (EXT_color_buffer_float): " +
        "the viewport cannot add up light",
    );
  }
  gl.getExtension("OES_texture_float_linear");
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  return gl;
}

const pause = (milliseconds) => new Promise((resolve) => setTimeout(resolve, milliseconds));

/** Wait until the GPU has executed all calls; return the milliseconds of the wait. */
export async function waitForGpu(gl) {
  const started = performance.now();
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  while (!gl.isContextLost() && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED)
    await pause(1);
  gl.deleteSync(fence);
  return performance.now() - started;
}

/** All programs, by the texts of their shaders; equal texts share a program. */
export class Programs {
  constructor(gl) {
    this.gl = gl;
    this.parallel = gl.getExtension("KHR_parallel_shader_compile");
    this.programs = new Map();
    this.compiled = 0; // number of programs that were compiled so far
  }

  /**
   * Return a program once it is linked. Where the browser compiles in the background, the page does
   * not wait.
   */
  get(vertex, fragment) {
    const key = `${vertex}\n//\n${fragment}`;
    if (!this.programs.has(key)) this.programs.set(key, this.link(vertex, fragment));
    return this.programs.get(key);
  }

  /** Return a new program, once it is linked; throws an Error with the logs if it fails. */
  async link(vertex, fragment) {
    const { gl } = this,
      handle = gl.createProgram();
    this.compiled += 1;
    const shaders = [
      [gl.VERTEX_SHADER, vertex],
      [gl.FRAGMENT_SHADER, fragment],
    ].map(([type, text]) => {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, text);
      gl.compileShader(shader);
      gl.attachShader(handle, shader);
      return shader;
    });
    gl.linkProgram(handle);
    while (
      this.parallel &&
      !gl.isContextLost() &&
      !gl.getProgramParameter(handle, this.parallel.COMPLETION_STATUS_KHR)
    ) {
      await pause(4);
    }
    if (!gl.getProgramParameter(handle, gl.LINK_STATUS)) {
      const logs = [
        ...shaders.map((shader) => gl.getShaderInfoLog(shader)),
        gl.getProgramInfoLog(handle),
      ];
      throw new Error(`a shader does not compile: ${logs.filter(Boolean).join("\n")}`);
    }
    shaders.forEach((shader) => gl.deleteShader(shader));
    return new Program(gl, handle);
  }
}

/** A linked program: its uniforms by name, and a texture unit for each sampler. */
export class Program {
  constructor(gl, handle) {
    this.gl = gl;
    this.handle = handle;
    this.uniforms = new Map();
    this.units = new Map();
    gl.useProgram(handle);
    const count = gl.getProgramParameter(handle, gl.ACTIVE_UNIFORMS);
    for (let number = 0; number < count; number += 1) {
      const { name, type } = gl.getActiveUniform(handle, number);
      const location = gl.getUniformLocation(handle, name);
      this.uniforms.set(name, { location, type });
      const samplers = [
        gl.SAMPLER_2D,
        gl.SAMPLER_3D,
        gl.INT_SAMPLER_2D,
        gl.UNSIGNED_INT_SAMPLER_2D,
      ];
      if (samplers.includes(type)) {
        gl.uniform1i(location, this.units.size);
        this.units.set(name, this.units.size);
      }
    }
    const limit = gl.getParameter(gl.MAX_TEXTURE_IMAGE_UNITS);
    if (this.units.size > limit) {
      throw new Error(
        `a look reads ${this.units.size} textures with its lights; ` +
          `this browser has room for ${limit}`,
      );
    }
  }

  /**
   * Use the program with numbers, vectors, matrices and textures by their names; skip those that it
   * does not read.
   */
  use(numbers, textures = {}) {
    const { gl } = this;
    gl.useProgram(this.handle);
    for (const [name, value] of Object.entries(numbers)) {
      const uniform = this.uniforms.get(name);
      if (!uniform) continue;
      const values = typeof value === "object" ? value : [value];
      if (uniform.type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(uniform.location, false, values);
      else if (uniform.type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(uniform.location, false, values);
      else {
        const isWhole = [gl.INT, gl.INT_VEC2, gl.BOOL].includes(uniform.type);
        gl[`uniform${values.length}${isWhole ? "iv" : "fv"}`](uniform.location, values);
      }
    }
    this.bind(textures);
  }

  /** Bind a texture to each sampler. */
  bind(textures) {
    const { gl } = this;
    for (const [name, unit] of this.units) {
      const source = textures[name];
      if (!source) throw new Error(`no texture '${name}'`);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(source.target ?? gl.TEXTURE_2D, source.handle ?? source);
    }
  }
}

/** Return a new texture whose texels are read by texelFetch. */
export function createTexture(gl, format, width, height, data = null) {
  const [channels, type] = FORMATS[format];
  const handle = gl.createTexture();
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, handle);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl[format], width, height, 0, gl[channels], gl[type], data);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
    gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T])
    gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  return handle;
}

/** Write numbers to the beginning of a texture R32F with a width in texels, row by row. */
export function writeNumbers(gl, handle, width, numbers) {
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, handle);
  for (let from = 0; from < numbers.length; from += width) {
    const row = new Float32Array(numbers.slice(from, from + width));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from / width, row.length, 1, gl.RED, gl.FLOAT, row);
  }
}

/**
 * Triangles on the GPU, by vertices and indices, as lookdev.studio.viewport.geometry describes
 * them. A vertex has 16 bytes: its position, three floats, and a whole number.
 */
export class Triangles {
  constructor(gl, vertices, indices) {
    this.gl = gl;
    this.array = gl.createVertexArray();
    this.buffers = [gl.createBuffer(), gl.createBuffer()];
    gl.bindVertexArray(this.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers[0]);
    gl.bufferData(gl.ARRAY_BUFFER, vertices, gl.STATIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 16, 0);
    gl.enableVertexAttribArray(1);
    gl.vertexAttribIPointer(1, 1, gl.UNSIGNED_INT, 16, 12);
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers[1]);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, indices, gl.STATIC_DRAW);
    gl.bindVertexArray(null);
  }

  bind() {
    this.gl.bindVertexArray(this.array);
  }

  /** Draw the triangles from number `first` to before `last`. */
  draw(first, last) {
    this.gl.drawElements(this.gl.TRIANGLES, 3 * (last - first), this.gl.UNSIGNED_INT, 12 * first);
  }

  delete() {
    this.gl.deleteVertexArray(this.array);
    this.buffers.forEach((buffer) => this.gl.deleteBuffer(buffer));
  }
}

/**
 * All textures of buffers; each buffer is fetched once. The description of a texture has the
 * digest of its `buffer`, its `format`, `width` and `height`.
 */
export class Textures {
  /** `fetchBuffer` returns the bytes of a buffer by its digest, as a promise of an ArrayBuffer. */
  constructor(gl, fetchBuffer) {
    this.gl = gl;
    this.fetchBuffer = fetchBuffer;
    this.textures = new Map();
  }

  /** Return the textures of descriptions, by the names of the descriptions. */
  async loadAll(descriptions) {
    const entries = Object.entries(descriptions).map(async ([name, description]) => [
      name,
      await this.load(description),
    ]);
    return Object.fromEntries(await Promise.all(entries));
  }

  /** Return the texture of a description, as a promise; fetch its buffer if it is new. */
  load(description) {
    const key = textureKey(description);
    if (!this.textures.has(key)) {
      const bytes = this.fetchBuffer(description.buffer);
      this.textures.set(
        key,
        bytes.then((buffer) => this.upload(description, buffer)),
      );
    }
    return this.textures.get(key);
  }

  /** Return a new texture with the texels in some bytes; throws an Error if it is too large. */
  upload({ format, width, height }, bytes) {
    const limit = this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE);
    if (Math.max(width, height) > limit) {
      throw new Error(
        `an image of ${width} x ${height} texels; this browser has room for ${limit} a side`,
      );
    }
    return createTexture(this.gl, format, width, height, new FORMATS[format][2](bytes));
  }

  /** Delete all textures but those of some descriptions. */
  async deleteOthers(descriptions) {
    const keys = new Set(descriptions.map(textureKey));
    for (const [key, loading] of this.textures) {
      if (keys.has(key)) continue;
      this.textures.delete(key);
      this.gl.deleteTexture(await loading);
    }
  }
}

const textureKey = ({ buffer, format, width }) => `${buffer} ${format} ${width}`;

/** Return the textures of an OpenColorIO view, which lookdev.output.review.view describes. */
export function createViewTextures(gl, view) {
  const smooth = gl.getExtension("OES_texture_float_linear");
  return Object.fromEntries(
    view.textures.map((table) => {
      const bytes = Uint8Array.from(atob(table.texels), (c) => c.charCodeAt(0));
      const texels = new Float32Array(bytes.buffer);
      const target = table.size[2] > 1 ? gl.TEXTURE_3D : gl.TEXTURE_2D;
      const format = table.components === 1 ? gl.RED : gl.RGB;
      const [single, half] = table.components === 1 ? [gl.R32F, gl.R16F] : [gl.RGB32F, gl.RGB16F];
      const internal = smooth ? single : half,
        handle = gl.createTexture();
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(target, handle);
      if (target === gl.TEXTURE_3D)
        gl.texImage3D(target, 0, internal, ...table.size, 0, format, gl.FLOAT, texels);
      else
        gl.texImage2D(
          target,
          0,
          internal,
          table.size[0],
          table.size[1],
          0,
          format,
          gl.FLOAT,
          texels,
        );
      for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
        gl.texParameteri(target, filter, table.smooth ? gl.LINEAR : gl.NEAREST);
      }
      for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
        gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
      }
      return [table.sampler, { handle, target }];
    }),
  );
}
