// @ts-check
// The plot: asks for the numbers of each surface, keeps them, and draws what has arrived in the
// next frame.
import { theme } from "./axes.js";
import { DECADES } from "./lobe.js";
import {
  changed,
  colorOf,
  givenOptions,
  nameOf,
  onChange,
  option,
  shownSurfaces,
  state,
  wordsOf,
} from "./state.js";
import { squares, VIEWS } from "./views.js";
import { shortly } from "./axes.js";

const canvas = document.getElementById("plot");
// In memory: curves and pictures of numbers are drawn sooner than a software graphics driver takes
// them.
const context = canvas.getContext("2d", { willReadFrequently: true });
const readout = document.getElementById("readout"),
  notice = document.getElementById("notice"),
  legend = document.getElementById("legend");
const SCALE_WORDS = { log: `log, ${DECADES} decades`, sqrt: "square root" };
const BROWSER = new Set(["lobe3d", "sphere"]); // drawn by GLSL

// Milliseconds from each move of a hand until its plot was drawn, and until the frame that shows
// it, for whoever measures.
export const latencies = [],
  shown = [];

export class Plots {
  constructor(link, balls, lobes) {
    this.link = link;
    this.balls = balls;
    this.lobes = lobes;
    this.cache = new Map();
    this.asked = new Map();
    this.waiting = [];
    this.probe = null;
    this.frame = 0;
    this.drawn = 0;
    this.ended = 0;
    this.took = 0;
    onChange((what, detail) => this.change(what, detail));
    // Asked of the canvas where it is drawn, its size would be found by a layout of the page for
    // each move.
    this.size = [canvas.clientWidth, canvas.clientHeight];
    new ResizeObserver(() => {
      this.size = [canvas.clientWidth, canvas.clientHeight];
      this.draw();
    }).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.look = null;
      changed("theme");
    });
    canvas.addEventListener("pointermove", (event) => this.point(event.offsetX, event.offsetY));
    canvas.addEventListener("pointerleave", () => {
      readout.textContent = "";
      this.at = null;
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
    this.orbit();
  }

  change(what, detail) {
    if (what === "parameter")
      this.ask(detail.surface, { moving: detail.name, draft: detail.held, since: detail.since });
    else if (what === "turn" || what === "selected" || what === "theme" || what === "label")
      this.draw();
    else if (what === "light") {
      if (state.kind === "sphere") this.draw();
    } else this.askAll(what === "options" ? detail : {});
  }

  // The key of what a surface's numbers depend on: exposure and scales are the browser's own.
  request(surface, draft) {
    const own = new Set(["scale", "angles", "channels", "exposure", "chroma"]);
    const options = Object.fromEntries(
      Object.entries(givenOptions()).filter(([name]) => !own.has(name)),
    );
    return {
      do: "values",
      kind: state.kind === "difference" ? "slice" : state.kind,
      surface: wordsOf(surface),
      options,
      draft,
    };
  }

  askAll(detail = {}) {
    for (const surface of state.surfaces) surface.problem = "";
    for (const surface of this.surfaces())
      this.ask(surface, {
        draft: detail.held ?? false,
        since: detail.since,
        moving: surface.moved,
      });
    this.draw();
  }

  surfaces() {
    const { most } = state.offered.kinds[state.kind];
    return shownSurfaces().slice(0, most);
  }

  async ask(surface, { moving = "", draft = false, since = 0 }) {
    surface.moved = moving || surface.moved || "";
    surface.problem = "";
    if (BROWSER.has(state.kind)) {
      this.draw(since);
      return;
    }
    if (!this.surfaces().includes(surface)) {
      this.draw();
      return;
    }
    const request = this.request(surface, draft),
      key = JSON.stringify(request);
    if (this.asked.get(surface.id) === key) {
      if (this.cache.get(surface.id)?.key === key) this.draw(since);
      return;
    }
    this.asked.set(surface.id, key);
    try {
      const slot = `plot/${surface.id}`,
        { slow } = state.offered.kinds[state.kind];
      // What takes long is first shown as a draft.
      for (const each of slow && !draft ? [true, draft] : [draft]) {
        const data = await this.link.newest(slot, {
          ...request,
          draft: each,
          moving: surface.moved,
        });
        if (!data) return;
        // While the hand moves on, what it has passed is shown nevertheless: answers of a slot come
        // in order.
        this.cache.set(surface.id, { key, kind: request.kind, data });
        this.draw(since);
        if (this.asked.get(surface.id) !== key) return;
        since = 0;
      }
    } catch (error) {
      if (this.asked.get(surface.id) !== key) return;
      this.asked.delete(surface.id);
      this.cache.delete(surface.id);
      surface.problem = error.message;
      this.draw();
    }
  }

  // Draw in the next frame. What follows a hand, which has moved at `since`, is drawn at once, so
  // that a frame that is
  // about to begin has it; answers that arrive faster than they are drawn share a frame.
  draw(since = 0) {
    if (since) this.waiting.push(since);
    const paint = () => {
      cancelAnimationFrame(this.frame);
      this.frame = 0;
      this.paint().catch((error) => this.tell(error.message));
    };
    if (since && !BROWSER.has(state.kind) && performance.now() - this.ended > this.took) paint();
    else this.frame ||= requestAnimationFrame(paint);
  }

  async paint() {
    const began = performance.now(),
      [width, height] = this.size,
      ratio = Math.min(devicePixelRatio, 2);
    if (!width || !state.offered) return;
    this.look ??= theme();
    if (
      canvas.width !== Math.round(width * ratio) ||
      canvas.height !== Math.round(height * ratio)
    ) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const waiting = this.waiting.splice(0),
      surfaces = this.surfaces(),
      items = [];
    const start = () => {
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.clearRect(0, 0, width, height);
    };
    canvas.classList.toggle("turns", state.kind === "lobe3d" || state.kind === "sphere");
    if (BROWSER.has(state.kind)) {
      if (this.busy) {
        this.again = true;
        this.waiting.unshift(...waiting);
        return;
      }
      this.busy = true;
      try {
        await (state.kind === "sphere"
          ? this.spheres(surfaces, width, height, ratio, start)
          : this.lobe3d(surfaces, width, height, ratio, start));
      } finally {
        this.busy = false;
        if (this.again) {
          this.again = false;
          this.draw();
        }
      }
    } else {
      const kind = state.kind === "difference" ? "slice" : state.kind;
      for (const surface of surfaces) {
        const kept = this.cache.get(surface.id);
        if (kept?.kind === kind) items.push({ surface, data: kept.data });
      }
      start();
      this.probe = null;
      const found =
        items.length || !surfaces.length
          ? VIEWS[state.kind](context, items, width, height, this.look)
          : null;
      if (typeof found === "string") start();
      else this.probe = found;
      // What a view lacks may be on its way.
      const coming = surfaces.some(
        (each) => !each.problem && !items.some((item) => item.surface === each),
      );
      if (typeof found === "string" && !coming) this.tell(found);
      else this.problems(surfaces);
    }
    const now = performance.now();
    [this.ended, this.took] = [now, now - began];
    for (const since of waiting) latencies.push(now - since);
    if (waiting.length)
      requestAnimationFrame((frame) => {
        for (const since of waiting) shown.push(Math.max(frame, now) - since);
      });
    for (const each of [latencies, shown]) if (each.length > 20000) each.splice(0, 10000);
    this.drawn++;
    this.tellLegend(surfaces);
    if (this.at) this.point(...this.at);
  }

  problems(surfaces) {
    const found = surfaces.filter((each) => each.problem).map((each) => each.problem);
    const { most } = state.offered.kinds[state.kind],
      left = shownSurfaces().length - most;
    if (left > 0) found.push(`This plot shows ${most} surfaces; ${left} more are left out.`);
    if (!state.surfaces.length)
      found.push("Add a surface from the list of models, presets and files.");
    else if (!shownSurfaces().length) found.push("All surfaces are hidden.");
    this.tell(found.join("  "));
  }

  tell(text) {
    if (notice.textContent !== text) notice.textContent = text;
    notice.hidden = !text;
  }

  tellLegend(surfaces) {
    const key = JSON.stringify([state.kind, surfaces.map((each) => [nameOf(each), colorOf(each)])]);
    if (this.legendKey === key) return;
    this.legendKey = key;
    legend.replaceChildren(
      ...surfaces.map((each) => {
        const item = document.createElement("li");
        item.style.setProperty("--own", colorOf(each));
        item.textContent = nameOf(each);
        return item;
      }),
    );
    canvas.setAttribute(
      "aria-label",
      `${state.offered.kinds[state.kind].text}: ${surfaces.map(nameOf).join(", ")}`,
    );
  }

  async spheres(surfaces, width, height, ratio, start) {
    const places = squares(2 * surfaces.length, width, height, {
      left: 10,
      right: 10,
      top: 30,
      bottom: 10,
      gap: 14,
    });
    // Pairs of a point light and a dome stay beside each other.
    const drawn = [],
      used = new Set(["ball"]);
    let more = false;
    for (const [i, surface] of surfaces.entries())
      for (const [j, light] of ["point", "dome"].entries()) {
        const place = places[2 * i + j],
          pixels = Math.min(512, Math.max(16, Math.round(place.size * ratio))),
          name = `plot/${surface.id}/${light}`;
        used.add(name);
        try {
          const copy = new OffscreenCanvas(pixels, pixels);
          const left = await this.balls.draw(
            name,
            surface,
            light,
            pixels,
            pixels,
            option("exposure"),
            (from, x, y) =>
              copy.getContext("2d").drawImage(from, x, y, pixels, pixels, 0, 0, pixels, pixels),
          );
          more ||= left;
          drawn.push({ copy, place, surface, light });
        } catch (error) {
          surface.problem = error.message;
        }
      }
    this.balls.keep(used);
    start();
    for (const { copy, place, surface, light } of drawn) {
      context.drawImage(copy, place.x, place.y, place.size, place.size);
      context.font = `550 12px ${this.look.font}`;
      context.textAlign = "center";
      context.fillStyle = colorOf(surface);
      context.fillText(
        `${nameOf(surface)}, ${light === "dome" ? "studio dome" : "point light"}`,
        place.x + place.size / 2,
        place.y - 10,
        place.size,
      );
    }
    this.probe = null;
    this.problems(surfaces);
    if (more && state.kind === "sphere") this.again = true;
  }

  async lobe3d(surfaces, width, height, ratio, start) {
    const [theta, phi] = [option("theta"), option("phi")].map((each) => (each * Math.PI) / 180),
      lobes = [],
      colors = [],
      names = [];
    for (const surface of surfaces) {
      try {
        const key = JSON.stringify([wordsOf(surface), theta, phi, option("cosine")]);
        if (surface.lobe?.key !== key)
          surface.lobe = {
            key,
            ...(await this.lobes.values(surface, theta, phi, option("cosine"))),
          };
        lobes.push({
          ...surface.lobe,
          solid: surface === state.surfaces[state.selected] || surfaces.length === 1,
        });
        colors.push(
          colorOf(surface)
            .match(/\w\w/g)
            .map((each) => parseInt(each, 16) / 255),
        );
        names.push(
          `${nameOf(surface)}: peak ${shortly(Number(surface.lobe.peak.toPrecision(3)))} /sr`,
        );
      } catch (error) {
        surface.problem = error.message;
      }
    }
    start();
    if (lobes.length) {
      const w = Math.round(width * ratio),
        h = Math.round(height * ratio),
        ink = this.look.ink
          .match(/[\d.]+/g)
          .slice(0, 3)
          .map((each) => each / 255);
      const {
        canvas: from,
        top,
        project,
      } = this.lobes.draw(lobes, w, h, option("scale"), colors, ink);
      context.drawImage(from, 0, top, w, h, 0, 0, width, height);
      context.font = `12px ${this.look.font}`;
      context.fillStyle = this.look.ink;
      context.textAlign = "center";
      const [x, y] = project(lobes[0].view.map((each) => each * 1.17));
      context.fillText("view", x / ratio, y / ratio);
      context.textAlign = "left";
      context.fillText(
        [
          `θo = ${option("theta")}°${option("cosine") ? ", times cos θi" : ""}`,
          `radius ${SCALE_WORDS[option("scale")] ?? "linear"}, one scale for all`,
        ].join("; "),
        18,
        28,
      );
      context.fillStyle = this.look.quiet;
      names.forEach((name, i) => context.fillText(name, 18, 50 + 18 * i));
    }
    this.probe = null;
    this.problems(surfaces);
  }

  point(x, y) {
    this.at = [x, y];
    const found = this.probe?.(x, y);
    readout.textContent = found?.text ?? "";
  }

  // Arrow keys move the place that is read, or turn the lobe and the light.
  key(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[
      event.key
    ];
    if (!step) return;
    event.preventDefault();
    if (BROWSER.has(state.kind)) {
      this.turn(step[0] * 8, step[1] * 8);
      return;
    }
    const [x, y] = this.at ?? [canvas.clientWidth / 2, canvas.clientHeight / 2],
      far = event.shiftKey ? 20 : 4;
    this.point(
      Math.min(canvas.clientWidth - 1, Math.max(0, x + far * step[0])),
      Math.min(canvas.clientHeight - 1, Math.max(0, y + far * step[1])),
    );
  }

  turn(dx, dy) {
    if (state.kind === "lobe3d") {
      state.turn = [
        state.turn[0] - dx * 0.008,
        Math.min(Math.PI / 2, Math.max(-0.2, state.turn[1] + dy * 0.008)),
      ];
      changed("turn");
    } else turnLight(dx, dy);
  }

  orbit() {
    let last = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (!BROWSER.has(state.kind)) return;
      last = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.turn(event.clientX - last[0], event.clientY - last[1]);
      last = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, () => {
        last = null;
      });
  }
}

// Move the point light over the sphere, by pixels.
export const turnLight = (dx, dy) => {
  const [theta, phi] = state.lightAt.map((each) => (each * Math.PI) / 180);
  const x = Math.sin(theta) * Math.cos(phi) + dx * 0.008,
    y = Math.sin(theta) * Math.sin(phi) - dy * 0.008;
  const sine = Math.min(0.999, Math.hypot(x, y));
  state.lightAt = [(Math.asin(sine) * 180) / Math.PI, (Math.atan2(y, x) * 180) / Math.PI];
  changed("light");
};
