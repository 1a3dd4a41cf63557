// @ts-check
// The list of a look's layers in the panel of layers, the top one first. The pointer and keys
// choose, move, mute, show alone (solo) and rename layers. The number of a layer is its position
// in the stack; the base has number 0.

import { byId, makeButton, makeElement, setLabel } from "./viewport/elements.js";

export class LayerList {
  /** `panel` is the panel of the layers (layers.js). */
  constructor(panel) {
    this.panel = panel;
    this.dragged = null; // number of the layer that the pointer drags
  }

  /** Return the list as an element. */
  element() {
    const { stack } = this.panel,
      items = [...stack.layers].reverse().map((layer) => this.item(layer));
    const list = makeElement("ol", { className: "stack", id: "stack" }, ...items);
    return setLabel(list, `Layers of ${stack.name}, the top one first`);
  }

  /** Return the item of a layer in the list. */
  item(layer) {
    const { number, name, mask } = layer,
      { stack } = this.panel,
      isSolo = stack.solo === number;
    const draggable = number > 0 && !stack.locked;
    const item = makeElement("li", { className: "layer-row", draggable }, this.nameButton(layer));
    item.dataset.number = number;
    item.classList.toggle("muted", !layer.enabled || (stack.solo !== null && !isSolo));
    if (mask && mask.kind !== "number") {
      const title = `mask: ${mask.text}`;
      item.append(makeElement("small", { className: "tag", textContent: mask.kind, title }));
    }
    if (!stack.locked) {
      item.append(
        makeToggle("S", `Show ${name} alone (S): not saved`, isSolo, () => this.toggleSolo(layer), {
          id: `layer-solo-${number}`,
          disabled: !layer.enabled,
        }),
        makeToggle(
          "M",
          number ? `Mute ${name} (M): saved with the look` : "The base cannot be muted",
          !layer.enabled,
          () => this.toggleMute(layer),
          { id: `layer-mute-${number}`, disabled: number === 0 },
        ),
      );
    }
    this.followDrag(item, layer);
    return item;
  }

  /** Return the button with the name of a layer, which chooses the layer. */
  nameButton(layer) {
    const { number, name } = layer;
    const button = makeElement(
      "button",
      {
        type: "button",
        className: "name",
        id: `layer-${number}`,
        title: `${name}, ${layer.title ?? "muted"}`,
      },
      makeElement("span", { textContent: name }),
      makeElement("small", { textContent: layer.enabled ? layer.title : "muted" }),
    );
    button.setAttribute("aria-current", String(number === this.panel.selected));
    button.addEventListener("click", () => this.panel.choose(number));
    button.addEventListener("dblclick", () => renameLayer(layer, this.panel));
    button.addEventListener("keydown", (event) => this.pressKey(event, layer));
    return button;
  }

  toggleSolo({ number }) {
    this.panel.solo(this.panel.stack.solo === number ? null : number);
  }

  toggleMute({ number, enabled }) {
    this.panel.arrange({ op: "enable", layer: number, enabled: !enabled });
  }

  /** Make the item of a layer draggable, and a target for other layers. */
  followDrag(item, layer) {
    const allowDrop = (event) => {
      if (this.dragged === null || layer.number === 0) return;
      event.preventDefault();
      item.classList.add("target");
    };
    item.addEventListener("dragstart", (event) => {
      this.dragged = layer.number;
      event.dataTransfer.effectAllowed = "move";
      event.dataTransfer.setData("text/plain", layer.name);
    });
    item.addEventListener("dragover", allowDrop);
    item.addEventListener("dragenter", allowDrop);
    item.addEventListener("dragleave", () => item.classList.remove("target"));
    item.addEventListener("dragend", () => {
      this.dragged = null;
    });
    item.addEventListener("drop", (event) => {
      event.preventDefault();
      item.classList.remove("target");
      const { dragged } = this;
      this.dragged = null;
      if (dragged !== null && dragged !== layer.number && layer.number !== 0)
        this.move(dragged, layer.number);
    });
  }

  /** Move the layer of a number to another number, choose it, and focus the element `focus`. */
  move(layer, to, focus = "") {
    this.panel.selected = to;
    this.panel.arrange({ op: "move", layer, to }, focus);
  }

  /** Choose and focus the layer of a number, if there is one. */
  chooseAndFocus(number) {
    if (!this.panel.stack.layers.some((layer) => layer.number === number)) return;
    this.panel.choose(number);
    byId(`layer-${number}`).focus();
  }

  remove({ number }) {
    this.panel.selected = number - 1;
    this.panel.arrange({ op: "remove", layer: number }, `layer-${number - 1}`);
  }

  /**
   * Return the action of a key on a layer, or undefined if the key has none. An action does
   * nothing where it is not possible, for example for the base.
   */
  keyAct(name, layer) {
    const { number } = layer,
      top = this.panel.stack.layers.length - 1,
      isBase = number === 0,
      move = (to) => this.move(number, to, `layer-${to}`);
    const remove = () => isBase || this.remove(layer);
    return {
      "Ctrl+d": () => this.panel.arrange({ op: "duplicate", layer: number }),
      "Alt+arrowup": () => isBase || number === top || move(number + 1),
      "Alt+arrowdown": () => number < 2 || move(number - 1),
      arrowup: () => this.chooseAndFocus(number + 1),
      arrowdown: () => this.chooseAndFocus(number - 1),
      delete: remove,
      backspace: remove,
      f2: () => renameLayer(layer, this.panel),
      m: () => isBase || this.toggleMute(layer),
      s: () => !layer.enabled || this.toggleSolo(layer),
      a: () => this.panel.add(),
    }[name];
  }

  pressKey(event, layer) {
    const isArrow = ["ArrowUp", "ArrowDown"].includes(event.key);
    const modifier =
      event.ctrlKey || event.metaKey ? "Ctrl+" : event.altKey && isArrow ? "Alt+" : "";
    const act = this.keyAct(`${modifier}${event.key.toLowerCase()}`, layer);
    if (!act) return;
    act();
    event.preventDefault();
    event.stopPropagation();
  }
}

/** Return a button that is pressed or not. */
function makeToggle(text, title, pressed, act, properties) {
  const button = makeButton(text, title, act, { className: "toggle", ...properties });
  button.setAttribute("aria-pressed", String(pressed));
  return setLabel(button, title);
}

/** Show an input for a layer's name in the list: Enter renames the layer, Escape cancels. */
export function renameLayer(layer, panel) {
  const button = byId(`layer-${layer.number}`);
  const input = makeElement("input", {
    type: "text",
    className: "renaming",
    value: layer.name,
    spellcheck: false,
    autocomplete: "off",
  });
  setLabel(input, `New name of ${layer.name}`);
  let ended = false;
  const end = (renames) => {
    if (ended) return;
    ended = true;
    const name = input.value.trim();
    input.replaceWith(button);
    button.focus();
    if (renames && name && name !== layer.name)
      panel.arrange({ op: "rename", layer: layer.number, name }, `layer-${layer.number}`);
  };
  input.addEventListener("keydown", (event) => {
    event.stopPropagation();
    if (event.key === "Enter") end(true);
    else if (event.key === "Escape") end(false);
  });
  input.addEventListener("blur", () => end(true));
  button.replaceWith(input);
  input.focus();
  input.select();
}
