// @ts-check
// What gives a value over the surface, of the mask of a layer or of a parameter: a number, a
// channel of an image, a
// primvar, or an expression with the sources of its names.

import { made, button } from "./made.js";

const MASK = {
  number: "a number",
  texture: "an image",
  primvar: "a primvar of the asset",
  expression: "an expression",
  part: "a part of the asset",
};
const PARAMETER = {
  number: "a constant",
  texture: "an image",
  primvar: "a primvar of the asset",
  expression: "an expression",
};
const KNOWN = new Set(["PI", "E", "linear", "smooth", "gaussian", "view"]);
// { had, kind, text, typed, problem }: edited and not yet given, by what it is of
const drafts = new Map();

/** The names of an expression: what is neither a function nor a constant. */
export function namesOf(text) {
  const plain = text.replace(/#[^\n]*/g, " ");
  const found = [...plain.matchAll(/(?<![\w.])[A-Za-z_]\w*(?!\w)(?!\s*\()/g)].map(
    (each) => each[0],
  );
  return [...new Set(found)].filter((each) => !KNOWN.has(each));
}

export function maskEditor(layer, acts) {
  const { mask, number, name } = layer;
  const title = "Where the layer is, and how much: white shows it, black shows what is beneath";
  return editor({
    id: "mask",
    key: `${number} ${name}`,
    of: `the mask of ${name}`,
    label: "mask",
    title,
    kinds: MASK,
    had: mask,
    acts,
    give: (text, inputs) => acts.arrange({ op: "mask", layer: number, mask: text, inputs }),
    plain: () => acts.arrange({ op: "mask", layer: number, mask: "1", inputs: {} }),
  });
}

/** The editor of what gives a parameter its value; `had` is as that of a mask. */
export function sourceEditor(layer, parameter, id, acts) {
  const { name, source } = parameter,
    { number } = layer;
  return editor({
    id,
    key: `${number} ${layer.name} ${name}`,
    of: `${name} of ${layer.name}`,
    label: "from",
    title: "What gives it its value",
    kinds: PARAMETER,
    had: source,
    color: parameter.kind === "color",
    acts,
    give: (text, inputs) =>
      acts.arrange({ op: "source", layer: number, parameter: name, source: text, inputs }),
    plain: () => acts.arrange({ op: "unstate", layer: number, parameter: name }),
  });
}

function editor({
  id,
  key,
  of,
  label,
  title,
  kinds,
  had,
  color = false,
  acts,
  give: given,
  plain,
}) {
  // A draft lasts while the list is drawn anew by other answers, until what it changes has another
  // value.
  const stated = JSON.stringify(had);
  if (drafts.get(key)?.had !== stated) drafts.delete(key);
  const draft = drafts.get(key) ?? {},
    kind = draft.kind ?? had.kind;
  const keep = (change) => drafts.set(key, { had: stated, kind, ...drafts.get(key), ...change });
  const problem = made("p", {
    className: "problem",
    hidden: !draft.problem,
    textContent: draft.problem ?? "",
    role: "alert",
  });
  problem.dataset.of = key;
  const choice = made(
    "select",
    { id: `${id}-kind` },
    ...Object.entries(kinds).map(([each, words]) => new Option(words, each, false, each === kind)),
  );
  choice.setAttribute("aria-label", `What ${of} is`);
  const give = async (text, inputs = {}) => {
    keep({ problem: "" });
    problem.hidden = true;
    const error = await given(text, inputs);
    if (!error) drafts.delete(key);
    else {
      keep({ problem: error });
      const paragraph = [...document.querySelectorAll(".mask .problem")].find(
        (element) => element.dataset.of === key,
      );
      if (paragraph) Object.assign(paragraph, { hidden: false, textContent: error });
    }
  };
  const box = made(
    "div",
    { className: "mask" },
    made("div", { className: "row", title }, made("span", { textContent: label }), choice),
  );
  choice.addEventListener("change", () => {
    if (choice.value === "number") {
      drafts.delete(key);
      if (had.kind === "number") acts.again();
      else plain();
      return;
    }
    drafts.set(key, { had: stated, kind: choice.value });
    acts.again();
  });
  const current = had.kind === kind;
  if (kind === "texture") box.append(...image(id, had, current, color, give, acts));
  else if (kind === "primvar") box.append(primvar(id, had, current, give));
  else if (kind === "expression")
    box.append(...expression(id, had, current, of, draft, keep, give, acts));
  else if (kind === "part") {
    const words =
      "A look does not know which part wears it. Dress the part in a look of its own, " +
      "under Part, or give the asset a primvar.";
    box.append(made("p", { className: "sentence", textContent: words }));
  }
  box.append(problem);
  return box;
}

function field(label, input, more = []) {
  input.setAttribute("aria-label", label);
  return made("div", { className: "row" }, made("span", { textContent: label }), input, ...more);
}

function listed(id, input, acts) {
  const list = made("datalist", { id: `${id}-images` });
  input.setAttribute("list", `${id}-images`);
  input.addEventListener(
    "focus",
    async () => list.replaceChildren(...(await acts.images()).map((each) => new Option(each))),
    { once: true },
  );
  return list;
}

function image(id, mask, current, color, give, acts) {
  const [, file = "", channel = "r"] = (current ? mask.text : "").match(/^(.*?)(?::(\w+))?$/) ?? [];
  const input = made("input", {
    type: "text",
    id: `${id}-file`,
    value: file,
    placeholder: "textures/dirt.png",
    spellcheck: false,
    className: "wide",
  });
  const of = made(
    "select",
    { id: `${id}-channel` },
    ...(color ? ["rgb"] : "rgba".split("")).map(
      (each) => new Option(each, each, false, each === channel),
    ),
  );
  of.setAttribute("aria-label", "Channel of the image");
  const changed = () => {
    if (input.value.trim()) give(`${input.value.trim()}:${of.value}`);
  };
  input.addEventListener("change", changed);
  of.addEventListener("change", changed);
  return [field("image", input, [of]), listed(id, input, acts)];
}

function primvar(id, mask, current, give) {
  const input = made("input", {
    type: "text",
    id: `${id}-primvar`,
    value: current ? mask.text.replace(/^primvar:/, "") : "",
    placeholder: "wear",
    spellcheck: false,
    className: "wide",
  });
  input.addEventListener("change", () => {
    if (input.value.trim()) give(`primvar:${input.value.trim()}`);
  });
  return field("primvar", input);
}

function expression(id, mask, current, of, draft, keep, give, acts) {
  const text = made("textarea", {
    id: `${id}-expression`,
    value: draft.text ?? (current ? mask.text : ""),
    rows: 3,
    spellcheck: false,
    placeholder: "smoothstep(dirt, .2, .6)",
  });
  text.setAttribute("aria-label", `Expression of ${of}`);
  const sources = made("div", {}),
    had = current ? mask.inputs : {},
    typed = { ...draft.typed };
  const list = made("datalist", { id: `${id}-images` });
  const show = () => {
    sources.replaceChildren(
      ...namesOf(text.value).map((name) => {
        const input = made("input", {
          type: "text",
          value: typed[name] ?? had[name] ?? "",
          placeholder: "0.5, dirt.png:r, primvar:wear, uv:st",
          className: "wide",
          spellcheck: false,
        });
        input.dataset.name = name;
        input.setAttribute("list", `${id}-images`);
        input.addEventListener("input", () => {
          typed[name] = input.value;
          keep({ typed });
        });
        input.addEventListener(
          "focus",
          async () =>
            list.replaceChildren(...(await acts.images()).map((each) => new Option(each))),
          { once: true },
        );
        return field(name, input);
      }),
    );
  };
  text.addEventListener("input", () => {
    keep({ text: text.value });
    show();
  });
  text.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) apply();
    event.stopPropagation();
  });
  // A name whose source was not typed anew keeps the one that it has, with all that the file says
  // of it.
  const apply = () => {
    const names = namesOf(text.value);
    give(
      text.value,
      Object.fromEntries(
        names
          .filter((name) => typed[name] !== undefined && typed[name] !== had[name])
          .map((name) => [name, typed[name]]),
      ),
    );
  };
  show();
  return [
    text,
    sources,
    list,
    made(
      "div",
      { className: "tools" },
      button("Apply", "Give it this expression (Ctrl+Enter)", apply, { id: `${id}-apply` }),
    ),
  ];
}
