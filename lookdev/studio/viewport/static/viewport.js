// @ts-check
// The viewport: it draws a scene, which lookdev.studio.viewport prepares, under a camera that the
// user orbits. Samples of the light add up. A change is shown at once, at a resolution that the
// machine draws in time, and then at the full resolution.

import * as cameras from "./camera.js";
import { Film } from "./film.js";
import {
  Programs,
  Textures,
  Triangles,
  createContext,
  createViewTextures,
  waitForGpu,
  writeNumbers,
} from "./gl.js";
import { ADD, OVER_ALL, PRESENT } from "./shaders.js";

const FIRST_PICTURE_TIME = 45; // milliseconds that the first picture after a change may take
const STRIP_TIME = 25; // milliseconds of drawing between checks for a change
// Samples of the light for each view, which is a point of the pixels' area and of the lens. Several
// samples share a view, because finding its visible triangles takes longer than the light.
const SAMPLES_PER_VIEW = 4;
// Milliseconds. If a sample of all pixels takes longer, ever finer pictures precede it.
const LONG_SAMPLE_TIME = 300;
const TRIANGLES_PER_DRAW = 1 << 16; // triangles that are drawn between checks for a change
const DIFFERENCE = 4; // gain of a difference: a quarter of white has full colour
// Height above the facet where a ray leaves a surface, in radii of the asset, as in the renderer.
const LIFT = 1e-6;
const SCALES = [1, 2, 4, 8, 16]; // the width of the canvas by that of a film

export class Viewport extends EventTarget {
  /** `fetchBuffer` returns the bytes of a buffer by its digest, as a promise of an ArrayBuffer. */
  constructor(canvas, fetchBuffer) {
    super();
    this.canvas = canvas;
    this.gl = createContext(canvas);
    this.programs = new Programs(this.gl);
    this.textures = new Textures(this.gl, fetchBuffer);
    this.settings = {
      element: 0,
      lighting: 0,
      exposure: 0,
      background: true,
      shadows: true,
      behind: 0,
      seed: 0,
      maxSamples: 4096,
      wipe: 1,
      differs: false,
    };
    /** @type {[number, number] | null} The size in pixels; null for the scene's resolution. */
    this.size = null;
    this.scale = 3; // index in SCALES of the film for the first picture after a change
    this.rate = null; // measured speed in pixels a millisecond
    this.version = 0; // counts changes
    this.viewVersion = 0; // the version that last changed the visible triangles
    this.lightVersion = 0; // counts changes of the lights' numbers
    this.shownVersion = -1; // the version of the last picture
    this.awaitedSamples = 0; // samples for which `accumulate` waits
    this.frames = 0; // counts first pictures after a change
    /** @type {(() => void) | null} The function that ends the wait of `run` for a change. */
    this.resume = null;
    this.stopped = false;
    this.running = this.run();
  }

  /**
   * Show a scene once all of it is compiled and fetched; until then, the viewport shows the
   * previous scene. The user's camera stays if the scene's camera is the same.
   */
  async show(data) {
    const { gl } = this;
    const looks = await Promise.all(
      data.looks.map(async (look) => ({
        ...look,
        visible: await this.programs.get(data.vertex, look.visible),
        relight: await this.programs.get(OVER_ALL, look.relight),
        textures: await this.textures.loadAll(look.textures),
        numbers: { ...look.numbers },
      })),
    );
    const [add, behind, develop, present, rig, corners, vertices, indices] = await Promise.all([
      this.programs.get(OVER_ALL, ADD),
      this.programs.get(OVER_ALL, data.behind),
      this.programs.get(OVER_ALL, data.develop),
      this.programs.get(OVER_ALL, PRESENT),
      this.textures.loadAll(data.rig.textures),
      this.textures.load(data.corners),
      this.textures.fetchBuffer(data.vertices),
      this.textures.fetchBuffer(data.indices),
    ]);
    const previous = this.scene;
    const triangles = new Triangles(gl, vertices, indices);
    const view =
      previous?.data.view.name === data.view.name
        ? previous.view
        : createViewTextures(gl, data.view);
    this.scene = {
      ...data,
      data,
      looks,
      add,
      behind,
      develop,
      present,
      view,
      rig,
      corners,
      triangles,
    };
    previous?.triangles.delete();
    if (JSON.stringify(previous?.data.camera) !== JSON.stringify(data.camera))
      this.camera = data.camera;
    const descriptions = data.looks.flatMap((look) => Object.values(look.textures));
    this.textures.deleteOthers([
      ...descriptions,
      ...Object.values(data.rig.textures),
      data.corners,
    ]);
    this.resize(...(this.size ?? data.resolution));
  }

  /** Set the size of the canvas in pixels. */
  resize(width, height) {
    this.films?.forEach((film) => film?.delete());
    [this.canvas.width, this.canvas.height] = [width, height];
    this.films = SCALES.map(() => null);
    this.change(true);
  }

  /** Return the film at an index of SCALES. */
  film(scale) {
    const size = (pixels) => Math.max(1, Math.round(pixels / SCALES[scale]));
    this.films[scale] ??= new Film(this.gl, size(this.canvas.width), size(this.canvas.height));
    return this.films[scale];
  }

  /** Set uniforms of the look with a number; `numbers` has their values by name. */
  setNumbers(look, numbers) {
    Object.assign(this.scene.looks[look].numbers, numbers);
    this.change();
  }

  /**
   * Change settings. `element` and `lighting` are the rotations of asset and lights in degrees,
   * `exposure` is in stops, and `behind` is the grey of a background without light. `wipe` and
   * `differs` show the exact picture, see `PRESENT` in shaders.js.
   */
  set(settings) {
    const differs = (name) => name in settings && settings[name] !== this.settings[name];
    const viewChanges = differs("element") || differs("seed");
    const lightChanges = differs("lighting") || differs("shadows");
    Object.assign(this.settings, settings);
    if (viewChanges || lightChanges) this.change(viewChanges);
    else this.redraw();
  }

  /** Set the numbers that describe the lights in the shaders, such as their radiance. */
  setLights(numbers) {
    writeNumbers(
      this.gl,
      this.scene.rig.rig_numbers,
      this.scene.data.rig.textures.rig_numbers.width,
      numbers,
    );
    this.lightVersion += 1;
    this.change();
  }

  setCamera(camera) {
    this.camera = camera;
    this.change(true);
  }

  /** Begin the picture anew; with `viewChanges`, find the visible triangles anew, too. */
  change(viewChanges = false) {
    this.version += 1;
    this.dispatchEvent(new Event("change"));
    if (viewChanges || this.scene?.looks.some((look) => look.see_through))
      this.viewVersion = this.version;
    this.resume?.();
  }

  /** Draw the film again, for a change that needs no new samples. */
  redraw() {
    this.needsRedraw = true;
    this.resume?.();
  }

  /** Return the part of the scene at a pixel of the canvas, y from the top; null for none. */
  pick(x, y) {
    if (!this.shownFilm) return null;
    const scale = (value, size, whole) => Math.min(size - 1, Math.floor((value * size) / whole));
    const { width, height } = this.shownFilm;
    const triangle = this.shownFilm.triangle(
      scale(x, width, this.canvas.width),
      scale(y, height, this.canvas.height),
    );
    return this.scene.parts.find((part) => part.first <= triangle && triangle < part.last) ?? null;
  }

  /** Wait until the canvas shows the last change. */
  async waitForPicture() {
    const version = this.version;
    while (this.shownVersion < version) await this.waitForEvent("picture");
  }

  /** Wait until the film has `count` samples or more; return their means, row 0 at the top. */
  async accumulate(count) {
    this.awaitedSamples = count;
    this.resume?.();
    const complete = () =>
      this.shownVersion === this.version &&
      this.shownFilm === this.film(0) &&
      this.shownFilm.count >= count;
    while (!complete()) await this.waitForEvent("picture");
    this.awaitedSamples = 0;
    return this.shownFilm.read();
  }

  /** Return the number of samples to draw: first that for which `accumulate` waits. */
  sampleGoal() {
    return this.film(0).count < this.awaitedSamples
      ? this.awaitedSamples
      : this.settings.maxSamples;
  }

  /** Wait for the next event of a name; throws the error that has ended the drawing. */
  async waitForEvent(name) {
    if (!this.failed)
      await new Promise((resolve) => this.addEventListener(name, resolve, { once: true }));
    if (this.failed) throw this.failed;
  }

  /** End the drawing; return a promise of its end. */
  stop() {
    this.stopped = true;
    this.resume?.();
    return this.running;
  }

  /** Draw what is to be drawn, and wait for changes, until the viewport is stopped. */
  async run() {
    try {
      while (!this.stopped) {
        if (this.scene && this.shownVersion < this.version) await this.drawFirst();
        else if (this.scene && this.film(0).count < this.sampleGoal()) await this.drawMore();
        else if (this.needsRedraw && this.shownFilm) this.showFilm(this.shownFilm);
        else
          await new Promise((resolve) => {
            this.resume = () => resolve(undefined);
          });
      }
    } catch (error) {
      this.failed = error;
      this.dispatchEvent(new CustomEvent("failed", { detail: error }));
      this.dispatchEvent(new Event("picture"));
    }
  }

  /**
   * Draw one sample of all pixels after a change, and adapt the scale to the time that it takes.
   */
  async drawFirst() {
    const { version } = this,
      film = this.film(this.scale),
      started = performance.now();
    for (const other of this.films) if (other) other.count = 0;
    await this.findVisible(film);
    if (this.version !== version) return;
    film.clear();
    this.relight(film, 0, film.height);
    film.add(this.scene.add);
    this.shownVersion = version;
    this.shownFilm = film;
    this.draw(film);
    await waitForGpu(this.gl);
    const duration = performance.now() - started;
    this.frames += 1;
    this.dispatchEvent(
      new CustomEvent("picture", { detail: { count: 1, duration, scale: SCALES[this.scale] } }),
    );
    if (duration > FIRST_PICTURE_TIME && this.scale + 1 < SCALES.length) this.scale += 1;
    else if (duration < FIRST_PICTURE_TIME / 5 && this.scale > 0) this.scale -= 1;
  }

  /**
   * Draw a finer picture, or add samples to the whole film: one in strips, or as many as fit into
   * the time of a strip.
   */
  async drawMore() {
    const finer = this.finerFilm();
    if (finer) {
      if (await this.drawStrips(finer)) this.showFilm(finer);
      return;
    }
    // `fit` is the number of samples that fit into the time of a strip.
    const { gl, version } = this,
      film = this.film(0),
      fit = this.rate ? (this.rate * STRIP_TIME) / (film.width * film.height) : 0;
    const started = performance.now();
    if (fit < 2) {
      if (!(await this.drawStrips(film))) return;
    } else {
      const count = Math.min(Math.floor(fit), this.sampleGoal() - film.count);
      for (let k = 0; k < count; k += 1) {
        if (!(await this.findVisible(film, true)) || this.version !== version) return;
        film.clear();
        this.relight(film, 0, film.height);
        film.add(this.scene.add);
      }
    }
    this.showFilm(film);
    await waitForGpu(gl);
    if (fit >= 2) this.measureRate(Math.floor(fit) * film.width * film.height, started);
  }

  /**
   * Return the film that is twice as fine as the visible one, if a sample of the whole film takes
   * long; else null.
   */
  finerFilm() {
    const whole = this.film(0),
      scale = this.films.indexOf(this.shownFilm);
    const sampleTime = this.rate ? (whole.width * whole.height) / this.rate : Infinity;
    return whole.count === 0 && scale > 1 && sampleTime > LONG_SAMPLE_TIME
      ? this.film(scale - 1)
      : null;
  }

  /** Add one sample to a film in strips; return false if a change ends it. */
  async drawStrips(film) {
    const { version } = this;
    if (!(await this.findVisible(film, true)) || this.version !== version) return false;
    film.clear();
    let top = 0;
    while (top < film.height) {
      const rows = this.rate ? Math.max(4, Math.floor((this.rate * STRIP_TIME) / film.width)) : 16;
      const bottom = Math.min(film.height, top + rows),
        started = performance.now();
      this.relight(film, top, bottom);
      await waitForGpu(this.gl);
      this.measureRate((bottom - top) * film.width, started);
      if (this.version !== version || this.stopped) return false;
      top = bottom;
    }
    film.add(this.scene.add);
    return true;
  }

  /**
   * Update the rate in pixels a millisecond by a measurement. It at most doubles, because a single
   * fast strip does not show that all strips are fast.
   */
  measureRate(pixels, started) {
    const now = pixels / Math.max(performance.now() - started, 0.1);
    this.rate = this.rate ? Math.min(now, 2 * this.rate) : now;
  }

  /** Show a film on the canvas, and dispatch an event. */
  showFilm(film) {
    this.shownFilm = film;
    this.draw(film);
    this.dispatchEvent(
      new CustomEvent("picture", {
        detail: { count: film.count, scale: SCALES[this.films.indexOf(film)] },
      }),
    );
  }

  /**
   * Find the visible triangles of a film for its next sample, unless the film has them already.
   * With `interruptible`, a change ends the search. Returns whether the film has them now.
   */
  async findVisible(film, interruptible = false) {
    const { gl, scene, version } = this,
      { element, seed } = this.settings;
    const number = Math.floor(film.count / Math.max(SAMPLES_PER_VIEW, film.subpixels ** 2));
    if (film.view?.version === this.viewVersion && film.view.number === number) return true;
    const subject = { element, center: scene.center, radius: scene.radius, number, seed };
    const [width, height] = [film.subpixels * film.width, film.subpixels * film.height];
    const view = cameras.viewUniforms(this.camera, { ...subject, width, height });
    Object.assign(view, { version: this.viewVersion, number });
    film.view = null;
    film.clearVisible();
    const opaque = mergeRanges(scene.looks.filter((look) => !look.see_through));
    const ranges = [
      ...opaque.map((range) => ({ ...range, look: scene.looks.find((look) => !look.see_through) })),
      ...scene.looks
        .filter((look) => look.see_through)
        .map((look) => ({ first: look.first, last: look.last, look })),
    ];
    for (const { first, last, look } of ranges) {
      for (let from = first; from < last; from += TRIANGLES_PER_DRAW) {
        gl.bindFramebuffer(gl.FRAMEBUFFER, film.visibleTarget);
        gl.viewport(0, 0, width, height);
        gl.enable(gl.DEPTH_TEST);
        const numbers = { ...view, sample_number: number, seed };
        look.visible.use(
          { ...numbers, ...look.numbers },
          { ...look.textures, corners: scene.corners },
        );
        scene.triangles.bind();
        scene.triangles.draw(from, Math.min(from + TRIANGLES_PER_DRAW, last));
        gl.bindVertexArray(null);
        gl.disable(gl.DEPTH_TEST);
        if (interruptible && last - from > TRIANGLES_PER_DRAW) {
          await waitForGpu(gl);
          if (this.version !== version || this.stopped) return false;
        }
      }
    }
    film.view = view;
    return true;
  }

  /** Draw a sample of the light in the rows of a film from `top` to before `bottom`. */
  relight(film, top, bottom) {
    const { gl, scene, settings } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, film.targets[2]);
    gl.viewport(0, 0, film.width, film.height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, film.height - bottom, film.width, bottom - top);
    const turns = cameras.lightRotations(settings.element, settings.lighting);
    const shadow = { shadowed: settings.shadows ? 1 : 0, lift: LIFT * scene.radius };
    for (const look of scene.looks) {
      const numbers = {
        ...film.view,
        ...shadow,
        size: [film.width, film.height],
        places: film.subpixels,
        turns,
      };
      Object.assign(numbers, {
        sample_number: film.count,
        seed: settings.seed,
        triangles: [look.first, look.last],
      });
      const textures = {
        ...look.textures,
        ...scene.rig,
        corners: scene.corners,
        visible: film.visible,
      };
      look.relight.use({ ...numbers, ...look.numbers }, textures);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Convert the light of a film to code values, over the light behind the asset. */
  develop(film) {
    const { gl, scene } = this,
      { exposure, behind, background } = this.settings;
    this.drawBackground(film);
    gl.bindFramebuffer(gl.FRAMEBUFFER, film.developedTarget);
    gl.viewport(0, 0, film.width, film.height);
    const numbers = {
      samples: film.count,
      exposure: 2 ** exposure,
      behind,
      lit: background ? 1 : 0,
    };
    scene.develop.use(numbers, { ...scene.view, sums: film.sums, lights: film.background });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    film.developedKey = JSON.stringify([this.backgroundKey, exposure, behind, background]);
  }

  /**
   * Set the exact picture of a version; `mean` has width * height * 4 numbers, row 0 at the top. It
   * is shown until the version changes, but settings of exposure and background still apply to it.
   */
  setExact(mean, width, height, version) {
    const { gl } = this;
    if (this.exact?.width !== width || this.exact?.height !== height) {
      this.exact?.delete();
      this.exact = new Film(gl, width, height, 1);
      gl.bindTexture(gl.TEXTURE_2D, this.exact.developed);
      for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
        gl.texParameteri(gl.TEXTURE_2D, name, gl.LINEAR);
    }
    this.exact.write(mean);
    this.exactVersion = version;
    this.redraw();
  }

  /** Return the uniforms and textures of `PRESENT` that concern the exact picture. */
  exactInputs(film) {
    const { wipe, differs } = this.settings,
      { exact } = this,
      isCurrent = exact && this.exactVersion === this.version;
    const none = { exact: film.developed, exact_sums: film.sums, sums: film.sums };
    if (!isCurrent || (wipe >= 1 && !differs))
      return { numbers: { wipe: 2, differs: 0, samples: 1, gain: 0 }, textures: none };
    this.develop(exact);
    const numbers = {
      wipe,
      differs: differs ? 1 : 0,
      samples: film.count,
      gain: 2 ** this.settings.exposure * DIFFERENCE,
    };
    return {
      numbers,
      textures: { exact: exact.developed, exact_sums: exact.sums, sums: film.sums },
    };
  }

  /** Show a film on the canvas. */
  draw(film) {
    const { gl, scene } = this,
      { width, height } = this.canvas,
      whole = this.films[0];
    this.needsRedraw = false;
    this.develop(film);
    const keep = film !== whole && whole?.developedKey === film.developedKey ? 1 : 0;
    const inputs = this.exactInputs(film);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    const textures = { film: film.developed, whole: keep ? whole.developed : film.developed };
    scene.present.use(
      { canvas: [width, height], keep, ...inputs.numbers },
      { ...textures, ...inputs.textures },
    );
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  /** A text that changes whenever the light behind the asset changes. */
  get backgroundKey() {
    const { element, lighting } = this.settings;
    return JSON.stringify([
      this.camera,
      element,
      lighting,
      this.scene.data.rig.textures.rig_numbers.buffer,
      this.lightVersion,
    ]);
  }

  /** Draw the light behind the asset, unless the film has it. */
  drawBackground(film) {
    const { gl, scene, settings, backgroundKey } = this;
    if (film.backgroundKey === backgroundKey || !settings.background) return;
    film.backgroundKey = backgroundKey;
    gl.bindFramebuffer(gl.FRAMEBUFFER, film.targets[3]);
    gl.viewport(0, 0, film.width, film.height);
    const subject = {
      element: settings.element,
      center: scene.center,
      radius: scene.radius,
      number: 0,
      seed: 0,
    };
    const size = { width: film.width, height: film.height, centred: true };
    const view = cameras.viewUniforms({ ...this.camera, lens: null }, { ...subject, ...size });
    scene.behind.use(
      { ...view, turns: cameras.lightRotations(settings.element, settings.lighting) },
      scene.rig,
    );
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

/** Return ranges of triangles; of the given ones, those that follow each other are merged. */
function mergeRanges(ranges) {
  const mergedRanges = [];
  for (const { first, last } of ranges) {
    if (mergedRanges.length && mergedRanges[mergedRanges.length - 1].last === first)
      mergedRanges[mergedRanges.length - 1].last = last;
    else mergedRanges.push({ first, last });
  }
  return mergedRanges;
}
