// @ts-check
// The film of the viewport, which is a set of textures of one size: the visible triangle of each
// pixel, one sample of its light, the sum of all samples so far, and the picture for the display.

import { createTexture } from "./gl.js";

const MAX_SUBPIXELS = 8; // largest number of points along each axis of a pixel
const MAX_POINTS = 1024; // largest number of points along the longer side of a film

export class Film {
  /**
   * `subpixels` is the number of points along each axis of a pixel that have a visible triangle.
   */
  constructor(gl, width, height, subpixels = null) {
    // Finding the visible triangles takes as long for few points as for many. So a small film finds
    // them at several points of a pixel, for several samples.
    const fit = Math.floor(Math.log2(Math.max(1, MAX_POINTS / Math.max(width, height))));
    this.gl = gl;
    this.width = width;
    this.height = height;
    this.subpixels = subpixels ?? Math.min(MAX_SUBPIXELS, 2 ** fit);
    this.count = 0; // samples in the sums
    /** The uniforms of the view of the triangles in `visible`; null before there are any. */
    this.view = null;
    this.visible = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.visible);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32UI, this.subpixels * width, this.subpixels * height);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(
      gl.RENDERBUFFER,
      gl.DEPTH_COMPONENT32F,
      this.subpixels * width,
      this.subpixels * height,
    );
    this.visibleTarget = this.createTarget(this.visible);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.depth);
    // The sums of an even and of an odd number of samples, the sample, and the background.
    this.floats = [0, 1, 2, 3].map(() => createTexture(gl, "RGBA32F", width, height));
    this.targets = this.floats.map((floats) => this.createTarget(floats));
    this.developed = createTexture(gl, "RGBA8", width, height);
    this.developedTarget = this.createTarget(this.developed);
  }

  /** Return a framebuffer that draws into a texture. */
  createTarget(attachment) {
    const { gl } = this,
      framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, attachment, 0);
    return framebuffer;
  }

  delete() {
    const { gl } = this;
    [this.visible, this.developed, ...this.floats].forEach((texture) => gl.deleteTexture(texture));
    [this.visibleTarget, this.developedTarget, ...this.targets].forEach((target) =>
      gl.deleteFramebuffer(target),
    );
    gl.deleteRenderbuffer(this.depth);
  }

  /** One sample of the light of each pixel. */
  get sample() {
    return this.floats[2];
  }

  /** The light behind the asset. */
  get background() {
    return this.floats[3];
  }

  /** The sum of all samples: premultiplied radiance, and coverage. */
  get sums() {
    return this.floats[this.count % 2];
  }

  /** Clear the visible triangles and their depths. */
  clearVisible() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.visibleTarget);
    gl.viewport(0, 0, this.subpixels * this.width, this.subpixels * this.height);
    gl.clearBufferuiv(gl.COLOR, 0, new Uint32Array(4));
    gl.clearBufferfv(gl.DEPTH, 0, new Float32Array([1]));
  }

  /** Clear the sample. */
  clear() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[2]);
    gl.clearBufferfv(gl.COLOR, 0, new Float32Array(4));
  }

  /** Add the sample to the sums, by a program that draws one triangle over all pixels. */
  add(program) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[(this.count + 1) % 2]);
    gl.viewport(0, 0, this.width, this.height);
    const hasSums = this.count > 0 ? 1 : 0;
    program.use({ hasSums }, { sums: this.sums, newSample: this.sample });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.count += 1;
  }

  /**
   * Set the sums to means of samples (height x width x 4), row 0 at the top, and their count to 1.
   */
  write(means) {
    const { gl, width, height } = this,
      rows = new Float32Array(means.length);
    for (let row = 0; row < height; row += 1) {
      rows.set(
        means.subarray(4 * width * row, 4 * width * (row + 1)),
        4 * width * (height - 1 - row),
      );
    }
    this.count = 1;
    gl.bindTexture(gl.TEXTURE_2D, this.sums);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGBA, gl.FLOAT, rows);
  }

  /** Return the means of all samples (height x width x 4), row 0 at the top. */
  read() {
    const { gl, width, height } = this,
      rows = new Float32Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[this.count % 2]);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.FLOAT, rows);
    const means = new Float32Array(rows.length);
    for (let row = 0; row < height; row += 1) {
      const from = rows.subarray(4 * width * (height - 1 - row), 4 * width * (height - row));
      means.set(
        from.map((x) => x / this.count),
        4 * width * row,
      );
    }
    return means;
  }

  /** Return the number of the triangle that is visible at a pixel, -1 for none; y from the top. */
  triangle(x, y) {
    const { gl, subpixels } = this,
      texel = new Uint32Array(4),
      middle = Math.floor(subpixels / 2);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.visibleTarget);
    gl.readPixels(
      subpixels * x + middle,
      subpixels * (this.height - 1 - y) + middle,
      1,
      1,
      gl.RGBA_INTEGER,
      gl.UNSIGNED_INT,
      texel,
    );
    return texel[0] - 1;
  }
}
