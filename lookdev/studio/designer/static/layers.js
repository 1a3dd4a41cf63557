// @ts-check
// The panel of the layers of the picked part's look: its variants, the list of its layers, and the
// parameters of the chosen layer.

import {
  byId,
  makeButton,
  makeElement,
  makeOptions,
  makeSentence,
  setLabel,
} from "./viewport/elements.js";
import { LayerList, renameLayer } from "./layer_list.js";
import { layerInspector } from "./parameters.js";
import { choosePreset, savePreset } from "./presets.js";

const aside = `<section id="layers" aria-label="Layers"></section>`;

const SEND_INTERVAL = 1000; // milliseconds after which a gesture sends an edit to the server
const LONGEST_PASTE = 60000; // characters of a pasted layer, as USD text

/**
 * The user's gesture on a parameter, such as a drag of its slider. All its edits are one step of
 * the history.
 */
class Gesture {
  constructor(designer) {
    this.designer = designer;
    this.id = "";
  }

  /**
   * Set a parameter. If it is a uniform, the picture changes at once. The document on the server
   * changes at the end of the gesture (`isFinal`), and for a uniform also about once in
   * `SEND_INTERVAL` before.
   */
  change(layer, parameter, value, isFinal) {
    const { look, viewport } = this.designer;
    if (parameter.uniform) viewport.setNumbers(look, { [parameter.uniform]: [value].flat() });
    if (!this.id) {
      this.id = `${Date.now()}-${Math.random()}`;
      this.sentAt = performance.now();
    }
    const edit = { look, layer, parameter: parameter.name, value, gesture: this.id };
    clearTimeout(this.timer);
    if (isFinal) {
      this.id = "";
      this.designer.request("edit", edit);
    } else if (parameter.uniform) {
      if (performance.now() - this.sentAt > SEND_INTERVAL) this.send(edit);
      else this.timer = setTimeout(() => this.send(edit), SEND_INTERVAL);
    }
  }

  /** Send an edit that the picture shows already, so that the scene need not be updated. */
  send(edit) {
    const { designer } = this;
    this.sentAt = performance.now();
    designer.enqueue(async () => {
      designer.scene.revision = (await designer.fetchJson("edit", edit)).revision;
    });
  }
}

/** The section of layers, and the functions of its buttons, keys and rows. */
class Layers {
  constructor(designer) {
    this.designer = designer;
    /** The number of the chosen layer in the stack; null: the top one. */
    this.selected = null;
    /** The ids of the rows of parameters whose editor of a source is open. */
    this.openSources = new Set();
    this.copiedText = ""; // the newest copied layer, for browsers whose clipboard cannot be read
    this.gesture = new Gesture(designer);
    this.list = new LayerList(this);
    const inList = () => document.activeElement?.closest("#stack");
    addEventListener("copy", (event) => {
      if (!inList()) return;
      event.preventDefault();
      this.copy();
    });
    addEventListener("paste", (event) => {
      if (!inList()) return;
      event.preventDefault();
      this.pasteText(event.clipboardData.getData("text/plain") || this.copiedText);
    });
  }

  get stack() {
    return this.designer.stack;
  }

  /** The chosen layer, or the top one. */
  get layer() {
    const { layers } = this.stack;
    return layers.find(({ number }) => number === this.selected) ?? layers[layers.length - 1];
  }

  /** Show the stack anew; the focus and the scroll position stay. */
  update() {
    const focused = document.activeElement?.closest("#layers") ? document.activeElement.id : "";
    const { stack, layer } = this;
    this.selected = layer.number;
    const parts = [makeElement("h2", { textContent: `Layers of ${stack.name}` })];
    if (stack.locked) parts.push(makeSentence(`Only shown: ${stack.locked}.`));
    else parts.push(...stack.variants.map((variant) => this.variantRow(variant)), this.toolbar());
    parts.push(this.list.element(), layerInspector(this));
    const scrollTop = byId("stack")?.scrollTop ?? 0;
    byId("layers").replaceChildren(...parts);
    byId("stack").scrollTop = scrollTop;
    if (focused) byId(focused)?.focus({ preventScroll: true });
  }

  /** Return the row of a variant set, which chooses one of its variants. */
  variantRow({ set, choices, chosen, by_job }) {
    const choice = makeElement("select", { id: `variant-${set}` }, ...makeOptions(choices, chosen));
    setLabel(choice, `Variant ${set}`);
    choice.addEventListener("change", () =>
      this.arrange({ op: "variant", set, choice: choice.value }),
    );
    const title = by_job
      ? "The job chooses this variant: another one is only shown"
      : "The file's own choice of this variant";
    const label = makeElement("span", { textContent: `variant ${set}` });
    return makeElement("div", { className: "row", title }, label, choice);
  }

  /** Return the buttons of operations on the chosen layer. */
  toolbar() {
    const { stack, layer } = this,
      { number } = layer,
      top = stack.layers.length - 1,
      exceptBase = number === 0 ? " (not the base)" : "";
    const act = (request) => () => this.arrange({ layer: number, ...request });
    return makeElement(
      "div",
      { className: "tools", role: "toolbar", ariaLabel: "Layers" },
      makeButton("Add…", "Lay a preset over the layers (A)", () => this.add(), {
        id: "layer-add",
      }),
      makeButton("Duplicate", "Lay a copy above (Ctrl+D)", act({ op: "duplicate" }), {
        id: "layer-duplicate",
      }),
      makeButton("Rename", "Rename the layer (F2)", () => renameLayer(layer, this), {
        id: "layer-rename",
      }),
      makeButton("Remove", `Remove the layer (Delete)${exceptBase}`, act({ op: "remove" }), {
        id: "layer-remove",
        disabled: number === 0,
      }),
      makeButton(
        "Up",
        `Move up (Alt+Up, or drag)${exceptBase}`,
        act({ op: "move", to: number + 1 }),
        { id: "layer-up", disabled: number === 0 || number === top },
      ),
      makeButton(
        "Down",
        `Move down (Alt+Down, or drag)${exceptBase}`,
        act({ op: "move", to: number - 1 }),
        { id: "layer-down", disabled: number < 2 },
      ),
      makeButton("Copy", "Copy the layer as USD text (Ctrl+C)", () => this.copy(), {
        id: "layer-copy",
      }),
      makeButton(
        "To library…",
        "Save the layer as a preset of the library",
        () => this.toLibrary(),
        {
          id: "layer-preset",
          disabled: !layer.enabled || !layer.own,
        },
      ),
      makeButton("Paste", "Lay a copied layer on top (Ctrl+V)", () => this.paste(), {
        id: "layer-paste",
      }),
    );
  }

  /** Choose the layer of a number: its parameters are shown. */
  choose(number) {
    this.selected = number;
    this.designer.update();
  }

  /** Set a parameter of a layer; `isFinal` marks the end of a gesture. */
  change(layer, parameter, value, isFinal) {
    this.gesture.change(layer.index, parameter, value, isFinal);
  }

  /**
   * Ask the server for an operation on the stack (`request`), then focus the element with the id
   * `focus`. Returns the message of the error, or "".
   */
  async arrange(request, focus = "") {
    const { designer } = this,
      count = this.stack.layers.length;
    const error = await designer.request("stack", { look: designer.look, ...request });
    if (error) return error;
    const { layers } = this.stack;
    if (["add", "paste"].includes(request.op)) this.selected = layers.length - 1;
    if (request.op === "duplicate" && layers.length > count) this.selected = request.layer + 1;
    if (request.op === "move") this.selected = request.to;
    designer.update();
    if (focus) byId(focus)?.focus();
    return "";
  }

  /** Show the layer of a number alone, or all layers for null. */
  solo(layer) {
    return this.designer.request("stack", { look: this.designer.look, op: "solo", layer });
  }

  /** Return the images that a mask may read. */
  async listImages() {
    return (await this.designer.fetchJson(`images?look=${this.designer.look}`)).images;
  }

  /** Ask for a preset, and lay it over the layers. */
  async add() {
    if (this.stack.locked) return;
    try {
      const preset = await choosePreset(this.designer);
      if (preset) await this.arrange({ op: "add", preset });
    } catch (error) {
      this.designer.say(error.message, true);
    }
  }

  /** Save the chosen layer as a preset of the library. */
  async toLibrary() {
    const { designer } = this;
    try {
      await designer.settle();
      designer.say(await savePreset(designer, designer.look, this.layer));
    } catch (error) {
      designer.say(error.message, true);
    }
  }

  /** Copy the chosen layer as USD text to the clipboard. */
  async copy() {
    const { designer, layer } = this,
      request = { look: designer.look, op: "copy", layer: layer.number };
    try {
      this.copiedText = (await designer.fetchJson("stack", request)).text;
      await navigator.clipboard?.writeText(this.copiedText).catch(() => {});
      designer.say(`copied ${layer.name} as USD text`);
    } catch (error) {
      designer.say(error.message, true);
    }
  }

  /** Lay the layer in the clipboard over the layers. */
  async paste() {
    const text = (await navigator.clipboard?.readText().catch(() => "")) || this.copiedText;
    await this.pasteText(text);
  }

  async pasteText(text) {
    if (text.length > LONGEST_PASTE)
      this.designer.say("what is pasted is too long for a layer", true);
    else await this.arrange({ op: "paste", text });
  }
}

export const panel = { markup: { aside }, mount: (designer) => new Layers(designer) };
