// @ts-check
// The panel of the rig's lights: intensity, tint and temperature of each, on or off. Like the
// exposure, these are settings of the view, and are not saved.

import { fromHex, toHex } from "./viewport/color.js";
import { byId, makeElement, makeRow, setLabel } from "./viewport/elements.js";

const NEUTRAL = 6500; // kelvin, where the temperature's slider begins
const formatStops = (stops) => `${stops > 0 ? "+" : ""}${stops.toFixed(1)}`;
const formatKelvin = (kelvin) => (kelvin === null ? "own" : `${kelvin} K`);
/** Return whether a light has the settings of the rig. */
const isUnchanged = ({ on, stops, kelvin, color }) =>
  on && stops === 0 && kelvin === null && color.every((x) => x === 1);

const aside = `
  <section>
    <details id="lights"><summary id="lights-title">Lights</summary>
      <ul id="light-list" aria-label="Lights"></ul>
      <p class="sentence">They light this page's pictures: no file changes.
        <button type="button" id="lights-reset"
          title="All lights as the rig has them" disabled>Reset</button></p>
    </details>
  </section>`;

/** The panel, with the list of the lights and their settings. */
class Lights {
  constructor(designer) {
    this.designer = designer;
    this.lights = [];
    this.busy = false;
    /** The newest setting that waits to be sent. */
    this.waiting = null;
    this.hasChanged = false; // since the page was loaded
    byId("lights-reset").addEventListener("click", () => this.send({ reset: true }, true));
  }

  /** Fetch the lights of the visible rig, and list them with their settings. */
  async load() {
    this.apply(await this.designer.fetchJson("lights"));
    this.showList();
  }

  /**
   * Set the lights of the viewport, and the states in the list, to an answer of the server: the
   * lights with settings, their numbers in the shaders (`rows`), and the ranges of sliders.
   */
  apply({ lights, rows, kelvin, stops }) {
    this.lights = lights;
    this.kelvin = kelvin;
    this.maxStops = stops;
    const unchanged = lights.every(isUnchanged);
    this.hasChanged ||= !unchanged; // before the first change, the rig's textures are right
    if (this.hasChanged) this.designer.viewport.setLights(rows);
    byId("lights-reset").disabled = unchanged;
    for (const [number, light] of lights.entries())
      byId("light-list").children[number]?.classList.toggle("off", !light.on);
  }

  /**
   * Send the setting of a light. While the server has not answered one, only the newest of the
   * others waits. With `updatesList`, the answer is also shown in the list.
   */
  async send(body, updatesList = false) {
    this.waiting = { body, updatesList };
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.waiting) {
        const setting = this.waiting;
        this.waiting = null;
        this.apply(await this.designer.fetchJson("lights", setting.body));
        if (setting.updatesList) this.showList();
      }
    } catch (error) {
      this.waiting = null;
      this.designer.say(error.message, true);
    }
    this.busy = false;
  }

  showList() {
    const plural = this.lights.length > 1 ? "s" : "";
    byId("light-list").replaceChildren(...this.lights.map((light, k) => this.makeItem(light, k)));
    byId("lights-title").textContent = `${this.lights.length} light${plural} of the rig`;
  }

  /** Return the item of a light in the list. */
  makeItem(light, number) {
    const { name, path, on, stops, color, kelvin } = light,
      setting = { light: number, on, stops, color, kelvin };
    const change = (changes) => {
      Object.assign(setting, changes);
      this.send({ ...setting });
    };
    const box = setLabel(makeElement("input", { type: "checkbox", checked: on }), `${name}, on`);
    box.addEventListener("change", () => change({ on: box.checked }));
    const title = makeElement(
      "label",
      { className: "check", title: path },
      box,
      makeElement("span", { textContent: name }),
      makeElement("small", { textContent: name.startsWith(light.kind) ? "" : light.kind }),
    );
    const item = makeElement(
      "li",
      {},
      title,
      stopsRow(light, this.maxStops, change),
      tintRow(light, change),
      temperatureRow(light, this.kelvin, change),
    );
    item.classList.toggle("off", !on);
    return item;
  }
}

function stopsRow({ name, stops }, maxStops, change) {
  const slider = setLabel(
    makeElement("input", {
      type: "range",
      min: -maxStops,
      max: maxStops,
      step: 0.1,
      value: stops,
      title: "Double click: as the rig has it",
    }),
    `${name}, intensity in stops`,
  );
  const output = makeElement("output", { textContent: formatStops(stops) });
  const set = (value) => {
    slider.value = value;
    output.textContent = formatStops(Number(value));
    change({ stops: Number(value) });
  };
  slider.addEventListener("input", () => set(slider.value));
  slider.addEventListener("dblclick", () => set(0));
  return makeRow("intensity", slider, output);
}

function tintRow({ name, color }, change) {
  const title = "Multiplies the light's own colour";
  const picker = setLabel(
    makeElement("input", { type: "color", value: toHex(color), title }),
    `${name}, tint`,
  );
  picker.addEventListener("input", () =>
    change({ color: picker.value === "#ffffff" ? [1, 1, 1] : fromHex(picker.value) }),
  );
  return makeRow("tint", picker, makeElement("output", {}));
}

function temperatureRow({ name, kelvin }, [coldest, hottest], change) {
  const slider = setLabel(
    makeElement("input", {
      type: "range",
      min: coldest,
      max: hottest,
      step: 50,
      value: kelvin ?? NEUTRAL,
      title: "Multiplies the light by a black body's colour. Double click: as the rig has it",
    }),
    `${name}, temperature in kelvin`,
  );
  const output = makeElement("output", { textContent: formatKelvin(kelvin) });
  const set = (value) => {
    output.textContent = formatKelvin(value);
    change({ kelvin: value });
  };
  slider.addEventListener("input", () => set(Number(slider.value)));
  slider.addEventListener("dblclick", () => {
    slider.value = NEUTRAL;
    set(null);
  });
  return makeRow("temperature", slider, output);
}

export const panel = { markup: { aside }, mount: (designer) => new Lights(designer) };
