// @ts-check
// What happens to files beside the page: unsaved work that was found, files changed on disk, and
// snapshots.

import { at, button, fileName, made, opened } from "./made.js";

const clock = (seconds) =>
  new Date(seconds * 1000).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });

/**
 * Show notices above the picture; `act` takes what is done about a file: load, keep, restore,
 * discard.
 */
export function showNotices(scene, act) {
  const notices = [],
    { recovery, changed } = scene;
  if (recovery) {
    const files = recovery.files.map((each) => fileName(each.file)).join(", ");
    const since = recovery.files
      .filter((each) => each.changed)
      .map((each) => fileName(each.file))
      .join(", ");
    const more = since && ` ${since} has been changed on disk since then.`;
    notices.push(
      made(
        "div",
        { className: "notice", id: "recovery", role: "alert" },
        made("p", {
          textContent: `Unsaved work of ${clock(recovery.time)} was found: ${files}.${more}`,
        }),
        button("Restore", "Show it; undo takes it away again", () => act("restore"), {
          id: "recovery-restore",
        }),
        button("Discard", "Remove it for good", () => act("discard"), { id: "recovery-discard" }),
      ),
    );
  }
  if (changed.length) {
    const edited = [scene.job, ...scene.stacks].some(
      (each) => changed.includes(each.file) && each.unsaved,
    );
    const unsaved = edited ? " You have unsaved edits of it." : "";
    const words = `${changed.map(fileName).join(", ")} changed on disk.${unsaved}`;
    notices.push(
      made(
        "div",
        { className: "notice", id: "changed", role: "alert" },
        made("p", { textContent: words, title: changed.join("\n") }),
        button("Load it", "Show what is on disk; undo brings your edits back", () => act("load"), {
          id: "changed-load",
        }),
        button("Keep mine", "Keep what is shown; saving writes over the file", () => act("keep"), {
          id: "changed-keep",
        }),
      ),
    );
  }
  const before = [...at("notices").children].map((each) => each.textContent).join();
  if (before !== notices.map((each) => each.textContent).join())
    at("notices").replaceChildren(...notices);
}

/**
 * Ask what to do where saving would write over what others have written: "over", "load", "as", or
 * "".
 */
export async function askConflict(files) {
  at("conflict-files").textContent = files.join("\n");
  return opened(at("conflict"));
}

/** Show snapshots side by side; `acts` has `now` (a picture of now), `show`, `drop`. */
export async function compareSnapshots(scene, acts) {
  const dialog = at("comparing"),
    now = acts.now();
  const side = (id, first) => {
    const figure = at(id),
      choice = figure.querySelector("select"),
      image = figure.querySelector("img");
    choice.replaceChildren(
      new Option("now", ""),
      ...scene.snapshots.map(
        (each) => new Option(`${each.name}, ${clock(each.time)}, ${each.look}`, each.number),
      ),
    );
    choice.value = first;
    const show = () => {
      image.src = choice.value ? `snapshots/${choice.value}` : now;
      image.alt = choice.selectedOptions[0].textContent;
      for (const each of figure.querySelectorAll("button")) each.disabled = !choice.value;
    };
    choice.onchange = show;
    figure.querySelector(".show").onclick = () => {
      dialog.close();
      acts.show(Number(choice.value));
    };
    figure.querySelector(".drop").onclick = () => {
      dialog.close();
      acts.drop(Number(choice.value));
    };
    show();
  };
  side("left", String(scene.snapshots[scene.snapshots.length - 1]?.number ?? ""));
  side("right", "");
  await opened(dialog);
}
