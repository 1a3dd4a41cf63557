// The viewport: a scene of lookdev.studio.viewport under an orbiting camera. Light adds up over frames; a change shows
// at once at a resolution that the machine draws in time, then whole.

import * as cameras from "./camera.js";
import { Film } from "./film.js";
import { Programs, Textures, Triangles, context, finished, viewTextures } from "./gl.js";

const AT_ONCE = 45; // milliseconds of the first picture after a change, at most
const TILE = 25; // milliseconds between changes that are looked at while light adds up
const SCALES = [1, 2, 4, 8, 16];

const OVER_ALL = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0); }`;
const ADD = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D sums, sampled;
uniform float before;
layout(location = 0) out vec4 total;
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    total = texelFetch(sampled, at, 0);
    if (before > 0.0) total += texelFetch(sums, at, 0);
}`;

export class Viewport extends EventTarget {
  /** `fetched` returns the bytes of a buffer by its digest, as a promise of an ArrayBuffer. */
  constructor(canvas, fetched) {
    super();
    this.canvas = canvas;
    this.gl = context(canvas);
    this.programs = new Programs(this.gl);
    this.textures = new Textures(this.gl, fetched);
    this.settings = { element: 0, lighting: 0, exposure: 0, background: true, behind: 0, seed: 0, most: 4096, perView: 4 };
    this.scale = 3; // of SCALES
    this.rate = null; // pixels a millisecond
    this.version = 0;
    this.placed = 0; // version of what is seen
    this.shown = -1; // version of the last picture
    this.frames = 0;
    this.wake = null;
    this.stopped = false;
    this.running = this.run();
  }

  /** Show a scene once all of it is compiled and fetched; until then what was shown stays, and can be changed. */
  async show(data) {
    const { gl } = this;
    const looks = await Promise.all(data.looks.map(async (look) => ({
      ...look,
      visible: await this.programs.get(data.vertex, look.visible),
      relight: await this.programs.get(OVER_ALL, look.relight),
      textures: await this.textures.get(look.textures),
      numbers: { ...look.numbers },
    })));
    const [add, display, rig, corners, vertices, indices] = await Promise.all([
      this.programs.get(OVER_ALL, ADD),
      this.programs.get(OVER_ALL, data.display),
      this.textures.get(data.rig.textures),
      this.textures.one(data.corners),
      this.textures.fetched(data.vertices),
      this.textures.fetched(data.indices),
    ]);
    const before = this.scene;
    const triangles = new Triangles(gl, vertices, indices);
    this.scene = { ...data, looks, add, display, rig, corners, triangles, view: viewTextures(gl, data.view) };
    before?.triangles.delete();
    if (!before) this.camera = data.camera;
    const described = data.looks.flatMap((look) => Object.values(look.textures));
    this.textures.keep([...described, ...Object.values(data.rig.textures), data.corners]);
    this.resize(...(before ? [this.canvas.width, this.canvas.height] : data.resolution));
  }

  resize(width, height) {
    this.films?.forEach((film) => film?.delete());
    [this.canvas.width, this.canvas.height] = [width, height];
    this.films = SCALES.map(() => null);
    this.change(true);
  }

  film(scale) {
    const size = (pixels) => Math.max(1, Math.round(pixels / SCALES[scale]));
    this.films[scale] ??= new Film(this.gl, size(this.canvas.width), size(this.canvas.height));
    return this.films[scale];
  }

  /** Change numbers of a look: uniforms, by their names. */
  setNumbers(look, numbers) {
    Object.assign(this.scene.looks[look].numbers, numbers);
    this.change();
  }

  /** Change settings: element and lighting are degrees, exposure is in stops. */
  set(settings) {
    const differs = (name) => name in settings && settings[name] !== this.settings[name];
    const [seen, lit] = [differs("element") || differs("seed"), differs("lighting")];
    Object.assign(this.settings, settings);
    if (seen || lit) this.change(seen);
    else this.redraw();
  }

  setCamera(camera) {
    this.camera = camera;
    this.change(true);
  }

  /** Begin anew; `seen` where other places are seen, not only another light. */
  change(seen = false) {
    this.version += 1;
    if (seen || this.scene?.looks.some((look) => look.see_through)) this.placed = this.version;
    this.wake?.();
  }

  redraw() {
    this.dirty = true;
    this.wake?.();
  }

  /** Return the part seen at a pixel of the canvas, y from the top, or null. */
  pick(x, y) {
    if (!this.last) return null;
    const at = (value, size, whole) => Math.min(size - 1, Math.floor((value * size) / whole));
    const { width, height } = this.last;
    const triangle = this.last.triangle(at(x, width, this.canvas.width), at(y, height, this.canvas.height));
    return this.scene.parts.find((each) => each.first <= triangle && triangle < each.last) ?? null;
  }

  /** Wait until a picture of the last change is shown. */
  async changed() {
    const version = this.version;
    while (this.shown < version && !this.failed) await this.once("picture");
    if (this.failed) throw this.failed;
  }

  /** Wait until `count` samples have been added up; returns their means, row 0 at the top. */
  async accumulated(count) {
    this.settings.most = Math.max(count, this.settings.most);
    this.wake?.();
    const complete = () => this.shown === this.version && this.last === this.film(0) && this.last.count >= count;
    while (!this.failed && !complete()) await this.once("picture");
    if (this.failed) throw this.failed;
    return this.last.read();
  }

  once(name) {
    return new Promise((resolve) => this.addEventListener(name, resolve, { once: true }));
  }

  stop() {
    this.stopped = true;
    this.wake?.();
    return this.running;
  }

  async run() {
    try {
      while (!this.stopped) {
        if (this.scene && this.shown < this.version) await this.first();
        else if (this.scene && this.film(0).count < this.settings.most) await this.more();
        else if (this.dirty && this.last) this.picture(this.last);
        else await new Promise((resolve) => { this.wake = resolve; });
      }
    } catch (error) {
      this.failed = error;
      this.dispatchEvent(new CustomEvent("failed", { detail: error }));
      this.dispatchEvent(new Event("picture"));
    }
  }

  /** Draw one sample of all pixels after a change, at the finest scale that has been in time. */
  async first() {
    const { version } = this, film = this.film(this.scale), started = performance.now();
    this.films.forEach((each) => { if (each) each.count = 0; });
    this.see(film);
    this.relight(film, 0, film.height);
    film.add(this.scene.add);
    this.shown = version;
    this.last = film;
    this.draw(film);
    await finished(this.gl);
    const took = performance.now() - started;
    this.frames += 1;
    this.dispatchEvent(new CustomEvent("picture", { detail: { count: 1, took, scale: SCALES[this.scale] } }));
    if (took > AT_ONCE && this.scale + 1 < SCALES.length) this.scale += 1;
    else if (took < AT_ONCE / 5 && this.scale > 0) this.scale -= 1;
  }

  /** Add one sample to the whole film, in strips after each of which a change is looked at. */
  async more() {
    const { version, gl } = this, film = this.film(0);
    this.see(film);
    let top = 0;
    while (top < film.height) {
      const rows = this.rate ? Math.max(4, Math.floor((this.rate * TILE) / film.width)) : 16;
      const bottom = Math.min(film.height, top + rows), started = performance.now();
      this.relight(film, top, bottom);
      if (bottom < film.height || film.count % 8 === 0) {
        await finished(gl);
        const now = ((bottom - top) * film.width) / Math.max(performance.now() - started, 0.1);
        this.rate = this.rate ? Math.min(now, 2 * this.rate) : now;
      }
      if (this.version !== version || this.stopped) return;
      top = bottom;
    }
    film.add(this.scene.add);
    this.picture(film);
    await finished(gl);
  }

  picture(film) {
    this.last = film;
    this.draw(film);
    this.dispatchEvent(new CustomEvent("picture", { detail: { count: film.count, scale: SCALES[this.films.indexOf(film)] } }));
  }

  /** Find what each pixel of a film sees in its next sample, unless that was seen last. */
  see(film) {
    const { gl, scene } = this, { element, seed } = this.settings, number = Math.floor(film.count / this.settings.perView);
    film.clear();
    if (film.seen?.placed === this.placed && film.seen.number === number) return;
    const given = { element, center: scene.center, radius: scene.radius, number, seed };
    film.seen = cameras.view(this.camera, { ...given, width: film.width, height: film.height });
    Object.assign(film.seen, { placed: this.placed, number });
    film.see();
    gl.bindFramebuffer(gl.FRAMEBUFFER, film.seeing);
    gl.enable(gl.DEPTH_TEST);
    const opaque = scene.looks.filter((look) => !look.see_through);
    const numbers = { ...film.seen, sample_number: number, seed };
    scene.triangles.bind();
    for (const look of scene.looks) {
      if (!look.see_through && look !== opaque[0]) continue;
      look.visible.use({ ...numbers, ...look.numbers }, { ...look.textures, corners: scene.corners });
      const ranges = look.see_through ? [look] : merged(opaque);
      for (const { first, last } of ranges) scene.triangles.draw(first, last);
    }
    gl.bindVertexArray(null);
    gl.disable(gl.DEPTH_TEST);
  }

  /** Find the light of rows of a film, from the top one to before the bottom one. */
  relight(film, top, bottom) {
    const { gl, scene, settings } = this;
    gl.bindFramebuffer(gl.FRAMEBUFFER, film.targets[2]);
    gl.viewport(0, 0, film.width, film.height);
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, film.height - bottom, film.width, bottom - top);
    const turns = cameras.turns(settings.element, settings.lighting);
    for (const look of scene.looks) {
      const numbers = { ...film.seen, sample_number: film.count, seed: settings.seed, turns, triangles: [look.first, look.last] };
      const textures = { ...look.textures, ...scene.rig, corners: scene.corners, visible: film.visible };
      look.relight.use({ ...numbers, ...look.numbers }, textures);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    gl.disable(gl.SCISSOR_TEST);
  }

  /** Show a film on the canvas. */
  draw(film) {
    const { gl, scene, settings } = this, { width, height } = this.canvas;
    this.dirty = false;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    const given = { element: settings.element, center: scene.center, radius: scene.radius, number: 0, seed: 0 };
    const view = cameras.view({ ...this.camera, lens: null }, { ...given, width, height, centred: true });
    scene.display.use({
      ...view,
      samples: film.count,
      exposure: 2 ** settings.exposure,
      behind: settings.behind,
      lights: settings.background ? 1 : 0,
      turns: cameras.turns(settings.element, settings.lighting),
    }, { ...scene.rig, ...scene.view, sums: film.sums });
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

/** Ranges of triangles, those that follow each other as one. */
function merged(ranges) {
  const joined = [];
  for (const { first, last } of ranges) {
    if (joined.length && joined[joined.length - 1].last === first) joined[joined.length - 1].last = last;
    else joined.push({ first, last });
  }
  return joined;
}
