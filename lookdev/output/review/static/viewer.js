// @ts-check
// The page: its state, which the address keeps, and what changes it.
"use strict";

review.start = (index) => {
  const { make } = review;
  const $ = (id) => document.getElementById(id);
  const unique = (list) => [...new Set(list)];
  const versions = index.versions;
  const names = Object.fromEntries(
    ["look", "rig", "turntable"].map((key) => [
      `${key}s`,
      unique(index.reels.map((reel) => reel[key])),
    ]),
  );
  const reels = new Map(
    index.reels.map((reel) => [
      [reel.version, reel.look, reel.rig, reel.turntable].join("\n"),
      reel,
    ]),
  );
  const find = (side, turntable = state.turntable) =>
    reels.get([side.version, side.look, side.rig, turntable].join("\n")) || null;

  const first = index.reels[0];
  const state = {
    a: { version: 0, look: first.look, rig: first.rig },
    // Of an old version, the same look and rig as A; otherwise another look, if there is one.
    b: {
      version: versions.length - 1,
      look: versions.length > 1 ? null : names.looks[1] || names.looks[0],
      rig: null,
    },
    turntable: first.turntable,
    frame: 0,
    mode: "picture",
    split: 0.5,
    amplify: 2,
    stops: 0,
    behind: 0,
    zoom: "fit",
    square: index.square,
    cursor: null,
    playing: false,
  };
  const sideB = () => ({
    version: state.b.version,
    look: state.b.look || state.a.look,
    rig: state.b.rig || state.a.rig,
  });
  const comparing = () => state.mode !== "picture";
  const { clamp, wrap } = review;
  const canvas = $("canvas"),
    picture = $("picture"),
    stage = $("stage"),
    box = $("frame");

  let drawer = null;
  try {
    drawer = review.drawer(canvas, index.view);
  } catch (error) {
    console.error(error);
  }
  if (!drawer) {
    $("problems").append(
      make(
        "li",
        {},
        "This browser has no WebGL 2: pictures turn, but exposure, wipes and differences need it.",
      ),
    );
  }

  // The pixels of the frames that are drawn.
  let images = { a: null, b: null };
  let turn = 0;

  // Frames are in step by the numbers in their names, as some may be missing: that of the state is
  // an index in A's reel.
  const frameNumber = () => {
    const reel = find(state.a);
    return reel ? reel.numbers[clamp(state.frame, 0, reel.count - 1)] : 1;
  };
  async function frameOf(side) {
    const reel = find(side),
      position = reel ? reel.numbers.indexOf(frameNumber()) : -1;
    if (position < 0) return null;
    const frames = await review.read(reel.script, reel.script);
    return frames[position];
  }

  // The state as text; the page has it in data-drawn once it is drawn.
  const stateText = () =>
    KEPT.map((key) => state[key])
      .concat(Object.values(state.a), Object.values(sideB()))
      .join(" ");
  Object.defineProperty(review, "wanted", { get: stateText });

  // Show the state: at once what is there, then what must be read.
  async function update() {
    const mine = ++turn;
    controls();
    const [a, b] = await Promise.all([
      frameOf(state.a),
      comparing() ? frameOf(sideB()) : null,
    ]).catch((error) => {
      failed(error, mine);
      return [null, null];
    });
    if (mine !== turn) return;
    if (!a) {
      picture.hidden = true;
      return notice("no frames of this look, rig and turntable");
    }
    review.showProvenance($("provenance"), a, b);
    const there = drawer && review.ready(a.key) && (!b || review.ready(b.key));
    if (there) return draw(a, b);
    const source = `data/frames/${a.key}.jpg`;
    if (!drawer || (state.mode === "picture" && state.stops === 0 && state.behind === 0)) {
      if (picture.getAttribute("src") !== source) picture.src = source;
      picture.hidden = false;
    }
    resizeStage(find(state.a));
    if (!drawer) return;
    clearTimeout(late);
    late = setTimeout(() => notice("reading …"), 400);
    // a hand that passes by reads nothing
    await new Promise((resolve) => setTimeout(resolve, state.playing ? 0 : 60));
    if (mine !== turn) return;
    try {
      await Promise.all([a, b].filter(Boolean).map((frame) => review.pixels(frame.key)));
      if (mine === turn) draw(a, b);
    } catch (error) {
      failed(error, mine);
    }
  }

  let ratios = null,
    ratiosOf = "";
  function draw(a, b) {
    const numbers = [a, b].map((frame) => frame && review.ready(frame.key));
    images = { a: numbers[0], b: numbers[1] };
    const pairKey = b && state.mode === "noise" ? `${a.key} ${b.key} ${state.square}` : "";
    if (pairKey !== ratiosOf) {
      ratios = pairKey && review.noiseRatios(images.a, images.b, state.square);
      ratiosOf = pairKey;
    }
    drawer.draw(images.a, images.b, { ...state, amplify: 2 ** state.amplify });
    picture.hidden = true;
    notice("");
    resizeStage(images.a);
    legend(b);
    values();
    ahead();
    document.body.dataset.drawn = stateText();
    review.drawnKeys = [a.key, b ? b.key : ""];
  }

  // Read the other frames of the turntable while nothing else is to do, as far as they fit into
  // memory.
  let reading = "";
  async function ahead() {
    const reel = find(state.a);
    if (!reel || reading === reel.script) return;
    reading = reel.script;
    const frames = await review.read(reel.script, reel.script);
    const most = Math.min(frames.length, review.roomFor(10 * reel.width * reel.height));
    for (let step = 1; step < most && reading === reel.script; step++) {
      await review.pixels(frames[wrap(state.frame + step, frames.length)].key).catch(() => null);
    }
  }

  let late = 0;
  function notice(text) {
    clearTimeout(late);
    $("busy").textContent = text;
    $("busy").hidden = !text;
  }

  function failed(error, mine) {
    if (mine === turn) notice(error.message);
  }

  function legend(b) {
    const target = $("legend");
    target.hidden = state.mode === "picture" || (state.mode === "wipe" && Boolean(b));
    if (target.hidden) return;
    delete target.dataset.share;
    if (!b)
      target.textContent = find(sideB())
        ? `B has no frame ${frameNumber()}`
        : "B has no frames here";
    else if (images.a.width !== images.b.width || images.a.height !== images.b.height)
      target.textContent = "A and B differ in size";
    else if (state.mode === "difference")
      target.textContent = `(A − B) × ${2 ** state.amplify}, grey where equal`;
    else {
      const share = ratios && review.shareBeyond(images.a, images.b, ratios, 3);
      target.textContent = ratios
        ? `${(100 * share).toFixed(2)} % of the asset beyond z = 3; noise alone: at most 0.3 %`
        : "the error of a frame is not known: it was rendered without, or by another version";
      if (ratios) target.dataset.share = share;
    }
  }

  function resizeStage({ width, height }) {
    const room =
      state.zoom === "fit"
        ? Math.min(stage.clientWidth / width, Math.max(200, 0.68 * innerHeight) / height)
        : Number(state.zoom) / devicePixelRatio;
    box.style.width = `${Math.round(width * room)}px`;
    box.style.height = `${Math.round(height * room)}px`;
    box.classList.toggle("pixelated", state.zoom !== "fit");
    $("handle").hidden = state.mode !== "wipe";
    $("handle").style.left = `${100 * state.split}%`;
    $("cursor").hidden = !state.cursor || !state.cursor.pinned;
    if (state.cursor) {
      $("cursor").style.left = `${(100 * (state.cursor.x + 0.5)) / width}%`;
      $("cursor").style.top = `${(100 * (state.cursor.y + 0.5)) / height}%`;
    }
  }

  function values() {
    if (!state.cursor || !images.a) return;
    const x = clamp(state.cursor.x, 0, images.a.width - 1),
      y = clamp(state.cursor.y, 0, images.a.height - 1);
    review.showValues($("values"), x, y, images.a, images.b, drawer.codeValues(x, y), ratios);
  }

  // Controls, and the address, as the state has them.
  const label = (side) =>
    `${side.look} / ${side.rig}${versions.length > 1 ? ` (${versions[side.version].name})` : ""}`;
  function controls() {
    const reel = find(state.a),
      count = reel ? reel.count : 1;
    state.frame = clamp(state.frame, 0, count - 1);
    $("number").max = count - 1;
    $("number").value = state.frame;
    const missing = reel && reel.numbers[count - 1] !== count;
    $("number").setAttribute("aria-valuetext", `frame ${state.frame + 1} of ${count}`);
    $("place").textContent =
      `${state.frame + 1} / ${count}${missing ? `, number ${frameNumber()}` : ""}`;
    $("play").setAttribute("aria-pressed", state.playing);
    $("play").textContent = state.playing ? "Pause" : "Play";
    $("split").value = state.split;
    $("split-field").hidden = state.mode !== "wipe";
    $("amplify").value = state.amplify;
    $("amplify-field").hidden = state.mode !== "difference";
    $("square").value = state.square;
    $("square-field").hidden = state.mode !== "noise";
    $("amplify-value").textContent = `× ${+(2 ** state.amplify).toPrecision(2)}`;
    $("exposure").value = state.stops;
    $("exposure-value").textContent = `${state.stops > 0 ? "+" : ""}${state.stops}`;
    $("behind").value = state.behind;
    $("zoom").value = state.zoom;
    for (const radio of document.querySelectorAll("[data-radio]")) {
      const [key, value] = radio.dataset.radio.split("=");
      radio.setAttribute("aria-checked", state[key] === value);
      radio.tabIndex = state[key] === value ? 0 : -1;
    }
    for (const [side, selects] of Object.entries(choices)) {
      for (const [key, select] of Object.entries(selects))
        select.value = state[side][key] === null ? "" : String(state[side][key]);
    }
    const other = sideB();
    $("tag-a").textContent = `A  ${label(state.a)}`;
    $("tag-b").textContent = `B  ${label(other)}`;
    $("tag-b").hidden = !comparing();
    stage.setAttribute(
      "aria-label",
      `${label(state.a)}, ${state.turntable}, frame ${state.frame + 1} of ${count}` +
        (comparing() ? `, ${state.mode} against ${label(other)}` : ""),
    );
    cells(
      (look, rig) => find({ ...state.a, look, rig }),
      frameNumber(),
      state.a,
      comparing() ? other : null,
    );
    keep();
  }

  const KEPT = [
    "turntable",
    "frame",
    "mode",
    "split",
    "amplify",
    "stops",
    "behind",
    "zoom",
    "square",
  ];
  function keep() {
    const parts = new URLSearchParams();
    for (const side of ["a", "b"]) parts.set(side, JSON.stringify(Object.values(state[side])));
    for (const key of KEPT) parts.set(key, state[key]);
    try {
      history.replaceState(null, "", `#${parts}`);
    } catch {
      // some browsers keep the address of a file as it is
    }
  }

  function recall() {
    const parts = new URLSearchParams(location.hash.slice(1));
    try {
      for (const side of ["a", "b"]) {
        if (!parts.has(side)) continue;
        const [version, look, rig] = JSON.parse(parts.get(side));
        const isVersion =
          versions[version] &&
          (names.looks.includes(look) || (side === "b" && look === null)) &&
          (names.rigs.includes(rig) || (side === "b" && rig === null));
        if (isVersion) state[side] = { version, look, rig };
      }
    } catch {
      // not an address of this page
    }
    for (const key of KEPT) {
      if (!parts.has(key)) continue;
      const value = typeof state[key] === "number" ? Number(parts.get(key)) : parts.get(key);
      if (typeof value === "number" ? Number.isFinite(value) : value) state[key] = value;
    }
    if (!names.turntables.includes(state.turntable)) state.turntable = first.turntable;
    if (!(state.mode in review.MODES)) state.mode = "picture";
    state.frame = Math.max(0, Math.floor(state.frame));
  }

  const set = (changes) => {
    const number = frameNumber();
    Object.assign(state, changes);
    // Another look stays at the number of the frame, or at the last before it.
    const reel = find(state.a);
    if (reel && !("frame" in changes))
      state.frame = Math.max(
        0,
        reel.numbers.findLastIndex((other) => other <= number),
      );
    update();
  };
  const setSide = (side, changes) => set({ [side]: { ...state[side], ...changes } });
  const step = (by) => {
    const reel = find(state.a);
    if (reel) set({ frame: wrap(state.frame + by, reel.count) });
  };
  const stepName = (key, by) => {
    const list = names[`${key}s`];
    setSide("a", { [key]: list[wrap(list.indexOf(state.a[key]) + by, list.length)] });
  };
  const stepTurntable = (by = 1) => {
    const list = names.turntables;
    set({ turntable: list[wrap(list.indexOf(state.turntable) + by, list.length)] });
  };
  const toggleMode = (mode) => set({ mode: state.mode === mode ? "picture" : mode });
  const swap = () => set({ a: sideB(), b: { ...state.a } });
  const expose = (by) => set({ stops: clamp(state.stops + by, -8, 8) });

  let timer = 0;
  function play(on) {
    clearInterval(timer);
    if (on) timer = setInterval(() => step(1), 1000 / 12);
    set({ playing: on });
  }

  function setCursor(x, y, pinned) {
    state.cursor = { x, y, pinned };
    if (images.a) resizeStage(images.a);
    values();
  }
  function moveCursor(dx, dy) {
    if (!images.a) return;
    const { x, y } = state.cursor || { x: images.a.width >> 1, y: images.a.height >> 1 };
    setCursor(clamp(x + dx, 0, images.a.width - 1), clamp(y + dy, 0, images.a.height - 1), true);
  }

  // Radio buttons and lists.
  function radios(target, key, entries) {
    target.replaceChildren(
      ...entries.map(([value, text]) =>
        make(
          "button",
          {
            type: "button",
            role: "radio",
            "data-radio": `${key}=${value}`,
            on: { click: () => set({ [key]: value }) },
          },
          text,
        ),
      ),
    );
    target.addEventListener("keydown", (event) => {
      const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!by) return;
      event.preventDefault();
      event.stopPropagation();
      const at = entries.findIndex(([value]) => value === state[key]);
      set({ [key]: entries[wrap(at + by, entries.length)][0] });
      target.querySelector('[aria-checked="true"]').focus();
    });
  }
  radios(
    $("tables"),
    "turntable",
    names.turntables.map((name) => [name, name]),
  );
  $("tables").hidden = names.turntables.length < 2;
  radios($("modes"), "mode", [
    ["picture", "Picture"],
    ["wipe", "Wipe"],
    ["difference", "Difference"],
    ["noise", "z (noise)"],
  ]);

  function choosers(side) {
    const follow = side === "b" ? [["", "as A"]] : [];
    const lists = {
      version:
        versions.length > 1
          ? versions.map((version, number) => [String(number), version.name])
          : null,
      look: [...follow, ...names.looks.map((name) => [name, name])],
      rig: [...follow, ...names.rigs.map((name) => [name, name])],
    };
    const selects = {};
    for (const [key, entries] of Object.entries(lists)) {
      if (!entries) continue;
      selects[key] = make(
        "select",
        {
          "aria-label": `${key} of ${side.toUpperCase()}`,
          on: {
            change: (event) =>
              setSide(side, {
                [key]: key === "version" ? Number(event.target.value) : event.target.value || null,
              }),
          },
        },
        ...entries.map(([value, text]) => make("option", { value }, text)),
      );
      $(`choose-${side}`).append(selects[key]);
    }
    return selects;
  }
  const choices = { a: choosers("a"), b: choosers("b") };

  const cells = review.grid($("cells"), index, names, (look, rig, asB) => {
    const changes = asB ? { b: { ...state.b, look, rig } } : { a: { ...state.a, look, rig } };
    if (asB && !comparing()) changes.mode = "wipe";
    set(changes);
    if (!asB) $("viewer").scrollIntoView({ block: "nearest" });
  });
  if (index.changes) {
    $("changes").hidden = false;
    const counts = index.changes.filter((change) => change.state === "changed").length;
    $("changes-title").textContent =
      `Changes since ${versions[1].name}: ${counts} of ${index.changes.length} turntables`;
    review.showChanges($("changes-table"), index.changes, (change) => {
      const reel = reels.get([0, change.look, change.rig, change.turntable].join("\n"));
      set({
        a: { version: 0, look: change.look, rig: change.rig },
        b: { version: 1, look: null, rig: null },
        turntable: change.turntable,
        frame: Math.max(0, reel.numbers.indexOf(change.frame)),
        mode: change.state === "new" ? "picture" : "noise",
      });
      $("viewer").scrollIntoView({ block: "start" });
    });
  }

  const bound = {
    number: "frame",
    split: "split",
    amplify: "amplify",
    exposure: "stops",
    behind: "behind",
    square: "square",
  };
  for (const [id, key] of Object.entries(bound))
    $(id).addEventListener("input", (event) => set({ [key]: Number(event.target.value) }));
  $("zoom").addEventListener("change", (event) => set({ zoom: event.target.value }));
  $("play").addEventListener("click", () => play(!state.playing));
  $("swap").addEventListener("click", swap);
  $("open-help").addEventListener("click", () => $("help").showModal());

  const page = {
    state,
    names,
    stage,
    box,
    size: () => images.a || find(state.a),
    reel: () => find(state.a),
    set,
    setSide,
    step,
    stepName,
    stepTurntable,
    toggleMode,
    swap,
    expose,
    play,
    setCursor,
    moveCursor,
  };
  review.followPointer(page);
  review.followKeys(page);
  addEventListener("resize", () => images.a && resizeStage(images.a));
  addEventListener("hashchange", () => {
    recall();
    update();
  });

  document.title = `${index.title}: review`;
  $("title").textContent = index.title;
  const count = (list, noun) => `${list.length} ${noun}${list.length === 1 ? "" : "s"}`;
  $("summary").textContent = [
    count(names.looks, "look"),
    count(names.rigs, "rig"),
    count(names.turntables, "turntable"),
    `view ${index.view.name}`,
    ...(versions.length > 1 ? [`against ${versions[1].name}`] : []),
  ].join(" · ");
  $("problems").append(
    ...versions.flatMap((version) => version.problems).map((problem) => make("li", {}, problem)),
  );
  $("problems").hidden = !$("problems").childElementCount;
  review.state = state;
  recall();
  update();
};
