// @ts-check
// The lights of the rig: how bright, of which colour or temperature, on or off. Settings of the
// view, as the exposure is.

import { fromHex, toHex } from "./color.js";
import { at, made } from "./made.js";

const WARM = 6500; // kelvin that a light takes first

export class LightList {
  /**
   * `asked` sends a body to a path of the server, and resolves with its answer; `say` tells an
   * error.
   */
  constructor(viewport, asked, say) {
    this.viewport = viewport;
    this.asked = asked;
    this.say = say;
    this.lights = [];
    this.busy = false;
    this.waiting = null;
    this.written = false;
    at("lights-reset").addEventListener("click", () => this.send({ reset: true }, true));
  }

  /** Fetch the lights of the rig that is shown, and show them as they are set. */
  async load() {
    this.take(await this.asked("lights"));
    this.list();
  }

  take({ lights, rows, kelvin, stops }) {
    this.lights = lights;
    this.kelvin = kelvin;
    this.most = stops;
    const own = lights.every(
      (each) =>
        each.on && each.stops === 0 && each.kelvin === null && each.color.every((x) => x === 1),
    );
    this.written ||= !own; // textures are kept: from then on they are written each time
    if (this.written) this.viewport.setLights(rows);
    at("lights-reset").disabled = own;
    for (const [number, light] of lights.entries())
      at("light-list").children[number]?.classList.toggle("off", !light.on);
  }

  /** Send a setting: while one is on its way, only the newest other waits. */
  async send(body, anew = false) {
    this.waiting = { body, anew };
    if (this.busy) return;
    this.busy = true;
    try {
      while (this.waiting) {
        const now = this.waiting;
        this.waiting = null;
        this.take(await this.asked("lights", now.body));
        if (now.anew) this.list();
      }
    } catch (error) {
      this.waiting = null;
      this.say(error.message, true);
    }
    this.busy = false;
  }

  list() {
    const several = this.lights.length > 1;
    at("light-list").replaceChildren(
      ...this.lights.map((light, number) => this.row(light, number)),
    );
    at("lights-title").textContent = `${this.lights.length} light${several ? "s" : ""} of the rig`;
  }

  row(light, number) {
    const { name } = light,
      now = {
        light: number,
        on: light.on,
        stops: light.stops,
        color: light.color,
        kelvin: light.kelvin,
      };
    const give = (changed) => {
      Object.assign(now, changed);
      this.send({ ...now });
    };
    const named = (input, what) => {
      input.setAttribute("aria-label", `${name}, ${what}`);
      return input;
    };
    const on = named(made("input", { type: "checkbox", checked: light.on }), "on");
    on.addEventListener("change", () => give({ on: on.checked }));
    const kind = name.startsWith(light.kind) ? "" : light.kind;
    const title = made(
      "label",
      { className: "check", title: light.path },
      on,
      made("span", { textContent: name }),
      made("small", { textContent: kind }),
    );

    const stops = named(
      made("input", {
        type: "range",
        min: -this.most,
        max: this.most,
        step: 0.1,
        value: light.stops,
        title: "Double click: as the rig has it",
      }),
      "intensity in stops",
    );
    const shown = made("output", { textContent: told(light.stops) });
    const stop = (value) => {
      stops.value = value;
      shown.textContent = told(Number(value));
      give({ stops: Number(value) });
    };
    stops.addEventListener("input", () => stop(stops.value));
    stops.addEventListener("dblclick", () => stop(0));

    const picker = named(
      made("input", {
        type: "color",
        value: toHex(light.color),
        title: "Multiplies the light's own colour",
      }),
      "tint",
    );
    picker.addEventListener("input", () =>
      give({ color: picker.value === "#ffffff" ? [1, 1, 1] : fromHex(picker.value) }),
    );
    const [coldest, hottest] = this.kelvin;
    const warm = named(
      made("input", {
        type: "range",
        min: coldest,
        max: hottest,
        step: 50,
        value: light.kelvin ?? WARM,
        title: "Multiplies the light by a black body's colour. Double click: as the rig has it",
      }),
      "temperature in kelvin",
    );
    const degrees = made("output", {
      textContent: light.kelvin === null ? "own" : `${light.kelvin} K`,
    });
    const heat = (value) => {
      degrees.textContent = value === null ? "own" : `${value} K`;
      give({ kelvin: value });
    };
    warm.addEventListener("input", () => heat(Number(warm.value)));
    warm.addEventListener("dblclick", () => {
      warm.value = WARM;
      heat(null);
    });

    const rows = [
      made("div", { className: "row" }, made("span", { textContent: "intensity" }), stops, shown),
      made(
        "div",
        { className: "row" },
        made("span", { textContent: "tint" }),
        picker,
        made("output", {}),
      ),
      made(
        "div",
        { className: "row" },
        made("span", { textContent: "temperature" }),
        warm,
        degrees,
      ),
    ];
    const item = made("li", {}, title, ...rows);
    item.classList.toggle("off", !light.on);
    return item;
  }
}

const told = (stops) => `${stops > 0 ? "+" : ""}${stops.toFixed(1)}`;
