// @ts-check
// The entry of the Designer's page. The page consists of panels, each with its HTML and behaviour:
// this module inserts their HTML, mounts them, and calls their functions for keys.

import { Designer, showMessage } from "./designer.js";
import { byId } from "./viewport/elements.js";
import { panels } from "./panels.js";

const POLL = 3000; // milliseconds between requests for the server's status

/** Add the HTML of a panel to the page; `markup` has HTML by the selector of its parent. */
function insertMarkup({ markup }) {
  for (const [selector, html] of Object.entries(markup))
    document.querySelector(selector).insertAdjacentHTML("beforeend", html);
}

/** Return the page's Designer; show the message of an error, such as of a missing WebGL 2. */
function startDesigner() {
  try {
    return new Designer(byId("picture"));
  } catch (error) {
    showMessage(error.message, true);
    throw error;
  }
}

/** Return a key with its modifiers, as panels name it: "v", "Ctrl+z", "Ctrl+Shift+z". */
function keyName(event) {
  if (!event.ctrlKey && !event.metaKey) return event.key;
  return `Ctrl+${event.shiftKey ? "Shift+" : ""}${event.key.toLowerCase()}`;
}

/** Return whether keys in an element are text or a choice, not shortcuts. */
const isTyping = ({ tagName, type }) =>
  ["SELECT", "TEXTAREA"].includes(tagName) ||
  (tagName === "INPUT" && !["range", "checkbox", "radio"].includes(type));

/** Return whether a key without Ctrl acts on the focused element or a dialog, not on a panel. */
const isTaken = ({ target, key }) =>
  isTyping(target) ||
  Boolean(document.querySelector("dialog[open]")) ||
  (target.tagName === "BUTTON" && key === " ");

/**
 * Call the panels' functions for a key, one after the other, until one has used the key: it then
 * returns a value that is not false.
 */
function pressKey(designer, event) {
  const name = keyName(event);
  if (!name.startsWith("Ctrl+") && isTaken(event)) return;
  const acts = Object.values(designer.panels).map((panel) => panel.keys?.[name]);
  if (acts.some((act) => act && act() !== false)) event.preventDefault();
}

for (const panel of Object.values(panels)) insertMarkup(panel);
const designer = startDesigner();
for (const [name, panel] of Object.entries(panels))
  designer.panels[name] = panel.mount(designer) ?? {};
Object.assign(window, { designer, viewport: designer.viewport }); // for tests

for (const id of ["look", "rig"]) byId(id).addEventListener("change", () => designer.choose());
addEventListener("keydown", (event) => pressKey(designer, event));
new ResizeObserver(() => designer.resize()).observe(byId("stage"));
setInterval(() => designer.poll(), POLL);
designer.load("reading the scene…").catch((error) => designer.say(error.message, true));
