// The mask of a layer: a number, a channel of an image, a primvar, or an expression with the sources of its names.

import { made, button } from "./made.js";

const KINDS = { number: "a number", texture: "an image", primvar: "a primvar of the asset", expression: "an expression", part: "a part of the asset" };
const KNOWN = new Set(["PI", "E", "linear", "smooth", "gaussian", "view"]);
const opened = new Map(); // kinds that are looked at and not yet given, by layer

/** The names of an expression: what is neither a function nor a constant. */
export function namesOf(text) {
  const plain = text.replace(/#[^\n]*/g, " ");
  const found = [...plain.matchAll(/(?<![\w.])[A-Za-z_]\w*(?!\w)(?!\s*\()/g)].map((each) => each[0]);
  return [...new Set(found)].filter((each) => !KNOWN.has(each));
}

export function maskEditor(layer, acts) {
  const { mask, number, name } = layer, key = `${number} ${name}`;
  const kind = opened.get(key) ?? mask.kind;
  const problem = made("p", { className: "problem", hidden: true, role: "alert" });
  const choice = made("select", { id: "mask-kind" }, ...Object.entries(KINDS).map(([each, words]) => new Option(words, each, false, each === kind)));
  choice.setAttribute("aria-label", `What the mask of ${name} is`);
  const give = async (text, inputs = {}) => {
    problem.hidden = true;
    const error = await acts.arrange({ op: "mask", layer: number, mask: text, inputs });
    if (!error) opened.delete(key);
    else Object.assign(problem, { hidden: false, textContent: error });
  };
  const editor = made("div", { className: "mask" },
    made("div", { className: "row", title: "Where the layer is, and how much: white shows it, black shows what is beneath" }, made("span", { textContent: "mask" }), choice));
  choice.addEventListener("change", () => {
    if (choice.value === "number" && mask.kind !== "number") { opened.delete(key); give("1"); return; }
    opened.set(key, choice.value);
    acts.again();
  });
  const current = mask.kind === kind;
  if (kind === "texture") editor.append(...image(mask, current, give, acts));
  else if (kind === "primvar") editor.append(primvar(mask, current, give));
  else if (kind === "expression") editor.append(...expression(mask, current, give, acts));
  else if (kind === "part") {
    const words = "A look does not know which part wears it. Give the part a look of its own, by [[look.assign]] of the job, or the asset a primvar.";
    editor.append(made("p", { className: "sentence", textContent: words }));
  }
  editor.append(problem);
  return editor;
}

function field(label, input, more = []) {
  input.setAttribute("aria-label", label);
  return made("div", { className: "row" }, made("span", { textContent: label }), input, ...more);
}

function listed(input, acts) {
  const list = made("datalist", { id: "mask-images" });
  input.setAttribute("list", "mask-images");
  input.addEventListener("focus", async () => list.replaceChildren(...(await acts.images()).map((each) => new Option(each))), { once: true });
  return list;
}

function image(mask, current, give, acts) {
  const [, file = "", channel = "r"] = (current ? mask.text : "").match(/^(.*?)(?::(\w+))?$/) ?? [];
  const input = made("input", { type: "text", id: "mask-file", value: file, placeholder: "textures/dirt.png", spellcheck: false, className: "wide" });
  const of = made("select", { id: "mask-channel" }, ..."rgba".split("").map((each) => new Option(each, each, false, each === channel)));
  of.setAttribute("aria-label", "Channel of the image");
  const changed = () => { if (input.value.trim()) give(`${input.value.trim()}:${of.value}`); };
  input.addEventListener("change", changed);
  of.addEventListener("change", changed);
  return [field("image", input, [of]), listed(input, acts)];
}

function primvar(mask, current, give) {
  const input = made("input", { type: "text", id: "mask-primvar", value: current ? mask.text.replace(/^primvar:/, "") : "", placeholder: "wear", spellcheck: false, className: "wide" });
  input.addEventListener("change", () => { if (input.value.trim()) give(`primvar:${input.value.trim()}`); });
  return field("primvar", input);
}

function expression(mask, current, give, acts) {
  const text = made("textarea", { id: "mask-expression", value: current ? mask.text : "", rows: 3, spellcheck: false, placeholder: "smoothstep(dirt, .2, .6)" });
  text.setAttribute("aria-label", "Expression of the mask");
  const sources = made("div", {}), had = current ? mask.inputs : {}, typed = {};
  const list = made("datalist", { id: "mask-images" });
  const show = () => {
    sources.replaceChildren(...namesOf(text.value).map((name) => {
      const input = made("input", { type: "text", value: typed[name] ?? had[name] ?? "", placeholder: "0.5, dirt.png:r, primvar:wear, uv:st", className: "wide", spellcheck: false });
      input.dataset.name = name;
      input.setAttribute("list", "mask-images");
      input.addEventListener("input", () => { typed[name] = input.value; });
      input.addEventListener("focus", async () => list.replaceChildren(...(await acts.images()).map((each) => new Option(each))), { once: true });
      return field(name, input);
    }));
  };
  text.addEventListener("input", show);
  text.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) apply();
    event.stopPropagation();
  });
  // A name whose source was not typed anew keeps the one that it has, with all that the file says of it.
  const apply = () => {
    const names = namesOf(text.value);
    give(text.value, Object.fromEntries(names.filter((name) => typed[name] !== undefined && typed[name] !== had[name]).map((name) => [name, typed[name]])));
  };
  show();
  return [text, sources, list, made("div", { className: "tools" }, button("Apply", "Give the layer this mask (Ctrl+Enter)", apply, { id: "mask-apply" }))];
}
