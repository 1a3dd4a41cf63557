// @ts-check
// Surfaces as GLSL, in one context for spheres, lobes and comparisons. A form of a surface is
// compiled once; its sliders set uniforms.
import { wordsOf } from "./state.js";
import { createTexture, Programs } from "./viewport/gl.js";
import { OVER_ALL } from "./viewport/shaders.js";

const canvas = document.createElement("canvas");
export const gl = canvas.getContext("webgl2", {
  antialias: true,
  alpha: true,
  premultipliedAlpha: true,
  preserveDrawingBuffer: true,
});
export const isSupported = Boolean(gl?.getExtension("EXT_color_buffer_float"));

const programs = isSupported ? new Programs(gl) : null;

const HEAD = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D;
`;
// Sets the directions that the generated functions read.
const SET_PAIR = `
void set_pair(vec3 wo, vec3 wi) {
    wo_x = wo.x; wo_y = wo.y; wo_z = wo.z;
    wi_x = wi.x; wi_y = wi.y; wi_z = wi.z;
}
`;
const EVALUATE = `
uniform sampler2D all_wo, all_wi;
uniform int quantity;
out vec4 result;
void main() {
    ivec2 texel = ivec2(gl_FragCoord.xy);
    set_pair(texelFetch(all_wo, texel, 0).xyz, texelFetch(all_wi, texel, 0).xyz);
    hand = 1.0; inside = 0.0;
    vec3 value = vec3(0.0); float pdf = 0.0;
    if (quantity == 0 && wo_z > 0.0 && (TRANSMITS ? wi_z != 0.0 : wi_z > 0.0))
        look_evaluate(value, pdf);
    vec3 direction = vec3(0.0), factor = vec3(0.0);
    DELTAS
    vec4 delta = quantity % 2 == 1 ? vec4(direction, 0.0) : vec4(factor, 0.0);
    result = quantity == 0 ? vec4(value, pdf) : delta;
}`;
const SPHERE = `
uniform sampler2D sums, dome, dome_samples;
uniform vec2 corner, size;
uniform int count, use_dome;
uniform vec3 light;
out vec4 result;
uint mix_bits(uint x) {
    x ^= x >> 16; x *= 0x7feb352dU;
    x ^= x >> 15; x *= 0x846ca68bU;
    return x ^ (x >> 16);
}
float random(uint x) { return float(mix_bits(x) >> 8) / 16777216.0; }
// The picture's y is the dome's up axis.
vec3 to_dome(vec3 d) { return vec3(d.x, -d.z, d.y); }
vec4 dome_radiance(vec3 d) {
    vec3 w = to_dome(d);
    vec2 extent = vec2(textureSize(dome, 0));
    float u = fract(look_atan2(w.y, w.x) / 6.283185307179586);
    float v = look_atan2(length(w.xy), w.z) / 3.141592653589793;
    vec2 texels = vec2(u, v) * extent - 0.5;
    vec2 low = floor(texels), high_share = texels - low, low_share = 1.0 - high_share;
    vec4 total = vec4(0.0);
    for (int j = 0; j < 2; j++) for (int i = 0; i < 2; i++) {
        float column = mod(low.x + float(i), extent.x);
        float row = clamp(low.y + float(j), 0.0, extent.y - 1.0);
        ivec2 cell = ivec2(int(column), int(row));
        float u_share = i == 0 ? low_share.x : high_share.x;
        float v_share = j == 0 ? low_share.y : high_share.y;
        total += u_share * v_share * texelFetch(dome, cell, 0);
    }
    return total;
}
void main() {
    vec2 stretch = vec2(max(size.x / size.y, 1.0), max(size.y / size.x, 1.0));
    vec2 p = ((gl_FragCoord.xy - corner) / size * 2.0 - 1.0) * stretch * 1.06;
    float square = dot(p, p);
    if (square >= 1.0) { result = vec4(0.0); return; }
    vec3 n = vec3(p, sqrt(1.0 - square));
    vec3 t = normalize(cross(vec3(0.0, 1.0, 0.0), n)), b = cross(n, t);
    mat3 toWorld = mat3(t, b, n);
    vec3 wo = vec3(t.z, b.z, n.z);
    hand = 1.0; inside = 0.0;
    vec3 total = vec3(0.0), value; float density;
    if (use_dome == 0) {
        vec3 wi = light * toWorld;
        set_pair(wo, wi);
        if (TRANSMITS ? wi.z != 0.0 : wi.z > 0.0) {
            look_evaluate(value, density);
            total = 3.141592653589793 * value;
        }
    } else {
        uint seed = mix_bits(uint(gl_FragCoord.x) + 4096U * uint(gl_FragCoord.y));
        vec4 start = vec4(random(seed), random(seed + 1U), random(seed + 2U), 0.0);
        for (int k = 0; k < SAMPLES; k++) {
            float index = float(count * SAMPLES + k);
            vec3 u = fract(start.xyz + index * vec3(0.8191725134, 0.6710436067, 0.5497004779));
            // One direction of the surface and one of the dome, with the balance heuristic (Veach
            // 1997, eq. 9.8).
            set_pair(wo, wo); u1 = u.x; u2 = u.y;
            vec3 wi; look_draw(wi);
            if (wi.z != 0.0) {
                set_pair(wo, wi); look_evaluate(value, density);
                vec4 sky = dome_radiance(toWorld * wi);
                if (density + sky.a > 0.0) total += value * sky.rgb / (density + sky.a);
            }
            ivec2 cell = ivec2(int(u.z * float(textureSize(dome_samples, 0).x)), 0);
            vec4 dome_sample = texelFetch(dome_samples, cell, 0);
            vec3 toward = vec3(dome_sample.x, dome_sample.z, -dome_sample.y);
            wi = toward * toWorld;
            if (TRANSMITS ? wi.z != 0.0 : wi.z > 0.0) {
                set_pair(wo, wi); look_evaluate(value, density);
                vec3 radiance = texelFetch(dome_samples, cell + ivec2(0, 1), 0).rgb;
                total += value * radiance / (density + dome_sample.a);
            }
        }
        total /= float(SAMPLES);
        DELTAS
    }
    vec4 sum = count == 0 ? vec4(0.0) : texelFetch(sums, ivec2(gl_FragCoord.xy), 0);
    result = vec4(sum.rgb + total, 1.0);
}`;

/** Return a new program of a fragment shader, once it is linked; throws its errors. */
export const linkProgram = async (fragment, vertex = OVER_ALL) => {
  if (!isSupported)
    throw new Error(
      "this browser has no WebGL 2 with float textures, which spheres and lobes need",
    );
  return programs.link(vertex, fragment);
};

/** Return a new texture of float colours, RGBA; its texels are undefined without data. */
export const createColors = (width, height, data = null) =>
  createTexture(gl, "RGBA32F", width, height, data);

const framebuffer = isSupported ? gl.createFramebuffer() : null;
export const bindTarget = (target, width, height) => {
  gl.bindFramebuffer(gl.FRAMEBUFFER, target ? framebuffer : null);
  if (target)
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, width, height);
};
export const growCanvas = (width, height) => {
  if (canvas.width < width || canvas.height < height) {
    canvas.width = Math.max(canvas.width, width);
    canvas.height = Math.max(canvas.height, height);
  }
  return canvas;
};

/** Return the words of a surface without its uniforms, and the parameters that become uniforms. */
const shaderForm = (surface, models) => {
  const parameters = models[surface.model]?.parameters ?? [];
  const live = new Set(
    parameters
      .filter((parameter) => parameter.live || surface.open.has(parameterGroup(parameter)))
      .map(({ name }) => name),
  );
  const constants = Object.fromEntries(
    Object.entries(surface.given).filter(([name]) => !surface.editable || !live.has(name)),
  );
  const isAlwaysLive = (name) => parameters.find((parameter) => parameter.name === name).live;
  const extra = [...live].filter((name) => !isAlwaysLive(name));
  return { words: wordsOf({ ...surface, given: constants }), extra };
};
export const parameterGroup = (parameter) =>
  parameter.kind === "normal" ? "normals" : parameter.optional ? "optional" : "";

/** A compiled surface: its two programs, and its tables. */
export class Shader {
  constructor(answer, pairProgram, sphereProgram) {
    this.answer = answer;
    this.pairProgram = pairProgram;
    this.sphereProgram = sphereProgram;
    this.tables = Object.fromEntries(
      Object.entries(answer.arrays).map(([name, data]) => {
        const [height, width] = answer.shapes[name];
        return [name, createTexture(gl, "R32F", width, height, data)];
      }),
    );
  }

  /** Compile the shader of a surface, as the server describes it. */
  static async compile(answer) {
    const deltas = Array.from({ length: answer.deltas }, (_, k) => k);
    const fillIn = (text, delta) =>
      text
        .replaceAll("TRANSMITS", answer.transmits)
        .replace("DELTAS", deltas.map(delta).join("\n"));
    const head = HEAD + answer.prelude + answer.text + SET_PAIR;
    const evaluate = fillIn(
      EVALUATE,
      (k) => `if (quantity > 0 && (quantity - 1) / 2 == ${k}) look_delta${k}(direction, factor);`,
    );
    // Light that enters a smooth solid leaves it on the other side of the sphere.
    const sphere = fillIn(
      SPHERE.replaceAll("SAMPLES", "4"),
      (k) => `{ vec3 d, f; set_pair(wo, wo); look_delta${k}(d, f);
        if (d.z > 0.0) total += f * dome_radiance(toWorld * d).rgb;
        if (d.z < 0.0) {
            vec3 inward = toWorld * d, m = n - 2.0 * dot(n, inward) * inward;
            vec3 s = normalize(cross(vec3(0.0, 1.0, 0.0), m)), c = cross(m, s);
            mat3 exitToWorld = mat3(s, c, -m);
            set_pair(-inward * exitToWorld, -inward * exitToWorld); inside = 1.0;
            vec3 exit_d, exit_f; look_delta${k}(exit_d, exit_f); inside = 0.0;
            if (exit_d.z < 0.0) total += f * exit_f * dome_radiance(exitToWorld * exit_d).rgb;
        } }`,
    );
    // The browser compiles both at the same time.
    const linking = [evaluate, sphere].map((text) => linkProgram(head + text));
    return new Shader(answer, ...(await Promise.all(linking)));
  }

  /** Use a program with the surface's parameters, which `lookUp` returns, and other uniforms. */
  use(program, lookUp, uniforms, textures) {
    const parameters = Object.entries(this.answer.numbers).map(([name, defaultValue]) => {
      const value = lookUp(this.answer.parameters[name]) ?? defaultValue;
      return [name, defaultValue.length === 3 || !Array.isArray(value) ? value : value[0]];
    });
    program.use(
      { ...Object.fromEntries(parameters), ...uniforms },
      { ...this.tables, ...textures },
    );
  }

  /**
   * Evaluate pairs of directions; return 4 numbers for each: for the quantity 0, f times the cosine
   * and the pdf; for 1 + 2 k the direction, for 2 + 2 k the factor of delta lobe k.
   */
  evaluate(wo, wi, lookUp, quantity = 0) {
    const count = wo.length / 3,
      width = 256,
      height = Math.ceil(count / width);
    const [all_wo, all_wi] = [wo, wi].map((directions) => {
      const texels = new Float32Array(4 * width * height);
      for (let i = 0; i < count; i++) texels.set(directions.subarray(3 * i, 3 * i + 3), 4 * i);
      return createColors(width, height, texels);
    });
    const target = createColors(width, height);
    this.use(this.pairProgram, lookUp, { quantity }, { all_wo, all_wi });
    bindTarget(target, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const values = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, values);
    bindTarget(null, canvas.width, canvas.height);
    for (const texture of [all_wo, all_wi, target]) gl.deleteTexture(texture);
    return values.subarray(0, 4 * count);
  }

  delete() {
    for (const { handle } of [this.pairProgram, this.sphereProgram]) gl.deleteProgram(handle);
    for (const table of Object.values(this.tables)) gl.deleteTexture(table);
  }
}

/** The newest 16 compiled surfaces, by their form. */
export class Shaders {
  constructor(link, models) {
    this.link = link;
    this.models = models;
    this.shaders = new Map();
    this.compiled = 0;
  }

  /** Return the shader of a surface, once the server has sent it and it is compiled. */
  async load(surface) {
    const { words, extra } = shaderForm(surface, this.models);
    const key = JSON.stringify([words, extra]);
    if (!this.shaders.has(key)) {
      this.shaders.set(
        key,
        this.link.ask({ do: "shader", surface: words, live: extra }).then((answer) => {
          this.compiled++;
          return Shader.compile(answer);
        }),
      );
      this.shaders.get(key).catch(() => this.shaders.delete(key));
      for (const oldKey of [...this.shaders.keys()].slice(0, -16)) {
        this.shaders.get(oldKey).then(
          (shader) => shader.delete(),
          () => {},
        );
        this.shaders.delete(oldKey);
      }
    }
    return this.shaders.get(key);
  }
}

// Return the function that looks up a parameter of a surface: the given value, or the value of the
// parameter that it follows, or the server's.
export const parameterLookup = (surface, models) => (name) => {
  const parameter = models[surface.model]?.parameters.find((other) => other.name === name);
  if (name in surface.given) return surface.given[name];
  if (parameter?.follows && parameter.follows in surface.given)
    return surface.given[parameter.follows];
  return surface.values[name];
};
