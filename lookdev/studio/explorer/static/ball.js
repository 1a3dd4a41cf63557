// @ts-check
// Lit spheres: under a point light at once, in the studio dome by samples that accumulate while the
// page rests.
import { colors, gl, into, linked, numberOf, sized } from "./gl.js";
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
    this.made = new Map();
    this.show = null;
    this.dome = null;
  }

  async light() {
    this.dome ??= this.link.ask({ do: "dome" }).then(({ arrays, shapes }) => ({
      radiance: colors(shapes.radiance[1], shapes.radiance[0], arrays.radiance),
      drawn: colors(shapes.drawn[1], 2, arrays.drawn),
    }));
    return this.dome;
  }

  // A sphere to be drawn in a place: it starts anew when what it shows changes. Resolves with
  // whether it lacks passes.
  async draw(place, surface, light, width, height, exposure, onto) {
    this.show ??= linked(SHOW);
    const [show, shader, dome] = await Promise.all([
      this.show,
      this.shaders.of(surface),
      light === "dome" ? this.light() : null,
    ]);
    const number = numberOf(surface, this.shaders.models);
    const numbers = Object.values(shader.answer.places).map(number);
    const key = JSON.stringify([
      numbers,
      light,
      light === "point" ? state.lightAt : 0,
      width,
      height,
    ]);
    let kept = this.made.get(place);
    if (!kept || kept.width !== width || kept.height !== height) {
      if (kept) for (const each of kept.sums) gl.deleteTexture(each);
      kept = {
        width,
        height,
        sums: [0, 1].map(() => colors(width, height)),
        key: "",
        shader: null,
        count: 0,
      };
      this.made.set(place, kept);
    }
    if (kept.key !== key || kept.shader !== shader) Object.assign(kept, { key, shader, count: 0 });
    const done = light === "dome" ? MOST : 1;
    if (kept.count < done) {
      const [theta, phi] = state.lightAt.map((degrees) => (degrees * Math.PI) / 180);
      const across = Math.sin(theta);
      const [before] = kept.sums;
      shader.use(
        shader.sphere,
        number,
        {
          size: [width, height],
          corner: [0, 0],
          light: [across * Math.cos(phi), across * Math.sin(phi), Math.cos(theta)],
          count: kept.count,
          lit: light === "dome" ? 1 : 0,
        },
        { before, dome: dome?.radiance ?? before, drawn: dome?.drawn ?? before },
      );
      gl.disable(gl.DEPTH_TEST);
      into(kept.sums[1], width, height);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      kept.sums.reverse();
      kept.count++;
    }
    const canvas = sized(width, height);
    into(null, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const chroma = place !== "ball" && option("chroma");
    const factor = 2 ** exposure / (chroma ? 1 : kept.count);
    show.use({ factor, chroma: chroma ? 1 : 0, size: [width, height] }, { sum: kept.sums[0] });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    onto(canvas, 0, canvas.height - height);
    return kept.count < done;
  }

  // Forget spheres that are no longer drawn.
  keep(places) {
    for (const [place, { sums }] of this.made) {
      if (places.has(place)) continue;
      for (const each of sums) gl.deleteTexture(each);
      this.made.delete(place);
    }
  }
}
