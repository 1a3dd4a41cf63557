// @ts-check
// Functions that find and make HTML elements, for all modules of the page.

export const byId = (id) => document.getElementById(id);

/** Return an element with a tag, properties and children. */
export const makeElement = (tag, properties = {}, ...children) => {
  const element = Object.assign(document.createElement(tag), properties);
  element.append(...children);
  return element;
};

/** Set the name of an element for assistive technology; return the element. */
export const setLabel = (element, label) => {
  element.setAttribute("aria-label", label);
  return element;
};
