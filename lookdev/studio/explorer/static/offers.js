// @ts-check
// The left side of the Explorer's page: the list of the surfaces in the plots, and the list of the
// models, presets, looks and files that the user can add as surfaces (offers).
import { makeElement } from "./viewport/elements.js";
import { colorOf, nameOf, notify, removeSurface, state } from "./state.js";

const surfaceList = document.getElementById("surfaces"),
  offers = document.getElementById("offers"),
  searchInput = document.getElementById("search");

// The paths of icons, in SVG.
const ICONS = {
  visible:
    "M1.5 8S4 3.5 8 3.5 14.5 8 14.5 8 12 12.5 8 12.5 1.5 8 1.5 8Z " +
    "M8 6a2 2 0 1 0 0 4 2 2 0 0 0 0-4Z",
  hidden: "M1.5 8S4 3.5 8 3.5 14.5 8 14.5 8 12 12.5 8 12.5 1.5 8 1.5 8Z M2.5 13.5 13.5 2.5",
  copy: "M5.5 5.5h8v8h-8z M3.5 10.5h-1v-8h8v1",
  remove: "M3.5 3.5l9 9 M12.5 3.5l-9 9",
};
const makeIcon = (name) => {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"),
    path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
};
const makeIconButton = (name, label, act) => {
  const element = makeButton("", label, act);
  element.append(makeIcon(name));
  return element;
};

const makeButton = (text, label, act, className = "plain") => {
  const element = makeElement("button", { type: "button", className, textContent: text });
  if (label) {
    element.setAttribute("aria-label", label);
    element.title = label;
  }
  element.addEventListener("click", act);
  return element;
};

/** Show the list of the surfaces in the plots. */
export const showSurfaces = () => {
  surfaceList.replaceChildren(
    ...state.surfaces.map((surface, index) => {
      const item = document.createElement("li"),
        selectButton = makeButton(
          "",
          "",
          () => {
            state.selected = index;
            notify("selected");
          },
          "select",
        );
      item.style.setProperty("--surface-color", colorOf(surface));
      item.classList.toggle("selected", index === state.selected);
      item.classList.toggle("hidden", surface.hidden);
      selectButton.setAttribute("aria-current", `${index === state.selected}`);
      selectButton.append(
        makeElement("span", { className: "chip" }),
        makeElement("span", { textContent: nameOf(surface), title: nameOf(surface) }),
      );
      item.append(
        selectButton,
        makeIconButton(
          surface.hidden ? "hidden" : "visible",
          `${surface.hidden ? "Show" : "Hide"} ${nameOf(surface)}`,
          () => {
            surface.hidden = !surface.hidden;
            notify("surfaces");
          },
        ),
        makeIconButton("copy", `Duplicate ${nameOf(surface)}`, () =>
          notify("duplicate", { surface }),
        ),
        makeIconButton("remove", `Remove ${nameOf(surface)}`, () => removeAndFocus(index)),
      );
      return item;
    }),
  );
};

const removeAndFocus = (index) => {
  removeSurface(index);
  (surfaceList.querySelector(".selected .select") ?? searchInput).focus();
};

// Return the groups of offers: [title, entries] of each. An entry is [words, name, description],
// where `words` is the text of the surface on the command line.
const offerGroups = () => {
  const { models, presets, looks, measured } = state.catalogue,
    /** @type {[string, any[][]][]} */
    groups = [
      [
        "models",
        Object.entries(models)
          .filter(([name]) => name !== "measured")
          .map(([name, model]) => [name, model.title, model.text]),
      ],
    ];
  const byCategory = Map.groupBy
    ? Map.groupBy(presets, ({ category }) => category)
    : presets.reduce(
        (all, preset) => all.set(preset.category, [...(all.get(preset.category) ?? []), preset]),
        new Map(),
      );
  for (const [category, members] of byCategory)
    groups.push([
      category,
      members.map(({ name, doc, model }) => [name, name.replaceAll("_", " "), `${doc} (${model})`]),
    ]);
  groups.push(
    ["looks", looks.map((look) => [look, look, "a look"])],
    [
      "measured",
      [
        ["measured:file=builtin:plastic", "synthetic plastic", models.measured.text],
        ...measured.map((file) => [
          file,
          file.replace(/^uploads\/[0-9a-f]{8}-/, ""),
          models.measured.text,
        ]),
      ],
    ],
  );
  return groups;
};

/** Show the offers that contain the searched text; `add` is called with the words of one. */
export const showOffers = (add) => {
  const search = searchInput.value.trim().toLowerCase(),
    elements = [];
  for (const [title, entries] of offerGroups()) {
    const matches = entries.filter(
      ([words, name, text]) =>
        !search || `${words} ${name} ${title} ${text}`.toLowerCase().includes(search),
    );
    if (matches.length)
      elements.push(
        makeElement("h3", { textContent: title }),
        ...matches.map(([words, name, text]) => {
          const offer = makeButton(name, "", () => add(words), "offer");
          offer.title = text;
          return offer;
        }),
      );
  }
  if (!elements.length)
    elements.push(
      makeElement("p", {
        className: "none",
        textContent: "Nothing has that name. Enter adds the words as they are.",
      }),
    );
  offers.replaceChildren(...elements);
};

/** Show offers while the user types. Enter adds the first offer, or the typed words. */
export const watchSearch = (add) => {
  searchInput.addEventListener("input", () => showOffers(add));
  searchInput.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !searchInput.value.trim()) return;
    const first = offers.querySelector(".offer"),
      words = searchInput.value.trim();
    if (first && !words.includes(":") && !words.includes("=")) first.click();
    else add(words);
    searchInput.value = "";
    showOffers(add);
  });
};

/** Upload a file; return its name on the server. `showProgress` is called with a fraction. */
const upload = (file, showProgress) =>
  new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", `upload?name=${encodeURIComponent(file.name)}`);
    request.responseType = "json";
    request.upload.onprogress = ({ loaded, total }) => showProgress(total ? loaded / total : 0);
    request.onload = () =>
      request.status === 200
        ? resolve(request.response.name)
        : reject(new Error(request.response?.error ?? `the server refuses it (${request.status})`));
    request.onerror = () =>
      reject(new Error(`${file.name}: the server refuses it, or does not answer`));
    request.send(file);
  });

/** Upload files, and add each as a surface; `say` shows the message of an error. */
const addFiles = async (files, add, say) => {
  const bar = document.getElementById("uploading");
  const showProgress = (share) => {
    bar.value = share;
  };
  bar.hidden = false;
  for (const file of files) {
    showProgress(0);
    try {
      if (file.size > state.catalogue.largestUpload)
        throw new Error(
          `${file.name} has ${(file.size / 2 ** 20).toFixed(0)} MiB; ` +
            `at most ${state.catalogue.largestUpload / 2 ** 20} MiB are taken`,
        );
      const name = await upload(file, showProgress);
      if (!state.catalogue.measured.includes(name)) state.catalogue.measured.push(name);
      await add(name);
      showOffers(add);
    } catch (error) {
      say(error.message);
    }
  }
  bar.hidden = true;
};

/**
 * Call a function with the files that the user drops on the page, which a veil covers meanwhile.
 */
const watchDrags = (send) => {
  const veil = document.getElementById("veil");
  let depth = 0;
  const hasFiles = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  addEventListener("dragenter", (event) => {
    if (hasFiles(event)) {
      depth++;
      veil.hidden = false;
      event.preventDefault();
    }
  });
  addEventListener("dragleave", (event) => {
    if (hasFiles(event) && --depth <= 0) {
      depth = 0;
      veil.hidden = true;
    }
  });
  addEventListener("dragover", (event) => {
    if (hasFiles(event)) event.preventDefault();
  });
  addEventListener("drop", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault();
    depth = 0;
    veil.hidden = true;
    send([...event.dataTransfer.files]);
  });
};

// Add files that the user drops or chooses.
export const watchFiles = (add, say) => {
  const input = document.getElementById("file"),
    send = (files) => addFiles(files, add, say);
  watchDrags(send);
  document.getElementById("choose").addEventListener("click", () => input.click());
  input.addEventListener("change", () => {
    send([...input.files]);
    input.value = "";
  });
};
