// @ts-check
// The panel of the picked part of the asset: its look, the pattern in the job that assigns the
// look, and the dialog that assigns another one. `prims` are patterns in a job: paths of parts,
// globs over paths, or names of collections.

import {
  byId,
  fileName,
  makeButton,
  makeElement,
  makeOptions,
  openDialog,
} from "./viewport/elements.js";
import { askFileName } from "./files.js";
import { choosePreset } from "./presets.js";

const aside = `
  <section>
    <h2>Part</h2>
    <label class="row wide"><span class="hidden">Part</span>
      <select id="part" aria-label="Part"></select></label>
    <div id="assignment"></div>
  </section>`;

const body = `
  <dialog id="assigning" aria-label="Assign a look">
    <form method="dialog">
      <label>Assign a look to <select id="assigning-prims"></select></label>
      <label id="assigning-other">Paths, globs and collections, apart by spaces
        <input type="text" id="assigning-typed" list="assigning-known" autocomplete="off"
          spellcheck="false"></label>
      <datalist id="assigning-known"></datalist>
      <p id="assigning-fits" role="status"></p>
      <label>Find a look
        <input type="text" id="assigning-search" autocomplete="off" spellcheck="false"></label>
      <div id="assigning-looks" role="group" aria-label="Looks"></div>
      <p id="assigning-none" hidden>No look has these words.</p>
      <menu class="reversed">
        <button value="preset"
          title="A file beside the job, whose base is the preset">New look from a preset…</button>
        <button value="cancel">Cancel</button>
      </menu>
    </form>
  </dialog>`;

const MOST_INSTANCES = 12; // largest number of instances that the dialog lists one by one
const TYPED = "typed"; // the choice of parts by prims that the user types
const FILE = "a file"; // the origin of a look that the job does not name

/** Return the regular expression of a glob, which also matches the paths below. */
const globPattern = (text) =>
  new RegExp(
    `^${text
      .replace(/[.+^${}()|\\]/g, "\\$&")
      .replace(/\[!/g, "[^")
      .replace(/\*/g, ".*")
      .replace(/\?/g, ".")}(/.*)?$`,
    "s",
  );

/** Return whether the path of a part matches a prim of a job. */
function matchesPrim(path, prim, collections) {
  if (prim.includes(".collection:")) return collections[prim]?.includes(path) ?? false;
  if (!/[*?[]/.test(prim)) return path === prim || path.startsWith(`${prim}/`);
  try {
    return globPattern(prim).test(path);
  } catch {
    return false;
  }
}

/** Return the number of parts that prims match, as docs/jobs.md describes. */
function countParts({ paths, collections }, prims) {
  return paths.filter((path) => prims.some((prim) => matchesPrim(path, prim, collections))).length;
}

/**
 * Return the choices of parts that the dialog offers for a picked part: [label, prims] of each.
 * `paths` are those of the picked part, one for each instance.
 */
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

/** Return a material of a job for the user: the name of its file, its prim and its variants. */
const describeMaterial = ({ material, prim, variants }) =>
  [
    fileName(material)
      .replace(/\.\w+$/, "")
      .replace(/_/g, " "),
    ...(prim ? [prim] : []),
    ...Object.values(variants),
  ].join(", ");

/** Return the last two names of an absolute path, with an ellipsis. */
const shortPath = (path) =>
  path.startsWith("/") ? `…/${path.split("/").slice(-2).join("/")}` : path;

/** The dialog that asks which parts get which look. */
class AssignDialog {
  /** `paths` are the paths of the picked part. */
  constructor(job, paths, materials) {
    this.job = job;
    this.paths = paths;
    this.choices = primChoices(job, paths);
    this.materials = [
      ...materials.job.map((material) => ({ ...material, origin: "of the job" })),
      ...materials.files.map((material) => ({ material, prim: null, variants: {}, origin: FILE })),
    ];
    byId("assigning-prims").replaceChildren(
      ...this.choices.map(([label], number) => new Option(label, `${number}`)),
      new Option("other paths or patterns…", TYPED),
    );
    byId("assigning-typed").value = paths.join(" ");
    byId("assigning-search").value = "";
    byId("assigning-known").replaceChildren(
      ...makeOptions([...job.paths, ...Object.keys(job.collections)]),
    );
    for (const id of ["assigning-prims", "assigning-typed", "assigning-search"])
      byId(id).oninput = () => this.show();
    byId("assigning-typed").onkeydown = byId("assigning-search").onkeydown = (event) => {
      if (event.key !== "Enter") return;
      event.preventDefault();
      if (event.target.id === "assigning-search")
        byId("assigning-looks").querySelector("button")?.click();
    };
  }

  get isTyped() {
    return byId("assigning-prims").value === TYPED;
  }

  /** The prims that the user has chosen or typed; none are all parts without an assignment. */
  get prims() {
    if (this.isTyped) return byId("assigning-typed").value.split(/\s+/).filter(Boolean);
    return this.choices[Number(byId("assigning-prims").value)][1];
  }

  /** Show the number of matched parts, and the looks that contain the searched words. */
  show() {
    const { isTyped, job } = this,
      count = countParts(job, this.prims),
      matches = count ? `fits ${count} of ${job.paths.length} parts` : "fits no part";
    byId("assigning-other").hidden = !isTyped;
    byId("assigning-fits").textContent = isTyped ? matches : "";
    byId("assigning-fits").classList.toggle("problem", isTyped && !count);
    const words = byId("assigning-search").value.trim().toLowerCase();
    const looks = this.materials.filter((material) =>
      `${describeMaterial(material)} ${material.material}`.toLowerCase().includes(words),
    );
    byId("assigning-looks").replaceChildren(...looks.map((look) => this.makeChoice(look)));
    byId("assigning-none").hidden = looks.length > 0;
  }

  /** Return the button of a look in the list of the dialog. */
  makeChoice(material) {
    const path = material.material,
      value = String(this.materials.indexOf(material)),
      origin = material.origin === FILE ? shortPath(path) : material.origin;
    return makeElement(
      "button",
      { type: "submit", value, className: "look-choice", title: path },
      makeElement("span", { textContent: describeMaterial(material) }),
      makeElement("small", { textContent: origin }),
    );
  }

  /**
   * Open the dialog; return the request to assign what the user chooses, or null for a cancel.
   * The request's material is "" for a new look, which does not exist yet.
   */
  async ask() {
    this.show();
    const closed = openDialog(byId("assigning"));
    byId("assigning-search").focus();
    const answer = await closed;
    if (answer === "" || answer === "cancel") return null;
    const { material, prim, variants } =
      answer === "preset" ? { material: "" } : this.materials[Number(answer)];
    return { part: this.paths[0], prims: this.prims, material, prim, variants };
  }
}

/** The panel, which shows the assignment of the picked part. */
class Assign {
  constructor(designer) {
    this.designer = designer;
    this.keys = { p: () => void this.assign() };
    byId("part").addEventListener("change", () => designer.pickPart(byId("part").selectedIndex));
  }

  /** The record of the picked part's slot (`EditedJob.describe_assignments` in Python). */
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
    const title = job.locked || "Choose a look for this part, or for more of the asset (P)";
    byId("assignment").replaceChildren(
      makeElement(
        "p",
        { className: "assigned-look", title: `${assignment.material ?? ""}\n${origin}` },
        makeElement("span", { textContent: stacks[part.look].name }),
        makeElement("small", { textContent: origin }),
      ),
      makeElement(
        "div",
        { className: "tools" },
        makeButton("Assign…", title, () => this.assign(), {
          id: "assign-look",
          disabled: Boolean(job.locked) || !paths.length,
        }),
        makeButton(
          "Unassign",
          `Remove the assignment to ${pattern} from the job`,
          () => this.designer.request("assign", { part: this.assignment.paths[0], unassign: true }),
          { id: "unassign-look", disabled: by !== "assign" || Boolean(job.locked) },
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

  /** Ask for a preset and a file name, and assign a new look whose base is this preset. */
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
