// @ts-check
// The rows of the chosen layer's parameters, in the panel of layers. Each parameter has a row with
// a slider, a colour or a choice. A parameter is stated if the look gives it a value, and otherwise
// has the model's default.

import { fromHex, toHex } from "./viewport/color.js";
import {
  makeButton,
  makeElement,
  makeOptions,
  makeSentence,
  setLabel,
  spaceWords,
} from "./viewport/elements.js";
import { maskEditor, sourceEditor } from "./mask.js";

// The step of a slider over a range: about a two-hundredth of it, with one digit.
const sliderStep = ([low, high]) => Number(((high - low) / 200).toPrecision(1));
const formatComponent = (x) => String(Number(x.toFixed(2))).replace(/^0\./, ".");

/** Return an element with the chosen layer's title and rows; `panel` is that of layers.js. */
export function layerInspector(panel) {
  const { layer, stack } = panel;
  const title = makeElement(
    "summary",
    {},
    makeElement("span", { textContent: layer.name }),
    makeElement("small", { textContent: layer.title ?? "" }),
  );
  const box = makeElement("details", { className: "layer", open: true }, title);
  box.dataset.layer = layer.index ?? "";
  if (!layer.enabled) {
    const sentence = "Muted: it is not in the picture, and has no sliders. M shows it again.";
    box.append(makeSentence(sentence));
    return box;
  }
  if (!layer.own) {
    const hint = "it has no sliders. A look of the shipped models has.";
    box.append(makeSentence(`Translated from ${layer.title}: ${hint}`));
  }
  if (stack.solo === layer.number && layer.number > 0) {
    const sentence = "Shown alone and whole, without its mask. What is saved has all layers.";
    box.append(makeSentence(sentence));
  }
  if (layer.number > 0 && !stack.locked) {
    if (layer.modes.length > 1) box.append(modeRow(layer, panel));
    box.append(maskEditor(layer, panel));
  }
  box.append(
    ...layer.parameters
      .filter(({ name, varies }) => name !== "mask" || !varies)
      .flatMap((parameter) => parameterRows(parameter, panel)),
  );
  return box;
}

/** Return the row in which the user chooses how a layer combines with the layers beneath. */
function modeRow(layer, panel) {
  const words = { over: "over what is beneath", transmit: "as a clear coat (transmit)" };
  const choice = makeElement(
    "select",
    { id: "layer-mode" },
    ...makeOptions(layer.modes, layer.mode, words),
  );
  setLabel(choice, `How ${layer.name} lies`);
  choice.addEventListener("change", () =>
    panel.arrange({ op: "mode", layer: layer.number, mode: choice.value }),
  );
  const title = "over: covers by its mask. transmit: what it lets through meets the layers beneath";
  const label = makeElement("span", { textContent: "lies" });
  return makeElement("div", { className: "row", title }, label, choice);
}

const rowId = (layer, parameter) => `p-${layer.number}-${parameter.name}`;
const isStated = ({ value, varies }) => value !== null || varies !== "";

/** Return the row of a parameter and, if it is open, the editor of its source (mask.js). */
function parameterRows(parameter, panel) {
  const { layer, stack } = panel,
    { name, kind } = parameter,
    row = parameterRow(parameter, panel);
  if (stack.locked || name === "mask" || name.includes(".") || !layer.own) return [row];
  if (isStated(parameter)) addUnstate(row, parameter, panel);
  if (!["float", "color"].includes(kind)) return [row];
  const id = rowId(layer, parameter),
    { openSources } = panel,
    isOpen = openSources.has(id);
  const toggle = () => {
    if (isOpen) openSources.delete(id);
    else openSources.add(id);
    panel.designer.update();
  };
  const title = `${spaceWords(name)}: an image, a primvar or an expression`;
  const button = makeButton("ƒ", title, toggle, { className: "toggle", id: `${id}-more` });
  button.setAttribute("aria-expanded", String(isOpen));
  row.append(button);
  return isOpen ? [row, sourceEditor(layer, parameter, `${id}-source`, panel)] : [row];
}

/** Add to a row the button and the key by which the user removes the value from the look. */
function addUnstate(row, parameter, panel) {
  const { layer } = panel,
    { name } = parameter,
    id = rowId(layer, parameter);
  const unstate = () => panel.arrange({ op: "unstate", layer: layer.number, parameter: name }, id);
  row.firstChild.prepend(
    makeButton("×", `${spaceWords(name)}: back to the model's default (Delete)`, unstate, {
      className: "unstate",
      id: `${id}-unstate`,
      tabIndex: -1,
    }),
  );
  row.addEventListener("keydown", (event) => {
    const { tagName, type } = event.target;
    const isText =
      tagName === "TEXTAREA" || (tagName === "INPUT" && ["number", "text"].includes(type));
    if (!["Delete", "Backspace"].includes(event.key) || isText) return;
    event.preventDefault();
    unstate();
  });
}

/** Return the row of a parameter: its name, and inputs, or a text if it varies or is fixed. */
function parameterRow(parameter, panel) {
  const { layer, stack } = panel,
    { name, kind, varies } = parameter,
    id = rowId(layer, parameter);
  const words = name === "mask" ? "how much" : spaceWords(name.replace(/^\w+\./, ""));
  const row = makeElement(
    "div",
    { className: "row parameter", title: parameter.help || name },
    makeElement("span", {}, words),
  );
  row.dataset.parameter = name;
  row.classList.toggle("stated", isStated(parameter));
  const change = (value, isFinal) => {
    row.classList.add("stated");
    panel.change(layer, parameter, value, isFinal);
  };
  const addInput = (input, quantity = "") => {
    setLabel(input, `${layer.name}, ${spaceWords(name)}${quantity}`);
    input.id = `${id}${quantity && "-number"}`;
    input.disabled = Boolean(stack.locked);
    row.append(input);
    return input;
  };
  const addInputs = { float: addNumber, color: addColor, token: addChoice }[kind];
  if (varies) {
    // The text can have the focus, so that the row receives keys.
    const properties = { className: "varies", textContent: varies, title: varies, tabIndex: 0, id };
    row.append(makeElement("span", properties));
  } else if (addInputs) addInputs(row, parameter, addInput, change);
  else {
    const text = parameter.value === null ? "the shading normal" : parameter.value.join(" ");
    row.append(makeElement("span", { className: "varies", textContent: text }));
  }
  return row;
}

/** Add a slider and a field for a number to a row. */
function addNumber(row, { value, default: standard, soft, hard }, addInput, change) {
  const current = value ?? standard;
  const slider = addInput(
    makeElement("input", {
      type: "range",
      min: soft[0],
      max: soft[1],
      step: sliderStep(soft),
      value: current,
    }),
  );
  const number = addInput(
    makeElement("input", {
      type: "number",
      min: hard[0],
      max: hard[1],
      step: "any",
      value: Number(current.toPrecision(6)),
    }),
    ", number",
  );
  slider.addEventListener("input", () => {
    number.value = slider.value;
    change(Number(slider.value), false);
  });
  slider.addEventListener("change", () => change(Number(slider.value), true));
  number.addEventListener("change", () => {
    if (!number.checkValidity() || number.value === "") {
      number.reportValidity();
      return;
    }
    slider.value = number.value;
    change(Number(number.value), true);
  });
}

/** Add the picker of a colour to a row. */
function addColor(row, { value, default: standard }, addInput, change) {
  const current = value ?? standard;
  const picker = addInput(makeElement("input", { type: "color", value: toHex(current) }));
  picker.addEventListener("input", () => change(fromHex(picker.value), false));
  picker.addEventListener("change", () => change(fromHex(picker.value), true));
  const text = current.map(formatComponent).join(" ");
  row.append(makeElement("output", { textContent: text }));
}

/** Add the select of a token to a row. */
function addChoice(row, { value, default: standard, choices }, addInput, change) {
  const current = value ?? standard;
  const choice = addInput(makeElement("select", {}, ...makeOptions(choices, current)));
  choice.value = current;
  choice.addEventListener("change", () => change(choice.value, true));
}
