// @ts-check
// The renderer of spheres in the Explorer, by WebGL: under a point light in one pass, or under the
// dome "studio" by passes whose sum becomes less noisy.
import { createColors, gl, bindTarget, linkProgram, parameterLookup, growCanvas } from "./gl.js";
import { option, state } from "./state.js";

const DOME_PASSES = 192; // passes of 4 samples each
const DISPLAY = `#version 300 es
precision highp float; precision highp sampler2D;
uniform sampler2D sum;
uniform float factor;
uniform bool chroma;
uniform vec2 size;
out vec4 result;
void main() {
    vec4 texel = texelFetch(sum, ivec2(gl_FragCoord.xy), 0);
    float largest = max(max(texel.r, texel.g), max(texel.b, 1e-30));
    vec3 linear = texel.rgb * (chroma ? factor / largest : factor);
    linear = clamp(linear, 0.0, 1.0);
    vec3 bright = 1.055 * pow(linear, vec3(1.0 / 2.4)) - 0.055;
    vec3 coded = mix(12.92 * linear, bright, step(0.0031308, linear));
    vec2 stretch = vec2(max(size.x / size.y, 1.0), max(size.y / size.x, 1.0));
    vec2 p = (gl_FragCoord.xy / size * 2.0 - 1.0) * stretch * 1.06;
    float cover = clamp((1.0 - length(p)) * min(size.x, size.y) / 2.12, 0.0, 1.0) * texel.a;
    result = vec4(coded * cover, cover);
}`;

export class SphereRenderer {
  constructor(link, shaders) {
    this.link = link;
    this.shaders = shaders;
    this.films = new Map(); // the sum of passes of each sphere, by the sphere's name
    this.displayProgram = null;
    this.dome = null;
  }

  /** Return the textures of the dome, which the server sends once: its map, and samples of it. */
  async loadDome() {
    this.dome ??= this.link.ask({ do: "dome" }).then(({ arrays, shapes }) => ({
      radiance: createColors(shapes.radiance[1], shapes.radiance[0], arrays.radiance),
      samples: createColors(shapes.samples[1], 2, arrays.samples),
    }));
    return this.dome;
  }

  /**
   * Add a pass to the sphere with a name, and call `copy` with the canvas and the corner of the
   * picture on it. If surface, light or size have changed, the sphere starts anew. `light` is
   * "point" or "dome". Returns whether the sphere still lacks passes.
   */
  async draw(name, surface, light, width, height, exposure, copy) {
    this.displayProgram ??= linkProgram(DISPLAY);
    const [display, shader, dome] = await Promise.all([
      this.displayProgram,
      this.shaders.load(surface),
      light === "dome" ? this.loadDome() : null,
    ]);
    const lookUp = parameterLookup(surface, this.shaders.models),
      film = this.film(name, width, height);
    const key = JSON.stringify([
      Object.values(shader.answer.parameters).map(lookUp),
      light,
      light === "point" ? state.lightAngles : 0,
      width,
      height,
    ]);
    if (film.key !== key || film.shader !== shader) Object.assign(film, { key, shader, count: 0 });
    const passes = light === "dome" ? DOME_PASSES : 1;
    if (film.count < passes) addPass(film, lookUp, dome);
    const canvas = growCanvas(width, height);
    bindTarget(null, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const chroma = name !== "ball" && option("chroma");
    const factor = 2 ** exposure / (chroma ? 1 : film.count);
    display.use({ factor, chroma: chroma ? 1 : 0, size: [width, height] }, { sum: film.sums[0] });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    copy(canvas, 0, canvas.height - height);
    return film.count < passes;
  }

  /** Return the film of a sphere by its name; it is new if the size has changed. */
  film(name, width, height) {
    const current = this.films.get(name);
    if (current?.width === width && current.height === height) return current;
    current?.sums.forEach((sum) => gl.deleteTexture(sum));
    const sums = [0, 1].map(() => createColors(width, height));
    const film = { width, height, sums, key: "", shader: null, count: 0 };
    this.films.set(name, film);
    return film;
  }

  /** Delete the films whose names are not in a set. */
  deleteOthers(names) {
    for (const [name, { sums }] of this.films) {
      if (names.has(name)) continue;
      sums.forEach((sum) => gl.deleteTexture(sum));
      this.films.delete(name);
    }
  }
}

/** Add a pass to a film: of the dome, or of the point light if the dome is null. */
const addPass = (film, lookUp, dome) => {
  const [theta, phi] = state.lightAngles.map((degrees) => (degrees * Math.PI) / 180),
    sine = Math.sin(theta),
    [sums] = film.sums,
    { shader, width, height } = film;
  shader.use(
    shader.sphereProgram,
    lookUp,
    {
      size: [width, height],
      corner: [0, 0],
      light: [sine * Math.cos(phi), sine * Math.sin(phi), Math.cos(theta)],
      count: film.count,
      use_dome: dome ? 1 : 0,
    },
    { sums, dome: dome?.radiance ?? sums, dome_samples: dome?.samples ?? sums },
  );
  gl.disable(gl.DEPTH_TEST);
  bindTarget(film.sums[1], width, height);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  film.sums.reverse();
  film.count++;
};
