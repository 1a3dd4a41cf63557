// @ts-check
// WebGL 2: programs that compile in the background, textures by the digests of their content, and
// fences.

const FORMATS = {
  R32F: ["RED", "FLOAT", Float32Array],
  RGB32F: ["RGB", "FLOAT", Float32Array],
  RGBA32F: ["RGBA", "FLOAT", Float32Array],
  RGBA16F: ["RGBA", "HALF_FLOAT", Uint16Array],
  RGBA8: ["RGBA", "UNSIGNED_BYTE", Uint8Array],
  R32I: ["RED_INTEGER", "INT", Int32Array],
};

/** Return WebGL 2 of a canvas; throws an Error that says what the browser lacks. */
export function context(canvas) {
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

/** Wait until the GPU has done what it was given; returns the milliseconds since. */
export async function finished(gl) {
  const started = performance.now();
  const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
  gl.flush();
  while (!gl.isContextLost() && gl.clientWaitSync(fence, 0, 0) === gl.TIMEOUT_EXPIRED)
    await pause(1);
  gl.deleteSync(fence);
  return performance.now() - started;
}

/** Programs by their texts: equal texts share one. */
export class Programs {
  constructor(gl) {
    this.gl = gl;
    this.parallel = gl.getExtension("KHR_parallel_shader_compile");
    this.made = new Map();
    this.compiled = 0; // programs so far
  }

  /**
   * Return a program once it is linked; the page goes on meanwhile where the browser compiles in
   * the background.
   */
  get(vertex, fragment) {
    const key = `${vertex}\n//\n${fragment}`;
    if (!this.made.has(key)) this.made.set(key, this.link(vertex, fragment));
    return this.made.get(key);
  }

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
        ...shaders.map((each) => gl.getShaderInfoLog(each)),
        gl.getProgramInfoLog(handle),
      ];
      throw new Error(`a shader does not compile: ${logs.filter(Boolean).join("\n")}`);
    }
    shaders.forEach((each) => gl.deleteShader(each));
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
      const at = gl.getUniformLocation(handle, name);
      this.uniforms.set(name, { at, type });
      const samplers = [
        gl.SAMPLER_2D,
        gl.SAMPLER_3D,
        gl.INT_SAMPLER_2D,
        gl.UNSIGNED_INT_SAMPLER_2D,
      ];
      if (samplers.includes(type)) {
        gl.uniform1i(at, this.units.size);
        this.units.set(name, this.units.size);
      }
    }
    const room = gl.getParameter(gl.MAX_TEXTURE_IMAGE_UNITS);
    if (this.units.size > room) {
      throw new Error(
        `a look reads ${this.units.size} textures with its lights; ` +
          `this browser has room for ${room}`,
      );
    }
  }

  /**
   * Use the program with numbers, vectors, matrices and textures by their names; those that it does
   * not read are passed over.
   */
  use(numbers, textures = {}) {
    const { gl } = this;
    gl.useProgram(this.handle);
    for (const [name, value] of Object.entries(numbers)) {
      const uniform = this.uniforms.get(name);
      if (!uniform) continue;
      const values = typeof value === "object" ? value : [value];
      if (uniform.type === gl.FLOAT_MAT3) gl.uniformMatrix3fv(uniform.at, false, values);
      else if (uniform.type === gl.FLOAT_MAT4) gl.uniformMatrix4fv(uniform.at, false, values);
      else {
        const whole = [gl.INT, gl.INT_VEC2, gl.BOOL].includes(uniform.type);
        gl[`uniform${values.length}${whole ? "iv" : "fv"}`](uniform.at, values);
      }
    }
    this.bind(textures);
  }

  /** Bind a texture to each sampler. */
  bind(textures) {
    const { gl } = this;
    for (const [name, unit] of this.units) {
      const bound = textures[name];
      if (!bound) throw new Error(`no texture '${name}'`);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(bound.target ?? gl.TEXTURE_2D, bound.handle ?? bound);
    }
  }
}

/** A texture whose texels are read by texelFetch. */
export function texture(gl, format, width, height, data = null) {
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

/** Write the first numbers of a texture R32F, row by row. */
export function writeNumbers(gl, handle, width, numbers) {
  gl.activeTexture(gl.TEXTURE0);
  gl.bindTexture(gl.TEXTURE_2D, handle);
  for (let from = 0; from < numbers.length; from += width) {
    const row = new Float32Array(numbers.slice(from, from + width));
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, from / width, row.length, 1, gl.RED, gl.FLOAT, row);
  }
}

/**
 * Triangles by vertices of three floats and a number each, and indices, as
 * lookdev.studio.viewport.geometry has them.
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

  draw(first, last) {
    this.gl.drawElements(this.gl.TRIANGLES, 3 * (last - first), this.gl.UNSIGNED_INT, 12 * first);
  }

  delete() {
    this.gl.deleteVertexArray(this.array);
    this.buffers.forEach((each) => this.gl.deleteBuffer(each));
  }
}

/** Textures of buffers that are fetched by their digests, each once. */
export class Textures {
  constructor(gl, fetched) {
    this.gl = gl;
    this.fetched = fetched;
    this.made = new Map();
  }

  /** Return the textures of descriptions by name, fetched where they are new. */
  async get(described) {
    const entries = Object.entries(described).map(async ([name, each]) => [
      name,
      await this.one(each),
    ]);
    return Object.fromEntries(await Promise.all(entries));
  }

  one(each) {
    const key = `${each.buffer} ${each.format} ${each.width}`;
    if (!this.made.has(key)) {
      this.made.set(
        key,
        this.fetched(each.buffer).then((bytes) => {
          const most = this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE);
          if (Math.max(each.width, each.height) > most) {
            throw new Error(
              `an image of ${each.width} x ${each.height} texels; ` +
                `this browser has room for ${most} a side`,
            );
          }
          return texture(
            this.gl,
            each.format,
            each.width,
            each.height,
            new FORMATS[each.format][2](bytes),
          );
        }),
      );
    }
    return this.made.get(key);
  }

  /** Delete the textures that none of some scenes describes. */
  async keep(described) {
    const kept = new Set(described.map((each) => `${each.buffer} ${each.format} ${each.width}`));
    for (const [key, made] of this.made) {
      if (kept.has(key)) continue;
      this.made.delete(key);
      this.gl.deleteTexture(await made);
    }
  }
}

/** The tables of a view of OpenColorIO, as lookdev.output.review.view describes them. */
export function viewTextures(gl, view) {
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
      for (const which of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) {
        gl.texParameteri(target, which, table.smooth ? gl.LINEAR : gl.NEAREST);
      }
      for (const axis of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) {
        gl.texParameteri(target, axis, gl.CLAMP_TO_EDGE);
      }
      return [table.sampler, { handle, target }];
    }),
  );
}
