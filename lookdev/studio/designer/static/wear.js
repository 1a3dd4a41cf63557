// @ts-check
// What the picked part wears, by which words of the job, and the dialog in which it is dressed
// otherwise.

import { at, button, fileName, made, opened } from "./made.js";

const MOST = 12; // instances that are listed one by one
const TYPED = "typed";

/** Show what a part wears; `acts` has `dress` and `undress`. */
export function showWorn(scene, part, acts) {
  const { worn, locked } = scene.job,
    found = worn[part.path] ?? { paths: [], by: "asset" };
  const by = {
    assign: `assigned to ${found.pattern}`,
    look: "the look's own material",
    asset: "as the asset has it",
  }[found.by];
  const off = button("Take off", `Take ${found.pattern} out of what is assigned`, acts.undress, {
    id: "wear-off",
    disabled: found.by !== "assign" || Boolean(locked),
  });
  at("worn").replaceChildren(
    made(
      "p",
      { className: "wears", title: `${found.material ?? ""}\n${by}` },
      made("span", { textContent: scene.stacks[part.look].name }),
      made("small", { textContent: by }),
    ),
    made(
      "div",
      { className: "tools" },
      button(
        "Dress…",
        locked || "Choose the look that this part, or more of the asset, wears (P)",
        acts.dress,
        { id: "wear", disabled: Boolean(locked) || !found.paths.length },
      ),
      off,
    ),
  );
}

/** The choices of what is dressed, for a part: words, and prims as the job has them. */
function choices({ paths, collections }, own) {
  const count = (prims) => paths.filter((path) => fits(path, prims, collections)).length;
  const parts = (prims) => (count(prims) === 1 ? "1 part" : `${count(prims)} parts`);
  const found =
    own.length > 1
      ? [
          [`all ${own.length} instances`, own],
          ...own.slice(0, MOST).map((each) => [`only ${each}`, [each]]),
        ]
      : [[`this part: ${own[0]}`, own]];
  for (const [name, members] of Object.entries(collections)) {
    if (own.some((each) => members.includes(each)))
      found.push([`${name} (${parts([name])})`, [name]]);
  }
  for (let above = own[0].replace(/\/[^/]*$/, ""); above; above = above.replace(/\/[^/]*$/, ""))
    found.push([`${above} and below (${parts([above])})`, [above]]);
  return [...found, ["all to which nothing is assigned", []]];
}

const glob = (pattern) =>
  new RegExp(
    `^${pattern
      .replace(/[.+^${}()|\\]/g, "\\$&")
      .replace(/\[!/g, "[^")
      .replace(/\*/g, ".*")
      .replace(/\?/g, ".")}(/.*)?$`,
    "s",
  );

/** Whether one of the patterns fits a part, as docs/jobs.md says. */
export function fits(path, prims, collections = {}) {
  return prims.some((each) => {
    if (each.includes(".collection:")) return collections[each]?.includes(path) ?? false;
    if (/[*?[]/.test(each)) {
      try {
        return glob(each).test(path);
      } catch {
        return false;
      }
    }
    return path === each || path.startsWith(`${each}/`);
  });
}

const words = ({ material, prim, variants }) =>
  [
    fileName(material)
      .replace(/\.\w+$/, "")
      .replace(/_/g, " "),
    ...(prim ? [prim] : []),
    ...Object.values(variants),
  ].join(", ");

const near = (path) => (path.startsWith("/") ? `…/${path.split("/").slice(-2).join("/")}` : path);

/**
 * Ask what a part shall wear; returns the request, with `material` "" for a new look of a preset,
 * or null.
 */
export async function chooseWorn(scene, part, asked) {
  const dialog = at("dressing"),
    { job } = scene,
    { paths: own } = job.worn[part.path];
  const given = choices(job, own),
    looks = await asked("wearables");
  const rows = [
    ...looks.job.map((each) => ({ ...each, of: "of the job" })),
    ...looks.files.map((material) => ({ material, prim: null, variants: {}, of: "a file" })),
  ];
  at("dressing-prims").replaceChildren(
    ...given.map(([text], n) => new Option(text, `${n}`)),
    new Option("other paths or patterns…", TYPED),
  );
  at("dressing-typed").value = own.join(" ");
  at("dressing-search").value = "";
  at("dressing-known").replaceChildren(
    ...[...job.paths, ...Object.keys(job.collections)].map((each) => new Option(each)),
  );
  const prims = () =>
    at("dressing-prims").value === TYPED
      ? at("dressing-typed").value.split(/\s+/).filter(Boolean)
      : given[Number(at("dressing-prims").value)][1];
  const show = () => {
    const typed = at("dressing-prims").value === TYPED,
      count = job.paths.filter((path) => fits(path, prims(), job.collections)).length;
    at("dressing-other").hidden = !typed;
    at("dressing-fits").textContent = !typed
      ? ""
      : count
        ? `fits ${count} of ${job.paths.length} parts`
        : "fits no part";
    at("dressing-fits").classList.toggle("problem", typed && !count);
    const search = at("dressing-search").value.trim().toLowerCase();
    const found = rows.filter((each) =>
      `${words(each)} ${each.material}`.toLowerCase().includes(search),
    );
    at("dressing-looks").replaceChildren(
      ...found.map((each) =>
        made(
          "button",
          {
            type: "submit",
            value: String(rows.indexOf(each)),
            className: "wearable",
            title: each.material,
          },
          made("span", { textContent: words(each) }),
          made("small", { textContent: each.of === "a file" ? near(each.material) : each.of }),
        ),
      ),
    );
    at("dressing-none").hidden = found.length > 0;
  };
  for (const id of ["dressing-prims", "dressing-typed", "dressing-search"]) at(id).oninput = show;
  at("dressing-search").onkeydown = at("dressing-typed").onkeydown = (event) => {
    if (event.key !== "Enter") return;
    event.preventDefault();
    if (event.target.id === "dressing-search")
      at("dressing-looks").querySelector("button")?.click();
  };
  show();
  const closed = opened(dialog);
  at("dressing-search").focus();
  const answer = await closed;
  if (answer === "" || answer === "cancel") return null;
  const { material, prim, variants } =
    answer === "preset" ? { material: "" } : rows[Number(answer)];
  return { part: own[0], prims: prims(), material, prim, variants };
}
