// @ts-check
// The panel of files: it saves edits, and shows notices of unsaved work that an earlier Designer
// left, and of files that other programs have changed on disk.

import {
  byId,
  fileName,
  formatTime,
  makeButton,
  makeElement,
  openDialog,
} from "./viewport/elements.js";

const header = `
  <button type="button" id="save"
    title="Write the edits to the look's file (Ctrl+S)" disabled>Save</button>
  <button type="button" id="save-as"
    title="Write the look to a new file beside its own" disabled>Save as…</button>`;

const body = `
  <dialog id="naming" aria-label="Save as">
    <form method="dialog">
      <label>What <select id="naming-what"></select></label>
      <label><span id="naming-label"></span>
        <input type="text" id="name" autocomplete="off" spellcheck="false"></label>
      <p id="naming-file"></p>
      <menu class="reversed"><button value="save" id="naming-save">Save</button>
        <button value="cancel">Cancel</button></menu>
    </form>
  </dialog>
  <dialog id="conflict" aria-label="Changed on disk">
    <form method="dialog">
      <h2>Changed on disk</h2>
      <p>Another program has written this file since the Designer read it:</p>
      <p id="conflict-files"></p>
      <p>Loading it takes your edits away, until you undo.
        Saving over it loses what is there.</p>
      <menu>
        <button value="">Cancel</button>
        <button value="as">Save as…</button>
        <button value="load"
          title="Show what is on disk; undo brings your edits back">Load it</button>
        <button value="over"
          title="What the other program has written is lost">Save over it</button>
      </menu>
    </form>
  </dialog>`;

/**
 * Ask for the kind and the name of a new file, and call `write` with both, unless the user cancels
 * the dialog. `kinds` are [kind, label, path of the file beside which it will be, default name].
 */
export async function askFileName(kinds, write) {
  const show = () => {
    const [, label, file, name] = kinds[byId("naming-what").selectedIndex];
    byId("naming-label").textContent = label;
    byId("naming-file").textContent = file;
    byId("name").value = name;
  };
  byId("naming-what").replaceChildren(...kinds.map(([kind]) => new Option(`the ${kind}`, kind)));
  byId("naming-what").closest("label").hidden = kinds.length < 2;
  byId("naming-what").onchange = show;
  show();
  const closed = openDialog(byId("naming"));
  byId("name").select();
  if ((await closed) === "save") await write(byId("naming-what").value, byId("name").value);
}

/** Return a notice: an element with a text and buttons. */
function makeNotice(id, text, title, ...buttons) {
  const sentence = makeElement("p", { textContent: text, title });
  return makeElement("div", { className: "notice", id, role: "alert" }, sentence, ...buttons);
}

/** Return the notice of unsaved work; `act` is called with the action that the user chooses. */
function recoveryNotice({ files, time }, act) {
  const names = (list) => list.map(({ file }) => fileName(file)).join(", ");
  const changed = names(files.filter((file) => file.changed));
  const warning = changed && ` ${changed} has been changed on disk since then.`;
  return makeNotice(
    "recovery",
    `Unsaved work of ${formatTime(time)} was found: ${names(files)}.${warning}`,
    "",
    makeButton("Restore", "Show it; undo takes it away again", () => act("restore"), {
      id: "recovery-restore",
    }),
    makeButton("Discard", "Remove it for good", () => act("discard"), { id: "recovery-discard" }),
  );
}

/** Return the notice of `changed` files; `act` is called with the action that the user chooses. */
function changeNotice(changed, unsaved, act) {
  const hasEdits = unsaved.some(({ file }) => changed.includes(file));
  const warning = hasEdits ? " You have unsaved edits of it." : "";
  return makeNotice(
    "changed",
    `${changed.map(fileName).join(", ")} changed on disk.${warning}`,
    changed.join("\n"),
    makeButton("Load it", "Show what is on disk; undo brings your edits back", () => act("load"), {
      id: "changed-load",
    }),
    makeButton("Keep mine", "Keep what is shown; saving writes over the file", () => act("keep"), {
      id: "changed-keep",
    }),
  );
}

/** Show notices above the picture; equal ones there stay, so that they keep the focus. */
function showNotices(notices) {
  const text = (elements) => elements.map((notice) => notice.textContent).join();
  if (text([...byId("notices").children]) !== text(notices))
    byId("notices").replaceChildren(...notices);
}

/** The panel: its buttons, keys and notices. */
class Files {
  constructor(designer) {
    this.designer = designer;
    const save = () => this.save();
    this.keys = { "Ctrl+s": save, "Ctrl+Shift+s": save };
    byId("save").addEventListener("click", save);
    byId("save-as").addEventListener("click", () => this.saveAs());
    addEventListener("beforeunload", (event) => {
      if (designer.unsaved.length) event.preventDefault();
    });
  }

  /** Save all files; `over` writes over changes of other programs. */
  save(over = false) {
    return this.write({ over });
  }

  /** Ask for the name of a new file for the look or the job, and write it. */
  saveAs() {
    const { look, scene, stack } = this.designer,
      secondName = (path) => fileName(path).replace(/(\.\w+)$/, "_2$1");
    const looks =
      stack.file && !stack.locked
        ? [["look", "A new file beside the look's own", stack.file, secondName(stack.file)]]
        : [];
    const job = ["job", "A new file beside the job's", scene.job.file, secondName(scene.job.file)];
    askFileName([...looks, job], (kind, name) =>
      this.write({ look: kind === "job" ? null : look, name }),
    );
  }

  /** Send a request to save; ask the user about conflicts with changes of other programs. */
  async write(request) {
    const { designer } = this;
    try {
      await designer.settle();
      const { files, ...status } = await designer.fetchJson("save", request);
      await designer.adopt(status);
      designer.say(files.length ? `saved ${files.join(", ")}` : "nothing is unsaved");
    } catch (error) {
      if (error.conflict) await this.resolveConflict(error.conflict);
      else designer.say(error.message, true);
    }
  }

  /** Ask what to do about files that other programs have changed, and do it. */
  async resolveConflict(files) {
    byId("conflict-files").textContent = files.join("\n");
    const answer = await openDialog(byId("conflict"));
    if (answer === "over") await this.save(true);
    else if (answer === "load")
      await this.designer.request("disk", { do: "load" }, "loaded from disk");
    else if (answer === "as") this.saveAs();
  }

  update({ recovery, changed }) {
    const { designer } = this,
      { unsaved } = designer;
    const act = (name) =>
      designer.request(
        "disk",
        { do: name },
        name === "keep" ? "kept: saving writes over the file" : "",
      );
    showNotices([
      ...(recovery ? [recoveryNotice(recovery, act)] : []),
      ...(changed.length ? [changeNotice(changed, unsaved, act)] : []),
    ]);
    const names = [...new Set(unsaved.map(({ file }) => file))].join(", ");
    byId("save").disabled = unsaved.length === 0;
    byId("save").title = names ? `Write the edits to ${names} (Ctrl+S)` : "Nothing is unsaved";
    byId("save-as").disabled = false;
    document.title = `${unsaved.length ? "• " : ""}Designer · lookdev`;
  }
}

export const panel = { markup: { header, body }, mount: (designer) => new Files(designer) };
