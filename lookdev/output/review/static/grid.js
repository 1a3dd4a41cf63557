// @ts-check
// The grid of the review page, which has a cell for each look and rig, and the table of changes
// between two versions. A reel has the frames of a turntable of a look under a rig. Functions
// called `open` show a cell, or a change, in the viewer.
"use strict";

// Show a thumbnail of a reel in an element. The sprite sheet of a reel is one picture with the
// thumbnails of all its frames; `number` is the index of a frame in it.
review.showSprite = (element, reel, number) => {
  const rows = Math.ceil(reel.count / reel.columns);
  const x = number % reel.columns,
    y = Math.floor(number / reel.columns);
  const percent = (index, count) => (count > 1 ? (100 * index) / (count - 1) : 0);
  element.style.backgroundSize = `${100 * reel.columns}% ${100 * rows}%`;
  element.style.backgroundPosition = `${percent(x, reel.columns)}% ${percent(y, rows)}%`;
  element.dataset.number = number;
};

// Fill an element with a cell for each look and rig; return the function that updates the cells.
// `open` is called with look, rig, and whether shift is held.
review.createGrid = (target, names, open) => {
  const { makeElement } = review;
  const cells = []; // { button, look, rig, reel }
  const observer = new IntersectionObserver(
    (entries) => {
      for (const entry of entries) {
        const cell = cells[/** @type {HTMLElement} */ (entry.target).dataset.cell];
        cell.visible = entry.isIntersecting;
        loadSprite(cell);
      }
    },
    { rootMargin: "200px" },
  );

  // Load the sprite sheet of a cell's reel when the cell is visible.
  function loadSprite(cell) {
    if (!cell.visible || !cell.reel || cell.loaded === cell.reel.sprite) return;
    cell.loaded = cell.reel.sprite;
    cell.button.style.backgroundImage = `url("${cell.reel.sprite}")`;
  }

  // Show the frame of a cell at the horizontal position of the pointer in the cell.
  function scrubCell(cell, event) {
    if (!cell.reel) return;
    const box = cell.button.getBoundingClientRect();
    const share = (event.clientX - box.left) / box.width;
    const number = Math.min(cell.reel.count - 1, Math.max(0, Math.floor(share * cell.reel.count)));
    review.showSprite(cell.button, cell.reel, number);
  }

  const rows = names.looks.map((look) =>
    makeElement(
      "tr",
      {},
      makeElement("th", { scope: "row" }, look),
      ...names.rigs.map((rig) => {
        const cell = { look, rig, reel: undefined, visible: false, loaded: "" };
        cell.button = makeElement("button", {
          type: "button",
          class: "cell",
          "data-cell": cells.push(cell) - 1,
          on: {
            pointermove: (event) => scrubCell(cell, event),
            pointerleave: () => cell.reel && review.showSprite(cell.button, cell.reel, cell.number),
            click: (event) => open(look, rig, event.shiftKey),
          },
        });
        observer.observe(cell.button);
        return makeElement("td", {}, cell.button);
      }),
    ),
  );
  target.replaceChildren(review.makeTable(["", ...names.rigs], rows, { class: "grid" }));

  // Show the frame of a number in all cells, and mark the cells of A and B. `findReel` returns the
  // reel of a look and a rig.
  return (findReel, number, a, b) => {
    for (const cell of cells) {
      const { button } = cell;
      const reel = findReel(cell.look, cell.rig);
      if (reel !== cell.reel) {
        cell.reel = reel;
        button.disabled = !reel;
        button.style.aspectRatio = reel ? `${reel.width} / ${reel.height}` : "4 / 3";
        button.replaceChildren(reel ? "" : "no frames");
        if (!reel) button.style.backgroundImage = "";
      }
      const isMarked = [a, b].map(
        (side) => side && side.look === cell.look && side.rig === cell.rig,
      );
      button.className = `cell${isMarked[0] ? " a" : ""}${isMarked[1] ? " b" : ""}`;
      button.setAttribute(
        "aria-label",
        `${cell.look} under ${cell.rig}${reel ? "" : ": no frames"}`,
      );
      button.toggleAttribute("aria-current", Boolean(isMarked[0]));
      if (!reel) continue;
      // If the reel lacks a frame of this number, the last one before it is shown.
      cell.number = Math.max(
        0,
        reel.numbers.findLastIndex((other) => other <= number),
      );
      review.showSprite(button, reel, cell.number);
      loadSprite(cell);
    }
  };
};

// The texts of the states of a comparison, in the order of the table.
const STATE_TEXTS = {
  changed: "changed",
  "same picture": "same but for noise",
  same: "identical",
  new: "new",
  removed: "removed",
  "other frames": "no frame in common",
};

// Show the comparisons of reels that lookdev.output.review.page writes, as a table in an element.
review.showChanges = (target, changes, open) => {
  const { makeElement, formatNumber } = review;
  const stateOrder = Object.keys(STATE_TEXTS);
  const sortedChanges = [...changes].sort(
    (p, q) =>
      stateOrder.indexOf(p.state) - stateOrder.indexOf(q.state) ||
      (q.beyond || 0) - (p.beyond || 0),
  );
  const hasHeaders = changes.some((change) => (change.headers || []).length);
  const rows = sortedChanges.map((change) =>
    makeElement(
      "tr",
      { class: change.state.replace(" ", "-") },
      makeElement(
        "th",
        { scope: "row" },
        makeElement(
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
      makeElement("td", {}, makeElement("span", { class: "state" }, STATE_TEXTS[change.state])),
      makeElement("td", {}, (change.changed || []).join(", ")),
      makeElement(
        "td",
        {},
        change.beyond === null || change.beyond === undefined
          ? ""
          : `${(100 * change.beyond).toFixed(2)} %`,
      ),
      makeElement(
        "td",
        {},
        change.relmse === null || change.relmse === undefined ? "" : formatNumber(change.relmse, 2),
      ),
      makeElement("td", {}, change.frame ? `${change.frame} (${change.frames})` : ""),
      hasHeaders &&
        makeElement(
          "td",
          {},
          (change.headers || [])
            .map(([name, before, after]) => `${name}: ${before || "–"} → ${after || "–"}`)
            .join("; "),
        ),
    ),
  );
  target.replaceChildren(
    review.makeTable(
      [
        "turntable",
        "",
        "inputs that differ",
        "asset beyond z = 3",
        "relMSE of the two",
        "worst frame",
        ...(hasHeaders ? ["header"] : []),
      ],
      rows,
      { class: "changes" },
    ),
  );
};
