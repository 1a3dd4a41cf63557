// @ts-check
// The class `Designer`, whose one object all panels of the page share. It has the viewport and the
// scene with the status of the document, and it sends requests to the server.

import { byId, makeElement, makeOptions } from "./viewport/elements.js";
import { Viewport } from "./viewport/viewport.js";

const LARGEST_CANVAS = 1024; // largest width of the picture in pixels; a wider one is scaled up
const SOON = 300; // milliseconds after which the page shows that it waits
const WORKING = "working…";

/** Show a message in the page's header. */
export function showMessage(text, isError = false) {
  byId("status").textContent = text;
  byId("status").classList.toggle("bad", isError);
}

/** Return the bytes of a buffer that the scene names, from the server. */
async function fetchBuffer(name) {
  const answer = await fetch(`buffers/${name}`);
  if (!answer.ok) throw new Error(`buffer ${name}: ${answer.statusText}`);
  return answer.arrayBuffer();
}

export class Designer {
  /** Throws an Error if the browser cannot draw on the canvas. */
  constructor(canvas) {
    this.canvas = canvas;
    this.viewport = new Viewport(canvas, fetchBuffer);
    this.viewport.addEventListener("failed", () => this.say(this.viewport.failed.message, true));
    /** The scene that the server has sent, with the status of the document; null at first. */
    this.scene = null;
    this.partNumber = 0; // of the picked part
    /** The mounted panels, by name. */
    this.panels = {};
    /** Is resolved when the server has answered all requests so far. */
    this.requests = Promise.resolve();
    this.say = showMessage;
  }

  /** The picked part of the scene: a slot of the asset, with its path and its look's number. */
  get part() {
    return this.scene.parts[this.partNumber];
  }

  /** The number of the picked part's look. */
  get look() {
    return this.part.look;
  }

  /** The stack of the picked part's look: its file, variants and layers with their parameters. */
  get stack() {
    return this.scene.stacks[this.look];
  }

  /** The records of the job and of the stacks whose file has unsaved edits. */
  get unsaved() {
    return this.scene ? [this.scene.job, ...this.scene.stacks].filter((file) => file.unsaved) : [];
  }

  /**
   * Send a request, and return the server's answer. A request with a `body`, which is an object
   * sent as JSON or a Blob, is a POST. The Error of a refusal lists files in `conflict`, if other
   * programs have changed them.
   */
  async fetchJson(path, body = undefined) {
    const isBlob = body instanceof Blob;
    const headers = { "content-type": isBlob ? body.type : "application/json" };
    const post = { method: "POST", headers, body: isBlob ? body : JSON.stringify(body) };
    const response = await fetch(path, body === undefined ? {} : post);
    const answer = await response.json();
    if (!response.ok) {
      const { error, conflict } = answer;
      throw Object.assign(new Error(error ?? response.statusText), { conflict });
    }
    return answer;
  }

  /** Wait until the server has answered all requests. */
  settle() {
    return this.requests;
  }

  /** Run a function after the server has answered all earlier requests; show its error. */
  enqueue(work, describeError = (error) => error.message) {
    this.requests = this.requests.then(work).catch((error) => this.say(describeError(error), true));
  }

  /**
   * Ask the server for a change, after all earlier requests, and show the answer. Returns the
   * message of the error, or "". `message` is shown if there is no error.
   */
  request(path, body, message = "") {
    const answered = this.requests.then(async () => {
      const waiting = setTimeout(() => this.say(WORKING), SOON);
      try {
        const answer = await this.fetchJson(path, body);
        clearTimeout(waiting);
        await this.adopt(answer);
        if (message || byId("status").textContent === WORKING)
          this.say(message || this.scene.view.name);
        return "";
      } catch (error) {
        clearTimeout(waiting);
        this.say(error.message, true);
        return error.message;
      }
    });
    this.requests = answered;
    return answered;
  }

  /**
   * Store the document's status from an answer, and show it in picture and panels. If `compiles`
   * is true, shaders have changed, and the scene is fetched anew.
   */
  async adopt({ compiles, ...status }) {
    Object.assign(this.scene, status);
    if (compiles) {
      await this.load("compiling in the background…");
      return;
    }
    this.scene.stacks.forEach((stack, look) => this.setUniforms(look, stack));
    this.update();
  }

  /** Set those uniforms of a look in the viewport that differ from the values of its stack. */
  setUniforms(look, stack) {
    const current = this.viewport.scene.looks[look].numbers,
      numbers = {};
    for (const { uniform, value } of stack.layers.flatMap((layer) => layer.parameters ?? [])) {
      const values = [value].flat();
      const differs = (number, k) => Math.fround(number) !== Math.fround(current[uniform]?.[k]);
      if (uniform && values.some(differs)) numbers[uniform] = values;
    }
    if (Object.keys(numbers).length) this.viewport.setNumbers(look, numbers);
  }

  /** Fetch the scene, and show it in picture and panels; the picked part stays picked. */
  async load(message) {
    this.say(message);
    const scene = await this.fetchJson("scene");
    this.fitCanvas(scene.resolution);
    await this.viewport.show(scene);
    for (const panel of Object.values(this.panels)) await panel.load?.(scene);
    const path = this.scene?.parts[this.partNumber]?.path;
    this.partNumber = Math.max(
      0,
      scene.parts.findIndex((part) => part.path === path),
    );
    this.scene = scene;
    const { looks, rigs, shipped } = scene.choices;
    byId("look").replaceChildren(...makeOptions(looks, scene.chosen.look));
    byId("rig").replaceChildren(...makeOptions(rigs, scene.chosen.rig));
    if (shipped.length) {
      const options = makeOptions(shipped, scene.chosen.rig);
      byId("rig").append(makeElement("optgroup", { label: "shipped: only shown" }, ...options));
    }
    this.update();
    this.say(`${scene.view.name}`);
  }

  /** Show another look of the job, or another light, by the choices in the header. */
  choose() {
    this.enqueue(async () => {
      await this.fetchJson("choose", { look: byId("look").value, rig: byId("rig").value });
      await this.load("reading the scene…");
    });
  }

  /** Ask for the server's status; if it is new, load the scene, or show which files changed. */
  poll() {
    if (!this.scene) return;
    this.enqueue(
      async () => {
        const status = await this.fetchJson("status");
        if (status.revision !== this.scene.revision) await this.load("edited on another page…");
        else if (String(status.changed) !== String(this.scene.changed)) {
          this.scene.changed = status.changed;
          this.update();
        }
      },
      (error) =>
        `the server does not answer: ${error.message}. What was edited is kept; start it again`,
    );
  }

  /** Show the document in all panels. */
  update() {
    for (const panel of Object.values(this.panels)) panel.update?.(this.scene);
  }

  /** Pick the part with a number in the scene, and show it in all panels. */
  pickPart(number) {
    this.partNumber = number;
    this.update();
  }

  /** Give the canvas the shape of the job's frames. */
  fitCanvas([width, height]) {
    document.documentElement.style.setProperty("--shape", `${height / width}`);
    const stage = byId("stage").getBoundingClientRect();
    const scale = Math.min(stage.width / width, stage.height / height);
    const [wide, high] = [width * scale, height * scale].map(Math.floor);
    [this.canvas.style.width, this.canvas.style.height] = [`${wide}px`, `${high}px`];
    const pixelScale = Math.min(1, LARGEST_CANVAS / wide);
    const pixels = (length) => Math.max(1, Math.round(length * pixelScale));
    this.viewport.size = [pixels(wide), pixels(high)];
  }

  /** Fit the canvas to the stage, whose size has changed. */
  resize() {
    if (!this.scene) return;
    this.fitCanvas(this.scene.resolution);
    this.viewport.resize(...this.viewport.size);
  }
}
