// @ts-check
// Surfaces as GLSL: one context for spheres, lobes and comparisons. A program is compiled once for
// a form of a surface; its sliders set uniforms.
import { wordsOf } from "./state.js";
import { createTexture, Programs, waitForGpu } from "./viewport/gl.js";
import { OVER_ALL } from "./viewport/shaders.js";

const canvas = document.createElement("canvas");
export const gl = canvas.getContext("webgl2", {
  antialias: true,
  alpha: true,
  premultipliedAlpha: true,
  preserveDrawingBuffer: true,
});
export const works = Boolean(gl?.getExtension("EXT_color_buffer_float"));

const programs = works ? new Programs(gl) : null;

const HEAD = `#version 300 es
precision highp float; precision highp int; precision highp sampler2D;
`;
// What both fragment shaders set before a call, and after it.
const CALL = `
void pair(vec3 wo, vec3 wi) {
    wo_x = wo.x; wo_y = wo.y; wo_z = wo.z;
    wi_x = wi.x; wi_y = wi.y; wi_z = wi.z;
}
`;
const EVALUATE = `
uniform sampler2D all_wo, all_wi;
uniform int which;
out vec4 result;
void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
    pair(texelFetch(all_wo, place, 0).xyz, texelFetch(all_wi, place, 0).xyz);
    hand = 1.0; inside = 0.0;
    vec3 value = vec3(0.0); float pdf = 0.0;
    if (which == 0 && wo_z > 0.0 && (TRANSMITS ? wi_z != 0.0 : wi_z > 0.0))
        look_evaluate(value, pdf);
    vec3 direction = vec3(0.0), factor = vec3(0.0);
    DELTAS
    vec4 drawn = which % 2 == 1 ? vec4(direction, 0.0) : vec4(factor, 0.0);
    result = which == 0 ? vec4(value, pdf) : drawn;
}`;
const SPHERE = `
uniform sampler2D before, dome, drawn;
uniform vec2 corner, size;
uniform int count, lit;
uniform vec3 light;
out vec4 result;
uint mixed(uint x) {
    x ^= x >> 16; x *= 0x7feb352dU;
    x ^= x >> 15; x *= 0x846ca68bU;
    return x ^ (x >> 16);
}
float number(uint x) { return float(mixed(x) >> 8) / 16777216.0; }
// The picture's y is the dome's up axis.
vec3 world(vec3 d) { return vec3(d.x, -d.z, d.y); }
vec4 around(vec3 d) {
    vec3 w = world(d);
    vec2 extent = vec2(textureSize(dome, 0));
    float u = fract(look_atan2(w.y, w.x) / 6.283185307179586);
    float v = look_atan2(length(w.xy), w.z) / 3.141592653589793;
    vec2 at = vec2(u, v) * extent - 0.5;
    vec2 low = floor(at), part = at - low;
    vec4 total = vec4(0.0);
    for (int j = 0; j < 2; j++) for (int i = 0; i < 2; i++) {
        float column = mod(low.x + float(i), extent.x);
        float row = clamp(low.y + float(j), 0.0, extent.y - 1.0);
        ivec2 cell = ivec2(int(column), int(row));
        float weight = (i == 0 ? 1.0 - part.x : part.x) * (j == 0 ? 1.0 - part.y : part.y);
        total += weight * texelFetch(dome, cell, 0);
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
    if (lit == 0) {
        vec3 wi = light * toWorld;
        pair(wo, wi);
        if (TRANSMITS ? wi.z != 0.0 : wi.z > 0.0) {
            look_evaluate(value, density);
            total = 3.141592653589793 * value;
        }
    } else {
        uint seed = mixed(uint(gl_FragCoord.x) + 4096U * uint(gl_FragCoord.y));
        vec4 start = vec4(number(seed), number(seed + 1U), number(seed + 2U), 0.0);
        for (int k = 0; k < SAMPLES; k++) {
            float index = float(count * SAMPLES + k);
            vec3 u = fract(start.xyz + index * vec3(0.8191725134, 0.6710436067, 0.5497004779));
            // One direction of the surface and one of the dome, with the balance heuristic (Veach
            // 1997, eq. 9.8).
            pair(wo, wo); u1 = u.x; u2 = u.y;
            vec3 wi; look_draw(wi);
            if (wi.z != 0.0) {
                pair(wo, wi); look_evaluate(value, density);
                vec4 sky = around(toWorld * wi);
                if (density + sky.a > 0.0) total += value * sky.rgb / (density + sky.a);
            }
            ivec2 cell = ivec2(int(u.z * float(textureSize(drawn, 0).x)), 0);
            vec4 from = texelFetch(drawn, cell, 0);
            vec3 toward = vec3(from.x, from.z, -from.y);
            wi = toward * toWorld;
            if (TRANSMITS ? wi.z != 0.0 : wi.z > 0.0) {
                pair(wo, wi); look_evaluate(value, density);
                total += value * texelFetch(drawn, cell + ivec2(0, 1), 0).rgb / (density + from.a);
            }
        }
        total /= float(SAMPLES);
        DELTAS
    }
    vec4 sum = count == 0 ? vec4(0.0) : texelFetch(before, ivec2(gl_FragCoord.xy), 0);
    result = vec4(sum.rgb + total, 1.0);
}`;

/** Return a new program of a fragment shader, once it is linked; throws its errors. */
export const linkProgram = async (fragment, vertex = OVER_ALL) => {
  if (!works)
    throw new Error(
      "this browser has no WebGL 2 with float textures, which spheres and lobes need",
    );
  return programs.link(vertex, fragment);
};

/** Return a texture of float colours, by default without content. */
export const colors = (width, height, data = null) =>
  createTexture(gl, "RGBA32F", width, height, data);

/** Wait until the graphics driver has drawn what it was given: calls return before that. */
export const whenDrawn = () => waitForGpu(gl);

const frame = works ? gl.createFramebuffer() : null;
export const bindTarget = (target, width, height) => {
  gl.bindFramebuffer(gl.FRAMEBUFFER, target ? frame : null);
  if (target)
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, width, height);
};
export const resizeCanvas = (width, height) => {
  if (canvas.width < width || canvas.height < height) {
    canvas.width = Math.max(canvas.width, width);
    canvas.height = Math.max(canvas.height, height);
  }
  return canvas;
};

// Which parameters a surface's sliders may change without a compilation.
const formOf = (surface, models) => {
  const parameters = models[surface.model]?.parameters ?? [];
  const live = new Set(
    parameters
      .filter((parameter) => parameter.live || surface.open.has(groupOf(parameter)))
      .map(({ name }) => name),
  );
  const fixed = Object.fromEntries(
    Object.entries(surface.given).filter(([name]) => !surface.editable || !live.has(name)),
  );
  const isAlwaysLive = (name) => parameters.find((parameter) => parameter.name === name).live;
  const extra = [...live].filter((name) => !isAlwaysLive(name));
  return { words: wordsOf({ ...surface, given: fixed }), extra };
};
export const groupOf = (parameter) =>
  parameter.kind === "normal" ? "normals" : parameter.optional ? "optional" : "";

// A compiled surface: its two programs, its tables, and where its numbers go.
export class Shader {
  constructor(answer, evaluate, sphere) {
    this.answer = answer;
    this.evaluate = evaluate;
    this.sphere = sphere;
    this.tables = Object.fromEntries(
      Object.entries(answer.arrays).map(([name, data]) => {
        const [height, width] = answer.shapes[name];
        return [name, createTexture(gl, "R32F", width, height, data)];
      }),
    );
  }

  /** Return the shader of a surface by the server's answer, compiled. */
  static async of(answer) {
    const deltas = Array.from({ length: answer.deltas }, (_, k) => k);
    const fillIn = (text, delta) =>
      text
        .replaceAll("TRANSMITS", answer.transmits)
        .replace("DELTAS", deltas.map(delta).join("\n"));
    const start = HEAD + answer.prelude + answer.text + CALL;
    const evaluate = fillIn(
      EVALUATE,
      (k) => `if (which > 0 && (which - 1) / 2 == ${k}) look_delta${k}(direction, factor);`,
    );
    // What passes a smooth solid leaves it on the other side of the sphere.
    const sphere = fillIn(
      SPHERE.replaceAll("SAMPLES", "4"),
      (k) => `{ vec3 d, f; pair(wo, wo); look_delta${k}(d, f);
        if (d.z > 0.0) total += f * around(toWorld * d).rgb;
        if (d.z < 0.0) {
            vec3 inward = toWorld * d, m = n - 2.0 * dot(n, inward) * inward;
            vec3 s = normalize(cross(vec3(0.0, 1.0, 0.0), m)), c = cross(m, s);
            mat3 there = mat3(s, c, -m);
            pair(-inward * there, -inward * there); inside = 1.0;
            vec3 out_d, out_f; look_delta${k}(out_d, out_f); inside = 0.0;
            if (out_d.z < 0.0) total += f * out_f * around(there * out_d).rgb;
        } }`,
    );
    // Both compile at the same time.
    const programsOfSurface = [evaluate, sphere].map((text) => linkProgram(start + text));
    return new Shader(answer, ...(await Promise.all(programsOfSurface)));
  }

  /** Use a program with a surface's numbers, and with others. */
  use(program, numberOfParameter, numbers, textures) {
    const uniforms = Object.entries(this.answer.numbers).map(([name, usual]) => {
      const value = numberOfParameter(this.answer.parameters[name]) ?? usual;
      return [name, usual.length === 3 || !Array.isArray(value) ? value : value[0]];
    });
    program.use({ ...Object.fromEntries(uniforms), ...numbers }, { ...this.tables, ...textures });
  }

  // Values times the cosine, and pdf, of pairs of directions, 4 numbers each; or a delta's
  // direction or factor.
  at(wo, wi, numbers, which = 0) {
    const count = wo.length / 3,
      width = 256,
      height = Math.ceil(count / width);
    const [all_wo, all_wi] = [wo, wi].map((directions) => {
      const texels = new Float32Array(4 * width * height);
      for (let i = 0; i < count; i++) texels.set(directions.subarray(3 * i, 3 * i + 3), 4 * i);
      return colors(width, height, texels);
    });
    const target = colors(width, height);
    this.use(this.evaluate, numbers, { which }, { all_wo, all_wi });
    bindTarget(target, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const values = new Float32Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, values);
    bindTarget(null, canvas.width, canvas.height);
    for (const texture of [all_wo, all_wi, target]) gl.deleteTexture(texture);
    return values.subarray(0, 4 * count);
  }

  free() {
    for (const { handle } of [this.evaluate, this.sphere]) gl.deleteProgram(handle);
    for (const table of Object.values(this.tables)) gl.deleteTexture(table);
  }
}

// Compiled surfaces, by their form; the last ones are kept.
export class Shaders {
  constructor(link, models) {
    this.link = link;
    this.models = models;
    this.shaders = new Map();
    this.compiled = 0;
  }

  // The shader of a surface, once the server has sent it and it is compiled.
  async of(surface) {
    const { words, extra } = formOf(surface, this.models);
    const key = JSON.stringify([words, extra]);
    if (!this.shaders.has(key)) {
      this.shaders.set(
        key,
        this.link.ask({ do: "shader", surface: words, live: extra }).then((answer) => {
          this.compiled++;
          return Shader.of(answer);
        }),
      );
      this.shaders.get(key).catch(() => this.shaders.delete(key));
      for (const old of [...this.shaders.keys()].slice(0, -16)) {
        this.shaders.get(old).then(
          (shader) => shader.free(),
          () => {},
        );
        this.shaders.delete(old);
      }
    }
    return this.shaders.get(key);
  }
}

// The value of a parameter: given, or that of the one it follows, or as the server says.
export const numberOf = (surface, models) => (name) => {
  const parameter = models[surface.model]?.parameters.find((other) => other.name === name);
  if (name in surface.given) return surface.given[name];
  if (parameter?.follows && parameter.follows in surface.given)
    return surface.given[parameter.follows];
  return surface.values[name];
};
