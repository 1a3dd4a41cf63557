// @ts-check
// The panel of the exact picture: Cycles or Mitsuba renders the viewport's scene on the server, in
// rounds of more samples. The picture replaces the viewport's own (mode "exact"), is shown to the
// right of a handle (mode "wipe"), or its difference from the viewport's is shown.

import { byId, makeElement } from "./viewport/elements.js";
import { parsePacket } from "./viewport/packets.js";

const REST = 150; // milliseconds without a change, after which the page requests a picture
const RETRY = 2000; // milliseconds after which the page reconnects
// Samples of the viewport: few until the first round arrives, because renderer and viewport use the
// same processors.
const SAMPLES_WAITING = 4,
  SAMPLES_ALONE = 4096,
  SAMPLES_COMPARED = 256,
  MAX_SAMPLES = {
    viewport: SAMPLES_ALONE,
    exact: SAMPLES_WAITING,
    wipe: SAMPLES_COMPARED,
    difference: SAMPLES_COMPARED,
  };
const MODES = { v: "viewport", e: "exact", w: "wipe", d: "difference" }; // by keys
const STEP = 0.02; // fraction of the width by which a key moves the wipe
// A fraction as text, in percent, without and with its sign.
const formatShare = (share) => `${(100 * share).toFixed(Math.abs(share) < 0.0995 ? 1 : 0)} %`;
const formatSigned = (share) => (share > 0 ? "+" : "−") + formatShare(Math.abs(share));

const stage = `
  <div id="wipe" role="slider" tabindex="0" hidden
    aria-label="Wipe: the viewport to the left, the exact picture to the right"
    aria-valuemin="0" aria-valuemax="100" aria-valuenow="50" aria-orientation="horizontal"
    title="Left: viewport. Right: exact. Drag, or arrow keys">
    <span>viewport</span><span>exact</span>
  </div>
  <div id="difference" aria-label="Difference" hidden>
    <p id="difference-mean"></p>
    <ul id="difference-parts"></ul>
    <p class="legend"><i class="more"></i>exact is brighter <i class="less"></i>darker</p>
  </div>`;

const aside = `
  <section>
    <h2>Picture</h2>
    <div id="mode" role="radiogroup" aria-label="Picture">
      <label title="Direct light with cast shadow, at once (V)">
        <input type="radio" name="mode" value="viewport"> Viewport</label>
      <label title="The renderer's own, when the hand rests (E)">
        <input type="radio" name="mode" value="exact" checked> Exact</label>
      <label title="Viewport to the left, exact to the right (W)">
        <input type="radio" name="mode" value="wipe"> Wipe</label>
      <label title="What exact has besides the viewport (D)">
        <input type="radio" name="mode" value="difference"> Difference</label>
    </div>
    <p id="exact-facts" role="status" aria-live="off"></p>
  </section>`;

/** The panel, with the requests for exact pictures and the newest round of the picture. */
class ExactPicture {
  constructor(designer) {
    this.designer = designer;
    this.viewport = designer.viewport;
    this.id = 0;
    /** The newest request that the server has not refused. */
    this.request = null;
    this.mode = "exact";
    /** The newest round of the picture: facts and arrays from the server, with their size. */
    this.round = null;
    this.problem = "";
    this.keys = Object.fromEntries(
      Object.entries(MODES).map(([key, mode]) => [key, () => this.choose(mode)]),
    );
    this.viewport.addEventListener("change", () => this.cancel());
    this.viewport.addEventListener("picture", () => {
      if (this.mode === "difference") this.compare();
    });
    for (const radio of document.querySelectorAll("input[name=mode]"))
      radio.addEventListener("change", () => this.choose(radio.value));
    this.wipe = new Wipe((share) => {
      if (this.mode === "wipe") this.viewport.set({ wipe: share });
    });
    this.choose(document.querySelector("input[name=mode]:checked").value);
  }

  /** Show the picture of a mode. */
  choose(mode) {
    this.mode = mode;
    document.querySelector(`input[name=mode][value=${mode}]`).checked = true;
    const wipe = { viewport: 1, exact: 0, wipe: this.wipe.share, difference: 1 }[mode];
    this.viewport.set({ wipe, differs: mode === "difference" });
    this.limit();
    byId("wipe").hidden = mode !== "wipe";
    byId("difference").hidden = mode !== "difference";
    if (mode === "viewport") this.cancel();
    else if (!this.request && !this.round) this.requestPicture();
    this.describe();
  }

  /** Limit the samples of the viewport by the mode (`MAX_SAMPLES`). */
  limit() {
    const waits = this.mode !== "viewport" && !this.round && !this.problem;
    this.viewport.settings.maxSamples = waits
      ? SAMPLES_WAITING
      : this.problem
        ? SAMPLES_ALONE
        : MAX_SAMPLES[this.mode];
    this.viewport.resume?.();
  }

  /** Cancel the picture, and request another one when nothing has changed for a while. */
  cancel() {
    if (this.request) this.send({ do: "cancel" });
    this.request = this.round = null;
    this.problem = "";
    clearTimeout(this.timer);
    if (this.mode !== "viewport") this.timer = setTimeout(() => this.requestPicture(), REST);
    this.describe();
  }

  /** Request a picture of the scene, once the server has all edits. */
  async requestPicture() {
    clearTimeout(this.timer);
    const { viewport } = this,
      version = viewport.version;
    if (!viewport.scene || this.mode === "viewport") return;
    await this.designer.settle();
    if (version !== viewport.version || this.mode === "viewport") return;
    const { element, lighting } = viewport.settings;
    this.id += 1;
    this.request = {
      id: this.id,
      version,
      time: performance.now(),
      state: "waiting for the renderer…",
    };
    this.send({
      do: "render",
      id: this.id,
      camera: viewport.camera,
      element,
      lighting,
      size: [viewport.canvas.width, viewport.canvas.height],
    });
    this.describe();
  }

  /** Send a message to the server, and connect first if there is no open websocket. */
  async send(message) {
    if (!this.socket || this.socket.readyState > 1) this.connect();
    const { socket } = this;
    await this.opening;
    if (socket === this.socket && socket.readyState === 1) socket.send(JSON.stringify(message));
  }

  /** Open a websocket to the server; `opening` is resolved when it is open, or has failed. */
  connect() {
    const socket = (this.socket = new WebSocket(`ws://${location.host}/exact`));
    socket.binaryType = "arraybuffer";
    this.opening = new Promise((resolve) => {
      socket.onopen = socket.onerror = resolve;
    });
    socket.onmessage = ({ data }) =>
      this.receive(typeof data === "string" ? JSON.parse(data) : parsePacket(data));
    socket.onclose = () => {
      if (socket !== this.socket || !this.request) return;
      this.request = null;
      this.problem = "the server does not answer: the exact picture follows when it does";
      this.timer = setTimeout(() => this.requestPicture(), RETRY);
      this.describe();
    };
  }

  /** Take over a message of the server about the newest request: an error, a state or a round. */
  receive(answer) {
    const { request, viewport } = this;
    if (!request || answer.id !== request.id || request.version !== viewport.version) return;
    if (answer.error !== undefined) {
      this.problem = answer.error;
      this.request = null;
    } else if (answer.state) request.state = answer.state;
    else if (answer.done) request.done = true;
    else if (answer.arrays) this.showRound(answer);
    this.describe();
  }

  /** Show the picture of a round. */
  showRound(answer) {
    const { request, viewport } = this,
      [height, width] = answer.shapes.beauty;
    request.first ??= performance.now() - request.time;
    const number = (this.round?.number ?? 0) + 1;
    this.round = { ...answer, width, height, first: request.first, number };
    viewport.setExact(premultipliedRgba(answer.arrays), width, height, request.version);
    if (this.mode === "difference") this.compare();
  }

  /**
   * Compare the round with the viewport's picture. Does nothing if the viewport does not show the
   * present version yet, or if this round was compared with about as many samples.
   */
  compare() {
    const { viewport, round } = this,
      film = viewport.shownFilm;
    const isCurrent =
      round && film === viewport.film(0) && viewport.shownVersion === viewport.version;
    if (!isCurrent) return;
    const samples =
        film.count >= SAMPLES_COMPARED ? SAMPLES_COMPARED : Math.floor(Math.log2(film.count)),
      key = `${round.number} ${samples}`;
    if (this.comparison?.key === key && this.comparison.round === round) return;
    const { width, height, arrays } = round,
      pixels = resizePixels(film.read(), film.width, film.height, width, height);
    this.comparison = { key, round, ...differences(arrays, pixels), samples: film.count };
    this.describe();
  }

  /** Write the state of the picture, and the difference, into the page. */
  describe() {
    this.limit();
    const { round, problem, mode } = this,
      facts = byId("exact-facts");
    facts.classList.toggle("bad", Boolean(problem));
    facts.textContent = problem || this.stateText();
    facts.title =
      !problem && mode !== "viewport" && round
        ? [
            `relMSE ${round.relmse.toExponential(1)} of ${round.width} × ${round.height} pixels`,
            `after ${round.seconds.toFixed(1)} s;`,
            `the first round after ${(round.first / 1000).toFixed(2)} s`,
          ].join(" ")
        : "";
    byId("progress").hidden = mode === "difference" || (mode === "exact" && Boolean(round));
    if (mode === "difference") this.describeDifference();
  }

  /** Return the state of the picture in words; "" for the viewport alone. */
  stateText() {
    const { request, round, mode } = this;
    if (mode === "viewport") return "";
    if (!round) return request ? request.state : "the exact picture follows when the hand rests";
    const noise = formatShare(Math.sqrt(round.relmse));
    return [
      `exact, ${round.backend} · ${round.samples} samples · noise ${noise}`,
      ...(request?.done ? ["done"] : []),
    ].join(" · ");
  }

  /** Write the parts of the difference, and its causes, into the page. */
  describeDifference() {
    const { round, comparison } = this;
    if (!round || !comparison) {
      byId("difference-parts").replaceChildren();
      byId("difference-mean").textContent = "waiting for both pictures…";
      return;
    }
    const causes = [...byId("left-out").querySelectorAll("li")]
      .map((item) => item.textContent.split(":")[0])
      .filter((cause) => cause !== "interreflection");
    const rest = causes.length
      ? causes.join(", ")
      : "direct light: what both have, by the noise of both";
    const noise = formatShare(Math.sqrt(comparison.round.relmse));
    const parts = [
      [formatSigned(comparison.indirect), "interreflection"],
      [formatSigned(comparison.rest), rest],
      [`± ${noise}`, "noise of a pixel, which the mean has in it"],
    ];
    const mean = formatShare(comparison.apart);
    byId("difference-mean").textContent = `mean ${mean} of the exact light`;
    byId("difference-parts").replaceChildren(
      ...parts.map(([share, name]) =>
        makeElement("li", {}, makeElement("b", { textContent: share }), ` ${name}`),
      ),
    );
  }
}

/**
 * The handle of the wipe, which the pointer and keys move. `onMove` is called with its position,
 * as a fraction of the picture's width.
 */
class Wipe {
  constructor(onMove) {
    this.onMove = onMove;
    this.share = 0.5;
    this.dragging = false;
    const handle = byId("wipe"),
      canvas = byId("picture");
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      event.preventDefault();
      handle.focus();
      this.dragging = true;
    });
    handle.addEventListener("pointermove", (event) => {
      if (this.dragging)
        this.moveTo((event.clientX - canvas.getBoundingClientRect().left) / canvas.offsetWidth);
    });
    for (const name of ["pointerup", "pointercancel"])
      handle.addEventListener(name, () => {
        this.dragging = false;
      });
    handle.addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -STEP, ArrowRight: STEP, Home: -1, End: 1 }[event.key];
      if (step === undefined) return;
      this.moveTo(this.share + step);
      event.preventDefault();
    });
    for (const element of [canvas, byId("stage")])
      new ResizeObserver(() => this.moveTo(this.share)).observe(element);
    this.moveTo(this.share);
  }

  moveTo(share) {
    const handle = byId("wipe"),
      canvas = byId("picture");
    this.share = Math.min(1, Math.max(0, share));
    handle.style.left = `${canvas.offsetLeft + this.share * canvas.offsetWidth}px`;
    handle.style.top = `${canvas.offsetTop}px`;
    handle.style.height = `${canvas.offsetHeight}px`;
    handle.setAttribute("aria-valuenow", `${Math.round(100 * this.share)}`);
    this.onMove(this.share);
  }
}

/** Return the pixels of a round as premultiplied RGBA, 4 numbers a pixel. */
function premultipliedRgba({ beauty, alpha }) {
  const pixels = new Float32Array(4 * alpha.length);
  for (let k = 0; k < alpha.length; k += 1) {
    pixels.set(beauty.subarray(3 * k, 3 * k + 3), 4 * k);
    pixels[4 * k + 3] = alpha[k];
  }
  return pixels;
}

/**
 * Return the differences of a round and the viewport's pixels (RGBA of the same size), summed over
 * the asset and divided by the round's light: `apart`, the absolute differences; `indirect`, the
 * round's indirect light; `rest`, the round's direct light minus the viewport's light.
 */
function differences({ beauty, direct, alpha }, pixels) {
  let light = 0,
    apart = 0,
    indirect = 0,
    rest = 0;
  for (let k = 0; k < alpha.length; k += 1) {
    if (alpha[k] <= 0) continue;
    for (let c = 0; c < 3; c += 1) {
      const exact = beauty[3 * k + c],
        exactDirect = direct[3 * k + c],
        viewportLight = pixels[4 * k + c];
      light += exact;
      apart += Math.abs(exact - viewportLight);
      indirect += exact - exactDirect;
      rest += exactDirect - viewportLight;
    }
  }
  const total = Math.max(light, 1e-9);
  return { apart: apart / total, indirect: indirect / total, rest: rest / total };
}

/** Resize pixels (height x width x 4): each new pixel is the mean of the area that it covers. */
function resizePixels(pixels, width, height, newWidth, newHeight) {
  const means = new Float32Array(4 * newWidth * newHeight),
    rows = coverage(height, newHeight),
    columns = coverage(width, newWidth);
  for (let y = 0; y < newHeight; y += 1) {
    for (let x = 0; x < newWidth; x += 1) {
      const target = 4 * (y * newWidth + x);
      for (const [row, rowShare] of rows[y]) {
        for (const [column, share] of columns[x]) {
          const source = 4 * (row * width + column);
          for (let c = 0; c < 4; c += 1) means[target + c] += rowShare * share * pixels[source + c];
        }
      }
    }
  }
  return means;
}

/**
 * Return, for each of `newCount` new pixels along an axis, [pixel, weight] of each of the `count`
 * old pixels that it covers; the weights of a new pixel sum to 1.
 */
function coverage(count, newCount) {
  return Array.from({ length: newCount }, (_, k) => {
    const [start, end] = [(k * count) / newCount, ((k + 1) * count) / newCount],
      pixels = [];
    for (let j = Math.floor(start); j < Math.min(count, Math.ceil(end)); j += 1) {
      pixels.push([j, (Math.min(end, j + 1) - Math.max(start, j)) / (end - start)]);
    }
    return pixels;
  });
}

export const panel = {
  markup: { "#stage": stage, aside },
  mount: (designer) => new ExactPicture(designer),
};
