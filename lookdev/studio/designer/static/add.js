// @ts-check
// The dialog of presets: their pictures come one after another, so that the page's own requests
// never wait for them.

import { at, made, opened, spaced } from "./made.js";

let presets = null;
let wanted = [];
let fetching = false;
const pictures = new Map();
const NOTHING = "data:image/gif;base64,R0lGODlhAQABAIAAAAAAAP///yH5BAEAAAAALAAAAAABAAEAAAIBRAA7";

/** Return the name of the preset that is chosen, or "". */
export async function choosePreset(asked) {
  const dialog = at("adding");
  presets ??= (await asked("presets")).presets;
  const categories = [...new Set(presets.map((each) => each.category))].sort();
  at("adding-category").replaceChildren(
    new Option("all", ""),
    ...categories.map((each) => new Option(each, each)),
  );
  at("adding-search").value = "";
  const observer = new IntersectionObserver(
    (seen) => {
      for (const { isIntersecting, target } of seen) {
        if (isIntersecting) wanted.push(target);
        else wanted = wanted.filter((each) => each !== target);
      }
      next(dialog);
    },
    { root: at("adding-presets") },
  );
  const show = () => {
    const words = at("adding-search").value.trim().toLowerCase(),
      category = at("adding-category").value;
    const found = presets.filter(
      (each) =>
        (!category || each.category === category) &&
        `${spaced(each.name)} ${each.category} ${each.doc}`.toLowerCase().includes(words),
    );
    const rank = ({ name }) =>
      [
        spaced(name) === words,
        spaced(name).startsWith(words),
        spaced(name).includes(words),
        true,
      ].indexOf(true);
    if (words) found.sort((a, b) => rank(a) - rank(b));
    wanted = [];
    observer.disconnect();
    at("adding-presets").replaceChildren(
      ...found.map((each) => {
        const image = made("img", { width: 56, height: 56, alt: "" });
        image.dataset.name = each.name;
        image.src = pictures.get(each.name) ?? NOTHING;
        if (!pictures.has(each.name)) observer.observe(image);
        const choice = made(
          "button",
          { type: "submit", value: each.name, className: "preset", title: each.doc },
          image,
          made("span", { textContent: spaced(each.name) }),
          made("small", { textContent: each.model }),
        );
        return choice;
      }),
    );
    at("adding-none").hidden = found.length > 0;
  };
  at("adding-search").oninput = show;
  at("adding-search").onkeydown = (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    at("adding-presets").querySelector("button")?.click();
  };
  at("adding-category").onchange = show;
  const closed = opened(dialog); // pictures are asked for where they are seen
  show();
  at("adding-search").focus();
  const name = await closed;
  observer.disconnect();
  wanted = [];
  return name === "cancel" ? "" : name;
}

async function next(dialog) {
  if (fetching) return;
  fetching = true;
  while (dialog.open && wanted.length) {
    const image = wanted.shift();
    try {
      const answer = await fetch(`presets/${encodeURIComponent(image.dataset.name)}`);
      if (answer.ok) {
        pictures.set(image.dataset.name, URL.createObjectURL(await answer.blob()));
        image.src = pictures.get(image.dataset.name);
      }
    } catch {
      /* a preset without a picture is still one */
    }
  }
  fetching = false;
}

/** Ask for the name and category of a new preset, and save a layer as it; returns what to say. */
export async function savePreset(asked, look, layer) {
  at("preset-name").value = layer.name.replace(/([a-z])([A-Z])/g, "$1_$2").toLowerCase();
  const closed = opened(at("preset"));
  at("preset-name").select();
  if ((await closed) !== "save") return "";
  const body = {
    look,
    op: "preset",
    layer: layer.number,
    name: at("preset-name").value,
    category: at("preset-category").value,
  };
  const { file } = await asked("stack", body);
  presets = null;
  return `saved the preset ${file}`;
}
