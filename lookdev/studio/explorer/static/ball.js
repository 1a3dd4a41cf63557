// @ts-check
// Lit spheres: under a point light at once, in the studio dome by samples that accumulate while the
// page rests.
import { colors, gl, bindTarget, linkProgram, numberOf, resizeCanvas } from "./gl.js";
import { option, state } from "./state.js";

const MOST = 192; // passes of 4 samples
const SHOW = `#version 300 es
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

export class Balls {
  constructor(link, shaders) {
    this.link = link;
    this.shaders = shaders;
    this.films = new Map(); // of spheres, by name
    this.show = null;
    this.dome = null;
  }

  async light() {
    this.dome ??= this.link.ask({ do: "dome" }).then(({ arrays, shapes }) => ({
      radiance: colors(shapes.radiance[1], shapes.radiance[0], arrays.radiance),
      drawn: colors(shapes.samples[1], 2, arrays.samples),
    }));
    return this.dome;
  }

  // Draw a pass of the sphere of a name, which starts anew when its surface changes; resolve with
  // whether it lacks passes.
  async draw(name, surface, light, width, height, exposure, onto) {
    this.show ??= linkProgram(SHOW);
    const [show, shader, dome] = await Promise.all([
      this.show,
      this.shaders.of(surface),
      light === "dome" ? this.light() : null,
    ]);
    const number = numberOf(surface, this.shaders.models),
      film = this.film(name, width, height);
    const key = JSON.stringify([
      Object.values(shader.answer.parameters).map(number),
      light,
      light === "point" ? state.lightAngles : 0,
      width,
      height,
    ]);
    if (film.key !== key || film.shader !== shader) Object.assign(film, { key, shader, count: 0 });
    const most = light === "dome" ? MOST : 1;
    if (film.count < most) addPass(film, number, dome);
    const canvas = resizeCanvas(width, height);
    bindTarget(null, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const chroma = name !== "ball" && option("chroma");
    const factor = 2 ** exposure / (chroma ? 1 : film.count);
    show.use({ factor, chroma: chroma ? 1 : 0, size: [width, height] }, { sum: film.sums[0] });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    onto(canvas, 0, canvas.height - height);
    return film.count < most;
  }

  /** Return the film of a name: a new one, if the size is another one. */
  film(name, width, height) {
    const before = this.films.get(name);
    if (before?.width === width && before.height === height) return before;
    before?.sums.forEach((sum) => gl.deleteTexture(sum));
    const sums = [0, 1].map(() => colors(width, height));
    const film = { width, height, sums, key: "", shader: null, count: 0 };
    this.films.set(name, film);
    return film;
  }

  // Delete the spheres without one of some names.
  deleteOthers(names) {
    for (const [name, { sums }] of this.films) {
      if (names.has(name)) continue;
      sums.forEach((sum) => gl.deleteTexture(sum));
      this.films.delete(name);
    }
  }
}

/** Add a pass to a film: of the dome, or of the point light for null. */
const addPass = (film, number, dome) => {
  const [theta, phi] = state.lightAngles.map((degrees) => (degrees * Math.PI) / 180),
    across = Math.sin(theta),
    [before] = film.sums,
    { shader, width, height } = film;
  shader.use(
    shader.sphere,
    number,
    {
      size: [width, height],
      corner: [0, 0],
      light: [across * Math.cos(phi), across * Math.sin(phi), Math.cos(theta)],
      count: film.count,
      lit: dome ? 1 : 0,
    },
    { before, dome: dome?.radiance ?? before, drawn: dome?.drawn ?? before },
  );
  gl.disable(gl.DEPTH_TEST);
  bindTarget(film.sums[1], width, height);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  film.sums.reverse();
  film.count++;
};
