// @ts-check
// The turntable: rendered in the background, and played in the viewport's place.

import { at } from "./made.js";

const RATE = 12; // frames a second
const POLL = 500; // milliseconds between looks at how far it is

export class Turntable {
  constructor(asked, settled) {
    this.asked = asked;
    this.settled = settled;
    this.state = { state: "none" };
    this.frames = [];
    this.shown = 0;
    this.playing = false;
    at("turntable-start").addEventListener("click", () =>
      this.state.state === "rendering" ? this.ask({ do: "cancel" }) : this.render(),
    );
    at("turntable-play").addEventListener("click", () => this.play(!this.playing));
    at("turntable-close").addEventListener("click", () => this.open(false));
    at("turntable-frame").addEventListener("input", () => {
      this.play(false);
      this.show(Number(at("turntable-frame").value));
    });
    at("turntable-open").addEventListener("click", () => this.open(true));
    this.ask();
  }

  async render() {
    await this.settled();
    await this.ask({ do: "render" });
  }

  async ask(body = undefined) {
    clearTimeout(this.timer);
    try {
      this.take(await this.asked("turntable", body));
    } catch (error) {
      this.say(error.message, true);
    }
    if (this.state.state === "rendering") this.timer = setTimeout(() => this.ask(), POLL);
  }

  take(state) {
    const other = state.run !== this.state.run;
    this.state = state;
    if (other) this.frames = [];
    for (const number of state.pictures ?? []) {
      if (this.frames.some((each) => each.number === number)) continue;
      // While it is rendered, files of a run before are replaced.
      this.frames.push({
        number,
        image: Object.assign(new Image(), {
          src: `turntable/${state.run}/${number}.png?${state.done}`,
          alt: "",
        }),
      });
      this.frames.sort((a, b) => a.number - b.number);
    }
    if (state.state === "done" && this.last === "rendering") {
      for (const each of this.frames)
        each.image.src = `turntable/${state.run}/${each.number}.png?done`;
      this.open(true);
    }
    this.last = state.state;
    const rendering = state.state === "rendering";
    at("turntable-start").textContent = rendering ? "Cancel" : "Render";
    at("turntable-open").disabled = this.frames.length === 0;
    at("turntable-progress").hidden = !rendering;
    at("turntable-progress").max = state.total ?? 1;
    at("turntable-progress").value = state.done ?? 0;
    at("turntable-frame").max = Math.max(0, this.frames.length - 1);
    const parts = {
      none: () =>
        "The job's frames of what is shown, with unsaved edits and the lights as set here.",
      rendering: () =>
        [
          `${state.done} of ${state.total} frames`,
          ...(state.frame ? [`${state.frame.split("/").pop()}, ${state.samples} samples`] : []),
        ].join(" · "),
      done: () => `${state.total} frames`,
      cancelled: () => `cancelled; ${state.done} of ${state.total} frames are kept`,
      failed: () => state.error ?? state.failed.join("; "),
    };
    this.say(
      parts[state.state]() + (state.output ? ` · ${state.output}` : ""),
      state.state === "failed",
    );
  }

  say(text, bad = false) {
    at("turntable-facts").textContent = text;
    at("turntable-facts").classList.toggle("bad", bad);
  }

  open(shown) {
    if (shown && !this.frames.length) return;
    at("turntable").hidden = !shown;
    this.play(shown);
    if (shown) at("turntable-play").focus();
    else at("picture").focus();
  }

  play(playing) {
    clearInterval(this.clock);
    this.playing = playing && this.frames.length > 0;
    at("turntable-play").textContent = this.playing ? "Pause" : "Play";
    if (this.playing)
      this.clock = setInterval(() => this.show((this.shown + 1) % this.frames.length), 1000 / RATE);
    this.show(Math.min(this.shown, this.frames.length - 1));
  }

  show(number) {
    const frame = this.frames[number];
    if (!frame) return;
    this.shown = number;
    at("turntable-frame").value = number;
    at("turntable-number").textContent = `${frame.number + 1} / ${this.state.total}`;
    if (frame.image.complete && frame.image.naturalWidth)
      at("turntable-stage").replaceChildren(frame.image);
  }

  /**
   * Take a key while it is open: space plays, comma and full stop step, Escape closes. Returns
   * whether it did.
   */
  key(name) {
    if (at("turntable").hidden) return false;
    const count = this.frames.length;
    const step = (by) => {
      this.play(false);
      this.show((this.shown + by + count) % count);
    };
    const keys = {
      " ": () => this.play(!this.playing),
      ",": () => step(-1),
      ".": () => step(1),
      Escape: () => this.open(false),
    };
    keys[name]?.();
    return name in keys;
  }
}
