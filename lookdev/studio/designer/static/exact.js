// @ts-check
// The renderer's own picture of what the viewport shows: in its place, beside a wipe, or as what
// both differ by.

import { at } from "./made.js";
import { packetOf } from "./viewport/packets.js";

const REST = 150; // milliseconds without a change after which the hand rests
// Samples of the viewport: until the first round is there, which should have the processors, and
// then by what is shown.
const WAITING = 4,
  ALONE = 4096,
  COMPARED = 256,
  MOST = { viewport: ALONE, exact: WAITING, wipe: COMPARED, difference: COMPARED };
const STEP = 0.02; // of the width, by which a key moves the wipe
const percent = (share) => `${(100 * share).toFixed(Math.abs(share) < 0.0995 ? 1 : 0)} %`;
const signed = (share) => (share > 0 ? "+" : "−") + percent(Math.abs(share));

/** `settled` resolves once the server has all edits. */
export class Exact {
  constructor(viewport, settled) {
    this.viewport = viewport;
    this.settled = settled;
    this.id = 0;
    this.asked = null;
    this.place = 0.5;
    this.mode = "exact";
    this.round = null;
    this.problem = "";
    viewport.addEventListener("change", () => this.cancel());
    viewport.addEventListener("picture", () => {
      if (this.mode === "difference") this.compare();
    });
    for (const radio of document.querySelectorAll("input[name=mode]"))
      radio.addEventListener("change", () => this.choose(radio.value));
    this.handle();
    this.choose(document.querySelector("input[name=mode]:checked").value);
  }

  /** Show one of the four pictures. */
  choose(mode) {
    this.mode = mode;
    document.querySelector(`input[name=mode][value=${mode}]`).checked = true;
    const wipe = { viewport: 1, exact: 0, wipe: this.place, difference: 1 }[mode];
    this.viewport.set({ wipe, differs: mode === "difference" });
    this.limit();
    at("wipe").hidden = mode !== "wipe";
    at("difference").hidden = mode !== "difference";
    if (mode === "viewport") this.cancel();
    else if (!this.asked && !this.round) this.rest();
    this.say();
  }

  /** Have the viewport add up as many samples as are seen. */
  limit() {
    const waits = this.mode !== "viewport" && !this.round && !this.problem;
    this.viewport.settings.most = waits ? WAITING : this.problem ? ALONE : MOST[this.mode];
    this.viewport.wake?.();
  }

  /**
   * What was asked for is not wanted any more; another picture is asked for when the hand rests.
   */
  cancel() {
    if (this.asked) this.send({ do: "cancel" });
    this.asked = this.round = null;
    this.problem = "";
    clearTimeout(this.timer);
    if (this.mode !== "viewport") this.timer = setTimeout(() => this.rest(), REST);
    this.say();
  }

  async rest() {
    clearTimeout(this.timer);
    const { viewport } = this,
      version = viewport.version;
    if (!viewport.scene || this.mode === "viewport") return;
    await this.settled();
    if (version !== viewport.version || this.mode === "viewport") return;
    const { element, lighting } = viewport.settings;
    this.id += 1;
    this.asked = {
      id: this.id,
      version,
      at: performance.now(),
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
    this.say();
  }

  async send(message) {
    if (!this.socket || this.socket.readyState > 1) this.connect();
    const { socket } = this;
    await this.open;
    if (socket === this.socket && socket.readyState === 1) socket.send(JSON.stringify(message));
  }

  connect() {
    const socket = (this.socket = new WebSocket(`ws://${location.host}/exact`));
    socket.binaryType = "arraybuffer";
    this.open = new Promise((done) => {
      socket.onopen = socket.onerror = done;
    });
    socket.onmessage = ({ data }) =>
      this.receive(typeof data === "string" ? JSON.parse(data) : packetOf(data));
    socket.onclose = () => {
      if (socket !== this.socket || !this.asked) return;
      this.asked = null;
      this.problem = "the server does not answer: the exact picture follows when it does";
      this.timer = setTimeout(() => this.rest(), 2000);
      this.say();
    };
  }

  receive(answer) {
    const { asked, viewport } = this;
    if (!asked || answer.id !== asked.id || asked.version !== viewport.version) return;
    if (answer.error !== undefined) {
      this.problem = answer.error;
      this.asked = null;
    } else if (answer.state) asked.state = answer.state;
    else if (answer.done) asked.done = true;
    else if (answer.arrays) {
      const { arrays, shapes } = answer,
        [height, width] = shapes.beauty,
        mean = new Float32Array(4 * width * height);
      for (let k = 0; k < width * height; k += 1) {
        mean.set(arrays.beauty.subarray(3 * k, 3 * k + 3), 4 * k);
        mean[4 * k + 3] = arrays.alpha[k];
      }
      asked.first ??= performance.now() - asked.at;
      this.round = {
        ...answer,
        width,
        height,
        first: asked.first,
        number: (this.round?.number ?? 0) + 1,
      };
      viewport.setExact(mean, width, height, asked.version);
      if (this.mode === "difference") this.compare();
    }
    this.say();
  }

  /**
   * Find what the exact picture has besides what the viewport shows, of all pixels of the asset, by
   * name.
   */
  compare() {
    const { viewport, round } = this,
      film = viewport.last;
    const key =
      round && film === viewport.film(0) && viewport.shown === viewport.version
        ? `${round.number} ${film.count >= COMPARED ? COMPARED : Math.floor(Math.log2(film.count))}`
        : "";
    if (!key || (this.compared?.key === key && this.compared.round === round)) return;
    const { width, height, arrays } = round,
      seen = resized(film.read(), film.width, film.height, width, height);
    let exact = 0,
      apart = 0,
      indirect = 0,
      rest = 0;
    for (let k = 0; k < width * height; k += 1) {
      if (arrays.alpha[k] <= 0) continue;
      for (let c = 0; c < 3; c += 1) {
        const [whole, direct, own] = [
          arrays.beauty[3 * k + c],
          arrays.direct[3 * k + c],
          seen[4 * k + c],
        ];
        exact += whole;
        apart += Math.abs(whole - own);
        indirect += whole - direct;
        rest += direct - own;
      }
    }
    const most = Math.max(exact, 1e-9);
    this.compared = {
      key,
      round,
      apart: apart / most,
      indirect: indirect / most,
      rest: rest / most,
      samples: film.count,
    };
    this.say();
  }

  /** Write what is known of the picture. */
  say() {
    this.limit();
    const { asked, round, problem, mode } = this,
      facts = at("exact-facts");
    facts.classList.toggle("bad", Boolean(problem));
    facts.title = "";
    if (problem) facts.textContent = problem;
    else if (mode === "viewport") facts.textContent = "";
    else if (!round)
      facts.textContent = asked ? asked.state : "the exact picture follows when the hand rests";
    else {
      const noise = percent(Math.sqrt(round.relmse));
      facts.textContent = [
        `exact, ${round.backend} · ${round.samples} samples · noise ${noise}`,
        ...(asked?.done ? ["done"] : []),
      ].join(" · ");
      facts.title = [
        `relMSE ${round.relmse.toExponential(1)} of ${round.width} × ${round.height} pixels`,
        `after ${round.seconds.toFixed(1)} s;`,
        `the first round after ${(round.first / 1000).toFixed(2)} s`,
      ].join(" ");
    }
    at("progress").hidden = mode === "difference" || (mode === "exact" && Boolean(round));
    const list = at("difference-parts"),
      { compared } = this;
    if (mode !== "difference") return;
    if (!round || (compared?.round !== round && !compared)) {
      list.replaceChildren();
      at("difference-mean").textContent = "waiting for both pictures…";
      return;
    }
    const left = [...at("left-out").querySelectorAll("li")]
      .map((each) => each.textContent.split(":")[0])
      .filter((each) => each !== "interreflection");
    const others = left.length
      ? left.join(", ")
      : "direct light: what both have, by the noise of both";
    at("difference-mean").textContent = `mean ${percent(compared.apart)} of the exact light`;
    list.replaceChildren(
      ...[
        [signed(compared.indirect), "interreflection"],
        [signed(compared.rest), others],
        [
          `± ${percent(Math.sqrt(compared.round.relmse))}`,
          "noise of a pixel, which the mean has in it",
        ],
      ].map(([share, name]) => {
        const row = document.createElement("li");
        row.append(Object.assign(document.createElement("b"), { textContent: share }), ` ${name}`);
        return row;
      }),
    );
  }

  /** The handle of the wipe, by hand and by keys. */
  handle() {
    const handle = at("wipe"),
      stage = at("stage"),
      canvas = at("picture");
    const put = (place) => {
      this.place = Math.min(1, Math.max(0, place));
      handle.style.left = `${canvas.offsetLeft + this.place * canvas.offsetWidth}px`;
      handle.style.top = `${canvas.offsetTop}px`;
      handle.style.height = `${canvas.offsetHeight}px`;
      handle.setAttribute("aria-valuenow", `${Math.round(100 * this.place)}`);
      if (this.mode === "wipe") this.viewport.set({ wipe: this.place });
    };
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      event.preventDefault();
      handle.focus();
      this.held = true;
    });
    handle.addEventListener("pointermove", (event) => {
      if (this.held)
        put((event.clientX - canvas.getBoundingClientRect().left) / canvas.offsetWidth);
    });
    for (const name of ["pointerup", "pointercancel"])
      handle.addEventListener(name, () => {
        this.held = false;
      });
    handle.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -STEP, ArrowRight: STEP, Home: -1, End: 1 }[event.key];
      if (by === undefined) return;
      put(this.place + by);
      event.preventDefault();
    });
    new ResizeObserver(() => put(this.place)).observe(canvas);
    new ResizeObserver(() => put(this.place)).observe(stage);
    put(0.5);
  }

  /** Take a key: V, E, W or D choose the picture. Returns whether it did. */
  key(name) {
    const mode = { v: "viewport", e: "exact", w: "wipe", d: "difference" }[name];
    if (mode) this.choose(mode);
    return Boolean(mode);
  }
}

/** Pixels (height x width x 4) as the means of the areas of others. */
function resized(pixels, width, height, wide, high) {
  const found = new Float32Array(4 * wide * high),
    rows = spans(height, high),
    columns = spans(width, wide);
  for (let y = 0; y < high; y += 1) {
    for (let x = 0; x < wide; x += 1) {
      const place = 4 * (y * wide + x);
      for (const [row, tall] of rows[y]) {
        for (const [column, share] of columns[x]) {
          const from = 4 * (row * width + column);
          for (let c = 0; c < 4; c += 1) found[place + c] += tall * share * pixels[from + c];
        }
      }
    }
  }
  return found;
}

/** The pixels that each of `few` covers of `many`, with their shares. */
function spans(many, few) {
  return Array.from({ length: few }, (_, k) => {
    const [start, end] = [(k * many) / few, ((k + 1) * many) / few],
      covered = [];
    for (let j = Math.floor(start); j < Math.min(many, Math.ceil(end)); j += 1) {
      covered.push([j, (Math.min(end, j + 1) - Math.max(start, j)) / (end - start)]);
    }
    return covered;
  });
}
