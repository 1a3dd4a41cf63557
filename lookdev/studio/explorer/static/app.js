// @ts-check
// The page: what is where, what happens when something changes, keys, copying and saving.
import { Balls } from "./ball.js";
import { Exact } from "./exact.js";
import { gl, Shaders, whenDrawn, works } from "./gl.js";
import { Link } from "./link.js";
import { Lobes } from "./lobe.js";
import { showOffers, showSurfaces, watchDrops, watchOffers } from "./offers.js";
import { latencies, Plots, shown, turnLight } from "./plots.js";
import { Sliders } from "./sliders.js";
import {
  addSurface,
  notify,
  colorOf,
  changedOptions,
  nameOf,
  onChange,
  option,
  readUrl,
  selectedSurface,
  setOption,
  visibleSurfaces,
  state,
  urlOf,
  wordsOf,
} from "./state.js";
import { verdict, verify } from "./verify.js";

const $ = (id) => document.getElementById(id);
const status = $("status"),
  dialog = $("dialog");
let fading = 0;
const say = (text, good = false) => {
  status.textContent = text;
  status.className = text && !good ? "bad" : "";
  clearTimeout(fading);
  if (good)
    fading = setTimeout(() => {
      status.textContent = "";
    }, 4000);
};

const NAMES = {
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

const link = new Link((text, good) => say(text, good));
let shaders, balls, plots, sliders, exact;

const showKinds = () => {
  $("kinds").replaceChildren(
    ...Object.entries(state.offered.kinds).map(([name, { text }]) => {
      const tab = Object.assign(document.createElement("button"), {
        type: "button",
        textContent: NAMES[name] ?? name,
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
  $("stage").setAttribute("aria-labelledby", `kind-${state.kind}`);
  const tabs = $("kinds"),
    tab = $(`kind-${state.kind}`);
  tabs.scrollLeft = tab.offsetLeft - tabs.offsetLeft - (tabs.clientWidth - tab.offsetWidth) / 2;
};

$("kinds").addEventListener("keydown", (event) => {
  const names = Object.keys(state.offered.kinds),
    step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!step) return;
  state.kind = names[(names.indexOf(state.kind) + step + names.length) % names.length];
  notify("kind");
  $(`kind-${state.kind}`).focus();
});

const makeElement = (tag, properties = {}) =>
  Object.assign(document.createElement(tag), properties);

/** The name of an option, which may be of the kind of the plot. */
const optionTitle = (name) => {
  if (name !== "theta") return OPTIONS[name][0];
  if (state.kind === "cartesian")
    return { theta_h: "θd", theta_d: "θh", theta_i: "θo" }[option("axis")];
  return state.kind === "sphere" ? "Light θ" : "View θ";
};

const changeOption = (name, value, event, held) => {
  setOption(name, value);
  if (name === "axis") showOptions();
  notify("options", { since: event.timeStamp, held });
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

/** Return the slider of an option, and the output of its value. */
const optionSlider = (name, [min, max, step, unit]) => {
  const slider = makeElement("input", { type: "range", min, max, step }),
    output = document.createElement("output");
  const put = () => {
    const value = Number(slider.value);
    output.textContent = `${value}${unit}`;
    slider.setAttribute("aria-valuetext", output.textContent);
    slider.style.setProperty("--at", `${(100 * (value - min)) / (max - min)}%`);
  };
  const move = (held) => (event) => {
    put();
    changeOption(name, Number(slider.value), event, held);
  };
  slider.value = option(name);
  put();
  slider.addEventListener("input", move(true));
  slider.addEventListener("change", move(false));
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
  const { uses } = state.offered.kinds[state.kind];
  const names = Object.keys(OPTIONS).filter((name) => uses.includes(name));
  $("options").replaceChildren(...names.map(optionField));
};

const showSubject = () => {
  const surface = selectedSurface(),
    right = $("right");
  for (const id of ["viewport", "parameters"]) $(id).hidden = !surface;
  $("label").parentElement.hidden = !surface;
  right.style.setProperty("--accent", surface ? colorOf(surface) : "var(--quiet)");
  right.style.setProperty("--own", surface ? colorOf(surface) : "var(--quiet)");
  $("name").textContent = surface ? nameOf(surface) : "Nothing selected";
  $("about").textContent = surface ? about(surface) : "";
  if (!surface) return;
  $("label").value = surface.label;
  $("label").placeholder = nameOf({ ...surface, label: "" });
  sliders.show(surface);
  showLight();
};

const about = (surface) => {
  const model = state.offered.models[surface.model],
    preset = state.offered.presets.find(({ name }) => name === surface.base);
  return [
    preset ? `${preset.doc.replace(/\.?$/, ".")}` : "",
    model?.text ?? (surface.look ? `A look: ${surface.title}.` : ""),
  ]
    .filter(Boolean)
    .join(" ");
};

let visibleLight = "";
const showLight = () => {
  const frame = exact.of(selectedSurface());
  visibleLight = frame && state.exact ? "exact" : state.light;
  for (const button of document.querySelectorAll("[data-light]")) {
    if (button.dataset.light === "exact") button.hidden = !frame;
    button.setAttribute("aria-checked", button.dataset.light === visibleLight);
    button.tabIndex = button.dataset.light === visibleLight ? 0 : -1;
  }
  drawBall();
};

const ball = $("ball");
const SLOW = 12,
  REST = 100; // milliseconds of a draw that is slow; and without a move, after which a hand rests
let ballFrame = 0,
  ballBusy = false,
  ballLater = 0,
  handMoved = -Infinity;
// of the last draws: the least is free of compilation and of other programs' work
const ballCosts = [];
const drawBall = () => {
  // Of a slow graphics driver the sphere waits until the hand rests: the plot is computed and shown
  // by the same cores.
  const left =
    Math.min(...ballCosts) > SLOW && ballCosts.length ? handMoved + REST - performance.now() : 0;
  clearTimeout(ballLater);
  if (left > 0) {
    ballLater = setTimeout(drawBall, left);
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
    if (ballBusy) {
      drawBall();
      return;
    }
    if (ball.width !== width || ball.height !== height) [ball.width, ball.height] = [width, height];
    const context = ball.getContext("2d");
    if (visibleLight === "exact") {
      exact.draw(context, width, height);
      return;
    }
    ballBusy = true;
    try {
      let began = 0;
      const more = await balls.draw(
        "ball",
        surface,
        visibleLight,
        width,
        height,
        option("exposure"),
        (from, x, y) => {
          began = performance.now();
          context.clearRect(0, 0, width, height);
          context.drawImage(from, x, y, width, height, 0, 0, width, height);
        },
      );
      await whenDrawn();
      ballCosts.push(performance.now() - began);
      ballCosts.splice(0, ballCosts.length - 3);
      if (more) drawBall();
      if ($("facts").dataset.of === "ball") $("facts").textContent = $("facts").dataset.of = "";
    } catch (error) {
      context.clearRect(0, 0, width, height);
      $("facts").textContent = error.message;
      $("facts").dataset.of = "ball";
    }
    ballBusy = false;
  });
};

const add = async (words, { select = true, hidden = false } = {}) => {
  try {
    const surface = addSurface({ ...(await link.ask({ do: "describe", surface: words })) }, hidden);
    if (select) state.selected = state.surfaces.indexOf(surface);
    if (select) notify("surfaces");
    return surface;
  } catch (error) {
    say(error.message);
    return null;
  }
};

// Of a surface whose form has notify, values follow: a metal's name stands for others.
const reform = async (surface) => {
  try {
    const { values, words } = await link.ask({ do: "describe", surface: wordsOf(surface) });
    Object.assign(surface, { values, words, problem: "" });
  } catch (error) {
    surface.problem = error.message;
    say(error.message);
  }
  showSubject();
  plots.ask(surface, {});
  drawBall();
};

onChange((change, detail) => {
  if (change === "duplicate") {
    add(wordsOf(detail.surface, true));
    return;
  }
  if (change === "form") {
    reform(detail.surface);
    return;
  }
  if (change === "kind") {
    showKinds();
    showOptions();
  }
  if (change === "surfaces" || change === "selected") {
    showSurfaces();
    showSubject();
  }
  if (change === "theme") {
    showSurfaces();
    showSubject();
  }
  if (detail?.held) handMoved = performance.now();
  if (change === "parameter" && detail.surface === selectedSurface()) {
    if (state.exact) {
      state.exact = false;
      showLight();
    }
    // The place on a look is a constant of its shader, which is compiled when the hand rests.
    if (!detail.held || !detail.surface.look) drawBall();
  }
  if (change === "options" || change === "light") drawBall();
  const title = `${selectedSurface() ? nameOf(selectedSurface()) : "Explorer"} · lookdev`;
  if (document.title !== title) document.title = title;
});

$("label").addEventListener("input", () => {
  const surface = selectedSurface();
  surface.label = $("label")
    .value.replace(/[=:@#/]/g, " ")
    .trim();
  $("name").textContent = nameOf(surface);
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
      all = [...document.querySelectorAll("[data-light]:not([hidden])")];
    if (step) {
      const other = all[(all.indexOf(button) + step + all.length) % all.length];
      other.click();
      other.focus();
    }
  });
}
let held = null;
const turnBall = (dx, dy) => {
  if (state.light !== "point" || state.exact) {
    state.light = "point";
    state.exact = false;
    showLight();
  }
  turnLight(dx, dy);
};
ball.addEventListener("pointerdown", (event) => {
  held = [event.clientX, event.clientY];
  ball.setPointerCapture(event.pointerId);
});
ball.addEventListener("pointermove", (event) => {
  if (held) {
    turnBall(event.clientX - held[0], event.clientY - held[1]);
    held = [event.clientX, event.clientY];
  }
});
for (const name of ["pointerup", "pointercancel"])
  ball.addEventListener(name, () => {
    held = null;
  });
ball.addEventListener("keydown", (event) => {
  const step = { ArrowLeft: [-8, 0], ArrowRight: [8, 0], ArrowUp: [0, -8], ArrowDown: [0, 8] }[
    event.key
  ];
  if (step) {
    event.preventDefault();
    turnBall(...step);
  }
});
new ResizeObserver(drawBall).observe(ball);

const copy = async (text, title) => {
  try {
    await navigator.clipboard.writeText(text);
    say(`${title} is copied.`, true);
  } catch {
    // Without permission the text is shown, to be copied by hand.
    const area = Object.assign(document.createElement("textarea"), {
      value: text,
      readOnly: true,
      rows: 14,
    });
    area.style.cssText = "width:100%;font:12px ui-monospace,monospace";
    show(title, [area]);
    area.select();
  }
};
const show = (title, parts) => {
  $("dialog-title").textContent = title;
  $("dialog-body").replaceChildren(...parts);
  if (!dialog.open) dialog.showModal();
};
const attempt = (act) => async () => {
  try {
    await act();
  } catch (error) {
    say(error.message);
  }
};

$("copy-link").addEventListener("click", () =>
  copy(new URL(urlOf(), location.href).href, "The link"),
);
$("copy-command").addEventListener(
  "click",
  attempt(async () =>
    copy(
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
$("copy-usd").addEventListener(
  "click",
  attempt(async () => {
    if (selectedSurface())
      await copy(
        (await link.ask({ do: "usd", surface: wordsOf(selectedSurface()) })).text,
        "The look as USD",
      );
  }),
);

const menu = $("save-menu"),
  save = $("save");
const openMenu = (open) => {
  menu.hidden = !open;
  save.setAttribute("aria-expanded", open);
  if (open) menu.querySelector("button").focus();
};
save.addEventListener("click", () => openMenu(menu.hidden));
menu.addEventListener("keydown", (event) => {
  const items = [...menu.querySelectorAll("button")],
    step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
  if (event.key === "Escape") {
    openMenu(false);
    save.focus();
  }
  if (step) {
    event.preventDefault();
    items[(items.indexOf(document.activeElement) + step + items.length) % items.length].focus();
  }
});
addEventListener("click", (event) => {
  if (!menu.hidden && !(/** @type {Element} */ (event.target).closest(".menu"))) openMenu(false);
});
const offer = (blob, name) => {
  const url = URL.createObjectURL(blob),
    anchor = Object.assign(document.createElement("a"), { href: url, download: name });
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(url), 10000);
};
for (const item of menu.querySelectorAll("[data-save]"))
  item.addEventListener(
    "click",
    attempt(async () => {
      openMenu(false);
      const suffix = item.dataset.save;
      if (suffix === "shown") {
        await plots.paint();
        const from = $("plot"),
          whole = new OffscreenCanvas(from.width, from.height),
          context = whole.getContext("2d");
        context.fillStyle = getComputedStyle($("stage")).backgroundColor;
        context.fillRect(0, 0, whole.width, whole.height);
        context.drawImage(from, 0, 0);
        offer(await whole.convertToBlob({ type: "image/png" }), `${state.kind}.png`);
        return;
      }
      say(`Making ${state.kind}.${suffix} …`, true);
      const query = new URLSearchParams([
        ...visibleSurfaces().map((surface) => ["s", wordsOf(surface, true)]),
        ["options", JSON.stringify(changedOptions())],
      ]);
      const answer = await fetch(`save/${state.kind}.${suffix}?${query}`);
      if (!answer.ok) throw new Error((await answer.text()).trim());
      offer(await answer.blob(), `${state.kind}.${suffix}`);
      say(`${state.kind}.${suffix} is saved.`, true);
    }),
  );

const runVerify = async () => {
  if (!works) throw new Error("this browser has no WebGL 2 with float textures");
  $("verify").disabled = true;
  try {
    const rows = await verify(link, shaders);
    show("The browser beside Python", verdict(rows));
    document.body.dataset.verified = JSON.stringify(rows);
  } finally {
    $("verify").disabled = false;
  }
};
$("verify").addEventListener("click", attempt(runVerify));

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
const help = () => {
  const table = document.createElement("table");
  for (const [key, text] of KEYS) {
    const row = table.insertRow();
    row.insertCell().append(Object.assign(document.createElement("kbd"), { textContent: key }));
    row.insertCell().textContent = text;
  }
  const first = document.createElement("p"),
    second = document.createElement("p");
  first.textContent =
    "Values in plots come from the float64 models in Python. Spheres and lobes are computed by " +
    "the browser, in float32, by code generated from the same models: Verify compares the two.";
  second.textContent =
    "The URL has the whole state of the page. Surfaces in it are words of the command line, " +
    "as for lookdev plot.";
  show("Explorer", [first, second, table]);
};
$("help").addEventListener("click", help);
addEventListener("keydown", (event) => {
  if (
    /** @type {Element} */ (event.target).matches("input, select, textarea") ||
    event.ctrlKey ||
    event.metaKey ||
    event.altKey ||
    dialog.open
  )
    return;
  const kinds = Object.keys(state.offered?.kinds ?? {}),
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
  else if (event.key === "Delete" && surface) {
    state.surfaces.splice(state.selected, 1);
    state.selected = Math.max(0, Math.min(state.selected, state.surfaces.length - 1));
    notify("surfaces");
  } else if (event.key === "/") {
    event.preventDefault();
    $("find").focus();
  } else if (event.key === "?") help();
});

const restore = async () => {
  const { words, on, hidden } = readUrl();
  state.surfaces = [];
  const surfaces = await Promise.all(
    (words.length ? words : state.offered.first).map((name) =>
      link.ask({ do: "describe", surface: name }).catch((error) => {
        say(error.message);
        return null;
      }),
    ),
  );
  surfaces.forEach((surface, index) => {
    if (surface) addSurface(surface, hidden.includes(index));
  });
  state.selected = Math.min(on, Math.max(0, state.surfaces.length - 1));
  showKinds();
  showOptions();
  notify("surfaces");
};

const start = async () => {
  state.offered = await (await fetch("start")).json();
  shaders = new Shaders(link, state.offered.models);
  balls = new Balls(link, shaders);
  plots = new Plots(link, balls, new Lobes(shaders));
  sliders = new Sliders(link);
  exact = new Exact(link, () => {
    state.exact = true;
    showLight();
  });
  watchOffers(add);
  showOffers(add);
  watchDrops(add, say);
  await restore();
  addEventListener("hashchange", () => restore().catch((error) => say(error.message)));
  if (!works)
    say("This browser has no WebGL 2 with float textures: spheres and lobes are not drawn.");
  window.explorer = { state, latencies, shown, ballCosts, plots, shaders, wordsOf, gl };
  document.body.dataset.ready = "true";
  if (new URLSearchParams(location.search).has("verify")) await runVerify();
};
start().catch((error) => say(error.message));
