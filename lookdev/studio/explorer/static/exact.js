// @ts-check
// The exact frame: on the user's request, the server renders the selected surface on a sphere by
// Cycles. The frame replaces the sphere that the page draws.
import { decodeSrgb } from "./viewport/color.js";
import { drawColors } from "./views.js";
import { option, selectedSurface, wordsOf } from "./state.js";

const [startButton, stopButton, progressBar, facts] = ["render", "cancel", "progress", "facts"].map(
  (id) => document.getElementById(id),
);

export class ExactFrame {
  /** `onFrame` is called when a frame has arrived. */
  constructor(link, onFrame) {
    this.link = link;
    this.onFrame = onFrame;
    this.frame = null;
    this.busy = false;
    startButton.addEventListener("click", () => this.render());
    stopButton.addEventListener("click", () => {
      stopButton.disabled = true;
      link.ask({ do: "cancel" }).catch(() => {});
    });
  }

  // Return the frame if it shows a surface as the surface is now, else null.
  frameOf(surface) {
    return this.frame && surface && this.frame.words === wordsOf(surface) ? this.frame : null;
  }

  /** Request a frame of the selected surface, and show its progress. */
  async render() {
    const surface = selectedSurface();
    if (!surface || this.busy) return;
    const words = wordsOf(surface);
    this.busy = true;
    startButton.hidden = true;
    stopButton.hidden = progressBar.hidden = false;
    stopButton.disabled = false;
    progressBar.removeAttribute("value");
    facts.className = "";
    try {
      const answer = await this.link.ask({ do: "render", surface: words }, (progress) => {
        if (progress.samples) {
          progressBar.value = progress.samples / progress.of;
          const { relmse } = progress;
          const error = relmse === null ? "" : `, relMSE ${relmse.toExponential(1)}`;
          facts.textContent = `${progress.samples} samples${error}`;
        } else facts.textContent = `${progress.state} …`;
      });
      if (answer.cancelled) facts.textContent = "cancelled";
      else {
        this.frame = { words, ...answer };
        facts.textContent = [
          `exact, ${answer.samples} samples`,
          `relMSE ${answer.relmse.toExponential(1)}`,
          `${answer.seconds.toFixed(1)} s`,
        ].join(", ");
        this.onFrame();
      }
    } catch (error) {
      facts.textContent = error.message;
      facts.className = "bad";
    }
    this.busy = false;
    startButton.hidden = false;
    stopButton.hidden = progressBar.hidden = true;
  }

  /** Draw the frame in the middle of a canvas. */
  draw(context, width, height) {
    const { arrays, shapes } = this.frame,
      [rows, columns] = shapes.beauty;
    if (this.flipped?.frame !== this.frame || this.flipped.exposure !== option("exposure")) {
      const flipped = new Float32Array(arrays.beauty.length);
      // The linear grey behind the sphere, divided by the factor of the exposure that follows.
      const grey = decodeSrgb(0x1a / 255) / 2 ** option("exposure");
      for (let y = 0; y < rows; y++)
        for (let i = 0; i < 3 * columns; i++)
          flipped[3 * columns * (rows - 1 - y) + i] =
            arrays.beauty[3 * columns * y + i] +
            (1 - arrays.alpha[columns * y + Math.floor(i / 3)]) * grey;
      this.flipped = { frame: this.frame, exposure: option("exposure"), values: flipped };
    }
    const size = Math.min(width, height);
    context.fillStyle = "#1a1a1a";
    context.fillRect(0, 0, width, height);
    context.imageSmoothingEnabled = true;
    context.drawImage(
      drawColors(this.flipped.values, columns, rows, option("exposure"), false),
      (width - size) / 2,
      (height - size) / 2,
      size,
      size,
    );
  }
}
