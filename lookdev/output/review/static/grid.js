// @ts-check
// The grid of looks and rigs, and the table of changes.
"use strict";

// Show one sprite of a reel in an element.
review.showSprite = (element, reel, number) => {
  const rows = Math.ceil(reel.count / reel.columns);
  const x = number % reel.columns,
    y = Math.floor(number / reel.columns);
  const at = (index, count) => (count > 1 ? (100 * index) / (count - 1) : 0);
  element.style.backgroundSize = `${100 * reel.columns}% ${100 * rows}%`;
  element.style.backgroundPosition = `${at(x, reel.columns)}% ${at(y, rows)}%`;
  element.dataset.number = number;
};

review.grid = (target, index, names, open) => {
  const { make } = review;
  const cells = []; // { button, look, rig, reel }
  const seen = new IntersectionObserver(
    (entries) => {
      for (const entry of entries) {
        const cell = cells[/** @type {HTMLElement} */ (entry.target).dataset.cell];
        cell.visible = entry.isIntersecting;
        load(cell);
      }
    },
    { rootMargin: "200px" },
  );

  function load(cell) {
    if (!cell.visible || !cell.reel || cell.loaded === cell.reel.sprite) return;
    cell.loaded = cell.reel.sprite;
    cell.button.style.backgroundImage = `url("${cell.reel.sprite}")`;
  }

  function scrub(cell, event) {
    if (!cell.reel) return;
    const box = cell.button.getBoundingClientRect();
    const part = (event.clientX - box.left) / box.width;
    const number = Math.min(cell.reel.count - 1, Math.max(0, Math.floor(part * cell.reel.count)));
    review.showSprite(cell.button, cell.reel, number);
  }

  const rows = names.looks.map((look) =>
    make(
      "tr",
      {},
      make("th", { scope: "row" }, look),
      ...names.rigs.map((rig) => {
        const cell = { look, rig, reel: undefined, visible: false, loaded: "" };
        cell.button = make("button", {
          type: "button",
          class: "cell",
          "data-cell": cells.push(cell) - 1,
          on: {
            pointermove: (event) => scrub(cell, event),
            pointerleave: () => cell.reel && review.showSprite(cell.button, cell.reel, cell.number),
            click: (event) => open(look, rig, event.shiftKey),
          },
        });
        seen.observe(cell.button);
        return make("td", {}, cell.button);
      }),
    ),
  );
  target.replaceChildren(review.table(["", ...names.rigs], rows, { class: "grid" }));

  // Show a turntable at a frame in all cells, which `find` returns reels for; mark the cells of A
  // and B.
  return (find, number, a, b) => {
    for (const cell of cells) {
      const { button } = cell;
      const reel = find(cell.look, cell.rig);
      if (reel !== cell.reel) {
        cell.reel = reel;
        button.disabled = !reel;
        button.style.aspectRatio = reel ? `${reel.width} / ${reel.height}` : "4 / 3";
        button.replaceChildren(reel ? "" : "no frames");
        if (!reel) button.style.backgroundImage = "";
      }
      const marks = [a, b].map((side) => side && side.look === cell.look && side.rig === cell.rig);
      button.className = `cell${marks[0] ? " a" : ""}${marks[1] ? " b" : ""}`;
      button.setAttribute(
        "aria-label",
        `${cell.look} under ${cell.rig}${reel ? "" : ": no frames"}`,
      );
      button.toggleAttribute("aria-current", Boolean(marks[0]));
      if (!reel) continue;
      // The last frame up to the number: another one may be missing here.
      cell.number = Math.max(
        0,
        reel.numbers.findLastIndex((other) => other <= number),
      );
      review.showSprite(button, reel, cell.number);
      load(cell);
    }
  };
};

const STATES = {
  changed: "changed",
  "same picture": "same but for noise",
  same: "identical",
  new: "new",
  removed: "removed",
  "other frames": "no frame in common",
};

review.showChanges = (target, changes, open) => {
  const { make, number } = review;
  const order = Object.keys(STATES);
  const sorted = [...changes].sort(
    (p, q) => order.indexOf(p.state) - order.indexOf(q.state) || (q.beyond || 0) - (p.beyond || 0),
  );
  const headers = changes.some((change) => (change.headers || []).length);
  const rows = sorted.map((change) =>
    make(
      "tr",
      { class: change.state.replace(" ", "-") },
      make(
        "th",
        { scope: "row" },
        make(
          "button",
          {
            type: "button",
            class: "link",
            disabled: change.state === "removed",
            on: { click: () => open(change) },
          },
          `${change.look} / ${change.rig} / ${change.turntable}`,
        ),
      ),
      make("td", {}, make("span", { class: "state" }, STATES[change.state])),
      make("td", {}, (change.changed || []).join(", ")),
      make(
        "td",
        {},
        change.beyond === null || change.beyond === undefined
          ? ""
          : `${(100 * change.beyond).toFixed(2)} %`,
      ),
      make(
        "td",
        {},
        change.relmse === null || change.relmse === undefined ? "" : number(change.relmse, 2),
      ),
      make("td", {}, change.frame ? `${change.frame} (${change.frames})` : ""),
      headers &&
        make(
          "td",
          {},
          (change.headers || [])
            .map(([name, old, now]) => `${name}: ${old || "–"} → ${now || "–"}`)
            .join("; "),
        ),
    ),
  );
  target.replaceChildren(
    review.table(
      [
        "turntable",
        "",
        "inputs that differ",
        "asset beyond z = 3",
        "relMSE of the two",
        "worst frame",
        ...(headers ? ["header"] : []),
      ],
      rows,
      { class: "changes" },
    ),
  );
};
