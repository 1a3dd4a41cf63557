// @ts-check
// Functions for all panels that make HTML elements, and that write names as a person reads them.

export const byId = (id) => document.getElementById(id);

/** Return an element with a tag, properties and children. */
export function makeElement(tag, properties = {}, ...children) {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
}

/** Return a button that calls `act`; its title is the tooltip, which states its key, if any. */
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

/** Return a paragraph with a sentence, which the style sheet shows small and grey. */
export function makeSentence(text) {
  return makeElement("p", { className: "sentence", textContent: text });
}

/**
 * Return the options of a select for some values; that of `value` is selected. `words` has the
 * text of a value, if the user should not see the value itself.
 */
export function makeOptions(values, value = undefined, words = {}) {
  return values.map((name) => new Option(words[name] ?? name, name, false, name === value));
}

/** Set the name of an element for assistive technology; return the element. */
export function setLabel(element, label) {
  element.setAttribute("aria-label", label);
  return element;
}

/** Return an identifier in words: "surface_color" and "surfaceColor" become "surface color". */
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

/** Return a time in seconds since the epoch as text: the date and the time of day. */
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
