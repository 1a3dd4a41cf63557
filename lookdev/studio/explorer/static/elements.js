// @ts-check
// HTML elements.

export const byId = (id) => document.getElementById(id);

export const makeElement = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

/** Name an element for assistive technology; return the element. */
export const setLabel = (element, label) => {
  element.setAttribute("aria-label", label);
  return element;
};
