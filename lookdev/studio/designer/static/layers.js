// @ts-check
// The picked part's look: its variants, its layers as a list, the top one first, and the parameters
// of the chosen one.

import { fromHex, toHex } from "./color.js";
import { made, button, spaced } from "./made.js";
import { maskEditor, sourceEditor } from "./mask.js";

const step = ([low, high]) => Number(((high - low) / 200).toPrecision(1));
let chosen = null; // number of a layer in the stack
let dragged = null;
const sourced = new Set(); // parameters whose source is being looked at, by the ids of their rows

/** The layer that is chosen in a stack: the one before, or the top one. */
export function chosenLayer(stack) {
  return (
    stack.layers.find((each) => each.number === chosen) ?? stack.layers[stack.layers.length - 1]
  );
}

export function choose(number) {
  chosen = number;
}

/**
 * Show a stack in a panel. `acts` has `change` (of a parameter), `arrange` (of the stack), `solo`,
 * `add`, `copy`, `paste`, `preset`,
 * `again` (to show the panel anew), and `images`. */
export function showLayers(panel, stack, acts) {
  const focused = document.activeElement?.closest("#layers") ? document.activeElement.id : "";
  const layer = chosenLayer(stack);
  chosen = layer.number;
  const parts = [made("h2", { textContent: `Layers of ${stack.name}` })];
  if (stack.locked)
    parts.push(made("p", { className: "sentence", textContent: `Only shown: ${stack.locked}.` }));
  else {
    parts.push(
      ...stack.variants.map((each) => variantRow(each, acts)),
      toolbar(stack, layer, acts),
    );
  }
  parts.push(list(stack, acts), inspector(stack, layer, acts));
  const scrolled = document.getElementById("stack")?.scrollTop ?? 0;
  panel.replaceChildren(...parts);
  document.getElementById("stack").scrollTop = scrolled;
  if (focused) document.getElementById(focused)?.focus({ preventScroll: true });
}

function variantRow({ set, choices, chosen: choice, by_job }, acts) {
  const given = made(
    "select",
    { id: `variant-${set}` },
    ...choices.map((each) => new Option(each, each, false, each === choice)),
  );
  given.setAttribute("aria-label", `Variant ${set}`);
  given.addEventListener("change", () => acts.arrange({ op: "variant", set, choice: given.value }));
  const title = by_job
    ? "The job chooses this variant: another one is only shown"
    : "The file's own choice of this variant";
  return made(
    "div",
    { className: "row", title },
    made("span", { textContent: `variant ${set}` }),
    given,
  );
}

function toolbar(stack, layer, acts) {
  const { number } = layer,
    top = stack.layers.length - 1,
    act = (body) => () => acts.arrange({ layer: number, ...body });
  const base = number === 0 ? " (not the base)" : "";
  return made(
    "div",
    { className: "tools", role: "toolbar", ariaLabel: "Layers" },
    button("Add…", "Lay a preset over the layers (A)", acts.add, { id: "layer-add" }),
    button("Duplicate", "Lay a copy above (Ctrl+D)", act({ op: "duplicate" }), {
      id: "layer-duplicate",
    }),
    button("Rename", "Rename the layer (F2)", () => rename(layer, acts), { id: "layer-rename" }),
    button("Remove", `Remove the layer (Delete)${base}`, act({ op: "remove" }), {
      id: "layer-remove",
      disabled: number === 0,
    }),
    button("Up", `Move up (Alt+Up, or drag)${base}`, act({ op: "move", to: number + 1 }), {
      id: "layer-up",
      disabled: number === 0 || number === top,
    }),
    button("Down", `Move down (Alt+Down, or drag)${base}`, act({ op: "move", to: number - 1 }), {
      id: "layer-down",
      disabled: number < 2,
    }),
    button("Copy", "Copy the layer as USD text (Ctrl+C)", acts.copy, { id: "layer-copy" }),
    button("To library…", "Save the layer as a preset of the library", acts.preset, {
      id: "layer-preset",
      disabled: !layer.enabled || !layer.own,
    }),
    button("Paste", "Lay a copied layer on top (Ctrl+V)", acts.paste, { id: "layer-paste" }),
  );
}

function list(stack, acts) {
  const shown = [...stack.layers].reverse();
  const items = shown.map((layer) => {
    const { number, name } = layer,
      current = number === chosen,
      solo = stack.solo === number;
    const main = made(
      "button",
      {
        type: "button",
        className: "name",
        id: `layer-${number}`,
        title: `${name}, ${layer.title ?? "muted"}`,
      },
      made("span", { textContent: name }),
      made("small", { textContent: layer.enabled ? layer.title : "muted" }),
    );
    main.setAttribute("aria-current", String(current));
    main.addEventListener("click", () => {
      choose(number);
      acts.again();
    });
    main.addEventListener("dblclick", () => rename(layer, acts));
    main.addEventListener("keydown", (event) => keyed(event, stack, layer, acts));
    const item = made(
      "li",
      { className: "layer-row", draggable: number > 0 && !stack.locked },
      main,
    );
    item.dataset.number = number;
    item.classList.toggle("muted", !layer.enabled || (stack.solo !== null && !solo));
    if (layer.mask && layer.mask.kind !== "number")
      item.append(
        made("small", {
          className: "tag",
          textContent: layer.mask.kind,
          title: `mask: ${layer.mask.text}`,
        }),
      );
    if (!stack.locked) {
      item.append(
        toggle(
          "S",
          `Show ${name} alone (S): not saved`,
          `layer-solo-${number}`,
          solo,
          !layer.enabled,
          () => acts.solo(solo ? null : number),
        ),
      );
      item.append(
        toggle(
          "M",
          number ? `Mute ${name} (M): saved with the look` : "The base cannot be muted",
          `layer-mute-${number}`,
          !layer.enabled,
          number === 0,
          () => acts.arrange({ op: "enable", layer: number, enabled: !layer.enabled }),
        ),
      );
    }
    dragging(item, stack, layer, acts);
    return item;
  });
  const found = made("ol", { className: "stack", id: "stack" }, ...items);
  found.setAttribute("aria-label", `Layers of ${stack.name}, the top one first`);
  return found;
}

function toggle(text, title, id, pressed, disabled, act) {
  const element = button(text, title, act, { className: "toggle", id, disabled });
  element.setAttribute("aria-pressed", String(pressed));
  element.setAttribute("aria-label", title);
  return element;
}

function dragging(item, stack, layer, acts) {
  const over = (event) => {
    if (dragged === null || layer.number === 0) return;
    event.preventDefault();
    item.classList.add("target");
  };
  item.addEventListener("dragstart", (event) => {
    dragged = layer.number;
    event.dataTransfer.effectAllowed = "move";
    event.dataTransfer.setData("text/plain", layer.name);
  });
  item.addEventListener("dragover", over);
  item.addEventListener("dragenter", over);
  item.addEventListener("dragleave", () => item.classList.remove("target"));
  item.addEventListener("dragend", () => {
    dragged = null;
  });
  item.addEventListener("drop", (event) => {
    event.preventDefault();
    item.classList.remove("target");
    const from = dragged;
    dragged = null;
    if (from === null || from === layer.number || layer.number === 0) return;
    choose(layer.number);
    acts.arrange({ op: "move", layer: from, to: layer.number });
  });
}

function keyed(event, stack, layer, acts) {
  const { number } = layer,
    top = stack.layers.length - 1,
    control = event.ctrlKey || event.metaKey,
    key = event.key.toLowerCase();
  const move = (to) => {
    choose(to);
    acts.arrange({ op: "move", layer: number, to }, `layer-${to}`);
  };
  const go = (to) => {
    if (!stack.layers.some((each) => each.number === to)) return;
    choose(to);
    acts.again();
    document.getElementById(`layer-${to}`).focus();
  };
  if (control && key === "d") acts.arrange({ op: "duplicate", layer: number });
  else if (control || event.metaKey) return;
  else if (event.altKey && key === "arrowup") {
    if (number > 0 && number < top) move(number + 1);
  } else if (event.altKey && key === "arrowdown") {
    if (number > 1) move(number - 1);
  } else if (key === "arrowup") go(number + 1);
  else if (key === "arrowdown") go(number - 1);
  else if (key === "delete" || key === "backspace") {
    if (number > 0) {
      choose(number - 1);
      acts.arrange({ op: "remove", layer: number }, `layer-${number - 1}`);
    }
  } else if (key === "f2") rename(layer, acts);
  else if (key === "m") {
    if (number > 0) acts.arrange({ op: "enable", layer: number, enabled: !layer.enabled });
  } else if (key === "s") {
    if (layer.enabled) acts.solo(stack.solo === number ? null : number);
  } else if (key === "a") acts.add();
  else return;
  event.preventDefault();
  event.stopPropagation();
}

/** Type another name in place; Enter gives it, Escape leaves the old one. */
function rename(layer, acts) {
  const main = document.getElementById(`layer-${layer.number}`);
  const input = made("input", {
    type: "text",
    className: "renaming",
    value: layer.name,
    spellcheck: false,
    autocomplete: "off",
  });
  input.setAttribute("aria-label", `New name of ${layer.name}`);
  let ended = false;
  const end = (gives) => {
    if (ended) return;
    ended = true;
    const name = input.value.trim();
    input.replaceWith(main);
    main.focus();
    if (gives && name && name !== layer.name)
      acts.arrange({ op: "rename", layer: layer.number, name }, `layer-${layer.number}`);
  };
  input.addEventListener("keydown", (event) => {
    event.stopPropagation();
    if (event.key === "Enter") end(true);
    else if (event.key === "Escape") end(false);
  });
  input.addEventListener("blur", () => end(true));
  main.replaceWith(input);
  input.focus();
  input.select();
}

/** The parameters of a layer. */
function inspector(stack, layer, acts) {
  const title = made(
    "summary",
    {},
    made("span", { textContent: layer.name }),
    made("small", { textContent: layer.title ?? "" }),
  );
  const box = made("details", { className: "layer", open: true }, title);
  box.dataset.layer = layer.place ?? "";
  if (!layer.enabled) {
    box.append(
      made("p", {
        className: "sentence",
        textContent: "Muted: it is not in the picture, and has no sliders. M shows it again.",
      }),
    );
    return box;
  }
  if (!layer.own)
    box.append(
      made("p", {
        className: "sentence",
        textContent:
          `Translated from ${layer.title}: it has no sliders. ` +
          "A look of the shipped models has.",
      }),
    );
  if (stack.solo === layer.number && layer.number > 0)
    box.append(
      made("p", {
        className: "sentence",
        textContent: "Shown alone and whole, without its mask. What is saved has all layers.",
      }),
    );
  if (layer.number > 0 && !stack.locked) {
    if (layer.modes.length > 1) box.append(modeRow(layer, acts));
    box.append(maskEditor(layer, acts));
  }
  box.append(
    ...layer.parameters
      .filter((each) => each.name !== "mask" || !each.varies)
      .flatMap((each) => rows(layer, each, stack, acts)),
  );
  return box;
}

function modeRow(layer, acts) {
  const words = { over: "over what is beneath", transmit: "as a clear coat (transmit)" };
  const given = made(
    "select",
    { id: "layer-mode" },
    ...layer.modes.map((each) => new Option(words[each], each, false, each === layer.mode)),
  );
  given.setAttribute("aria-label", `How ${layer.name} lies`);
  given.addEventListener("change", () =>
    acts.arrange({ op: "mode", layer: layer.number, mode: given.value }),
  );
  return made(
    "div",
    {
      className: "row",
      title: "over: covers by its mask. transmit: what it lets through meets the layers beneath",
    },
    made("span", { textContent: "lies" }),
    given,
  );
}

/** The row of a parameter, with what gives it its value under it where that is looked at. */
function rows(layer, parameter, stack, acts) {
  const { name, kind, value, varies } = parameter,
    id = `p-${layer.number}-${name}`;
  const element = row(layer, parameter, stack, acts);
  if (stack.locked || name === "mask" || name.includes(".") || !layer.own) return [element];
  const stated = value !== null || varies !== "";
  const unstate = () => acts.arrange({ op: "unstate", layer: layer.number, parameter: name }, id);
  if (stated) {
    element.firstChild.prepend(
      button("×", `${spaced(name)}: back to the model's default (Delete)`, unstate, {
        className: "unstate",
        id: `${id}-unstate`,
        tabIndex: -1,
      }),
    );
    element.addEventListener("keydown", (event) => {
      const { tagName, type } = event.target;
      if (
        !["Delete", "Backspace"].includes(event.key) ||
        tagName === "TEXTAREA" ||
        (tagName === "INPUT" && ["number", "text"].includes(type))
      )
        return;
      event.preventDefault();
      unstate();
    });
  }
  if (!["float", "color"].includes(kind)) return [element];
  const open = sourced.has(id);
  const more = button(
    "ƒ",
    `${spaced(name)}: an image, a primvar or an expression`,
    () => {
      if (open) sourced.delete(id);
      else sourced.add(id);
      acts.again();
    },
    { className: "toggle", id: `${id}-more` },
  );
  more.setAttribute("aria-expanded", String(open));
  element.append(more);
  return open ? [element, sourceEditor(layer, parameter, `${id}-source`, acts)] : [element];
}

function row(layer, parameter, stack, acts) {
  const { name, kind, value, soft, hard } = parameter;
  const id = `p-${layer.number}-${name}`;
  const label = made("span", {}, name === "mask" ? "how much" : spaced(name.replace(/^\w+\./, "")));
  const element = made("div", { className: "row parameter", title: parameter.help || name }, label);
  element.dataset.parameter = name;
  element.classList.toggle("stated", value !== null || parameter.varies !== "");
  const locked = Boolean(stack.locked);
  const give = (given, rests) => {
    element.classList.add("stated");
    acts.change(layer.place, parameter, given, rests);
  };
  const named = (input, what = "") => {
    input.setAttribute("aria-label", `${layer.name}, ${spaced(name)}${what}`);
    input.id = `${id}${what && "-number"}`;
    input.disabled = locked;
    return input;
  };
  if (parameter.varies) {
    // It takes the focus, so that keys reach it.
    element.append(
      made("span", {
        className: "varies",
        textContent: parameter.varies,
        title: parameter.varies,
        tabIndex: 0,
        id,
      }),
    );
  } else if (kind === "float") {
    const shown = value ?? parameter.default,
      [low, high] = soft;
    const slider = named(
      made("input", { type: "range", min: low, max: high, step: step(soft), value: shown }),
    );
    const number = named(
      made("input", {
        type: "number",
        min: hard[0],
        max: hard[1],
        step: "any",
        value: Number(shown.toPrecision(6)),
      }),
      ", number",
    );
    slider.addEventListener("input", () => {
      number.value = slider.value;
      give(Number(slider.value), false);
    });
    slider.addEventListener("change", () => give(Number(slider.value), true));
    number.addEventListener("change", () => {
      if (!number.checkValidity() || number.value === "") {
        number.reportValidity();
        return;
      }
      slider.value = number.value;
      give(Number(number.value), true);
    });
    element.append(slider, number);
  } else if (kind === "color") {
    const shown = value ?? parameter.default;
    const picker = named(made("input", { type: "color", value: toHex(shown) }));
    picker.addEventListener("input", () => give(fromHex(picker.value), false));
    picker.addEventListener("change", () => give(fromHex(picker.value), true));
    element.append(
      picker,
      made("output", {
        textContent: shown.map((x) => String(Number(x.toFixed(2))).replace(/^0\./, ".")).join(" "),
      }),
    );
  } else if (kind === "token") {
    const choice = named(
      made(
        "select",
        {},
        ...parameter.choices.map((each) => made("option", { value: each, textContent: each })),
      ),
    );
    choice.value = value ?? parameter.default;
    choice.addEventListener("change", () => give(choice.value, true));
    element.append(choice);
  } else {
    element.append(
      made("span", {
        className: "varies",
        textContent: value === null ? "the shading normal" : value.join(" "),
      }),
    );
  }
  return element;
}
