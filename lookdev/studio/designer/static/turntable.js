// @ts-check
// The panel of the turntable: the server renders the job's frames of the visible scene in the
// background, and a player shows them in place of the viewport.

import { byId } from "./viewport/elements.js";

const RATE = 12; // frames a second
const POLL = 500; // milliseconds between requests for the progress

const stage = `
  <div id="turntable" role="region" aria-label="Turntable" hidden>
    <div id="turntable-stage" role="img" aria-label="A frame of the turntable"></div>
    <div id="turntable-bar">
      <button type="button" id="turntable-play" title="Space">Play</button>
      <input type="range" id="turntable-frame" min="0" max="0" value="0" aria-label="Frame"
        title="Comma and full stop step">
      <output id="turntable-number"></output>
      <button type="button" id="turntable-close" title="Escape">Close</button>
    </div>
  </div>`;

const aside = `
  <section>
    <h2>Turntable</h2>
    <div class="buttons">
      <button type="button" id="turntable-start"
        title="Render the job's frames in the background">Render</button>
      <button type="button" id="turntable-open"
        title="Play the frames that are there" disabled>Play</button>
      <progress id="turntable-progress" aria-label="Frames done" hidden></progress>
    </div>
    <p id="turntable-facts" class="sentence"></p>
  </section>`;

/** Return the progress of a run in words. */
function describeProgress(run) {
  const words = {
    none: () => "The job's frames of what is shown, with unsaved edits and the lights as set here.",
    rendering: () =>
      [
        `${run.done} of ${run.total} frames`,
        ...(run.frame ? [`${run.frame.split("/").pop()}, ${run.samples} samples`] : []),
      ].join(" · "),
    done: () => `${run.total} frames`,
    cancelled: () => `cancelled; ${run.done} of ${run.total} frames are kept`,
    failed: () => run.error ?? run.failed.join("; "),
  };
  return words[run.state]() + (run.output ? ` · ${run.output}` : "");
}

/** The panel and the player. A run is one render of the turntable by the server. */
class Turntable {
  constructor(designer) {
    this.designer = designer;
    /** The newest run, as the server describes it. */
    this.run = { state: "none" };
    /** The frames that have a picture, in order: {number, image}. */
    this.frames = [];
    this.index = 0; // of the visible frame, in `frames`
    this.playing = false;
    this.keys = {
      " ": () => this.actIfOpen(() => this.play(!this.playing)),
      ",": () => this.actIfOpen(() => this.step(-1)),
      ".": () => this.actIfOpen(() => this.step(1)),
      Escape: () => this.actIfOpen(() => this.setOpen(false)),
    };
    byId("turntable-start").addEventListener("click", () =>
      this.run.state === "rendering" ? this.request({ do: "cancel" }) : this.render(),
    );
    byId("turntable-play").addEventListener("click", () => this.play(!this.playing));
    byId("turntable-close").addEventListener("click", () => this.setOpen(false));
    byId("turntable-frame").addEventListener("input", () => {
      this.play(false);
      this.showFrame(Number(byId("turntable-frame").value));
    });
    byId("turntable-open").addEventListener("click", () => this.setOpen(true));
    this.request();
  }

  async render() {
    await this.designer.settle();
    await this.request({ do: "render" });
  }

  /**
   * Send a request to start or cancel a run, or without a body for its state; show the answer. The
   * state is requested again while the server renders.
   */
  async request(body = undefined) {
    clearTimeout(this.timer);
    try {
      this.showRun(await this.designer.fetchJson("turntable", body));
    } catch (error) {
      this.showFacts(error.message, true);
    }
    if (this.run.state === "rendering") this.timer = setTimeout(() => this.request(), POLL);
  }

  /** Show the state of a run, and open the player when the run is done. */
  showRun(run) {
    const previous = this.run;
    this.run = run;
    if (run.run !== previous.run) this.frames = [];
    for (const number of run.pictures ?? []) this.addFrame(number);
    if (run.state === "done" && previous.state === "rendering") {
      // The images may show files of an earlier run, which the render has replaced.
      for (const { image, number } of this.frames)
        image.src = `turntable/${run.run}/${number}.png?done`;
      this.setOpen(true);
    }
    const rendering = run.state === "rendering";
    byId("turntable-start").textContent = rendering ? "Cancel" : "Render";
    byId("turntable-open").disabled = this.frames.length === 0;
    byId("turntable-progress").hidden = !rendering;
    byId("turntable-progress").max = run.total ?? 1;
    byId("turntable-progress").value = run.done ?? 0;
    byId("turntable-frame").max = Math.max(0, this.frames.length - 1);
    this.showFacts(describeProgress(run), run.state === "failed");
  }

  /** Load the picture of a frame, by its number, unless it is loaded. */
  addFrame(number) {
    if (this.frames.some((frame) => frame.number === number)) return;
    const src = `turntable/${this.run.run}/${number}.png?${this.run.done}`;
    this.frames.push({ number, image: Object.assign(new Image(), { src, alt: "" }) });
    this.frames.sort((a, b) => a.number - b.number);
  }

  showFacts(text, isError = false) {
    byId("turntable-facts").textContent = text;
    byId("turntable-facts").classList.toggle("bad", isError);
  }

  /** Open the player and play, or close it. */
  setOpen(open) {
    if (open && !this.frames.length) return;
    byId("turntable").hidden = !open;
    this.play(open);
    byId(open ? "turntable-play" : "picture").focus();
  }

  /** Call a function if the player is open; return whether it is open. */
  actIfOpen(act) {
    const open = !byId("turntable").hidden;
    if (open) act();
    return open;
  }

  /** Start or stop playing. */
  play(playing) {
    clearInterval(this.playTimer);
    this.playing = playing && this.frames.length > 0;
    byId("turntable-play").textContent = this.playing ? "Pause" : "Play";
    const next = () => this.showFrame((this.index + 1) % this.frames.length);
    if (this.playing) this.playTimer = setInterval(next, 1000 / RATE);
    this.showFrame(Math.min(this.index, this.frames.length - 1));
  }

  /** Show the next frame (1) or the previous one (-1). */
  step(direction) {
    this.play(false);
    this.showFrame((this.index + direction + this.frames.length) % this.frames.length);
  }

  /** Show the frame at an index of `frames`, if its picture is loaded. */
  showFrame(index) {
    const frame = this.frames[index];
    if (!frame) return;
    this.index = index;
    byId("turntable-frame").value = index;
    byId("turntable-number").textContent = `${frame.number + 1} / ${this.run.total}`;
    if (frame.image.complete && frame.image.naturalWidth)
      byId("turntable-stage").replaceChildren(frame.image);
  }
}

export const panel = {
  markup: { "#stage": stage, aside },
  mount: (designer) => new Turntable(designer),
};
