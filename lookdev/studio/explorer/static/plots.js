// @ts-check
// The plot: asks for the numbers of each surface, keeps them, and draws what has arrived in the
// next frame.
import { theme } from "./axes.js";
import { DECADES } from "./lobe.js";
import {
  notify,
  colorOf,
  changedOptions,
  nameOf,
  onChange,
  option,
  visibleSurfaces,
  state,
  wordsOf,
} from "./state.js";
import { squares, VIEWS } from "./views.js";
import { formatShort } from "./axes.js";

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
    this.requests = new Map();
    this.waiting = [];
    this.probe = null;
    this.frame = 0;
    this.drawn = 0;
    this.ended = 0;
    this.took = 0;
    onChange((change, detail) => this.change(change, detail));
    // Asked of the canvas where it is drawn, its size would be found by a layout of the page for
    // each move.
    this.size = [canvas.clientWidth, canvas.clientHeight];
    new ResizeObserver(() => {
      this.size = [canvas.clientWidth, canvas.clientHeight];
      this.draw();
    }).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.look = null;
      notify("theme");
    });
    canvas.addEventListener("pointermove", (event) => this.point(event.offsetX, event.offsetY));
    canvas.addEventListener("pointerleave", () => {
      readout.textContent = "";
      this.at = null;
    });
    canvas.addEventListener("keydown", (event) => this.key(event));
    this.followDrags();
  }

  change(change, detail) {
    if (change === "parameter")
      this.ask(detail.surface, { moving: detail.name, draft: detail.held, since: detail.since });
    else if (change === "turn" || change === "selected" || change === "theme" || change === "label")
      this.draw();
    else if (change === "light") {
      if (state.kind === "sphere") this.draw();
    } else this.askAll(change === "options" ? detail : {});
  }

  // The key of what a surface's numbers depend on: exposure and scales are the browser's own.
  request(surface, draft) {
    const local = new Set(["scale", "angles", "channels", "exposure", "chroma"]);
    const options = Object.fromEntries(
      Object.entries(changedOptions()).filter(([name]) => !local.has(name)),
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
    return visibleSurfaces().slice(0, most);
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
    if (this.requests.get(surface.id) === key) {
      if (this.cache.get(surface.id)?.key === key) this.draw(since);
      return;
    }
    this.requests.set(surface.id, key);
    try {
      const slot = `plot/${surface.id}`,
        { slow } = state.offered.kinds[state.kind];
      // What takes long is first shown as a draft.
      for (const isDraft of slow && !draft ? [true, draft] : [draft]) {
        const data = await this.link.newest(slot, {
          ...request,
          draft: isDraft,
          moving: surface.moved,
        });
        if (!data) return;
        // While the hand moves on, what it has passed is shown nevertheless: answers of a slot come
        // in order.
        this.cache.set(surface.id, { key, kind: request.kind, data });
        this.draw(since);
        if (this.requests.get(surface.id) !== key) return;
        since = 0;
      }
    } catch (error) {
      if (this.requests.get(surface.id) !== key) return;
      this.requests.delete(surface.id);
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
      this.paint().catch((error) => this.say(error.message));
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
      surfaces = this.surfaces();
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
          ? this.drawSpheres(surfaces, width, height, ratio, start)
          : this.drawLobes(surfaces, width, height, ratio, start));
      } finally {
        this.busy = false;
        if (this.again) {
          this.again = false;
          this.draw();
        }
      }
    } else {
      this.drawNumbers(surfaces, width, height, start);
    }
    const now = performance.now();
    [this.ended, this.took] = [now, now - began];
    for (const since of waiting) latencies.push(now - since);
    if (waiting.length)
      requestAnimationFrame((frame) => {
        for (const since of waiting) shown.push(Math.max(frame, now) - since);
      });
    for (const times of [latencies, shown]) if (times.length > 20000) times.splice(0, 10000);
    this.drawn++;
    this.showLegend(surfaces);
    if (this.at) this.point(...this.at);
  }

  /** Draw the numbers of surfaces, as far as they have arrived. */
  drawNumbers(surfaces, width, height, start) {
    const kind = state.kind === "difference" ? "slice" : state.kind,
      items = [];
    for (const surface of surfaces) {
      const cached = this.cache.get(surface.id);
      if (cached?.kind === kind) items.push({ surface, data: cached.data });
    }
    start();
    this.probe = null;
    const drawn =
      items.length || !surfaces.length
        ? VIEWS[state.kind](context, items, width, height, this.look)
        : null;
    if (typeof drawn === "string") start();
    else this.probe = drawn;
    // What a view lacks may be on its way.
    const isWaiting = surfaces.some(
      (surface) => !surface.problem && !items.some((item) => item.surface === surface),
    );
    if (typeof drawn === "string" && !isWaiting) this.say(drawn);
    else this.showProblems(surfaces);
  }

  showProblems(surfaces) {
    const problems = surfaces.map(({ problem }) => problem).filter(Boolean);
    const { most } = state.offered.kinds[state.kind],
      left = visibleSurfaces().length - most;
    if (left > 0) problems.push(`This plot shows ${most} surfaces; ${left} more are left out.`);
    if (!state.surfaces.length)
      problems.push("Add a surface from the list of models, presets and files.");
    else if (!visibleSurfaces().length) problems.push("All surfaces are hidden.");
    this.say(problems.join("  "));
  }

  say(text) {
    if (notice.textContent !== text) notice.textContent = text;
    notice.hidden = !text;
  }

  showLegend(surfaces) {
    const key = JSON.stringify([
      state.kind,
      surfaces.map((surface) => [nameOf(surface), colorOf(surface)]),
    ]);
    if (this.legendKey === key) return;
    this.legendKey = key;
    legend.replaceChildren(
      ...surfaces.map((surface) => {
        const item = document.createElement("li");
        item.style.setProperty("--own", colorOf(surface));
        item.textContent = nameOf(surface);
        return item;
      }),
    );
    canvas.setAttribute(
      "aria-label",
      `${state.offered.kinds[state.kind].text}: ${surfaces.map(nameOf).join(", ")}`,
    );
  }

  async drawSpheres(surfaces, width, height, ratio, start) {
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
    this.balls.deleteOthers(used);
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
    this.showProblems(surfaces);
    if (more && state.kind === "sphere") this.again = true;
  }

  async drawLobes(surfaces, width, height, ratio, start) {
    const [theta, phi] = [option("theta"), option("phi")].map(
        (degrees) => (degrees * Math.PI) / 180,
      ),
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
            .map((digits) => parseInt(digits, 16) / 255),
        );
        names.push(
          `${nameOf(surface)}: peak ${formatShort(Number(surface.lobe.peak.toPrecision(3)))} /sr`,
        );
      } catch (error) {
        surface.problem = error.message;
      }
    }
    start();
    if (lobes.length) this.drawLobeScene(lobes, colors, names, width, height, ratio);
    this.probe = null;
    this.showProblems(surfaces);
  }

  drawLobeScene(lobes, colors, names, width, height, ratio) {
    const w = Math.round(width * ratio),
      h = Math.round(height * ratio),
      ink = this.look.ink
        .match(/[\d.]+/g)
        .slice(0, 3)
        .map((code) => code / 255);
    const scene = this.lobes.draw(lobes, w, h, option("scale"), colors, ink);
    context.drawImage(scene.canvas, 0, scene.top, w, h, 0, 0, width, height);
    context.font = `12px ${this.look.font}`;
    context.fillStyle = this.look.ink;
    context.textAlign = "center";
    const [x, y] = scene.project(lobes[0].view.map((part) => part * 1.17));
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

  point(x, y) {
    this.at = [x, y];
    readout.textContent = this.probe?.(x, y)?.text ?? "";
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
      notify("turn");
    } else turnLight(dx, dy);
  }

  followDrags() {
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
  const [theta, phi] = state.lightAngles.map((degrees) => (degrees * Math.PI) / 180);
  const x = Math.sin(theta) * Math.cos(phi) + dx * 0.008,
    y = Math.sin(theta) * Math.sin(phi) - dy * 0.008;
  const sine = Math.min(0.999, Math.hypot(x, y));
  state.lightAngles = [(Math.asin(sine) * 180) / Math.PI, (Math.atan2(y, x) * 180) / Math.PI];
  notify("light");
};
