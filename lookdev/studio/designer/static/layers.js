// The layers of the picked part's look: a row for each parameter, with its range and what the model says of it.

import { fromHex, toHex } from "./color.js";

const made = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};
const spaced = (name) => name.replace(/([a-z])([A-Z0-9])/g, "$1 $2").toLowerCase();
const step = ([low, high]) => Number(((high - low) / 200).toPrecision(1));

/** Show a stack in a panel; `changed` is called with a layer, a parameter, a value, and whether the hand rests. */
export function showLayers(panel, stack, changed) {
  const open = new Set([...panel.querySelectorAll("details[open]")].map((each) => each.dataset.layer));
  const first = panel.childElementCount === 0 || panel.dataset.stack !== stack.name;
  panel.dataset.stack = stack.name;
  const layers = stack.layers.map((layer, number) => {
    const rows = layer.parameters.map((parameter) => row(layer, number, parameter, changed));
    if (!layer.own) {
      rows.push(made("p", { className: "sentence", textContent: `Translated from ${layer.title}: it has no sliders. A look of the shipped models has.` }));
    }
    const title = made("summary", {}, made("span", { textContent: layer.name }), made("small", { textContent: layer.title }));
    const box = made("details", { className: "layer", open: first || open.has(String(number)) }, title, ...rows);
    box.dataset.layer = number;
    return box;
  });
  panel.replaceChildren(made("h2", { textContent: `Layers of ${stack.name}` }), ...layers.reverse());
}

function row(layer, number, parameter, changed) {
  const { name, kind, value, soft, hard } = parameter;
  const id = `p-${number}-${name}`;
  const label = made("span", { textContent: spaced(name), id: `${id}-label` });
  const element = made("div", { className: "row", title: parameter.help || name }, label);
  element.dataset.parameter = name;
  element.classList.toggle("stated", value !== null);
  const give = (given, rests) => {
    element.classList.add("stated");
    changed(number, parameter, given, rests);
  };
  const named = (input, what = "") => {
    input.setAttribute("aria-label", `${layer.name}, ${spaced(name)}${what}`);
    return input;
  };
  if (parameter.varies) {
    element.append(made("span", { className: "varies", textContent: parameter.varies, title: parameter.varies }));
  } else if (kind === "float") {
    const shown = value ?? parameter.default, [low, high] = soft;
    const slider = named(made("input", { type: "range", min: low, max: high, step: step(soft), value: shown }));
    const number = named(made("input", { type: "number", min: hard[0], max: hard[1], step: "any", value: shown }), ", number");
    slider.addEventListener("input", () => { number.value = slider.value; give(Number(slider.value), false); });
    slider.addEventListener("change", () => give(Number(slider.value), true));
    number.addEventListener("change", () => {
      if (!number.checkValidity() || number.value === "") { number.reportValidity(); return; }
      slider.value = number.value;
      give(Number(number.value), true);
    });
    element.append(slider, number);
  } else if (kind === "color") {
    const shown = value ?? parameter.default;
    const picker = named(made("input", { type: "color", value: toHex(shown) }));
    picker.addEventListener("input", () => give(fromHex(picker.value), false));
    picker.addEventListener("change", () => give(fromHex(picker.value), true));
    element.append(picker, made("output", { textContent: shown.map((x) => x.toFixed(2).replace(/^0/, "")).join(" ") }));
  } else if (kind === "token") {
    const choice = named(made("select", {}, ...parameter.choices.map((each) => made("option", { value: each, textContent: each }))));
    choice.value = value ?? parameter.default;
    choice.addEventListener("change", () => give(choice.value, true));
    element.append(choice);
  } else {
    element.append(made("span", { className: "varies", textContent: value === null ? "the shading normal" : value.join(" ") }));
  }
  return element;
}
