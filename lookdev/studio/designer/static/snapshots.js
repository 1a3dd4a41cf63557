// @ts-check
// The panel of snapshots, which are pictures with the state of the looks. A dialog compares two
// pictures, and the user can go back to the state of one.

import { byId, formatTime, openDialog } from "./viewport/elements.js";

const header = `
  <button type="button" id="snapshot"
    title="Keep a picture and the state of the looks">Snapshot</button>
  <button type="button" id="compare"
    title="Compare snapshots side by side, and go back to one">Compare…</button>`;

const figure = (id, label) => `
  <figure id="${id}"><select aria-label="${label}"></select><img alt=""><div class="tools">
    <button type="button" class="show">Go back to this</button>
    <button type="button" class="drop">Forget</button></div></figure>`;
const body = `
  <dialog id="comparing" aria-label="Snapshots">
    <form method="dialog">
      <div class="sides">${figure("left", "Left picture")}${figure("right", "Right picture")}</div>
      <menu><button value="">Close</button></menu>
    </form>
  </dialog>`;

/**
 * Fill a side of the dialog, by its id, with a choice of the snapshots and of `picture`, which the
 * viewport shows now. `first` is the value of the choice at first: a number, or "" for now.
 */
function fillSide(id, snapshots, first, picture, { goBack, drop }) {
  const side = byId(id),
    choice = side.querySelector("select"),
    image = side.querySelector("img");
  const label = ({ name, time, look }) => `${name}, ${formatTime(time)}, ${look}`;
  const options = snapshots.map((snapshot) => new Option(label(snapshot), snapshot.number));
  choice.replaceChildren(new Option("now", ""), ...options);
  choice.value = first;
  const show = () => {
    image.src = choice.value ? `snapshots/${choice.value}` : picture;
    image.alt = choice.selectedOptions[0].textContent;
    for (const button of side.querySelectorAll("button")) button.disabled = !choice.value;
  };
  const close = (act) => () => {
    byId("comparing").close();
    act(Number(choice.value));
  };
  choice.onchange = show;
  side.querySelector(".show").onclick = close(goBack);
  side.querySelector(".drop").onclick = close(drop);
  show();
}

function mount(designer) {
  const { canvas } = designer;
  const store = (picture) => designer.request("picture", picture, "kept a snapshot");
  byId("snapshot").addEventListener("click", () => canvas.toBlob(store, "image/png"));
  const acts = {
    goBack: (number) =>
      designer.request("snapshots", { do: "show", number }, `back at snapshot ${number}`),
    drop: (number) => designer.request("snapshots", { do: "drop", number }),
  };
  byId("compare").addEventListener("click", () => {
    const { snapshots } = designer.scene,
      picture = canvas.toDataURL("image/png");
    fillSide("left", snapshots, String(snapshots.at(-1)?.number ?? ""), picture, acts);
    fillSide("right", snapshots, "", picture, acts);
    openDialog(byId("comparing"));
  });
  return {
    update({ snapshots }) {
      byId("compare").textContent = snapshots.length
        ? `Compare (${snapshots.length})…`
        : "Compare…";
    },
  };
}

export const panel = { markup: { header, body }, mount };
