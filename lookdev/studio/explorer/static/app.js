// @ts-check
// The entry of the Explorer's page: its tabs of plots and their options, the selected surface with
// its sphere, keys, copying and saving. `words` of a surface are the text by which the command line
// and the server know it.
import { SphereRenderer } from "./ball.js";
import { byId, makeElement } from "./viewport/elements.js";
import { ExactFrame } from "./exact.js";
import { gl, isSupported, Shaders } from "./gl.js";
import { Link } from "./link.js";
import { LobeRenderer } from "./lobe.js";
import { showOffers, showSurfaces, watchFiles, watchSearch } from "./offers.js";
import { drawLatencies, frameLatencies, Plots, turnLight } from "./plots.js";
import { Sliders } from "./sliders.js";
import {
  addSurface,
  notify,
  colorOf,
  changedOptions,
  nameOf,
  onChange,
  option,
  pageUrl,
  readUrl,
  removeSurface,
  selectedSurface,
  setOption,
  visibleSurfaces,
  state,
  wordsOf,
} from "./state.js";
import { makeReport, verifySurfaces } from "./verify.js";
import { waitForGpu } from "./viewport/gl.js";

const status = byId("status"),
  dialog = byId("dialog");
let statusTimer = 0;
/** Show a message; a good one, which is not an error, disappears after a while. */
const say = (text, isGood = false) => {
  status.textContent = text;
  status.className = text && !isGood ? "bad" : "";
  clearTimeout(statusTimer);
  if (isGood)
    statusTimer = setTimeout(() => {
      status.textContent = "";
    }, 4000);
};

const KIND_TITLES = {
  slice: "Slice",
  polar: "Polar",
  lobe3d: "Lobe",
  cartesian: "Cartesian",
  albedo: "Albedo",
  sphere: "Sphere",
  retro: "Retro",
  fresnel: "Fresnel",
  difference: "Difference",
  sampling: "Sampling",
};
// The controls of options: [title] of a check box, [title, choices] of a select, or [title, lowest
// value, highest value, step, unit] of a slider.
const OPTIONS = {
  axis: ["Over", { theta_h: "θh", theta_d: "θd", theta_i: "θi" }],
  theta: ["θ", 0, 89.9, 0.5, "°"],
  phi: ["φ", -180, 180, 1, "°"],
  limit: ["Up to", 1, 90, 1, "°"],
  scale: ["Scale", { linear: "linear", sqrt: "square root", log: "log" }],
  angles: ["Angles", { linear: "linear", sqrt: "square root" }],
  channels: ["Channels", { luminance: "luminance", rgb: "red, green, blue" }],
  exposure: ["Exposure", -6, 6, 0.1, ""],
  cosine: ["× cos θi"],
  chroma: ["Chroma only"],
};

/**
 * Return the item that is `step` places after an item of a list; after the last comes the first.
 */
const stepIn = (list, item, step) => list[(list.indexOf(item) + step + list.length) % list.length];

const link = new Link(say);
let shaders, spheres, plots, sliders, exactFrame;

const showTabs = () => {
  byId("kinds").replaceChildren(
    ...Object.entries(state.catalogue.kinds).map(([name, { text }]) => {
      const tab = makeElement("button", {
        type: "button",
        textContent: KIND_TITLES[name] ?? name,
        title: text,
        id: `kind-${name}`,
        tabIndex: name === state.kind ? 0 : -1,
      });
      tab.setAttribute("role", "tab");
      tab.setAttribute("aria-selected", `${name === state.kind}`);
      tab.setAttribute("aria-controls", "stage");
      tab.addEventListener("click", () => {
        state.kind = name;
        notify("kind");
      });
      return tab;
    }),
  );
  byId("stage").setAttribute("aria-labelledby", `kind-${state.kind}`);
  const tabs = byId("kinds"),
    tab = byId(`kind-${state.kind}`);
  tabs.scrollLeft = tab.offsetLeft - tabs.offsetLeft - (tabs.clientWidth - tab.offsetWidth) / 2;
};

byId("kinds").addEventListener("keydown", (event) => {
  const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!step) return;
  state.kind = stepIn(Object.keys(state.catalogue.kinds), state.kind, step);
  notify("kind");
  byId(`kind-${state.kind}`).focus();
});

/** Return the title of an option, which may depend on the kind of plot. */
const optionTitle = (name) => {
  if (name !== "theta") return OPTIONS[name][0];
  if (state.kind === "cartesian")
    return { theta_h: "θd", theta_d: "θh", theta_i: "θo" }[option("axis")];
  return state.kind === "sphere" ? "Light θ" : "View θ";
};

/** Set an option; `held` is whether the pointer still moves the slider. */
const changeOption = (name, value, event, held) => {
  setOption(name, value);
  if (name === "axis") showOptions();
  notify("options", { moveTime: event.timeStamp, held });
};

const optionBox = (name) => {
  const box = makeElement("input", { type: "checkbox", checked: option(name) });
  box.addEventListener("change", (event) => changeOption(name, box.checked, event, false));
  return box;
};

const optionSelect = (name, choices) => {
  const select = document.createElement("select");
  for (const [value, textContent] of Object.entries(choices))
    select.append(makeElement("option", { value, textContent, selected: option(name) === value }));
  select.addEventListener("change", (event) => changeOption(name, select.value, event, false));
  return select;
};

/** Return the slider of an option, and the output that shows its value. */
const optionSlider = (name, [min, max, step, unit]) => {
  const slider = makeElement("input", { type: "range", min, max, step }),
    output = document.createElement("output");
  const showValue = () => {
    const value = Number(slider.value);
    output.textContent = `${value}${unit}`;
    slider.setAttribute("aria-valuetext", output.textContent);
    slider.style.setProperty("--share", `${(100 * (value - min)) / (max - min)}%`);
  };
  const change = (event, held) => {
    showValue();
    changeOption(name, Number(slider.value), event, held);
  };
  slider.value = option(name);
  showValue();
  slider.addEventListener("input", (event) => change(event, true));
  slider.addEventListener("change", (event) => change(event, false));
  return [slider, output];
};

const optionField = (name) => {
  const [, ...values] = OPTIONS[name],
    field = makeElement("label", { className: "field" }),
    label = makeElement("span", { textContent: optionTitle(name) });
  if (!values.length) field.append(optionBox(name), label);
  else if (typeof values[0] === "object") field.append(label, optionSelect(name, values[0]));
  else field.append(label, ...optionSlider(name, values));
  return field;
};

const showOptions = () => {
  const { uses } = state.catalogue.kinds[state.kind];
  const names = Object.keys(OPTIONS).filter((name) => uses.includes(name));
  byId("options").replaceChildren(...names.map(optionField));
};

/** Show the name, the sliders and the sphere of the selected surface. */
const showSelected = () => {
  const surface = selectedSurface(),
    right = byId("right");
  for (const id of ["viewport", "parameters"]) byId(id).hidden = !surface;
  byId("label").parentElement.hidden = !surface;
  right.style.setProperty("--accent", surface ? colorOf(surface) : "var(--quiet)");
  right.style.setProperty("--surface-color", surface ? colorOf(surface) : "var(--quiet)");
  byId("name").textContent = surface ? nameOf(surface) : "Nothing selected";
  byId("about").textContent = surface ? describeSurface(surface) : "";
  if (!surface) return;
  byId("label").value = surface.label;
  byId("label").placeholder = nameOf({ ...surface, label: "" });
  sliders.show(surface);
  showLight();
};

const describeSurface = (surface) => {
  const model = state.catalogue.models[surface.model],
    preset = state.catalogue.presets.find(({ name }) => name === surface.base);
  return [
    preset ? preset.doc.replace(/\.?$/, ".") : "",
    model?.text ?? (surface.look ? `A look: ${surface.title}.` : ""),
  ]
    .filter(Boolean)
    .join(" ");
};

let visibleLight = "";
const showLight = () => {
  const frame = exactFrame.frameOf(selectedSurface());
  visibleLight = frame && state.exact ? "exact" : state.light;
  for (const button of document.querySelectorAll("[data-light]")) {
    if (button.dataset.light === "exact") button.hidden = !frame;
    button.setAttribute("aria-checked", button.dataset.light === visibleLight);
    button.tabIndex = button.dataset.light === visibleLight ? 0 : -1;
  }
  drawBall();
};

const ball = byId("ball");
const SLOW_DRAW = 12; // milliseconds of drawing the sphere above which the driver counts as slow
const REST = 100; // milliseconds without a move after which the pointer rests
let ballFrame = 0,
  isDrawingBall = false,
  ballTimer = 0,
  lastMove = -Infinity; // time of the pointer's last move
// Milliseconds of the last three draws. The shortest is used: it has no compilation in it.
const ballTimes = [];
/** Draw the sphere of the selected surface in the next frame, until it has all its passes. */
const drawBall = () => {
  // With a slow graphics driver, the sphere waits until the pointer rests: the plot needs the same
  // processors.
  const isSlow = ballTimes.length && Math.min(...ballTimes) > SLOW_DRAW;
  const delay = isSlow ? lastMove + REST - performance.now() : 0;
  clearTimeout(ballTimer);
  if (delay > 0) {
    ballTimer = setTimeout(drawBall, delay);
    return;
  }
  ballFrame ||= requestAnimationFrame(async () => {
    ballFrame = 0;
    const surface = selectedSurface(),
      ratio = Math.min(devicePixelRatio, 2);
    const [width, height] = [ball.clientWidth, ball.clientHeight].map((side) =>
      Math.round(side * ratio),
    );
    if (!surface || !width || document.hidden) return;
    if (isDrawingBall) {
      drawBall();
      return;
    }
    if (ball.width !== width || ball.height !== height) [ball.width, ball.height] = [width, height];
    const context = ball.getContext("2d");
    if (visibleLight === "exact") {
      exactFrame.draw(context, width, height);
      return;
    }
    isDrawingBall = true;
    try {
      let began = 0;
      const lacksPasses = await spheres.draw(
        "ball",
        surface,
        visibleLight,
        width,
        height,
        option("exposure"),
        (source, x, y) => {
          began = performance.now();
          context.clearRect(0, 0, width, height);
          context.drawImage(source, x, y, width, height, 0, 0, width, height);
        },
      );
      await waitForGpu(gl);
      ballTimes.push(performance.now() - began);
      ballTimes.splice(0, ballTimes.length - 3);
      if (lacksPasses) drawBall();
      if (byId("facts").dataset.of === "ball")
        byId("facts").textContent = byId("facts").dataset.of = "";
    } catch (error) {
      context.clearRect(0, 0, width, height);
      byId("facts").textContent = error.message;
      byId("facts").dataset.of = "ball";
    }
    isDrawingBall = false;
  });
};

/** Add a surface by its words, and select it. */
const add = async (words) => {
  try {
    const surface = addSurface(await link.ask({ do: "describe", surface: words }));
    state.selected = state.surfaces.indexOf(surface);
    notify("surfaces");
  } catch (error) {
    say(error.message);
  }
};

/**
 * Get the values of a surface from the server after a change of a token, which can set other
 * parameters, as the name of a metal does.
 */
const updateValues = async (surface) => {
  try {
    const { values, words } = await link.ask({ do: "describe", surface: wordsOf(surface) });
    Object.assign(surface, { values, words, problem: "" });
  } catch (error) {
    surface.problem = error.message;
    say(error.message);
  }
  showSelected();
  plots.requestNumbers(surface, {});
  drawBall();
};

onChange((change, detail) => {
  if (change === "duplicate") {
    add(wordsOf(detail.surface, true));
    return;
  }
  if (change === "form") {
    updateValues(detail.surface);
    return;
  }
  if (change === "kind") {
    showTabs();
    showOptions();
  }
  if (["surfaces", "selected", "theme"].includes(change)) {
    showSurfaces();
    showSelected();
  }
  if (detail?.held) lastMove = performance.now();
  if (change === "parameter" && detail.surface === selectedSurface()) {
    if (state.exact) {
      state.exact = false;
      showLight();
    }
    // The texture coordinates of a look are constants of its shader, which is compiled only when
    // the pointer no longer holds the slider.
    if (!detail.held || !detail.surface.look) drawBall();
  }
  if (change === "options" || change === "light") drawBall();
  const title = `${selectedSurface() ? nameOf(selectedSurface()) : "Explorer"} · lookdev`;
  if (document.title !== title) document.title = title;
});

byId("label").addEventListener("input", () => {
  const surface = selectedSurface();
  surface.label = byId("label")
    .value.replace(/[=:@#/]/g, " ")
    .trim();
  byId("name").textContent = nameOf(surface);
  showSurfaces();
  notify("label");
});
for (const button of document.querySelectorAll("[data-light]")) {
  button.addEventListener("click", () => {
    state.exact = button.dataset.light === "exact";
    if (!state.exact) state.light = button.dataset.light;
    showLight();
    notify("light");
  });
  button.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key],
      buttons = [...document.querySelectorAll("[data-light]:not([hidden])")];
    if (step) {
      const other = stepIn(buttons, button, step);
      other.click();
      other.focus();
    }
  });
}
let lastPoint = null; // of the pointer, while it drags the sphere
const turnBallLight = (dx, dy) => {
  if (state.light !== "point" || state.exact) {
    state.light = "point";
    state.exact = false;
    showLight();
  }
  turnLight(dx, dy);
};
ball.addEventListener("pointerdown", (event) => {
  lastPoint = [event.clientX, event.clientY];
  ball.setPointerCapture(event.pointerId);
});
ball.addEventListener("pointermove", (event) => {
  if (lastPoint) {
    turnBallLight(event.clientX - lastPoint[0], event.clientY - lastPoint[1]);
    lastPoint = [event.clientX, event.clientY];
  }
});
for (const name of ["pointerup", "pointercancel"])
  ball.addEventListener(name, () => {
    lastPoint = null;
  });
ball.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: [-8, 0], ArrowRight: [8, 0], ArrowUp: [0, -8], ArrowDown: [0, 8] }[
    event.key
  ];
  if (step) {
    event.preventDefault();
    turnBallLight(...step);
  }
});
new ResizeObserver(drawBall).observe(ball);

const copyText = async (text, title) => {
  try {
    await navigator.clipboard.writeText(text);
    say(`${title} is copied.`, true);
  } catch {
    // Without the permission to write the clipboard, a dialog shows the text.
    const area = makeElement("textarea", { value: text, readOnly: true, rows: 14 });
    area.style.cssText = "width:100%;font:12px ui-monospace,monospace";
    showDialog(title, [area]);
    area.select();
  }
};
const showDialog = (title, parts) => {
  byId("dialog-title").textContent = title;
  byId("dialog-body").replaceChildren(...parts);
  if (!dialog.open) dialog.showModal();
};
/** Return a function that calls `act`, and shows the message of its error. */
const reportErrors = (act) => async () => {
  try {
    await act();
  } catch (error) {
    say(error.message);
  }
};

byId("copy-link").addEventListener("click", () =>
  copyText(new URL(pageUrl(), location.href).href, "The link"),
);
byId("copy-command").addEventListener(
  "click",
  reportErrors(async () =>
    copyText(
      (
        await link.ask({
          do: "command",
          kind: state.kind,
          surfaces: visibleSurfaces().map((surface) => wordsOf(surface, true)),
          options: changedOptions(),
        })
      ).text,
      "The command",
    ),
  ),
);
byId("copy-usd").addEventListener(
  "click",
  reportErrors(async () => {
    if (selectedSurface())
      await copyText(
        (await link.ask({ do: "usd", surface: wordsOf(selectedSurface()) })).text,
        "The look as USD",
      );
  }),
);

const menu = byId("save-menu"),
  save = byId("save");
const setMenuOpen = (open) => {
  menu.hidden = !open;
  save.setAttribute("aria-expanded", open);
  if (open) menu.querySelector("button").focus();
};
save.addEventListener("click", () => setMenuOpen(menu.hidden));
menu.addEventListener("keydown", (event) => {
  const items = [...menu.querySelectorAll("button")],
    step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (event.key === "Escape") {
    setMenuOpen(false);
    save.focus();
  }
  if (step) {
    event.preventDefault();
    stepIn(items, document.activeElement, step).focus();
  }
});
addEventListener("click", (event) => {
  if (!menu.hidden && !(/** @type {Element} */ (event.target).closest(".menu"))) setMenuOpen(false);
});
const download = (blob, name) => {
  const url = URL.createObjectURL(blob);
  makeElement("a", { href: url, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
};
for (const item of menu.querySelectorAll("[data-save]"))
  item.addEventListener(
    "click",
    reportErrors(async () => {
      setMenuOpen(false);
      const suffix = item.dataset.save;
      if (suffix === "shown") {
        await plots.paint();
        const plot = byId("plot"),
          picture = new OffscreenCanvas(plot.width, plot.height),
          context = picture.getContext("2d");
        context.fillStyle = getComputedStyle(byId("stage")).backgroundColor;
        context.fillRect(0, 0, picture.width, picture.height);
        context.drawImage(plot, 0, 0);
        download(await picture.convertToBlob({ type: "image/png" }), `${state.kind}.png`);
        return;
      }
      say(`Making ${state.kind}.${suffix} …`, true);
      const query = new URLSearchParams([
        ...visibleSurfaces().map((surface) => ["s", wordsOf(surface, true)]),
        ["options", JSON.stringify(changedOptions())],
      ]);
      const answer = await fetch(`save/${state.kind}.${suffix}?${query}`);
      if (!answer.ok) throw new Error((await answer.text()).trim());
      download(await answer.blob(), `${state.kind}.${suffix}`);
      say(`${state.kind}.${suffix} is saved.`, true);
    }),
  );

const runVerify = async () => {
  if (!isSupported) throw new Error("this browser has no WebGL 2 with float textures");
  byId("verify").disabled = true;
  try {
    const rows = await verifySurfaces(link, shaders);
    showDialog("The browser beside Python", makeReport(rows));
    document.body.dataset.verified = JSON.stringify(rows);
  } finally {
    byId("verify").disabled = false;
  }
};
byId("verify").addEventListener("click", reportErrors(runVerify));

const KEYS = [
  ["1 … 9, 0", "the kinds of plots"],
  ["[ ]", "the surface before, the next"],
  ["h", "hide or show the surface"],
  ["d", "duplicate it"],
  ["Delete", "remove it"],
  ["/", "find something to add"],
  ["Arrow keys", "on a plot, read its values; on a lobe or sphere, turn it or its light"],
  ["?", "this help"],
];
const HELP = [
  "Values in plots come from the float64 models in Python. Spheres and lobes are computed by " +
    "the browser, in float32, by code generated from the same models: Verify compares the two.",
  "The URL has the whole state of the page. Surfaces in it are words of the command line, " +
    "as for lookdev plot.",
];
const showHelp = () => {
  const table = document.createElement("table");
  for (const [key, text] of KEYS) {
    const row = table.insertRow();
    row.insertCell().append(makeElement("kbd", { textContent: key }));
    row.insertCell().textContent = text;
  }
  const paragraphs = HELP.map((textContent) => makeElement("p", { textContent }));
  showDialog("Explorer", [...paragraphs, table]);
};
byId("help").addEventListener("click", showHelp);
addEventListener("keydown", (event) => {
  if (
    /** @type {Element} */ (event.target).matches("input, select, textarea") ||
    event.ctrlKey ||
    event.metaKey ||
    event.altKey ||
    dialog.open
  )
    return;
  const kinds = Object.keys(state.catalogue?.kinds ?? {}),
    digit = "1234567890".indexOf(event.key),
    surface = selectedSurface();
  if (digit >= 0 && kinds[digit]) {
    state.kind = kinds[digit];
    notify("kind");
  } else if ((event.key === "[" || event.key === "]") && state.surfaces.length) {
    state.selected =
      (state.selected + (event.key === "]" ? 1 : -1) + state.surfaces.length) %
      state.surfaces.length;
    notify("selected");
  } else if (event.key === "h" && surface) {
    surface.hidden = !surface.hidden;
    notify("surfaces");
  } else if (event.key === "d" && surface) notify("duplicate", { surface });
  else if (event.key === "Delete" && surface) removeSurface(state.selected);
  else if (event.key === "/") {
    event.preventDefault();
    byId("search").focus();
  } else if (event.key === "?") showHelp();
});

/** Show the surfaces and options of the URL. */
const showUrl = async () => {
  const { words, selected, hidden } = readUrl();
  state.surfaces = [];
  const surfaces = await Promise.all(
    (words.length ? words : state.catalogue.first).map((name) =>
      link.ask({ do: "describe", surface: name }).catch((error) => {
        say(error.message);
        return null;
      }),
    ),
  );
  surfaces.forEach((surface, index) => {
    if (surface) addSurface(surface, hidden.includes(index));
  });
  state.selected = Math.min(selected, Math.max(0, state.surfaces.length - 1));
  showTabs();
  showOptions();
  notify("surfaces");
};

const startExplorer = async () => {
  state.catalogue = await (await fetch("start")).json();
  shaders = new Shaders(link, state.catalogue.models);
  spheres = new SphereRenderer(link, shaders);
  plots = new Plots(link, spheres, new LobeRenderer(shaders));
  sliders = new Sliders();
  exactFrame = new ExactFrame(link, () => {
    state.exact = true;
    showLight();
  });
  watchSearch(add);
  showOffers(add);
  watchFiles(add, say);
  await showUrl();
  addEventListener("hashchange", reportErrors(showUrl));
  if (!isSupported)
    say("This browser has no WebGL 2 with float textures: spheres and lobes are not drawn.");
  window.explorer = { state, drawLatencies, frameLatencies, plots, shaders, wordsOf }; // for tests
  document.body.dataset.ready = "true";
  if (new URLSearchParams(location.search).has("verify")) await runVerify();
};
startExplorer().catch((error) => say(error.message));
