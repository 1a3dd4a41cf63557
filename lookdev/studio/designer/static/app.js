// The Designer's page: a scene in the viewport, and the layers of its looks.

import { Exact } from "./exact.js";
import { follow } from "./hand.js";
import { showLayers } from "./layers.js";
import { LightList } from "./lights.js";
import { Turntable } from "./turntable.js";
import { Viewport } from "./viewport/viewport.js";

const WIDEST = 1024; // pixels of the canvas
const at = (id) => document.getElementById(id);
const canvas = at("picture");
let scene = null;
let picked = 0; // number of a part
const done = [], undone = []; // edits
let sending = Promise.resolve();

function say(text, bad = false) {
  at("status").textContent = text;
  at("status").classList.toggle("bad", bad);
}

async function asked(path, body) {
  const post = { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(body) };
  const answer = await fetch(path, body === undefined ? {} : post);
  const found = await answer.json();
  if (!answer.ok) throw new Error(found.error ?? answer.statusText);
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
viewport.addEventListener("failed", (event) => say(event.detail.message, true));
viewport.addEventListener("picture", (event) => {
  const { count, scale } = event.detail ?? {};
  at("progress").textContent = scale > 1 ? "…" : `${count} samples · direct light, no shadows`;
});

/** Fetch and show the scene, which the server has made anew. */
async function load(what) {
  say(what);
  const next = await asked("scene");
  fit(next.resolution);
  await viewport.show(next);
  await lights.load();
  const first = scene === null;
  scene = next;
  if (first) {
    at("background").checked = next.background === "ibl";
    const behind = Array.isArray(next.background) ? next.background[1] : 0;
    viewport.set({ background: at("background").checked, behind });
  }
  select(at("look"), next.choices.looks, next.chosen.look);
  select(at("rig"), next.choices.rigs, next.chosen.rig);
  select(at("part"), next.parts.map((each) => each.path), next.parts[Math.min(picked, next.parts.length - 1)].path);
  at("left-out").querySelector("ul").replaceChildren(...next.left_out.map((each) => Object.assign(document.createElement("li"), { textContent: each })));
  panel();
  say(`${next.view.name}`);
}

function select(element, names, chosen) {
  element.replaceChildren(...names.map((each) => new Option(each, each, false, each === chosen)));
}

/** Give the canvas the frame's shape: the picture is framed as the job's frames are. */
function fit([width, height]) {
  const room = at("stage").getBoundingClientRect();
  const scale = Math.min(room.width / width, room.height / height);
  const [wide, high] = [width * scale, height * scale].map(Math.floor);
  [canvas.style.width, canvas.style.height] = [`${wide}px`, `${high}px`];
  const pixels = Math.min(1, WIDEST / wide);
  viewport.size = [Math.max(1, Math.round(wide * pixels)), Math.max(1, Math.round(high * pixels))];
}

const lookOf = () => scene.parts[picked].look;

function panel() {
  const stack = scene.stacks[lookOf()];
  showLayers(at("layers"), stack, (layer, parameter, value, rests) => change(layer, parameter, value, rests));
  marks();
}

function marks() {
  const stack = scene.stacks[lookOf()];
  at("save").disabled = !stack.file || !stack.unsaved;
  at("save-as").disabled = !stack.file;
  at("save").title = stack.file ? `Write the edits to ${stack.file} (Ctrl+S)` : "This look is of no file of its own";
  at("undo").disabled = done.length === 0;
  at("redo").disabled = undone.length === 0;
}

let before = null; // what the parameter had before the hand moved

/** A parameter moves: its uniform at once, the document when the hand rests. */
function change(layer, parameter, value, rests) {
  const look = lookOf();
  before ??= { look, layer, parameter: parameter.name, value: parameter.value };
  if (parameter.uniform) viewport.setNumbers(look, { [parameter.uniform]: [value].flat() });
  if (!rests) return;
  const edit = { look, layer, parameter: parameter.name, value };
  if (JSON.stringify(before) !== JSON.stringify(edit)) {
    done.push({ back: before, forth: edit });
    undone.length = 0;
  }
  before = null;
  send(edit);
}

/** Send an edit; edits arrive in order. A parameter that a look did not state is compiled in the background. */
function send(edit) {
  sending = sending.then(async () => {
    try {
      const { compiles, stacks } = await asked("edit", edit);
      scene.stacks = stacks;
      if (compiles) await load("compiling in the background…");
      else {
        const parameter = stacks[edit.look].layers[edit.layer].parameters.find((each) => each.name === edit.parameter);
        if (parameter.uniform) viewport.setNumbers(edit.look, { [parameter.uniform]: [parameter.value].flat() });
        panel();
      }
    } catch (error) {
      say(error.message, true);
    }
  });
  return sending;
}

function step(from, to, which) {
  const edit = from.pop();
  if (!edit) return;
  to.push(edit);
  send(edit[which]);
}

async function save(name) {
  try {
    await sending;
    const { file, stacks } = await asked("save", { look: lookOf(), name });
    scene.stacks = stacks;
    marks();
    say(`saved ${file}`);
  } catch (error) {
    say(error.message, true);
  }
}

function turn(degrees) {
  const lighting = (((viewport.settings.lighting + degrees) % 360) + 360) % 360;
  at("lighting").value = lighting;
  view();
}

function view() {
  const [exposure, lighting, element] = ["exposure", "lighting", "element"].map((id) => Number(at(id).value));
  at("exposure-value").textContent = exposure.toFixed(1);
  at("lighting-value").textContent = `${Math.round(lighting)}°`;
  at("element-value").textContent = `${Math.round(element)}°`;
  viewport.set({ exposure, lighting, element, background: at("background").checked });
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
for (const id of ["exposure", "lighting", "element", "background"]) at(id).addEventListener("input", view);
at("part").addEventListener("change", () => {
  picked = at("part").selectedIndex;
  panel();
});
for (const id of ["look", "rig"]) {
  at(id).addEventListener("change", () => {
    sending = sending.then(async () => {
      await asked("choose", { look: at("look").value, rig: at("rig").value });
      [done.length, undone.length] = [0, 0]; // edits have the numbers of looks of the scene that was shown
      await load("reading the scene…");
    }).catch((error) => say(error.message, true));
  });
}
at("undo").addEventListener("click", () => step(done, undone, "back"));
at("redo").addEventListener("click", () => step(undone, done, "forth"));
at("save").addEventListener("click", () => save(null));
at("save-as").addEventListener("click", () => {
  const file = scene.stacks[lookOf()].file;
  at("name").value = file.split(/[\\/]/).pop().replace(/(\.\w+)$/, "_2$1");
  at("naming-file").textContent = file;
  at("naming").showModal();
  at("name").select();
});
at("naming").addEventListener("close", () => {
  if (at("naming").returnValue === "save") save(at("name").value);
});
const typing = ({ tagName, type }) => ["SELECT", "TEXTAREA"].includes(tagName) || (tagName === "INPUT" && !["range", "checkbox", "radio"].includes(type));
addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey) {
    const key = event.key.toLowerCase();
    if (key === "s") save(null);
    else if (key === "z" && event.shiftKey) step(undone, done, "forth");
    else if (key === "z") step(done, undone, "back");
    else return;
    event.preventDefault();
  } else if (typing(event.target)) return;
  else if ((event.target.tagName !== "BUTTON" || event.key !== " ") && (turntable.key(event.key) || exact.key(event.key))) event.preventDefault();
  else if (event.key === "b") {
    at("background").checked = !at("background").checked;
    view();
  }
});
addEventListener("beforeunload", (event) => {
  if (scene?.stacks.some((each) => each.unsaved)) event.preventDefault();
});
new ResizeObserver(() => {
  if (!scene) return;
  fit(scene.resolution);
  viewport.resize(...viewport.size);
}).observe(at("stage"));

load("reading the scene…").catch((error) => say(error.message, true));
