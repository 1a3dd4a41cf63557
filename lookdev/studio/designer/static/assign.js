// @ts-check
// The picked part: its look, by which words of the job it has it, and the dialog that assigns
// another one.

import { byId, fileName, makeButton, makeElement, makeOptions, openDialog } from "./elements.js";
import { askFileName } from "./files.js";
import { choosePreset } from "./presets.js";

const aside = `
  <section>
    <h2>Part</h2>
    <label class="row wide"><span class="hidden">Part</span>
      <select id="part" aria-label="Part"></select></label>
    <div id="worn"></div>
  </section>`;

const body = `
  <dialog id="dressing" aria-label="Dress">
    <form method="dialog">
      <label>Dress <select id="dressing-prims"></select></label>
      <label id="dressing-other">Paths, globs and collections, apart by spaces
        <input type="text" id="dressing-typed" list="dressing-known" autocomplete="off"
          spellcheck="false"></label>
      <datalist id="dressing-known"></datalist>
      <p id="dressing-fits" role="status"></p>
      <label>Find a look
        <input type="text" id="dressing-search" autocomplete="off" spellcheck="false"></label>
      <div id="dressing-looks" role="group" aria-label="Looks"></div>
      <p id="dressing-none" hidden>No look has these words.</p>
      <menu class="reversed">
        <button value="preset"
          title="A file beside the job, whose base is the preset">New look from a preset…</button>
        <button value="cancel">Cancel</button>
      </menu>
    </form>
  </dialog>`;

const MOST_INSTANCES = 12; // that are listed one by one
const TYPED = "typed";
const FILE = "a file";

const globPattern = (text) =>
  new RegExp(
    `^${text
      .replace(/[.+^${}()|\\]/g, "\\$&")
      .replace(/\[!/g, "[^")
      .replace(/\*/g, ".*")
      .replace(/\?/g, ".")}(/.*)?$`,
    "s",
  );

function matchesPrim(path, prim, collections) {
  if (prim.includes(".collection:")) return collections[prim]?.includes(path) ?? false;
  if (!/[*?[]/.test(prim)) return path === prim || path.startsWith(`${prim}/`);
  try {
    return globPattern(prim).test(path);
  } catch {
    return false;
  }
}

/** Count the parts that a pattern matches, as docs/jobs.md says. */
function countParts({ paths, collections }, prims) {
  return paths.filter((path) => prims.some((prim) => matchesPrim(path, prim, collections))).length;
}

/** Return the choices of parts for one with some paths: a label, and prims as the job has them. */
function primChoices(job, paths) {
  const count = (prims) => {
    const parts = countParts(job, prims);
    return parts === 1 ? "1 part" : `${parts} parts`;
  };
  const [first] = paths;
  const choices =
    paths.length > 1
      ? [
          [`all ${paths.length} instances`, paths],
          ...paths.slice(0, MOST_INSTANCES).map((path) => [`only ${path}`, [path]]),
        ]
      : [[`this part: ${first}`, paths]];
  for (const [name, members] of Object.entries(job.collections)) {
    if (paths.some((path) => members.includes(path)))
      choices.push([`${name} (${count([name])})`, [name]]);
  }
  const parent = (path) => path.replace(/\/[^/]*$/, "");
  for (let above = parent(first); above; above = parent(above))
    choices.push([`${above} and below (${count([above])})`, [above]]);
  return [...choices, ["all to which nothing is assigned", []]];
}

const describeMaterial = ({ material, prim, variants }) =>
  [
    fileName(material)
      .replace(/\.\w+$/, "")
      .replace(/_/g, " "),
    ...(prim ? [prim] : []),
    ...Object.values(variants),
  ].join(", ");

const shortPath = (path) =>
  path.startsWith("/") ? `…/${path.split("/").slice(-2).join("/")}` : path;

/** The dialog that asks which parts get which look. */
class AssignDialog {
  /** `paths` are those of the picked part. */
  constructor(job, paths, materials) {
    this.job = job;
    this.paths = paths;
    this.choices = primChoices(job, paths);
    this.materials = [
      ...materials.job.map((material) => ({ ...material, origin: "of the job" })),
      ...materials.files.map((material) => ({ material, prim: null, variants: {}, origin: FILE })),
    ];
    byId("dressing-prims").replaceChildren(
      ...this.choices.map(([label], number) => new Option(label, `${number}`)),
      new Option("other paths or patterns…", TYPED),
    );
    byId("dressing-typed").value = paths.join(" ");
    byId("dressing-search").value = "";
    byId("dressing-known").replaceChildren(
      ...makeOptions([...job.paths, ...Object.keys(job.collections)]),
    );
    for (const id of ["dressing-prims", "dressing-typed", "dressing-search"])
      byId(id).oninput = () => this.show();
    byId("dressing-typed").onkeydown = byId("dressing-search").onkeydown = (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      if (event.target.id === "dressing-search")
        byId("dressing-looks").querySelector("button")?.click();
    };
  }

  get isTyped() {
    return byId("dressing-prims").value === TYPED;
  }

  /** The prims to which the look is assigned, as the job has them. */
  get prims() {
    if (this.isTyped) return byId("dressing-typed").value.split(/\s+/).filter(Boolean);
    return this.choices[Number(byId("dressing-prims").value)][1];
  }

  show() {
    const { isTyped, job } = this,
      count = countParts(job, this.prims),
      matches = count ? `fits ${count} of ${job.paths.length} parts` : "fits no part";
    byId("dressing-other").hidden = !isTyped;
    byId("dressing-fits").textContent = isTyped ? matches : "";
    byId("dressing-fits").classList.toggle("problem", isTyped && !count);
    const words = byId("dressing-search").value.trim().toLowerCase();
    const looks = this.materials.filter((material) =>
      `${describeMaterial(material)} ${material.material}`.toLowerCase().includes(words),
    );
    byId("dressing-looks").replaceChildren(...looks.map((look) => this.makeChoice(look)));
    byId("dressing-none").hidden = looks.length > 0;
  }

  makeChoice(material) {
    const path = material.material,
      value = String(this.materials.indexOf(material)),
      origin = material.origin === FILE ? shortPath(path) : material.origin;
    return makeElement(
      "button",
      { type: "submit", value, className: "wearable", title: path },
      makeElement("span", { textContent: describeMaterial(material) }),
      makeElement("small", { textContent: origin }),
    );
  }

  /** Return the request that the user makes, with the material "" for a new look, or null. */
  async ask() {
    this.show();
    const closed = openDialog(byId("dressing"));
    byId("dressing-search").focus();
    const answer = await closed;
    if (answer === "" || answer === "cancel") return null;
    const { material, prim, variants } =
      answer === "preset" ? { material: "" } : this.materials[Number(answer)];
    return { part: this.paths[0], prims: this.prims, material, prim, variants };
  }
}

class Assign {
  constructor(designer) {
    this.designer = designer;
    this.keys = { p: () => void this.assign() };
    byId("part").addEventListener("change", () => designer.pickPart(byId("part").selectedIndex));
  }

  /** The assignment of the picked part: its paths, and the words of the job. */
  get assignment() {
    const { scene, part } = this.designer;
    return scene.job.assignments[part.path] ?? { paths: [], by: "asset" };
  }

  update({ job, parts, stacks }) {
    const { part } = this.designer,
      { assignment } = this,
      { paths, by, pattern } = assignment;
    if (parts !== this.parts) {
      this.parts = parts;
      byId("part").replaceChildren(...makeOptions(parts.map(({ path }) => path)));
    }
    byId("part").value = part.path;
    const origin = {
      assign: `assigned to ${pattern}`,
      look: "the look's own material",
      asset: "as the asset has it",
    }[by];
    const title = job.locked || "Choose the look that this part, or more of the asset, wears (P)";
    byId("worn").replaceChildren(
      makeElement(
        "p",
        { className: "wears", title: `${assignment.material ?? ""}\n${origin}` },
        makeElement("span", { textContent: stacks[part.look].name }),
        makeElement("small", { textContent: origin }),
      ),
      makeElement(
        "div",
        { className: "tools" },
        makeButton("Dress…", title, () => this.assign(), {
          id: "wear",
          disabled: Boolean(job.locked) || !paths.length,
        }),
        makeButton(
          "Take off",
          `Take ${pattern} out of what is assigned`,
          () => this.designer.request("assign", { part: this.assignment.paths[0], unassign: true }),
          { id: "wear-off", disabled: by !== "assign" || Boolean(job.locked) },
        ),
      ),
    );
  }

  /** Ask for a look of the picked part, and assign it. */
  async assign() {
    const { designer } = this,
      { job } = designer.scene;
    if (job.locked) return;
    try {
      await designer.settle();
      const materials = await designer.fetchJson("materials");
      const dialog = new AssignDialog(designer.scene.job, this.assignment.paths, materials);
      const request = await dialog.ask();
      if (request?.material) await designer.request("assign", request);
      else if (request) await this.assignNewLook(request);
    } catch (error) {
      designer.say(error.message, true);
    }
  }

  /** Ask for a preset and for a file's name, and assign a new look of them. */
  async assignNewLook(request) {
    const preset = await choosePreset(this.designer);
    if (!preset) return;
    const { file: job } = this.designer.scene.job;
    await askFileName([["preset", "A new look beside the job", job, `${preset}.usda`]], (_, file) =>
      this.designer.request("assign", { ...request, preset, file }),
    );
  }
}

export const panel = {
  markup: { aside, body },
  mount: (designer) => new Assign(designer),
};
