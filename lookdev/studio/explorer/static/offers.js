// @ts-check
// The left side: the surfaces in the plots, and what can be added to them.
import { changed, colorOf, nameOf, state } from "./state.js";

const list = document.getElementById("surfaces"),
  offers = document.getElementById("offers"),
  find = document.getElementById("find");

const ICONS = {
  shown:
    "M1.5 8S4 3.5 8 3.5 14.5 8 14.5 8 12 12.5 8 12.5 1.5 8 1.5 8Z " +
    "M8 6a2 2 0 1 0 0 4 2 2 0 0 0 0-4Z",
  hidden: "M1.5 8S4 3.5 8 3.5 14.5 8 14.5 8 12 12.5 8 12.5 1.5 8 1.5 8Z M2.5 13.5 13.5 2.5",
  copy: "M5.5 5.5h8v8h-8z M3.5 10.5h-1v-8h8v1",
  remove: "M3.5 3.5l9 9 M12.5 3.5l-9 9",
};
const icon = (name) => {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"),
    path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("aria-hidden", "true");
  path.setAttribute("d", ICONS[name]);
  svg.append(path);
  return svg;
};
const iconButton = (name, label, act) => {
  const made = button("", label, act);
  made.append(icon(name));
  return made;
};

const button = (text, label, act, className = "plain") => {
  const made = Object.assign(document.createElement("button"), {
    type: "button",
    className,
    textContent: text,
  });
  if (label) {
    made.setAttribute("aria-label", label);
    made.title = label;
  }
  made.addEventListener("click", act);
  return made;
};

export const showSurfaces = () => {
  list.replaceChildren(
    ...state.surfaces.map((surface, index) => {
      const item = document.createElement("li"),
        pick = button(
          "",
          "",
          () => {
            state.selected = index;
            changed("selected");
          },
          "pick",
        );
      item.style.setProperty("--own", colorOf(surface));
      item.classList.toggle("selected", index === state.selected);
      item.classList.toggle("hidden", surface.hidden);
      pick.setAttribute("aria-current", `${index === state.selected}`);
      pick.append(
        Object.assign(document.createElement("span"), { className: "chip" }),
        Object.assign(document.createElement("span"), {
          textContent: nameOf(surface),
          title: nameOf(surface),
        }),
      );
      item.append(
        pick,
        iconButton(
          surface.hidden ? "hidden" : "shown",
          `${surface.hidden ? "Show" : "Hide"} ${nameOf(surface)}`,
          () => {
            surface.hidden = !surface.hidden;
            changed("surfaces");
          },
        ),
        iconButton("copy", `Duplicate ${nameOf(surface)}`, () => changed("duplicate", { surface })),
        iconButton("remove", `Remove ${nameOf(surface)}`, () => remove(index)),
      );
      return item;
    }),
  );
};

export const remove = (index) => {
  state.surfaces.splice(index, 1);
  state.selected = Math.max(
    0,
    Math.min(state.selected - (index < state.selected ? 1 : 0), state.surfaces.length - 1),
  );
  changed("surfaces");
  (list.querySelector(".selected .pick") ?? find).focus();
};

// Everything that can be added, in groups; the words are those of the command line.
const groups = () => {
  const { models, presets, looks, measured } = state.offered,
    /** @type {[string, any[][]][]} */
    found = [
      [
        "models",
        Object.entries(models)
          .filter(([name]) => name !== "measured")
          .map(([name, model]) => [name, model.title, model.text]),
      ],
    ];
  const byCategory = Map.groupBy
    ? Map.groupBy(presets, (each) => each.category)
    : presets.reduce(
        (all, each) => all.set(each.category, [...(all.get(each.category) ?? []), each]),
        new Map(),
      );
  for (const [category, each] of byCategory)
    found.push([
      category,
      each.map(({ name, doc, model }) => [name, name.replaceAll("_", " "), `${doc} (${model})`]),
    ]);
  found.push(
    ["looks", looks.map((each) => [each, each, "a look"])],
    [
      "measured",
      [
        ["measured:file=builtin:plastic", "synthetic plastic", models.measured.text],
        ...measured.map((each) => [
          each,
          each.replace(/^uploads\/[0-9a-f]{8}-/, ""),
          models.measured.text,
        ]),
      ],
    ],
  );
  return found;
};

export const showOffers = (add) => {
  const wanted = find.value.trim().toLowerCase(),
    shown = [];
  for (const [title, entries] of groups()) {
    const fitting = entries.filter(
      ([words, name, text]) =>
        !wanted || `${words} ${name} ${title} ${text}`.toLowerCase().includes(wanted),
    );
    if (fitting.length)
      shown.push(
        Object.assign(document.createElement("h3"), { textContent: title }),
        ...fitting.map(([words, name, text]) => {
          const made = button(name, "", () => add(words), "offer");
          made.title = text;
          return made;
        }),
      );
  }
  if (!shown.length)
    shown.push(
      Object.assign(document.createElement("p"), {
        className: "none",
        textContent: "Nothing has that name. Enter adds the words as they are.",
      }),
    );
  offers.replaceChildren(...shown);
};

export const watchOffers = (add) => {
  find.addEventListener("input", () => showOffers(add));
  find.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || !find.value.trim()) return;
    const first = offers.querySelector(".offer"),
      words = find.value.trim();
    if (first && !words.includes(":") && !words.includes("=")) first.click();
    else add(words);
    find.value = "";
    showOffers(add);
  });
};

// Files that are dropped or chosen go to the server, and become surfaces.
export const watchDrops = (add, tell) => {
  const veil = document.getElementById("veil"),
    input = document.getElementById("file"),
    bar = document.getElementById("uploading");
  let depth = 0;
  const has = (event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  addEventListener("dragenter", (event) => {
    if (has(event)) {
      depth++;
      veil.hidden = false;
      event.preventDefault();
    }
  });
  addEventListener("dragleave", (event) => {
    if (has(event) && --depth <= 0) {
      depth = 0;
      veil.hidden = true;
    }
  });
  addEventListener("dragover", (event) => {
    if (has(event)) event.preventDefault();
  });
  addEventListener("drop", (event) => {
    if (!has(event)) return;
    event.preventDefault();
    depth = 0;
    veil.hidden = true;
    send([...event.dataTransfer.files]);
  });
  document.getElementById("choose").addEventListener("click", () => input.click());
  input.addEventListener("change", () => {
    send([...input.files]);
    input.value = "";
  });
  const sent = (file) =>
    new Promise((done, fail) => {
      const request = new XMLHttpRequest();
      request.open("POST", `upload?name=${encodeURIComponent(file.name)}`);
      request.responseType = "json";
      request.upload.onprogress = ({ loaded, total }) => {
        bar.value = total ? loaded / total : 0;
      };
      request.onload = () =>
        request.status === 200
          ? done(request.response.name)
          : fail(new Error(request.response?.error ?? `the server refuses it (${request.status})`));
      request.onerror = () =>
        fail(new Error(`${file.name}: the server refuses it, or does not answer`));
      request.send(file);
    });
  const send = async (files) => {
    bar.hidden = false;
    for (const file of files) {
      bar.value = 0;
      try {
        if (file.size > state.offered.largestUpload)
          throw new Error(
            `${file.name} has ${(file.size / 2 ** 20).toFixed(0)} MiB; ` +
              `at most ${state.offered.largestUpload / 2 ** 20} MiB are taken`,
          );
        const name = await sent(file);
        if (!state.offered.measured.includes(name)) state.offered.measured.push(name);
        await add(name);
        showOffers(add);
      } catch (error) {
        tell(error.message);
      }
    }
    bar.hidden = true;
  };
};
