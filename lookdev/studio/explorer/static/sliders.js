// @ts-check
// The panel of the selected surface's parameters. Each has sliders or a select, and the sentence of
// the model's publication about it. A parameter has a `soft` range for its slider, and a `hard`
// range of valid values.
import { fromHex, toHex } from "./viewport/color.js";
import { makeElement, setLabel } from "./viewport/elements.js";
import { parameterGroup, parameterLookup } from "./gl.js";
import { notify, nameOf, selectedSurface, state } from "./state.js";

/** Return the name of a parameter as a title: "clearcoatGloss" becomes "Clearcoat gloss". */
const titleOf = (name) => {
  const text = name.replace(/([a-z])([A-Z0-9])/g, "$1 $2");
  return text[0].toUpperCase() + text.slice(1).toLowerCase();
};
const formatNumber = (value) => Number(value.toPrecision(4)).toString();
const clamp = (value, [low, high]) => Math.min(high, Math.max(low, value));

// The position of a slider is in [0, 1]. For a long range, such as that of an exponent, it is the
// cube root of the value's position in the range, so that small values can be set.
const isLong = ([low, high]) => low >= 0 && high >= 100;
const toSlider = (value, range) => {
  const t = (value - range[0]) / (range[1] - range[0]);
  return isLong(range) ? Math.max(0, t) ** (1 / 3) : t;
};
const fromSlider = (t, range) => {
  const value = range[0] + (isLong(range) ? t ** 3 : t) * (range[1] - range[0]);
  return Number(value.toPrecision(isLong(range) ? 3 : 4));
};

/** Show the position of a slider by its style, which colours that fraction of its track. */
const setShare = (slider, share) =>
  slider.style.setProperty("--share", `${100 * clamp(share, [0, 1])}%`);

const makeSlider = (properties) =>
  makeElement("input", { type: "range", min: 0, max: 1, ...properties });

/** Call `act` at each change of an input, with the event and whether the pointer still holds it. */
const followInput = (input, act) => {
  input.addEventListener("input", (event) => act(event, true));
  input.addEventListener("change", (event) => act(event, false));
};

/** Return an element with the publication's sentence about a parameter, or else with its help. */
function makeSentence({ name, quote, help }, model) {
  const sentence = makeElement("p", { className: "sentence", id: `p-${name}-s` });
  if (quote)
    sentence.append(makeElement("q", { textContent: quote, title: `${help} ${model.quoted}.` }));
  else sentence.textContent = help;
  return sentence;
}

function makeLabel(id, title, help) {
  return makeElement("label", { htmlFor: id, textContent: title, title: help });
}

function makeNumber([min, max], properties = {}) {
  return makeElement("input", { type: "number", min, max, step: "any", ...properties });
}

/**
 * Return a slider and a field for one component of a vector, and `showNumber`, which sets both.
 * `set` is called with the user's number, or with null if what the user typed is not a number.
 */
function componentInputs(label, soft, hard, set) {
  const slider = setLabel(makeSlider({ step: 0.002 }), `${label}, slider`),
    field = setLabel(makeNumber(hard), label);
  followInput(slider, (event, held) => set(fromSlider(Number(slider.value), soft), event, held));
  field.addEventListener("change", (event) => {
    const number = Number(field.value),
      isValid = field.value !== "" && Number.isFinite(number);
    set(isValid ? clamp(number, hard) : null, event, false);
  });
  const showNumber = (number) => {
    field.value = formatNumber(number);
    slider.value = toSlider(number, soft);
    setShare(slider, toSlider(number, soft));
  };
  return { slider, field, showNumber };
}

const parameterValue = (surface, parameter) =>
  parameterLookup(surface, state.catalogue.models)(parameter.name) ?? parameter.default;

export class Sliders {
  constructor() {
    this.panel = document.getElementById("parameters");
  }

  /** Show the parameters of a surface, in their groups. */
  show(surface) {
    const { models } = state.catalogue,
      model = models[surface.model];
    this.panel.replaceChildren();
    if (!surface.editable || !model) {
      if (surface.look) this.showCoordinates(surface);
      return;
    }
    const groups = new Map();
    for (const parameter of model.parameters) {
      const group = parameter.kind === "token" ? "forms" : parameterGroup(parameter);
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
        .filter((parameter) => !parameter.file)
        .map((parameter) => this.makeRow(surface, parameter, model));
      if (!rows.length) continue;
      if (group === "optional" || group === "normals") {
        const box = makeElement(
          "details",
          {
            open:
              surface.open.has(group) ||
              groups.get(group).some(({ name }) => name in surface.given),
          },
          makeElement("summary", { textContent: titles[group] }),
          ...rows,
        );
        if (box.open) surface.open.add(group);
        box.addEventListener("toggle", () => {
          surface.open[box.open ? "add" : "delete"](group);
        });
        this.panel.append(box);
      } else this.panel.append(makeElement("h3", { textContent: titles[group] }), ...rows);
    }
  }

  // Show sliders for the texture coordinates at which the layers of a look are plotted.
  showCoordinates(surface) {
    const [, stem, , u, v] = surface.base.match(/^(.*?)(@([\d.]+),([\d.]+))?$/),
      st = [u ?? 0.5, v ?? 0.5].map(Number);
    this.panel.append(
      makeElement("h3", { textContent: "Place" }),
      makeElement("p", {
        className: "sentence",
        textContent:
          "A look has its parameters in its file. Its layers, the lowest first: " +
          `${surface.layers.join(", ")}. They are plotted at these texture coordinates.`,
      }),
    );
    ["U", "V"].forEach((name, k) => {
      const slider = makeSlider({ step: 0.005, value: st[k], id: `p-${name}` }),
        output = makeElement("output", { textContent: formatNumber(st[k]) }),
        label = makeElement("label", { htmlFor: slider.id, textContent: name });
      followInput(slider, (event, held) => {
        st[k] = Number(slider.value);
        output.textContent = formatNumber(st[k]);
        setShare(slider, st[k]);
        surface.base = `${stem}@${st.map(formatNumber).join(",")}`;
        notify("parameter", { surface, name: "", moveTime: event.timeStamp, held });
      });
      setShare(slider, st[k]);
      const row = makeElement("div", { className: "row" }, label, output);
      this.panel.append(makeElement("div", { className: "parameter" }, row, slider));
    });
  }

  /** Return the row of a parameter: its name, its inputs, and its sentence. */
  makeRow(surface, parameter, model) {
    const { name, kind } = parameter,
      element = makeElement("div", { className: "parameter" });
    const markChanged = () => element.classList.toggle("changed", name in surface.given);
    const row = {
      element,
      surface,
      parameter,
      id: `p-${name}`,
      title: titleOf(name),
      reset: this.resetButton(surface, parameter),
      sentence: makeSentence(parameter, model),
      set: (value, event, held) => {
        this.replacePresets(surface, parameter);
        surface.given[name] = value;
        markChanged();
        notify("parameter", { surface, name, moveTime: event.timeStamp, held });
      },
    };
    if (kind === "token") this.addChoice(row);
    else if (kind === "float") this.addNumber(row);
    else this.addVector(row);
    markChanged();
    return element;
  }

  /** Return the button that sets a parameter back to its default. */
  resetButton(surface, { name }) {
    const button = makeElement("button", {
      type: "button",
      className: "plain reset",
      textContent: "↺",
      title: "Reset",
    });
    button.addEventListener("click", () => {
      delete surface.given[name];
      this.requestValues(surface);
    });
    return setLabel(button, `Reset ${titleOf(name)}`);
  }

  addChoice({ element, surface, parameter, id, title, reset, sentence }) {
    const options = parameter.choices.map((choice) =>
      makeElement("option", { value: choice, textContent: choice }),
    );
    const select = makeElement("select", { id }, ...options);
    select.value = parameterValue(surface, parameter);
    select.setAttribute("aria-describedby", sentence.id);
    select.addEventListener("change", () => {
      if (select.value === parameter.default) delete surface.given[parameter.name];
      else surface.given[parameter.name] = select.value;
      this.requestValues(surface);
    });
    const label = makeLabel(id, title, parameter.help);
    element.append(makeElement("div", { className: "row" }, label, reset, select), sentence);
  }

  addNumber({ element, surface, parameter, id, title, reset, sentence, set }) {
    const { soft, hard, unit, help } = parameter;
    const field = makeNumber(hard, { id });
    const slider = setLabel(makeSlider({ step: 0.001 }), `${title}, slider`);
    field.setAttribute("aria-describedby", sentence.id);
    const showNumber = (value) => {
      field.value = formatNumber(value);
      slider.value = toSlider(value, soft);
      setShare(slider, toSlider(value, soft));
      slider.setAttribute("aria-valuetext", `${formatNumber(value)} ${unit}`.trim());
    };
    followInput(slider, (event, held) => {
      const value = fromSlider(Number(slider.value), soft);
      if (held) showNumber(value);
      set(value, event, held);
    });
    field.addEventListener("change", (event) => {
      const value = clamp(Number(field.value), hard);
      if (field.value === "" || !Number.isFinite(value)) {
        showNumber(parameterValue(surface, parameter));
        return;
      }
      showNumber(value);
      set(value, event, false);
    });
    showNumber(parameterValue(surface, parameter));
    const [low, high] = soft,
      isWider = hard[0] !== low || hard[1] !== high;
    const beyond = isWider ? ` (up to ${formatNumber(hard[1])})` : "";
    const units = unit ? [makeElement("span", { className: "unit", textContent: unit })] : [];
    const label = makeLabel(id, title, help);
    element.append(
      makeElement("div", { className: "row" }, label, reset, field, ...units),
      slider,
      makeElement(
        "div",
        { className: "ends" },
        makeElement("span", { textContent: formatNumber(low) }),
        makeElement("span", { textContent: `${formatNumber(high)}${beyond}` }),
      ),
      sentence,
    );
  }

  /** Add a colour, a vector or a normal: a slider and a field for each component. */
  addVector({ element, surface, parameter, id, title, reset, sentence, set }) {
    const { kind, name, soft, hard, help } = parameter,
      value = [...parameterValue(surface, parameter)],
      isDisplayable = kind === "color" && soft[0] === 0 && soft[1] === 1,
      isColor = isDisplayable || (kind === "color" && !/coefficients/.test(name));
    const swatch = isDisplayable
      ? makeElement("input", { type: "color", className: "swatch", value: toHex(value) })
      : null;
    const grid = makeElement("div", { className: "channels" });
    grid.setAttribute("role", "group");
    grid.setAttribute("aria-labelledby", `${id}-l`);
    grid.setAttribute("aria-describedby", sentence.id);
    const components = [];
    const send = (event, held) => {
      if (kind === "normal" && !value.some(Boolean)) return;
      components.forEach((component, k) => component.showNumber(value[k]));
      if (swatch) swatch.value = toHex(value);
      set([...value], event, held);
    };
    (isColor ? ["R", "G", "B"] : ["X", "Y", "Z"]).forEach((component, k) => {
      const inputs = componentInputs(`${title} ${component}`, soft, hard, (number, event, held) => {
        value[k] = number ?? value[k];
        send(event, held);
      });
      inputs.showNumber(value[k]);
      components.push(inputs);
      const label = makeElement("span", { textContent: component });
      grid.append(label, inputs.slider, inputs.field);
    });
    if (swatch) {
      setLabel(swatch, `${title}, colour`);
      followInput(swatch, (event, held) => {
        value.splice(0, 3, ...fromHex(swatch.value));
        send(event, held);
      });
    }
    const properties = { className: "label-text", textContent: title, title: help, id: `${id}-l` };
    const label = makeElement("span", properties),
      swatches = swatch ? [swatch] : [];
    const row = makeElement("div", { className: "row" }, label, reset, ...swatches);
    element.append(row, grid, sentence);
  }

  // Replace a token that sets other parameters, such as the name of a metal, by the values that it
  // sets, because the user now changes one of them.
  replacePresets(surface, parameter) {
    const model = state.catalogue.models[surface.model];
    const presets = model.parameters.filter(
      ({ name, stands, default: standard }) =>
        stands && name in surface.given && surface.given[name] !== standard,
    );
    if (!presets.length || parameter.kind === "token" || parameter.name in surface.given) return;
    const { given, usual: defaults, values } = surface;
    const differs = ({ name }) => JSON.stringify(values[name]) !== JSON.stringify(defaults[name]);
    const isToken = ({ kind }) => kind === "token";
    const numbers = model.parameters.filter((other) => !isToken(other) && differs(other));
    const tokens = model.parameters.filter(
      (other) => isToken(other) && !other.stands && differs(other),
    );
    for (const { name } of [...numbers, ...tokens]) given[name] ??= values[name];
    for (const { name } of presets) delete given[name];
    queueMicrotask(() => this.show(surface));
  }

  // Request all values from the server anew, after a change of a token.
  async requestValues(surface) {
    notify("form", { surface });
    if (selectedSurface() === surface)
      document.getElementById("name").textContent = nameOf(surface);
  }
}
