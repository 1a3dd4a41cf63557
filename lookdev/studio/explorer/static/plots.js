// @ts-check
// The plot of the Explorer's page. It requests and caches the numbers of each surface, and draws
// those that have arrived; spheres and lobes are drawn by WebGL, without numbers from the server.
import { DECADES, formatShort, readTheme } from "./axes.js";
import { hexCodes } from "./viewport/color.js";
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
import { layOutSquares, VIEWS } from "./views.js";

const canvas = document.getElementById("plot");
// The option keeps the canvas in the main memory: with a software graphics driver, copying it would
// take longer than drawing.
const context = canvas.getContext("2d", { willReadFrequently: true });
const readout = document.getElementById("readout"),
  notice = document.getElementById("notice"),
  legend = document.getElementById("legend");
const SCALE_WORDS = { log: `log, ${DECADES} decades`, sqrt: "square root" };
// The options that do not change the numbers of a plot, only its drawing.
const PAGE_OPTIONS = new Set(["scale", "angles", "channels", "exposure", "chroma"]);
const GPU_KINDS = new Set(["lobe3d", "sphere"]); // kinds of plots that are drawn by WebGL

// Milliseconds from each move of the pointer until its plot was drawn, and until the frame that
// shows it. Tests read them.
export const drawLatencies = [],
  frameLatencies = [];

export class Plots {
  constructor(link, spheres, lobes) {
    this.link = link;
    this.spheres = spheres;
    this.lobes = lobes;
    this.cache = new Map(); // the numbers of surfaces, {key, kind, data}, by the surface's id
    this.requests = new Map(); // the key of the newest request of each surface, by its id
    this.moveTimes = []; // times of the moves of the pointer that are not drawn yet
    this.readAt = null; // the function from a point of the canvas to the text of the readout
    this.frameRequest = 0;
    this.paintCount = 0;
    this.paintEnd = 0;
    this.paintDuration = 0;
    onChange((change, detail) => this.applyChange(change, detail));
    // The size is stored, because reading it in `paint` would lay out the page at each move.
    this.size = [canvas.clientWidth, canvas.clientHeight];
    new ResizeObserver(() => {
      this.size = [canvas.clientWidth, canvas.clientHeight];
      this.draw();
    }).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.theme = null;
      notify("theme");
    });
    canvas.addEventListener("pointermove", (event) =>
      this.showReadout(event.offsetX, event.offsetY),
    );
    canvas.addEventListener("pointerleave", () => {
      readout.textContent = "";
      this.pointer = null;
    });
    canvas.addEventListener("keydown", (event) => this.pressKey(event));
    this.followDrags();
  }

  /** Draw the plot anew, and request numbers, as far as a change of the state needs it. */
  applyChange(change, detail) {
    if (change === "parameter")
      this.requestNumbers(detail.surface, {
        moving: detail.name,
        draft: detail.held,
        moveTime: detail.moveTime,
      });
    else if (change === "turn" || change === "selected" || change === "theme" || change === "label")
      this.draw();
    else if (change === "light") {
      if (state.kind === "sphere") this.draw();
    } else this.requestAll(change === "options" ? detail : {});
  }

  // Return the request for the numbers of a surface, without `PAGE_OPTIONS`. A draft is coarser.
  makeRequest(surface, draft) {
    const options = Object.fromEntries(
      Object.entries(changedOptions()).filter(([name]) => !PAGE_OPTIONS.has(name)),
    );
    return {
      do: "values",
      kind: state.kind === "difference" ? "slice" : state.kind,
      surface: wordsOf(surface),
      options,
      draft,
    };
  }

  requestAll(detail = {}) {
    for (const surface of state.surfaces) surface.problem = "";
    for (const surface of this.plottedSurfaces())
      this.requestNumbers(surface, {
        draft: detail.held ?? false,
        moveTime: detail.moveTime,
        moving: surface.movedParameter,
      });
    this.draw();
  }

  /** Return the visible surfaces, up to the largest number that the kind of plot shows. */
  plottedSurfaces() {
    const { most } = state.catalogue.kinds[state.kind];
    return visibleSurfaces().slice(0, most);
  }

  /**
   * Request the numbers of a surface, unless they are requested already, and draw them. `moving` is
   * the parameter that a slider moves, and `moveTime` the time of the pointer's move.
   */
  async requestNumbers(surface, { moving = "", draft = false, moveTime = 0 }) {
    surface.movedParameter = moving || surface.movedParameter || "";
    surface.problem = "";
    if (GPU_KINDS.has(state.kind)) {
      this.draw(moveTime);
      return;
    }
    if (!this.plottedSurfaces().includes(surface)) {
      this.draw();
      return;
    }
    const request = this.makeRequest(surface, draft),
      key = JSON.stringify(request);
    if (this.requests.get(surface.id) === key) {
      if (this.cache.get(surface.id)?.key === key) this.draw(moveTime);
      return;
    }
    this.requests.set(surface.id, key);
    try {
      const slot = `plot/${surface.id}`,
        { slow } = state.catalogue.kinds[state.kind];
      // A slow plot is first shown as a draft.
      for (const isDraft of slow && !draft ? [true, draft] : [draft]) {
        const data = await this.link.askNewest(slot, {
          ...request,
          draft: isDraft,
          moving: surface.movedParameter,
        });
        if (!data) return;
        // Also show an answer that is no longer the newest: while the pointer moves on, the plot
        // follows. Answers of a slot arrive in the order of its requests.
        this.cache.set(surface.id, { key, kind: request.kind, data });
        this.draw(moveTime);
        if (this.requests.get(surface.id) !== key) return;
        moveTime = 0;
      }
    } catch (error) {
      if (this.requests.get(surface.id) !== key) return;
      this.requests.delete(surface.id);
      this.cache.delete(surface.id);
      surface.problem = error.message;
      this.draw();
    }
  }

  // Draw the plot in the next frame of the browser. After a move of the pointer, at the time
  // `moveTime`, it is drawn at once, so that the next frame has it already. But answers that arrive
  // faster than the plot is drawn share a frame.
  draw(moveTime = 0) {
    if (moveTime) this.moveTimes.push(moveTime);
    const paint = () => {
      cancelAnimationFrame(this.frameRequest);
      this.frameRequest = 0;
      this.paint().catch((error) => this.showNotice(error.message));
    };
    if (
      moveTime &&
      !GPU_KINDS.has(state.kind) &&
      performance.now() - this.paintEnd > this.paintDuration
    )
      paint();
    else this.frameRequest ||= requestAnimationFrame(paint);
  }

  /** Draw the plot now. */
  async paint() {
    const began = performance.now(),
      [width, height] = this.size,
      ratio = Math.min(devicePixelRatio, 2);
    if (!width || !state.catalogue) return;
    this.theme ??= readTheme();
    if (
      canvas.width !== Math.round(width * ratio) ||
      canvas.height !== Math.round(height * ratio)
    ) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    const moveTimes = this.moveTimes.splice(0),
      surfaces = this.plottedSurfaces();
    const clear = () => {
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      context.clearRect(0, 0, width, height);
    };
    canvas.classList.toggle("rotatable", GPU_KINDS.has(state.kind));
    if (GPU_KINDS.has(state.kind)) {
      if (this.isPainting) {
        this.mustRepaint = true;
        this.moveTimes.unshift(...moveTimes);
        return;
      }
      this.isPainting = true;
      try {
        await (state.kind === "sphere"
          ? this.drawSpheres(surfaces, width, height, ratio, clear)
          : this.drawLobes(surfaces, width, height, ratio, clear));
      } finally {
        this.isPainting = false;
        if (this.mustRepaint) {
          this.mustRepaint = false;
          this.draw();
        }
      }
    } else {
      this.drawNumbers(surfaces, width, height, clear);
    }
    const now = performance.now();
    [this.paintEnd, this.paintDuration] = [now, now - began];
    for (const moveTime of moveTimes) drawLatencies.push(now - moveTime);
    if (moveTimes.length)
      requestAnimationFrame((frame) => {
        for (const moveTime of moveTimes) frameLatencies.push(Math.max(frame, now) - moveTime);
      });
    for (const times of [drawLatencies, frameLatencies])
      if (times.length > 20000) times.splice(0, 10000);
    this.paintCount++;
    this.showLegend(surfaces);
    if (this.pointer) this.showReadout(...this.pointer);
  }

  /** Draw the numbers of those surfaces whose numbers have arrived. */
  drawNumbers(surfaces, width, height, clear) {
    const kind = state.kind === "difference" ? "slice" : state.kind,
      items = [];
    for (const surface of surfaces) {
      const cached = this.cache.get(surface.id);
      if (cached?.kind === kind) items.push({ surface, data: cached.data });
    }
    clear();
    this.readAt = null;
    // A view returns the function for the readout, or a sentence if it lacks a surface.
    const result =
      items.length || !surfaces.length
        ? VIEWS[state.kind](context, items, width, height, this.theme)
        : null;
    if (typeof result === "string") clear();
    else this.readAt = result;
    // The sentence is shown only if no numbers are still to arrive.
    const isWaiting = surfaces.some(
      (surface) => !surface.problem && !items.some((item) => item.surface === surface),
    );
    if (typeof result === "string" && !isWaiting) this.showNotice(result);
    else this.showProblems(surfaces);
  }

  showProblems(surfaces) {
    const problems = surfaces.map(({ problem }) => problem).filter(Boolean);
    const { most } = state.catalogue.kinds[state.kind],
      rest = visibleSurfaces().length - most;
    if (rest > 0) problems.push(`This plot shows ${most} surfaces; ${rest} more are left out.`);
    if (!state.surfaces.length)
      problems.push("Add a surface from the list of models, presets and files.");
    else if (!visibleSurfaces().length) problems.push("All surfaces are hidden.");
    this.showNotice(problems.join("  "));
  }

  showNotice(text) {
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
        item.style.setProperty("--surface-color", colorOf(surface));
        item.textContent = nameOf(surface);
        return item;
      }),
    );
    canvas.setAttribute(
      "aria-label",
      `${state.catalogue.kinds[state.kind].text}: ${surfaces.map(nameOf).join(", ")}`,
    );
  }

  async drawSpheres(surfaces, width, height, ratio, clear) {
    const squares = layOutSquares(2 * surfaces.length, width, height, {
      left: 10,
      right: 10,
      top: 30,
      bottom: 10,
      gap: 14,
    });
    // The two spheres of a surface, under the point light and under the dome, are side by side.
    const pictures = [],
      names = new Set(["ball"]);
    let lacksPasses = false;
    for (const [i, surface] of surfaces.entries())
      for (const [j, light] of ["point", "dome"].entries()) {
        const square = squares[2 * i + j],
          pixels = Math.min(512, Math.max(16, Math.round(square.size * ratio))),
          name = `plot/${surface.id}/${light}`;
        names.add(name);
        try {
          const copy = new OffscreenCanvas(pixels, pixels);
          const isUnfinished = await this.spheres.draw(
            name,
            surface,
            light,
            pixels,
            pixels,
            option("exposure"),
            (source, x, y) =>
              copy.getContext("2d").drawImage(source, x, y, pixels, pixels, 0, 0, pixels, pixels),
          );
          lacksPasses ||= isUnfinished;
          pictures.push({ copy, square, surface, light });
        } catch (error) {
          surface.problem = error.message;
        }
      }
    this.spheres.deleteOthers(names);
    clear();
    for (const { copy, square, surface, light } of pictures) {
      context.drawImage(copy, square.x, square.y, square.size, square.size);
      context.font = `550 12px ${this.theme.font}`;
      context.textAlign = "center";
      context.fillStyle = colorOf(surface);
      context.fillText(
        `${nameOf(surface)}, ${light === "dome" ? "studio dome" : "point light"}`,
        square.x + square.size / 2,
        square.y - 10,
        square.size,
      );
    }
    this.readAt = null;
    this.showProblems(surfaces);
    if (lacksPasses && state.kind === "sphere") this.mustRepaint = true;
  }

  async drawLobes(surfaces, width, height, ratio, clear) {
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
            ...(await this.lobes.evaluate(surface, theta, phi, option("cosine"))),
          };
        lobes.push({
          ...surface.lobe,
          solid: surface === state.surfaces[state.selected] || surfaces.length === 1,
        });
        colors.push(hexCodes(colorOf(surface)));
        names.push(
          `${nameOf(surface)}: peak ${formatShort(Number(surface.lobe.peak.toPrecision(3)))} /sr`,
        );
      } catch (error) {
        surface.problem = error.message;
      }
    }
    clear();
    if (lobes.length) this.drawLobeScene(lobes, colors, names, width, height, ratio);
    this.readAt = null;
    this.showProblems(surfaces);
  }

  drawLobeScene(lobes, colors, names, width, height, ratio) {
    const w = Math.round(width * ratio),
      h = Math.round(height * ratio),
      ink = this.theme.ink
        .match(/[\d.]+/g)
        .slice(0, 3)
        .map((code) => code / 255);
    const scene = this.lobes.draw(lobes, w, h, option("scale"), colors, ink);
    context.drawImage(scene.canvas, 0, scene.top, w, h, 0, 0, width, height);
    context.font = `12px ${this.theme.font}`;
    context.fillStyle = this.theme.ink;
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
    context.fillStyle = this.theme.quiet;
    names.forEach((name, i) => context.fillText(name, 18, 50 + 18 * i));
  }

  /** Show the values of the plot at a point of the canvas as text. */
  showReadout(x, y) {
    this.pointer = [x, y];
    readout.textContent = this.readAt?.(x, y) ?? "";
  }

  // Let arrow keys move the point of the readout, or rotate the lobe or the light.
  pressKey(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[
      event.key
    ];
    if (!step) return;
    event.preventDefault();
    if (GPU_KINDS.has(state.kind)) {
      this.rotate(step[0] * 8, step[1] * 8);
      return;
    }
    const [x, y] = this.pointer ?? [canvas.clientWidth / 2, canvas.clientHeight / 2],
      pixels = event.shiftKey ? 20 : 4;
    this.showReadout(
      Math.min(canvas.clientWidth - 1, Math.max(0, x + pixels * step[0])),
      Math.min(canvas.clientHeight - 1, Math.max(0, y + pixels * step[1])),
    );
  }

  /** Rotate the lobe, or move the light of the spheres, by pixels of a drag. */
  rotate(dx, dy) {
    if (state.kind === "lobe3d") {
      state.lobeAngles = [
        state.lobeAngles[0] - dx * 0.008,
        Math.min(Math.PI / 2, Math.max(-0.2, state.lobeAngles[1] + dy * 0.008)),
      ];
      notify("turn");
    } else turnLight(dx, dy);
  }

  followDrags() {
    let last = null;
    canvas.addEventListener("pointerdown", (event) => {
      if (!GPU_KINDS.has(state.kind)) return;
      last = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!last) return;
      this.rotate(event.clientX - last[0], event.clientY - last[1]);
      last = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"])
      canvas.addEventListener(name, () => {
        last = null;
      });
  }
}

// Move the point light over the sphere, as the pointer moves by `dx` and `dy` pixels.
export const turnLight = (dx, dy) => {
  const [theta, phi] = state.lightAngles.map((degrees) => (degrees * Math.PI) / 180);
  const x = Math.sin(theta) * Math.cos(phi) + dx * 0.008,
    y = Math.sin(theta) * Math.sin(phi) - dy * 0.008;
  const sine = Math.min(0.999, Math.hypot(x, y));
  state.lightAngles = [(Math.asin(sine) * 180) / Math.PI, (Math.atan2(y, x) * 180) / Math.PI];
  notify("light");
};
