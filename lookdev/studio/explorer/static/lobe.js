// @ts-check
// The plot of lobes in three dimensions, by WebGL. A lobe is a mesh whose radius, in a direction to
// the light above the horizon, is the value of the BSDF f for one view.
import { gl, bindTarget, linkProgram, parameterLookup, growCanvas, isSupported } from "./gl.js";
import { DECADES } from "./axes.js";
import { luminance } from "./viewport/color.js";
import { state } from "./state.js";

const VERTEX = `#version 300 es
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
uniform mat4 view;
uniform mat3 rotation;
out vec3 viewNormal;
void main() { gl_Position = view * vec4(position, 1.0); viewNormal = rotation * normal; }`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 viewNormal;
uniform vec4 color;
uniform float shaded;
out vec4 result;
void main() {
    vec3 n = normalize(viewNormal + vec3(0.0, 0.0, 1e-6));
    float light = mix(1.0, 0.35 + 0.65 * abs(dot(n, normalize(vec3(-0.3, 0.5, 0.8)))), shaded);
    result = vec4(color.rgb * light * color.a, color.a);
}`;

const COUNT = 72; // polar angles of directions to the light; there are twice as many azimuths

// Return increasing angles from `low` to `high`: a third evenly spaced, the others dense near
// `center`, as `lookdev.plotting.solid` has them.
const denseAngles = (low, high, center, count) => {
  const even = Math.max(Math.floor(count / 3), 2);
  const angles = Array.from({ length: even }, (_, i) => low + ((high - low) * i) / (even - 1));
  const rest = count - even;
  for (let i = 0; i < rest; i++)
    angles.push(
      Math.min(high, Math.max(low, center + 0.5 * (high - low) * (-1 + (2 * i) / (rest - 1)) ** 3)),
    );
  return [...new Set(angles)].sort((a, b) => a - b);
};

export class LobeRenderer {
  constructor(shaders) {
    this.shaders = shaders;
    this.linking = null;
    this.program = null;
    this.buffers = isSupported
      ? {
          position: gl.createBuffer(),
          normal: gl.createBuffer(),
          index: gl.createBuffer(),
          array: gl.createVertexArray(),
        }
      : null;
  }

  /**
   * Return the lobe of a surface for a view at angles `theta` and `phi` in radians: `f` at a grid
   * of directions `wi` to the light (rows x columns), its `peak`, and the direction `view`. With
   * `cosine`, f is multiplied by the cosine of the light.
   */
  async evaluate(surface, theta, phi, cosine) {
    if (surface.delta)
      throw new Error(
        `${surface.title}: scatters along single directions and has no lobe; see Fresnel or albedo`,
      );
    this.linking ??= linkProgram(FRAGMENT, VERTEX);
    this.program = await this.linking;
    const shader = await this.shaders.load(surface);
    const thetas = denseAngles(0, Math.PI / 2, theta, COUNT),
      phis = denseAngles(-Math.PI, Math.PI, 0, 2 * COUNT).map((angle) => angle + phi);
    const count = thetas.length * phis.length,
      wo = new Float32Array(3 * count),
      wi = new Float32Array(3 * count);
    const view = [
      Math.sin(theta) * Math.cos(phi + Math.PI),
      Math.sin(theta) * Math.sin(phi + Math.PI),
      Math.cos(theta),
    ];
    let k = 0;
    for (const t of thetas)
      for (const p of phis) {
        wi.set(
          [Math.sin(t) * Math.cos(p), Math.sin(t) * Math.sin(p), Math.max(Math.cos(t), 1e-6)],
          k,
        );
        wo.set(view, k);
        k += 3;
      }
    const pairs = shader.evaluate(wo, wi, parameterLookup(surface, this.shaders.models));
    const f = new Float32Array(count);
    let peak = 0;
    for (let i = 0; i < count; i++) {
      const value = luminance(pairs, 4 * i);
      f[i] = cosine ? value : value / wi[3 * i + 2];
      // The peak leaves out the last degree above the horizon, where some models have no bound.
      if (wi[3 * i + 2] > 0.0175) peak = Math.max(peak, f[i]);
    }
    return { f, wi, rows: thetas.length, columns: phis.length, peak, view };
  }

  /** Draw lobes: those that are `solid` as surfaces, others as nets of lines. */
  draw(lobes, width, height, scale, colors, ink) {
    const canvas = growCanvas(width, height);
    bindTarget(null, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const { view, rotation } = this.camera(width, height);
    this.program.use({ view, rotation });
    const highest = Math.max(...lobes.map(({ peak }) => peak), 1e-30);
    const radius = (f) =>
      scale === "log"
        ? Math.max(Math.log10(Math.max(f / highest, 1e-30)) / DECADES + 1, 0)
        : scale === "sqrt"
          ? Math.sqrt(Math.max(f, 0) / highest)
          : Math.max(f, 0) / highest;
    gl.bindVertexArray(this.buffers.array);
    const ring = Array.from({ length: 97 }, (_, i) => [
      Math.cos((i * Math.PI) / 48),
      Math.sin((i * Math.PI) / 48),
      0,
    ]).flat();
    this.drawLines(ring, gl.LINE_STRIP, [...ink, 0.35]);
    this.drawLines([-1, 0, 0, 1, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1.05], gl.LINES, [
      ...ink,
      0.25,
    ]);
    lobes.forEach((lobe, index) => {
      const [x, y, z] = lobe.view;
      if (index === 0) this.drawLines([0, 0, 0, 1.1 * x, 1.1 * y, 1.1 * z], gl.LINES, [...ink, 1]);
      if (lobe.solid) this.drawMesh(lobe, radius, colors[index]);
    });
    // Nets are also visible through solid lobes in front of them.
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    lobes.forEach((lobe, index) => {
      if (!lobe.solid) this.drawMesh(lobe, radius, colors[index]);
    });
    gl.disable(gl.BLEND);
    gl.bindVertexArray(null);
    return {
      canvas,
      top: canvas.height - height,
      project: (p) => this.project(view, p, width, height),
    };
  }

  drawLines(positions, mode, color) {
    gl.bindBuffer(gl.ARRAY_BUFFER, this.buffers.position);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(positions), gl.STREAM_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 0, 0);
    gl.disableVertexAttribArray(1);
    gl.vertexAttrib3f(1, 0, 0, 1);
    this.program.use({ color, shaded: 0 });
    gl.drawArrays(mode, 0, positions.length / 3);
  }

  /** Draw a lobe; `radius` maps values of f to lengths. */
  drawMesh({ f, wi, rows, columns, solid }, radius, color) {
    const count = rows * columns,
      positions = new Float32Array(3 * count),
      normals = new Float32Array(3 * count);
    for (let i = 0; i < count; i++) {
      const r = Math.min(radius(f[i]), 1.5);
      for (let c = 0; c < 3; c++) positions[3 * i + c] = r * wi[3 * i + c];
    }
    for (let i = 0; i < rows; i++)
      for (let j = 0; j < columns; j++) {
        const k = 3 * (i * columns + j),
          a = 3 * (Math.min(i + 1, rows - 1) * columns + j),
          b = 3 * (Math.max(i - 1, 0) * columns + j);
        const c = 3 * (i * columns + ((j + 1) % columns)),
          d = 3 * (i * columns + ((j + columns - 1) % columns));
        const u = [0, 1, 2].map((n) => positions[a + n] - positions[b + n]),
          v = [0, 1, 2].map((n) => positions[c + n] - positions[d + n]);
        normals.set(
          [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]],
          k,
        );
      }
    const index = [];
    for (let i = 0; i < rows - 1; i++)
      for (let j = 0; j < columns - 1; j++) {
        const k = i * columns + j;
        if (solid) index.push(k, k + 1, k + columns, k + 1, k + columns + 1, k + columns);
        else {
          if (i % 3 === 0) index.push(k, k + 1);
          if (j % 4 === 0) index.push(k, k + columns);
        }
      }
    for (const [location, buffer, data] of /** @type {[number, WebGLBuffer, Float32Array][]} */ ([
      [0, this.buffers.position, positions],
      [1, this.buffers.normal, normals],
    ])) {
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STREAM_DRAW);
      gl.enableVertexAttribArray(location);
      gl.vertexAttribPointer(location, 3, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, this.buffers.index);
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, new Uint32Array(index), gl.STREAM_DRAW);
    this.program.use({ color: [...color, solid ? 1 : 0.7], shaded: solid ? 1 : 0 });
    gl.drawElements(solid ? gl.TRIANGLES : gl.LINES, index.length, gl.UNSIGNED_INT, 0);
  }

  /** Return the matrices of an orthographic camera, z up, which shows the whole hemisphere. */
  camera(width, height) {
    const [azimuth, elevation] = state.lobeAngles,
      [ca, sa, ce, se] = [
        Math.cos(azimuth),
        Math.sin(azimuth),
        Math.cos(elevation),
        Math.sin(elevation),
      ];
    const right = [ca, sa, 0],
      up = [-sa * se, ca * se, ce],
      back = [sa * ce, -ca * ce, se];
    const pixels = Math.min(width / 2.5, height / 2.3),
      view = new Float32Array(16);
    for (let i = 0; i < 3; i++)
      [view[4 * i], view[4 * i + 1], view[4 * i + 2]] = [
        (right[i] * 2 * pixels) / width,
        (up[i] * 2 * pixels) / height,
        -back[i] * 0.3,
      ];
    view[13] = (-0.42 * ce * 2 * pixels) / height;
    view[15] = 1;
    return {
      view,
      rotation: new Float32Array([0, 1, 2].flatMap((i) => [right[i], up[i], back[i]])),
    };
  }

  /** Return the position of a point on the canvas, in pixels from the upper left corner. */
  project(view, [x, y, z], width, height) {
    const at = (row) => view[row] * x + view[4 + row] * y + view[8 + row] * z + view[12 + row];
    return [((at(0) + 1) / 2) * width, ((1 - at(1)) / 2) * height];
  }
}
