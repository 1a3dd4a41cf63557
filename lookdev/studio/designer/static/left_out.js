// @ts-check
// The panel that lists the effects of light that the viewport's picture lacks.

import { byId, makeElement } from "./viewport/elements.js";

const aside = `
  <section>
    <details id="left-out"><summary>What this picture leaves out</summary><ul></ul></details>
  </section>`;

function mount({ viewport }) {
  let leftOut = [];
  let text = "";
  const show = () => {
    const names = [...leftOut];
    if (viewport.scene?.shadows && !viewport.settings.shadows)
      names.push("cast shadow: switched off");
    if (text === names.join()) return;
    text = names.join();
    const items = names.map((name) => makeElement("li", { textContent: name }));
    byId("left-out")
      .querySelector("ul")
      .replaceChildren(...items);
  };
  viewport.addEventListener("change", show);
  return {
    load({ left_out }) {
      leftOut = left_out;
      show();
    },
  };
}

export const panel = { markup: { aside }, mount };
