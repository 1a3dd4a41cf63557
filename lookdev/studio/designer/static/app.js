// @ts-check
// The Designer's page: a scene in the viewport, and the layers of its looks.

import { choosePreset, savePreset } from "./add.js";
import { Exact } from "./exact.js";
import { askConflict, compareSnapshots, showNotices } from "./files.js";
import { follow } from "./hand.js";
import { choose, chosenLayer, showLayers } from "./layers.js";
import { LightList } from "./lights.js";
import { at, fileName, made, opened } from "./made.js";
import { Turntable } from "./turntable.js";
import { Viewport } from "./viewport/viewport.js";
import { chooseWorn, showWorn } from "./wear.js";

const WIDEST = 1024; // pixels of the canvas
const LIVE = 1000; // milliseconds after which a parameter that is still moved is sent
const LONGEST_PASTE = 60000; // characters
const SOON = 300; // milliseconds after which the page says that it waits
const WORKING = "working…";
const WATCHED = 3000; // milliseconds between looks at the files
const canvas = at("picture");
let scene = null;
let picked = 0; // number of a part
let sending = Promise.resolve();

function say(text, bad = false) {
  at("status").textContent = text;
  at("status").classList.toggle("bad", bad);
}

async function asked(path, body) {
  const picture = body instanceof Blob;
  const headers = { "content-type": picture ? body.type : "application/json" };
  const post = { method: "POST", headers, body: picture ? body : JSON.stringify(body) };
  const answer = await fetch(path, body === undefined ? {} : post);
  const found = await answer.json();
  if (!answer.ok)
    throw Object.assign(new Error(found.error ?? answer.statusText), { conflict: found.conflict });
  return found;
}

async function buffer(name) {
  const answer = await fetch(`buffers/${name}`);
  if (!answer.ok) throw new Error(`buffer ${name}: ${answer.statusText}`);
  return answer.arrayBuffer();
}

let viewport = null;
try {
  viewport = new Viewport(canvas, buffer);
} catch (error) {
  say(error.message, true);
  throw error;
}
const exact = new Exact(viewport, () => sending);
const lights = new LightList(viewport, asked, say);
const turntable = new Turntable(asked, () => sending);
Object.assign(window, { viewport, exact, lights, turntable }); // for tests
/** Say whether the light has shadows; nothing where none can be cast. */
const shadowWords = () =>
  castable() ? (viewport.settings.shadows ? " with cast shadow" : ", no shadow") : "";
viewport.addEventListener("failed", (event) => say(event.detail.message, true));
viewport.addEventListener("picture", (event) => {
  const { count, scale } = event.detail ?? {};
  at("progress").textContent = scale > 1 ? "…" : `${count} samples · direct light${shadowWords()}`;
});

/** Fetch and show the scene, which the server has made anew. */
async function load(what) {
  say(what);
  const next = await asked("scene");
  fit(next.resolution);
  await viewport.show(next);
  await lights.load();
  const first = scene === null,
    path = scene?.parts[picked]?.path;
  picked = Math.max(
    0,
    next.parts.findIndex((each) => each.path === path),
  );
  scene = next;
  if (first) {
    at("background").checked = next.background === "ibl";
    const behind = Array.isArray(next.background) ? next.background[1] : 0;
    viewport.set({ background: at("background").checked, behind });
  }
  const { looks, rigs, shipped } = next.choices;
  select(at("look"), looks, next.chosen.look);
  select(at("rig"), rigs, next.chosen.rig, shipped, "shipped: only shown");
  select(
    at("part"),
    next.parts.map((each) => each.path),
    next.parts[picked].path,
  );
  at("shadows").disabled = !next.shadows;
  at("shadows").parentElement.title = next.shadows
    ? "What the asset takes of the light that arrives on it"
    : "This asset casts no shadow on itself: it is convex";
  leftOut();
  panel();
  say(`${next.view.name}`);
}

const castable = () => scene?.shadows ?? false;

/** Name what the picture leaves out, as it is now. */
function leftOut() {
  const switched = castable() && !viewport.settings.shadows ? ["cast shadow: switched off"] : [];
  at("left-out")
    .querySelector("ul")
    .replaceChildren(
      ...[...scene.left_out, ...switched].map((each) => made("li", { textContent: each })),
    );
}

function select(element, names, chosen, others = [], label = "") {
  const options = (given) => given.map((each) => new Option(each, each, false, each === chosen));
  element.replaceChildren(
    ...options(names),
    ...(others.length ? [made("optgroup", { label }, ...options(others))] : []),
  );
}

/** Give the canvas the frame's shape: the picture is framed as the job's frames are. */
function fit([width, height]) {
  document.documentElement.style.setProperty("--shape", `${height / width}`);
  const room = at("stage").getBoundingClientRect();
  const scale = Math.min(room.width / width, room.height / height);
  const [wide, high] = [width * scale, height * scale].map(Math.floor);
  [canvas.style.width, canvas.style.height] = [`${wide}px`, `${high}px`];
  const pixels = Math.min(1, WIDEST / wide);
  viewport.size = [Math.max(1, Math.round(wide * pixels)), Math.max(1, Math.round(high * pixels))];
}

const lookOf = () => scene.parts[picked].look;

function panel() {
  showWorn(scene, scene.parts[picked], acts);
  showLayers(at("layers"), scene.stacks[lookOf()], acts);
  showNotices(scene, (what) =>
    ask("disk", { do: what }, what === "keep" ? "kept: saving writes over the file" : ""),
  );
  marks();
}

function marks() {
  const unsaved = [scene.job, ...scene.stacks].filter((each) => each.unsaved);
  at("save").disabled = unsaved.length === 0;
  at("save-as").disabled = false;
  const files = [...new Set(unsaved.map((each) => each.file))].join(", ");
  at("save").title = files ? `Write the edits to ${files} (Ctrl+S)` : "Nothing is unsaved";
  at("undo").disabled = scene.undoes === null;
  at("undo").title = scene.undoes === null ? "Nothing to undo" : `Undo: ${scene.undoes} (Ctrl+Z)`;
  at("redo").disabled = scene.redoes === null;
  at("redo").title =
    scene.redoes === null ? "Nothing to do again" : `Redo: ${scene.redoes} (Ctrl+Shift+Z)`;
  at("compare").textContent = scene.snapshots.length
    ? `Compare (${scene.snapshots.length})…`
    : "Compare…";
  document.title = `${unsaved.length ? "• " : ""}Designer · lookdev`;
}

/**
 * Take what an answer says of stacks and files; the picture follows, by uniforms where nothing is
 * to be compiled.
 */
async function adopt({ compiles, ...status }) {
  Object.assign(scene, status);
  if (compiles) await load("compiling in the background…");
  else {
    scene.stacks.forEach((stack, look) => {
      const known = viewport.scene.looks[look].numbers,
        numbers = {};
      for (const { uniform, value } of stack.layers.flatMap((layer) => layer.parameters ?? [])) {
        const values = [value].flat();
        if (
          uniform &&
          values.some((each, k) => Math.fround(each) !== Math.fround(known[uniform]?.[k]))
        )
          numbers[uniform] = values;
      }
      if (Object.keys(numbers).length) viewport.setNumbers(look, numbers);
    });
    panel();
  }
}

/** Ask the server for a change, in order with others; returns what is wrong, or "". */
function ask(path, body, said = "") {
  const asking = sending.then(async () => {
    const waiting = setTimeout(() => say(WORKING), SOON);
    try {
      const answer = await asked(path, body);
      clearTimeout(waiting);
      await adopt(answer);
      if (said || at("status").textContent === WORKING) say(said || scene.view.name);
      return "";
    } catch (error) {
      clearTimeout(waiting);
      say(error.message, true);
      return error.message;
    }
  });
  sending = asking;
  return asking;
}

let gesture = null; // of the parameter under the hand

/**
 * A parameter moves: its uniform at once, the document when the hand rests, or now and then while
 * it does not.
 */
function change(layer, parameter, value, rests) {
  const look = lookOf();
  if (parameter.uniform) viewport.setNumbers(look, { [parameter.uniform]: [value].flat() });
  gesture ??= { id: `${Date.now()}-${Math.random()}` };
  const { id } = gesture;
  const edit = { look, layer, parameter: parameter.name, value, gesture: id };
  clearTimeout(gesture.timer);
  if (rests) {
    gesture = null;
    ask("edit", edit);
  } else if (parameter.uniform) {
    const send = () => {
      gesture.sent = performance.now();
      sending = sending
        .then(async () => {
          scene.revision = (await asked("edit", edit)).revision;
        })
        .catch((error) => say(error.message, true));
    };
    gesture.sent ??= performance.now();
    if (performance.now() - gesture.sent > LIVE) send();
    else gesture.timer = setTimeout(send, LIVE);
  }
}

let copied = ""; // where the browser's clipboard cannot be read

const acts = {
  change,
  async dress() {
    if (scene.job.locked) return;
    try {
      await sending;
      const body = await chooseWorn(scene, scene.parts[picked], asked);
      if (!body) return;
      if (body.material) {
        await ask("wear", body);
        return;
      }
      const preset = await choosePreset(asked);
      if (preset)
        await named(
          [["preset", "A new look beside the job", scene.job.file, `${preset}.usda`]],
          (_, file) => ask("wear", { ...body, preset, file }),
        );
    } catch (error) {
      say(error.message, true);
    }
  },
  undress: () =>
    ask("wear", { part: scene.job.worn[scene.parts[picked].path].paths[0], take: true }),
  again: () => panel(),
  images: async () => (await asked(`images?look=${lookOf()}`)).images,
  async arrange(body, focus = "") {
    const count = scene.stacks[lookOf()].layers.length;
    const error = await ask("stack", { look: lookOf(), ...body });
    if (error) return error;
    const { layers } = scene.stacks[lookOf()];
    if (["add", "paste"].includes(body.op)) choose(layers.length - 1);
    if (body.op === "duplicate" && layers.length > count) choose(body.layer + 1);
    if (body.op === "move") choose(body.to);
    panel();
    if (focus) at(focus)?.focus();
    return "";
  },
  solo: (layer) => ask("stack", { look: lookOf(), op: "solo", layer }),
  async add() {
    if (scene.stacks[lookOf()].locked) return;
    try {
      const preset = await choosePreset(asked);
      if (preset) await acts.arrange({ op: "add", preset });
    } catch (error) {
      say(error.message, true);
    }
  },
  async preset() {
    try {
      await sending;
      say(await savePreset(asked, lookOf(), chosenLayer(scene.stacks[lookOf()])));
    } catch (error) {
      say(error.message, true);
    }
  },
  async copy() {
    try {
      const layer = chosenLayer(scene.stacks[lookOf()]);
      copied = (await asked("stack", { look: lookOf(), op: "copy", layer: layer.number })).text;
      await navigator.clipboard?.writeText(copied).catch(() => {});
      say(`copied ${layer.name} as USD text`);
    } catch (error) {
      say(error.message, true);
    }
  },
  async paste() {
    const text = (await navigator.clipboard?.readText().catch(() => "")) || copied;
    await acts.pasteText(text);
  },
  async pasteText(text) {
    if (text.length > LONGEST_PASTE) say("what is pasted is too long for a layer", true);
    else await acts.arrange({ op: "paste", text });
  },
};

async function save(name, over = false, what = "look") {
  try {
    await sending;
    const { files, ...status } = await asked(
      "save",
      name === null ? { over } : { look: what === "job" ? null : lookOf(), name },
    );
    await adopt(status);
    say(files.length ? `saved ${files.join(", ")}` : "nothing is unsaved");
  } catch (error) {
    if (!error.conflict) {
      say(error.message, true);
      return;
    }
    const chosen = await askConflict(error.conflict);
    if (chosen === "over") await save(name, true);
    else if (chosen === "load") await ask("disk", { do: "load" }, "loaded from disk");
    else if (chosen === "as") at("save-as").click();
  }
}

function turn(degrees) {
  const lighting = (((viewport.settings.lighting + degrees) % 360) + 360) % 360;
  at("lighting").value = lighting;
  view();
}

function view() {
  const [exposure, lighting, element] = ["exposure", "lighting", "element"].map((id) =>
    Number(at(id).value),
  );
  at("exposure-value").textContent = exposure.toFixed(1);
  at("lighting-value").textContent = `${Math.round(lighting)}°`;
  at("element-value").textContent = `${Math.round(element)}°`;
  viewport.set({
    exposure,
    lighting,
    element,
    background: at("background").checked,
    shadows: at("shadows").checked,
  });
  if (scene) leftOut();
}

follow(canvas, viewport, {
  turn,
  framed: () => scene.camera,
  pick: (x, y) => {
    const part = viewport.pick(x, y);
    if (!part) return;
    picked = scene.parts.findIndex((each) => each.path === part.path);
    at("part").value = part.path;
    panel();
  },
});
for (const id of ["exposure", "lighting", "element", "background", "shadows"])
  at(id).addEventListener("input", view);
at("part").addEventListener("change", () => {
  picked = at("part").selectedIndex;
  panel();
});
for (const id of ["look", "rig"]) {
  at(id).addEventListener("change", () => {
    sending = sending
      .then(async () => {
        await asked("choose", { look: at("look").value, rig: at("rig").value });
        await load("reading the scene…");
      })
      .catch((error) => say(error.message, true));
  });
}
at("undo").addEventListener("click", () => ask("history", { redo: false }));
at("redo").addEventListener("click", () => ask("history", { redo: true }));
at("snapshot").addEventListener("click", () =>
  canvas.toBlob((picture) => ask("picture", picture, "kept a snapshot"), "image/png"),
);
at("compare").addEventListener("click", () =>
  compareSnapshots(scene, {
    now: () => canvas.toDataURL("image/png"),
    show: (number) => ask("snapshots", { do: "show", number }, `back at snapshot ${number}`),
    drop: (number) => ask("snapshots", { do: "drop", number }),
  }),
);
at("save").addEventListener("click", () => save(null));
at("save-as").addEventListener("click", () => {
  const { file, locked } = scene.stacks[lookOf()],
    second = (path) => fileName(path).replace(/(\.\w+)$/, "_2$1");
  const looks =
    file && !locked ? [["look", "A new file beside the look's own", file, second(file)]] : [];
  named(
    [...looks, ["job", "A new file beside the job's", scene.job.file, second(scene.job.file)]],
    (what, name) => save(name, false, what),
  );
});

/**
 * Ask for the name of a new file of one of several kinds: [kind, words, the file that it is beside,
 * a name].
 */
async function named(kinds, then) {
  const show = () => {
    const [, words, file, name] = kinds[at("naming-what").selectedIndex];
    at("naming-label").textContent = words;
    at("naming-file").textContent = file;
    at("name").value = name;
  };
  at("naming-what").replaceChildren(...kinds.map(([kind]) => new Option(`the ${kind}`, kind)));
  at("naming-what").closest("label").hidden = kinds.length < 2;
  at("naming-what").onchange = show;
  show();
  const closed = opened(at("naming"));
  at("name").select();
  if ((await closed) === "save") await then(at("naming-what").value, at("name").value);
}

addEventListener("copy", (event) => {
  if (!document.activeElement?.closest("#stack")) return;
  event.preventDefault();
  acts.copy();
});
addEventListener("paste", (event) => {
  if (!document.activeElement?.closest("#stack")) return;
  event.preventDefault();
  acts.pasteText(event.clipboardData.getData("text/plain") || copied);
});
const typing = ({ tagName, type }) =>
  ["SELECT", "TEXTAREA"].includes(tagName) ||
  (tagName === "INPUT" && !["range", "checkbox", "radio"].includes(type));
addEventListener("keydown", (event) => {
  const target = /** @type {HTMLInputElement} */ (event.target);
  if (event.ctrlKey || event.metaKey) {
    const key = event.key.toLowerCase();
    if (key === "s") save(null);
    else if ((key === "z" && event.shiftKey) || key === "y") ask("history", { redo: true });
    else if (key === "z") ask("history", { redo: false });
    else return;
    event.preventDefault();
  } else if (typing(target) || document.querySelector("dialog[open]")) return;
  else if (
    (target.tagName !== "BUTTON" || event.key !== " ") &&
    (turntable.key(event.key) || exact.key(event.key))
  )
    event.preventDefault();
  else if (event.key === "p") acts.dress();
  else {
    const box = at({ b: "background", h: "shadows" }[event.key]);
    if (box && !box.disabled) {
      box.checked = !box.checked;
      view();
    }
  }
});
addEventListener("beforeunload", (event) => {
  if (scene && [scene.job, ...scene.stacks].some((each) => each.unsaved)) event.preventDefault();
});
new ResizeObserver(() => {
  if (!scene) return;
  fit(scene.resolution);
  viewport.resize(...viewport.size);
}).observe(at("stage"));

setInterval(() => {
  if (!scene) return;
  sending = sending
    .then(async () => {
      const signs = await asked("status");
      if (signs.revision !== scene.revision) await load("edited on another page…");
      else if (String(signs.changed) !== String(scene.changed)) {
        scene.changed = signs.changed;
        panel();
      }
    })
    .catch((error) =>
      say(
        `the server does not answer: ${error.message}. What was edited is kept; start it again`,
        true,
      ),
    );
}, WATCHED);

load("reading the scene…").catch((error) => say(error.message, true));
