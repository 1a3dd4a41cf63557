// @ts-check
// HTML elements, and names as a person reads them.

export const byId = (id) => document.getElementById(id);

export function makeElement(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Return a button; its title is the tooltip, with its key. */
export function makeButton(text, title, act, properties = {}) {
  const element = makeElement("button", {
    type: "button",
    textContent: text,
    title,
    ...properties,
  });
  element.addEventListener("click", act);
  return element;
}

/** Return a row of a list of settings: a label, and the elements that set the value. */
export function makeRow(label, ...inputs) {
  return makeElement(
    "div",
    { className: "row" },
    makeElement("span", { textContent: label }),
    ...inputs,
  );
}

/** Return a sentence in small, quiet letters. */
export function makeSentence(text) {
  return makeElement("p", { className: "sentence", textContent: text });
}

/** Return options of a select; `value` is the selected one. `words` maps values to texts. */
export function makeOptions(values, value = undefined, words = {}) {
  return values.map((name) => new Option(words[name] ?? name, name, false, name === value));
}

/** Name an element for assistive technology; return the element. */
export function setLabel(element, label) {
  element.setAttribute("aria-label", label);
  return element;
}

/** Return a name of a program in words: "surface_color" and "surfaceColor" are "surface color". */
export function spaceWords(name) {
  return name
    .replace(/_/g, " ")
    .replace(/([a-z])([A-Z0-9])/g, "$1 $2")
    .toLowerCase();
}

/** Return the name of a file without its folders. */
export function fileName(path) {
  return path.split(/[\\/]/).pop();
}

/** Return seconds of the epoch as a date and a time. */
export function formatTime(seconds) {
  const time = new Date(seconds * 1000);
  return time.toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
}

/** Open a dialog; return the value of the button that closes it, or "" for a cancel. */
export function openDialog(dialog) {
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((resolve) =>
    dialog.addEventListener("close", () => resolve(dialog.returnValue), { once: true }),
  );
}
