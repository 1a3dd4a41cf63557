// @ts-check
// The panel of the view: exposure, rotations, background and shadow. It also lets the pointer act
// on the picture, and shows the picture's progress.

import { byId } from "./viewport/elements.js";
import { followPointer } from "./pointer.js";

const stage = `
  <p id="progress"></p>
  <p id="hints">drag: orbit · right drag: pan · wheel: zoom · shift-drag: turn the light
    · click: pick · P: assign a look · F: frame as rendered</p>`;

const aside = `
  <section>
    <h2>View</h2>
    <label class="row"><span>Exposure</span>
      <input type="range" id="exposure" min="-6" max="6" step="0.1" value="0">
      <output id="exposure-value">0</output></label>
    <label class="row"><span>Light turned</span>
      <input type="range" id="lighting" min="0" max="360" step="1" value="0">
      <output id="lighting-value">0°</output></label>
    <label class="row"><span>Element turned</span>
      <input type="range" id="element" min="0" max="360" step="1" value="0">
      <output id="element-value">0°</output></label>
    <label class="check">
      <input type="checkbox" id="background"> Light behind the asset (B)</label>
    <label class="check"><input type="checkbox" id="shadows" checked> Cast shadow (H)</label>
  </section>`;

const SLIDERS = ["exposure", "lighting", "element"];

/** The panel, whose inputs set the viewport. */
class View {
  constructor(designer) {
    this.designer = designer;
    this.viewport = designer.viewport;
    this.isFirstScene = true;
    this.keys = { b: () => this.toggle("background"), h: () => this.toggle("shadows") };
    for (const id of [...SLIDERS, "background", "shadows"])
      byId(id).addEventListener("input", () => this.apply());
    followPointer(designer.canvas, this.viewport, {
      turnLight: (degrees) => this.turnLight(degrees),
      frameCamera: () => designer.scene.camera,
      pick: (x, y) => this.pick(x, y),
    });
    this.viewport.addEventListener("picture", ({ detail }) => {
      const { count, scale } = detail ?? {};
      byId("progress").textContent =
        scale > 1 ? "…" : `${count} samples · direct light${this.describeShadow()}`;
    });
  }

  load({ background, shadows }) {
    if (this.isFirstScene) {
      byId("background").checked = background === "ibl";
      const behind = Array.isArray(background) ? background[1] : 0;
      this.viewport.set({ background: byId("background").checked, behind });
      this.isFirstScene = false;
    }
    byId("shadows").disabled = !shadows;
    byId("shadows").parentElement.title = shadows
      ? "What the asset takes of the light that arrives on it"
      : "This asset casts no shadow on itself: it is convex";
  }

  /** Set the viewport to the values of the panel. */
  apply() {
    const [exposure, lighting, element] = SLIDERS.map((id) => Number(byId(id).value));
    byId("exposure-value").textContent = exposure.toFixed(1);
    byId("lighting-value").textContent = `${Math.round(lighting)}°`;
    byId("element-value").textContent = `${Math.round(element)}°`;
    const [background, shadows] = ["background", "shadows"].map((id) => byId(id).checked);
    this.viewport.set({ exposure, lighting, element, background, shadows });
  }

  toggle(id) {
    if (byId(id).disabled) return;
    byId(id).checked = !byId(id).checked;
    this.apply();
  }

  turnLight(degrees) {
    byId("lighting").value = (((this.viewport.settings.lighting + degrees) % 360) + 360) % 360;
    this.apply();
  }

  /** Pick the part at a pixel of the picture. */
  pick(x, y) {
    const pickedPart = this.viewport.pick(x, y);
    if (!pickedPart) return;
    const { parts } = this.designer.scene;
    this.designer.pickPart(parts.findIndex((part) => part.path === pickedPart.path));
  }

  /** Return a text that states whether the light has shadows; "" for an asset without shadows. */
  describeShadow() {
    if (!this.designer.scene?.shadows) return "";
    return this.viewport.settings.shadows ? " with cast shadow" : ", no shadow";
  }
}

export const panel = {
  markup: { "#stage": stage, aside },
  mount: (designer) => new View(designer),
};
