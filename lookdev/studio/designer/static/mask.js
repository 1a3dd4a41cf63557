// @ts-check
// The editors of a source, in the panel of layers. A source gives a layer's mask, or a parameter
// that varies over the surface, its value: an image, a primvar, or an expression. The names in an
// expression have sources of their own.

import {
  makeButton,
  makeElement,
  makeOptions,
  makeRow,
  makeSentence,
  setLabel,
} from "./viewport/elements.js";

const MASK_KINDS = {
  number: "a number",
  texture: "an image",
  primvar: "a primvar of the asset",
  expression: "an expression",
  part: "a part of the asset",
};
const PARAMETER_KINDS = {
  number: "a constant",
  texture: "an image",
  primvar: "a primvar of the asset",
  expression: "an expression",
};
// The names that have a meaning in every expression.
const CONSTANTS = new Set(["PI", "E", "linear", "smooth", "gaussian", "view"]);

/** Return the names of an expression that need a source: all but functions and constants. */
function freeNames(expression) {
  const text = expression.replace(/#[^\n]*/g, " ");
  const names = [...text.matchAll(/(?<![\w.])[A-Za-z_]\w*(?!\w)(?!\s*\()/g)].map(([name]) => name);
  return [...new Set(names)].filter((name) => !CONSTANTS.has(name));
}

/**
 * The drafts: texts that the user has typed and not applied yet, by the key of their editor. Each
 * answer of the server makes new editors, which begin with their draft. A draft lasts until its
 * source changes. It has `version`, the source that it replaces, as JSON; `kind` and `text` of the
 * new source; `typedSources`, the sources of names; and `problem`, the server's error.
 */
const drafts = new Map();

/** Return the editor of a layer's mask; `panel` is the panel of the layers (layers.js). */
export function maskEditor(layer, panel) {
  const { mask, number, name } = layer;
  return new SourceEditor(panel, mask, {
    id: "mask",
    key: `${number} ${name}`,
    owner: `the mask of ${name}`,
    label: "mask",
    title: "Where the layer is, and how much: white shows it, black shows what is beneath",
    kinds: MASK_KINDS,
    channels: ["r", "g", "b", "a"],
    request: (text, inputs) => ({ op: "mask", layer: number, mask: text, inputs }),
    reset: { op: "mask", layer: number, mask: "1", inputs: {} },
  }).element();
}

/** Return the editor of the source of a parameter. */
export function sourceEditor(layer, parameter, id, panel) {
  const { name, source, kind } = parameter,
    { number } = layer;
  return new SourceEditor(panel, source, {
    id,
    key: `${number} ${layer.name} ${name}`,
    owner: `${name} of ${layer.name}`,
    label: "from",
    title: "What gives it its value",
    kinds: PARAMETER_KINDS,
    channels: kind === "color" ? ["rgb"] : ["r", "g", "b", "a"],
    request: (text, inputs) => ({
      op: "source",
      layer: number,
      parameter: name,
      source: text,
      inputs,
    }),
    reset: { op: "unstate", layer: number, parameter: name },
  }).element();
}

/** The editor of one source, from its kind to the inputs of this kind. */
class SourceEditor {
  /**
   * `source` is the source in the look's file. `target` describes the mask or the parameter:
   * `target.request` returns the edit of the stack that sets a source by its text and the sources
   * of its names, and `target.reset` is the edit that removes the source.
   */
  constructor(panel, source, target) {
    this.panel = panel;
    this.source = source;
    this.target = target;
    this.version = JSON.stringify(source);
    if (drafts.get(target.key)?.version !== this.version) drafts.delete(target.key);
    this.draft = drafts.get(target.key) ?? {};
    this.kind = this.draft.kind ?? source.kind;
    /** The source in the file, if it is of the kind that the editor shows; else an empty one. */
    this.current = source.kind === this.kind ? source : { text: "", inputs: {} };
  }

  element() {
    const { label, title, key } = this.target;
    const row = makeElement(
      "div",
      { className: "row", title },
      makeElement("span", { textContent: label }),
      this.kindChoice(),
    );
    this.problem = makeElement("p", {
      className: "problem",
      hidden: !this.draft.problem,
      textContent: this.draft.problem ?? "",
      role: "alert",
    });
    this.problem.dataset.of = key;
    return makeElement("div", { className: "mask" }, row, ...this.inputs(), this.problem);
  }

  /** Return the select of the source's kind. "number" removes the source. */
  kindChoice() {
    const { id, key, kinds, owner, reset } = this.target;
    const choice = makeElement(
      "select",
      { id: `${id}-kind` },
      ...makeOptions(Object.keys(kinds), this.kind, kinds),
    );
    choice.addEventListener("change", () => {
      if (choice.value !== "number") {
        drafts.set(key, { version: this.version, kind: choice.value });
        this.panel.designer.update();
        return;
      }
      drafts.delete(key);
      if (this.source.kind === "number") this.panel.designer.update();
      else this.panel.arrange(reset);
    });
    return setLabel(choice, `What ${owner} is`);
  }

  /** Return the elements that edit a source of the chosen kind. */
  inputs() {
    switch (this.kind) {
      case "texture":
        return this.imageInputs();
      case "primvar":
        return [this.primvarRow()];
      case "expression":
        return this.expressionInputs();
      case "part":
        return [
          makeSentence(
            "A look does not know which part it is assigned to. " +
              "Assign the part a look of its own, under Part, or give the asset a primvar.",
          ),
        ];
      default:
        return [];
    }
  }

  /** Change entries of the draft; make it if there is none. */
  storeDraft(changes) {
    const { key } = this.target;
    drafts.set(key, { version: this.version, kind: this.kind, ...drafts.get(key), ...changes });
  }

  /**
   * Ask the server to set the source that a text describes. An error is shown below the editor,
   * which the answer may have replaced by a new one.
   */
  async apply(text, inputs = {}) {
    const { key, request } = this.target;
    this.storeDraft({ problem: "" });
    this.problem.hidden = true;
    const error = await this.panel.arrange(request(text, inputs));
    if (!error) {
      drafts.delete(key);
      return;
    }
    this.storeDraft({ problem: error });
    const problem = [...document.querySelectorAll(".mask .problem")].find(
      (element) => element.dataset.of === key,
    );
    if (problem) Object.assign(problem, { hidden: false, textContent: error });
  }

  /** Offer images as values of an input; their list is fetched when the input gets the focus. */
  offerImages(input, list) {
    const fill = async () => list.replaceChildren(...makeOptions(await this.panel.listImages()));
    input.setAttribute("list", list.id);
    input.addEventListener("focus", fill, { once: true });
  }

  imageInputs() {
    const { id, channels } = this.target;
    const [, file = "", channel = "r"] = this.current.text.match(/^(.*?)(?::(\w+))?$/) ?? [];
    const input = makeTextInput({
      id: `${id}-file`,
      value: file,
      placeholder: "textures/dirt.png",
    });
    const choice = makeElement(
      "select",
      { id: `${id}-channel` },
      ...makeOptions(channels, channel),
    );
    setLabel(choice, "Channel of the image");
    const apply = () => {
      if (input.value.trim()) this.apply(`${input.value.trim()}:${choice.value}`);
    };
    input.addEventListener("change", apply);
    choice.addEventListener("change", apply);
    const list = makeElement("datalist", { id: `${id}-images` });
    this.offerImages(input, list);
    return [makeField("image", input, choice), list];
  }

  primvarRow() {
    const input = makeTextInput({
      id: `${this.target.id}-primvar`,
      value: this.current.text.replace(/^primvar:/, ""),
      placeholder: "wear",
    });
    input.addEventListener("change", () => {
      if (input.value.trim()) this.apply(`primvar:${input.value.trim()}`);
    });
    return makeField("primvar", input);
  }

  expressionInputs() {
    const { id, owner } = this.target,
      typedSources = { ...this.draft.typedSources }; // by the names in the expression
    const text = makeElement("textarea", {
      id: `${id}-expression`,
      value: this.draft.text ?? this.current.text,
      rows: 3,
      spellcheck: false,
      placeholder: "smoothstep(dirt, .2, .6)",
    });
    setLabel(text, `Expression of ${owner}`);
    const sources = makeElement("div"),
      list = makeElement("datalist", { id: `${id}-images` });
    const showSources = () =>
      sources.replaceChildren(
        ...freeNames(text.value).map((name) => this.nameRow(name, typedSources, list)),
      );
    const apply = () => this.apply(text.value, this.changedInputs(text.value, typedSources));
    text.addEventListener("input", () => {
      this.storeDraft({ text: text.value });
      showSources();
    });
    text.addEventListener("keydown", (event) => {
      if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) apply();
      event.stopPropagation();
    });
    showSources();
    const button = makeButton("Apply", "Give it this expression (Ctrl+Enter)", apply, {
      id: `${id}-apply`,
    });
    return [text, sources, list, makeElement("div", { className: "tools" }, button)];
  }

  /** Return the row of a name in an expression, with its source. */
  nameRow(name, typedSources, list) {
    const input = makeTextInput({
      value: typedSources[name] ?? this.current.inputs[name] ?? "",
      placeholder: "0.5, dirt.png:r, primvar:wear, uv:st",
    });
    input.dataset.name = name;
    input.addEventListener("input", () => {
      typedSources[name] = input.value;
      this.storeDraft({ typedSources });
    });
    this.offerImages(input, list);
    return makeField(name, input);
  }

  /**
   * Return the typed sources, by name, that differ from those in the file. A name that is not in
   * the result keeps its source.
   */
  changedInputs(text, typedSources) {
    const names = freeNames(text).filter(
      (name) =>
        typedSources[name] !== undefined && typedSources[name] !== this.current.inputs[name],
    );
    return Object.fromEntries(names.map((name) => [name, typedSources[name]]));
  }
}

/** Return an input of one line of text. */
function makeTextInput(properties) {
  return makeElement("input", {
    type: "text",
    className: "wide",
    spellcheck: false,
    ...properties,
  });
}

/** Return a row with an input, which the label names, and further elements. */
function makeField(label, input, ...more) {
  return makeRow(label, setLabel(input, label), ...more);
}
