// @ts-check
// The dialogs of presets: in one, the user chooses a preset of the library by its picture, in the
// other, the user saves a layer as a preset.

import { byId, makeElement, makeOptions, openDialog, spaceWords } from "./viewport/elements.js";

const body = `
  <dialog id="adding" aria-label="Add a layer">
    <form method="dialog">
      <div class="tools">
        <label>Find
          <input type="text" id="adding-search" autocomplete="off" spellcheck="false"></label>
        <label>Category <select id="adding-category"></select></label>
        <button value="cancel">Cancel</button>
      </div>
      <div id="adding-presets"></div>
      <p id="adding-none" hidden>No preset has these words.</p>
    </form>
  </dialog>
  <dialog id="preset" aria-label="Save as a preset">
    <form method="dialog">
      <label>Name of the preset, for instance red_rubber
        <input type="text" id="preset-name" autocomplete="off" spellcheck="false"></label>
      <label>Category
        <input type="text" id="preset-category" autocomplete="off" value="own"></label>
      <p>It has the layer's constants, without its mask, in the first folder of the library.</p>
      <menu class="reversed"><button value="save">Save</button>
        <button value="cancel">Cancel</button></menu>
    </form>
  </dialog>`;

const SIZE = 56; // pixels of a picture
// A transparent picture of one pixel, in place of a preset's picture until that is fetched.
const EMPTY = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7";

/** The presets of the library; null until they are fetched. */
let presets = null;

/** The pictures of presets, which are fetched one at a time, so that other requests do not wait. */
class Pictures {
  constructor() {
    /** The URLs of the pictures that are fetched, by the names of their presets. */
    this.urls = new Map();
    /** Images that are in view and have no picture yet. */
    this.queue = [];
    this.fetching = false;
  }

  /** Fetch pictures of images from now on when the images scroll into view in an element. */
  watch(root) {
    this.observer = new IntersectionObserver(
      (entries) => {
        for (const { isIntersecting, target } of entries) {
          if (isIntersecting) this.queue.push(target);
          else this.queue = this.queue.filter((image) => image !== target);
        }
        this.fetchQueue();
      },
      { root },
    );
  }

  /** Return the image of a preset, whose picture is fetched when the image comes into view. */
  makeImage(name) {
    const image = makeElement("img", { width: SIZE, height: SIZE, alt: "" });
    image.dataset.name = name;
    image.src = this.urls.get(name) ?? EMPTY;
    if (!this.urls.has(name)) this.observer.observe(image);
    return image;
  }

  clear() {
    this.queue = [];
    this.observer.disconnect();
  }

  async fetchQueue() {
    if (this.fetching) return;
    this.fetching = true;
    while (this.queue.length) {
      const image = this.queue.shift(),
        { name } = image.dataset;
      try {
        const answer = await fetch(`presets/${encodeURIComponent(name)}`);
        if (answer.ok) {
          this.urls.set(name, URL.createObjectURL(await answer.blob()));
          image.src = this.urls.get(name);
        }
      } catch {
        /* a preset without a picture can be chosen as well */
      }
    }
    this.fetching = false;
  }
}

const pictures = new Pictures();

/**
 * Return the presets of a category, or of all, whose name, category or description contains a
 * text. Presets whose name contains the text come first.
 */
function findPresets(words, category) {
  const matches = presets.filter(
    (preset) =>
      (!category || preset.category === category) &&
      `${spaceWords(preset.name)} ${preset.category} ${preset.doc}`.toLowerCase().includes(words),
  );
  const rank = (preset) => {
    const name = spaceWords(preset.name);
    return [name === words, name.startsWith(words), name.includes(words), true].indexOf(true);
  };
  return words ? matches.sort((a, b) => rank(a) - rank(b)) : matches;
}

/** Show the presets with the searched words in the dialog. */
function showPresets() {
  const words = byId("adding-search").value.trim().toLowerCase();
  const matches = findPresets(words, byId("adding-category").value);
  pictures.clear();
  byId("adding-presets").replaceChildren(
    ...matches.map(({ name, model, doc }) =>
      makeElement(
        "button",
        { type: "submit", value: name, className: "preset", title: doc },
        pictures.makeImage(name),
        makeElement("span", { textContent: spaceWords(name) }),
        makeElement("small", { textContent: model }),
      ),
    ),
  );
  byId("adding-none").hidden = matches.length > 0;
}

/** Return the name of the preset that the user chooses, or "". */
export async function choosePreset(designer) {
  presets ??= (await designer.fetchJson("presets")).presets;
  const categories = [...new Set(presets.map(({ category }) => category))].sort();
  byId("adding-category").replaceChildren(new Option("all", ""), ...makeOptions(categories));
  byId("adding-search").value = "";
  pictures.watch(byId("adding-presets"));
  const closed = openDialog(byId("adding")); // before the images, which load when they are in view
  showPresets();
  byId("adding-search").focus();
  const name = await closed;
  pictures.clear();
  return name === "cancel" ? "" : name;
}

/**
 * Ask for name and category of a new preset, and save a layer as this preset. Returns a message, or
 * "" for a cancel.
 */
export async function savePreset(designer, look, layer) {
  byId("preset-name").value = layer.name.replace(/([a-z])([A-Z])/g, "$1_$2").toLowerCase();
  const closed = openDialog(byId("preset"));
  byId("preset-name").select();
  if ((await closed) !== "save") return "";
  const name = byId("preset-name").value,
    category = byId("preset-category").value;
  const request = { look, op: "preset", layer: layer.number, name, category };
  const { file } = await designer.fetchJson("stack", request);
  presets = null;
  return `saved the preset ${file}`;
}

function mount() {
  byId("adding-search").oninput = showPresets;
  byId("adding-category").onchange = showPresets;
  byId("adding-search").onkeydown = (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    byId("adding-presets").querySelector("button")?.click();
  };
}

export const panel = { markup: { body }, mount };
