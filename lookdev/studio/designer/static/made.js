// @ts-check
// Elements, and what a person reads of names.

export const at = (id) => document.getElementById(id);
export const made = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};
export const spaced = (name) =>
  name
    .replace(/_/g, " ")
    .replace(/([a-z])([A-Z0-9])/g, "$1 $2")
    .toLowerCase();
export const fileName = (path) => path.split(/[\\/]/).pop();

/** A button with its key in the tooltip. */
export const button = (text, title, act, properties = {}) => {
  const element = made("button", { type: "button", textContent: text, title, ...properties });
  element.addEventListener("click", act);
  return element;
};

/** Open a dialog, and return what closed it, or "" for a cancel. */
export function opened(dialog) {
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((resolve) =>
    dialog.addEventListener("close", () => resolve(dialog.returnValue), { once: true }),
  );
}
