// @ts-check
// A film: the visible triangle of each pixel, one sample of its light, and the sum of all samples
// so far, in floats.

import { createTexture } from "./gl.js";

const MOST_PLACES = 8; // of a pixel along each axis
const FINEST = 1024; // places along the longer side, if that is more than pixels

export class Film {
  constructor(gl, width, height, places = null) {
    // Finding triangles takes as long for few pixels as for many: small films find them at several
    // places of a pixel.
    const fit = Math.floor(Math.log2(Math.max(1, FINEST / Math.max(width, height))));
    this.gl = gl;
    this.width = width;
    this.height = height;
    this.places = places ?? Math.min(MOST_PLACES, 2 ** fit);
    this.count = 0;
    /** The uniforms of the view whose triangles `visible` has; null for none. */
    this.view = null;
    this.visible = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, this.visible);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.R32UI, this.places * width, this.places * height);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    this.depth = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, this.depth);
    gl.renderbufferStorage(
      gl.RENDERBUFFER,
      gl.DEPTH_COMPONENT32F,
      this.places * width,
      this.places * height,
    );
    this.visibleTarget = this.createTarget(this.visible);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, this.depth);
    this.floats = [0, 1, 2, 3].map(() => createTexture(gl, "RGBA32F", width, height));
    this.targets = this.floats.map((floats) => this.createTarget(floats));
    this.developed = createTexture(gl, "RGBA8", width, height);
    this.developedTarget = this.createTarget(this.developed);
  }

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

  /** The sum of all samples: radiance that coverage multiplies, and coverage. */
  get sums() {
    return this.floats[this.count % 2];
  }

  /** Begin to find the visible triangles: none. */
  clearVisible() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.visibleTarget);
    gl.viewport(0, 0, this.places * this.width, this.places * this.height);
    gl.clearBufferuiv(gl.COLOR, 0, new Uint32Array(4));
    gl.clearBufferfv(gl.DEPTH, 0, new Float32Array([1]));
  }

  /** Begin a new sample: no pixel has light. */
  clear() {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[2]);
    gl.clearBufferfv(gl.COLOR, 0, new Float32Array(4));
  }

  /** Add the sample to the sums, by a program that draws a triangle over all. */
  add(program) {
    const { gl } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.targets[(this.count + 1) % 2]);
    gl.viewport(0, 0, this.width, this.height);
    program.use({ before: this.count > 0 ? 1 : 0 }, { sums: this.sums, sampled: this.sample });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.count += 1;
  }

  /** Set the means (height x width x 4), row 0 at the top, as of one sample. */
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

  /** Return the means (height x width x 4), row 0 at the top. */
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
    const { gl, places } = this,
      texel = new Uint32Array(4),
      middle = Math.floor(places / 2);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.visibleTarget);
    gl.readPixels(
      places * x + middle,
      places * (this.height - 1 - y) + middle,
      1,
      1,
      gl.RGBA_INTEGER,
      gl.UNSIGNED_INT,
      texel,
    );
    return texel[0] - 1;
  }
}
