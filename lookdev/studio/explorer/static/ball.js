// @ts-check
// Lit spheres: under a point light at once, in the studio dome by samples that accumulate while the
// page rests.
import { bound, gl, into, linked, checked, numberOf, sized, texture, works } from "./gl.js";
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
    this.show = works ? linked(SHOW) : null;
    this.dome = null;
  }

  async light() {
    this.dome ??= this.link.ask({ do: "dome" }).then(({ arrays, shapes }) => ({
      radiance: texture(shapes.radiance[1], shapes.radiance[0], 4, arrays.radiance),
      drawn: texture(shapes.drawn[1], 2, 4, arrays.drawn),
    }));
    return this.dome;
  }

  // A sphere to be drawn in a place: it starts anew when what it shows changes. Resolves with
  // whether it lacks passes.
  async draw(place, surface, light, width, height, exposure, onto) {
    if (!works)
      throw new Error(
        "this browser has no WebGL 2 with float textures, which spheres and lobes need",
      );
    const [shader, dome] = [
      await this.shaders.of(surface),
      light === "dome" ? await this.light() : null,
    ];
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
        sums: [0, 1].map(() => texture(width, height, 4, null)),
        key: "",
        shader: null,
        count: 0,
      };
      this.made.set(place, kept);
    }
    if (kept.key !== key || kept.shader !== shader) Object.assign(kept, { key, shader, count: 0 });
    const done = light === "dome" ? MOST : 1;
    if (kept.count < done) {
      const program = shader.use(shader.sphere, number);
      bound(program, "before", kept.sums[0], 0);
      if (dome) {
        bound(program, "dome", dome.radiance, 1);
        bound(program, "drawn", dome.drawn, 2);
      } else
        for (const [name, unit] of [
          ["dome", 1],
          ["drawn", 2],
        ])
          bound(program, name, kept.sums[0], unit);
      const [theta, phi] = state.lightAt.map((each) => (each * Math.PI) / 180);
      const set = (name, ...values) =>
        gl[`uniform${values.length}f`](gl.getUniformLocation(program, name), ...values);
      set("size", width, height);
      set("corner", 0, 0);
      set(
        "light",
        Math.sin(theta) * Math.cos(phi),
        Math.sin(theta) * Math.sin(phi),
        Math.cos(theta),
      );
      gl.uniform1i(gl.getUniformLocation(program, "count"), kept.count);
      gl.uniform1i(gl.getUniformLocation(program, "lit"), light === "dome" ? 1 : 0);
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
    gl.useProgram(checked(this.show));
    bound(this.show, "sum", kept.sums[0], 0);
    const chroma = place !== "ball" && option("chroma");
    gl.uniform1f(
      gl.getUniformLocation(this.show, "factor"),
      2 ** exposure / (chroma ? 1 : kept.count),
    );
    gl.uniform1i(gl.getUniformLocation(this.show, "chroma"), chroma ? 1 : 0);
    gl.uniform2f(gl.getUniformLocation(this.show, "size"), width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    onto(canvas, 0, canvas.height - height);
    return kept.count < done;
  }

  // Resolves when the graphics driver has drawn what it was given: calls return before that.
  async drawn() {
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    while (gl.getSyncParameter(fence, gl.SYNC_STATUS) === gl.UNSIGNALED)
      await new Promise((done) => setTimeout(done, 4));
    gl.deleteSync(fence);
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
