// @ts-check
// The panel of undo and redo: two buttons, whose tooltips name the step.

import { byId } from "./viewport/elements.js";

const header = `
  <button type="button" id="undo" title="Undo (Ctrl+Z)" disabled>Undo</button>
  <button type="button" id="redo" title="Redo (Ctrl+Shift+Z)" disabled>Redo</button>`;

function mount(designer) {
  const undo = () => designer.request("history", { redo: false });
  const redo = () => designer.request("history", { redo: true });
  byId("undo").addEventListener("click", undo);
  byId("redo").addEventListener("click", redo);
  return {
    keys: { "Ctrl+z": undo, "Ctrl+Shift+z": redo, "Ctrl+y": redo, "Ctrl+Shift+y": redo },
    update({ undoes, redoes }) {
      byId("undo").disabled = undoes === null;
      byId("undo").title = undoes === null ? "Nothing to undo" : `Undo: ${undoes} (Ctrl+Z)`;
      byId("redo").disabled = redoes === null;
      byId("redo").title =
        redoes === null ? "Nothing to do again" : `Redo: ${redoes} (Ctrl+Shift+Z)`;
    },
  };
}

export const panel = { markup: { header }, mount };
