// @ts-check
// The parameters of the selected surface: sliders with units, ranges, and what the publication says
// of each.
import { groupOf } from "./gl.js";
import { changed, nameOf, selected, state } from "./state.js";

const made = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

const spaced = (name) => {
  const text = name.replace(/([a-z])([A-Z0-9])/g, "$1 $2");
  return text[0].toUpperCase() + text.slice(1).toLowerCase();
};
const shown = (value) => Number(value.toPrecision(4)).toString();

// Exponents and the like: a slider of the root of the value, where the range is long.
const bent = ([low, high]) => low >= 0 && high >= 100;
const toSlider = (value, range) => {
  const t = (value - range[0]) / (range[1] - range[0]);
  return bent(range) ? Math.max(0, t) ** (1 / 3) : t;
};
const fromSlider = (t, range) => {
  const value = range[0] + (bent(range) ? t ** 3 : t) * (range[1] - range[0]);
  return Number(value.toPrecision(bent(range) ? 3 : 4));
};

const toHex = (color) =>
  `#${color
    .map((v) => {
      const c = Math.min(1, Math.max(0, v));
      return Math.round(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055))
        .toString(16)
        .padStart(2, "0");
    })
    .join("")}`;
const fromHex = (text) =>
  text.match(/\w\w/g).map((each) => {
    const c = parseInt(each, 16) / 255;
    return Number((c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4).toPrecision(4));
  });

export class Sliders {
  constructor(link) {
    this.link = link;
    this.panel = document.getElementById("parameters");
  }

  show(surface) {
    const { models } = state.offered,
      model = models[surface.model];
    this.panel.replaceChildren();
    if (!surface.editable || !model) {
      if (surface.look) this.place(surface);
      return;
    }
    const groups = new Map();
    for (const parameter of model.parameters) {
      const group = parameter.kind === "token" ? "forms" : groupOf(parameter);
      if (!groups.has(group)) groups.set(group, []);
      groups.get(group).push(parameter);
    }
    const titles = {
      "": "Parameters",
      forms: "Forms of the model",
      optional: "Optional parts",
      normals: "Normals",
    };
    for (const group of ["", "forms", "optional", "normals"]) {
      const rows = (groups.get(group) ?? [])
        .filter((each) => !each.file)
        .map((each) => this.row(surface, each, model));
      if (!rows.length) continue;
      if (group === "optional" || group === "normals") {
        const box = made(
          "details",
          {
            open:
              surface.open.has(group) ||
              groups.get(group).some((each) => each.name in surface.given),
          },
          made("summary", { textContent: titles[group] }),
          ...rows,
        );
        if (box.open) surface.open.add(group);
        box.addEventListener("toggle", () => {
          surface.open[box.open ? "add" : "delete"](group);
        });
        this.panel.append(box);
      } else this.panel.append(made("h3", { textContent: titles[group] }), ...rows);
    }
  }

  // Of a look, the place whose stack is plotted.
  place(surface) {
    const [, stem, , u, v] = surface.base.match(/^(.*?)(@([\d.]+),([\d.]+))?$/),
      at = [u ?? 0.5, v ?? 0.5].map(Number);
    this.panel.append(
      made("h3", { textContent: "Place" }),
      made("p", {
        className: "sentence",
        textContent:
          "A look has its parameters in its file. Its layers, the lowest first: " +
          `${surface.layers.join(", ")}. They are plotted at these texture coordinates.`,
      }),
    );
    ["U", "V"].forEach((name, k) => {
      const slider = made("input", {
          type: "range",
          min: 0,
          max: 1,
          step: 0.005,
          value: at[k],
          id: `p-${name}`,
        }),
        out = made("output", { textContent: shown(at[k]) });
      for (const [type, held] of [
        ["input", true],
        ["change", false],
      ])
        slider.addEventListener(type, (event) => {
          at[k] = Number(slider.value);
          out.textContent = shown(at[k]);
          slider.style.setProperty("--at", `${100 * at[k]}%`);
          surface.base = `${stem}@${at.map(shown).join(",")}`;
          changed("parameter", { surface, name: "", since: event.timeStamp, held });
        });
      slider.style.setProperty("--at", `${100 * at[k]}%`);
      this.panel.append(
        made(
          "div",
          { className: "parameter" },
          made(
            "div",
            { className: "row" },
            made("label", { htmlFor: slider.id, textContent: name }),
            out,
          ),
          slider,
        ),
      );
    });
  }

  value(surface, parameter) {
    if (parameter.name in surface.given) return surface.given[parameter.name];
    if (parameter.follows && parameter.follows in surface.given)
      return surface.given[parameter.follows];
    return surface.values[parameter.name] ?? parameter.default;
  }

  row(surface, parameter, model) {
    const id = `p-${parameter.name}`,
      row = made("div", { className: "parameter" }),
      reset = made("button", {
        type: "button",
        className: "plain reset",
        textContent: "↺",
        title: "Reset",
      });
    reset.setAttribute("aria-label", `Reset ${spaced(parameter.name)}`);
    const mark = () => row.classList.toggle("changed", parameter.name in surface.given);
    reset.addEventListener("click", () => {
      delete surface.given[parameter.name];
      this.refresh(surface);
    });
    const [low, high] = parameter.soft,
      unit = made("span", { className: "unit", textContent: parameter.unit });
    const sentence = made("p", { className: "sentence", id: `${id}-s` });
    if (parameter.quote)
      sentence.append(
        made("q", { textContent: parameter.quote, title: `${parameter.help} ${model.quoted}.` }),
      );
    else sentence.textContent = parameter.help;
    const label = (like) =>
      made(
        like ? "span" : "label",
        like
          ? {
              className: "like",
              textContent: spaced(parameter.name),
              title: parameter.help,
              id: `${id}-l`,
            }
          : { htmlFor: id, textContent: spaced(parameter.name), title: parameter.help },
      );
    const give = (value, event, held) => {
      this.free(surface, parameter);
      surface.given[parameter.name] = value;
      mark();
      changed("parameter", { surface, name: parameter.name, since: event.timeStamp, held });
    };
    if (parameter.kind === "token") {
      const select = made(
        "select",
        { id },
        ...parameter.choices.map((each) => made("option", { value: each, textContent: each })),
      );
      select.value = this.value(surface, parameter);
      select.setAttribute("aria-describedby", `${id}-s`);
      select.addEventListener("change", () => {
        if (select.value === parameter.default) delete surface.given[parameter.name];
        else surface.given[parameter.name] = select.value;
        this.refresh(surface);
      });
      row.append(made("div", { className: "row" }, label(false), reset, select), sentence);
    } else if (parameter.kind === "float") {
      const field = made("input", {
        type: "number",
        id,
        min: parameter.hard[0],
        max: parameter.hard[1],
        step: "any",
      });
      const slider = made("input", { type: "range", min: 0, max: 1, step: 0.001 });
      field.setAttribute("aria-describedby", `${id}-s`);
      slider.setAttribute("aria-label", `${spaced(parameter.name)}, slider`);
      const put = (value) => {
        field.value = shown(value);
        slider.value = toSlider(value, parameter.soft);
        slider.style.setProperty(
          "--at",
          `${100 * Math.min(1, Math.max(0, toSlider(value, parameter.soft)))}%`,
        );
        slider.setAttribute("aria-valuetext", `${shown(value)} ${parameter.unit}`.trim());
      };
      slider.addEventListener("input", (event) => {
        const value = fromSlider(Number(slider.value), parameter.soft);
        put(value);
        give(value, event, true);
      });
      slider.addEventListener("change", (event) =>
        give(fromSlider(Number(slider.value), parameter.soft), event, false),
      );
      field.addEventListener("change", (event) => {
        const value = Math.min(parameter.hard[1], Math.max(parameter.hard[0], Number(field.value)));
        if (field.value === "" || !Number.isFinite(value)) {
          put(this.value(surface, parameter));
          return;
        }
        put(value);
        give(value, event, false);
      });
      put(this.value(surface, parameter));
      const beyond =
        parameter.hard[0] !== low || parameter.hard[1] !== high
          ? ` (up to ${shown(parameter.hard[1])})`
          : "";
      row.append(
        made(
          "div",
          { className: "row" },
          label(false),
          reset,
          field,
          ...(parameter.unit ? [unit] : []),
        ),
        slider,
        made(
          "div",
          { className: "ends" },
          made("span", { textContent: shown(low) }),
          made("span", { textContent: `${shown(high)}${beyond}` }),
        ),
        sentence,
      );
    } else {
      const value = [...this.value(surface, parameter)],
        plain = parameter.kind === "color" && low === 0 && high === 1,
        names = plain
          ? ["R", "G", "B"]
          : parameter.kind === "color" && !/coefficients/.test(parameter.name)
            ? ["R", "G", "B"]
            : ["X", "Y", "Z"];
      const swatch = plain
        ? made("input", { type: "color", className: "swatch", value: toHex(value) })
        : null;
      swatch?.setAttribute("aria-label", `${spaced(parameter.name)}, colour`);
      const fields = [],
        sliders = [],
        grid = made("div", { className: "channels" });
      grid.setAttribute("role", "group");
      grid.setAttribute("aria-labelledby", `${id}-l`);
      grid.setAttribute("aria-describedby", `${id}-s`);
      const put = () =>
        value.forEach((each, k) => {
          fields[k].value = shown(each);
          sliders[k].value = toSlider(each, parameter.soft);
          sliders[k].style.setProperty(
            "--at",
            `${100 * Math.min(1, Math.max(0, toSlider(each, parameter.soft)))}%`,
          );
          if (swatch) swatch.value = toHex(value);
        });
      const send = (event, held) => {
        if (parameter.kind === "normal" && !value.some(Boolean)) return;
        put();
        give([...value], event, held);
      };
      names.forEach((name, k) => {
        sliders.push(made("input", { type: "range", min: 0, max: 1, step: 0.002 }));
        fields.push(
          made("input", {
            type: "number",
            min: parameter.hard[0],
            max: parameter.hard[1],
            step: "any",
          }),
        );
        sliders[k].setAttribute("aria-label", `${spaced(parameter.name)} ${name}, slider`);
        fields[k].setAttribute("aria-label", `${spaced(parameter.name)} ${name}`);
        for (const [type, held] of [
          ["input", true],
          ["change", false],
        ])
          sliders[k].addEventListener(type, (event) => {
            value[k] = fromSlider(Number(sliders[k].value), parameter.soft);
            send(event, held);
          });
        fields[k].addEventListener("change", (event) => {
          const read = Number(fields[k].value);
          if (fields[k].value !== "" && Number.isFinite(read))
            value[k] = Math.min(parameter.hard[1], Math.max(parameter.hard[0], read));
          send(event, false);
        });
        grid.append(made("span", { textContent: name }), sliders[k], fields[k]);
      });
      for (const [type, held] of [
        ["input", true],
        ["change", false],
      ])
        swatch?.addEventListener(type, (event) => {
          fromHex(swatch.value).forEach((each, k) => {
            value[k] = each;
          });
          send(event, held);
        });
      put();
      row.append(
        made("div", { className: "row" }, label(true), reset, ...(swatch ? [swatch] : [])),
        grid,
        sentence,
      );
    }
    mark();
    return row;
  }

  // A value that a name such as a metal's stands for becomes the surface's own when it is moved.
  free(surface, parameter) {
    const model = state.offered.models[surface.model];
    const short = model.parameters.filter(
      (each) =>
        each.stands && each.name in surface.given && surface.given[each.name] !== each.default,
    );
    if (!short.length || parameter.kind === "token" || parameter.name in surface.given) return;
    for (const each of model.parameters) {
      if (
        each.kind !== "token" &&
        JSON.stringify(surface.values[each.name]) !== JSON.stringify(surface.usual[each.name])
      )
        surface.given[each.name] ??= surface.values[each.name];
    }
    for (const each of model.parameters)
      if (
        each.kind === "token" &&
        !each.stands &&
        surface.values[each.name] !== surface.usual[each.name]
      )
        surface.given[each.name] ??= surface.values[each.name];
    for (const each of short) delete surface.given[each.name];
    queueMicrotask(() => this.show(surface));
  }

  // After a change of form: ask for all values anew.
  async refresh(surface) {
    changed("form", { surface });
    if (selected() === surface) document.getElementById("name").textContent = nameOf(surface);
  }
}
