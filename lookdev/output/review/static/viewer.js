// @ts-check
// The entry of the review page: the state of the page, which its URL stores, and the functions that
// change and show it. The page shows a frame A, alone or compared with a frame B.
"use strict";

// Start the page; `index` is the value that data/index.js passes (lookdev.output.review.page).
review.start = (index) => {
  const { makeElement } = review;
  const $ = (id) => document.getElementById(id);
  const uniqueValues = (list) => [...new Set(list)];
  const versions = index.versions;
  const names = Object.fromEntries(
    ["look", "rig", "turntable"].map((key) => [
      `${key}s`,
      uniqueValues(index.reels.map((reel) => reel[key])),
    ]),
  );
  const reels = new Map(
    index.reels.map((reel) => [
      [reel.version, reel.look, reel.rig, reel.turntable].join("\n"),
      reel,
    ]),
  );
  // Return the reel of a side, which has a version, a look and a rig, or null if there is none.
  const findReel = (side, turntable = state.turntable) =>
    reels.get([side.version, side.look, side.rig, turntable].join("\n")) || null;

  const firstReel = index.reels[0];
  const state = {
    a: { version: 0, look: firstReel.look, rig: firstReel.rig },
    // If there is an old version, B is this version of A; else B is another look, if there is one.
    // A look or rig of null is that of A.
    b: {
      version: versions.length - 1,
      look: versions.length > 1 ? null : names.looks[1] || names.looks[0],
      rig: null,
    },
    turntable: firstReel.turntable,
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
  // Return version, look and rig of B, without null.
  const sideB = () => ({
    version: state.b.version,
    look: state.b.look || state.a.look,
    rig: state.b.rig || state.a.rig,
  });
  const isComparing = () => state.mode !== "picture";
  const { clamp, wrap } = review;
  const canvas = $("canvas"),
    picture = $("picture"),
    stage = $("stage"),
    frameBox = $("frame");

  let renderer = null;
  try {
    renderer = review.createRenderer(canvas, index.view);
  } catch (error) {
    console.error(error);
  }
  if (!renderer) {
    $("problems").append(
      makeElement(
        "li",
        {},
        "This browser has no WebGL 2: pictures turn, but exposure, wipes and differences need it.",
      ),
    );
  }

  // The pixels of the frames on the canvas.
  let pixels = { a: null, b: null };
  let updateCount = 0;

  // A and B show the frame of the same number, which is in the name of its file. `state.frame` is
  // an index in A's reel, which may lack numbers.
  const frameNumber = () => {
    const reel = findReel(state.a);
    return reel ? reel.numbers[clamp(state.frame, 0, reel.count - 1)] : 1;
  };
  // Return the entry of a side's frame: its key, file, header and command; null if there is none.
  async function loadFrame(side) {
    const reel = findReel(side),
      position = reel ? reel.numbers.indexOf(frameNumber()) : -1;
    if (position < 0) return null;
    const frames = await review.loadScript(reel.script, reel.script);
    return frames[position];
  }

  // The state as text. The attribute data-drawn of the body has the state that the canvas shows.
  const stateText = () =>
    URL_KEYS.map((key) => state[key])
      .concat(Object.values(state.a), Object.values(sideB()))
      .join(" ");
  Object.defineProperty(review, "stateText", { get: stateText });

  // Show the state: at once by what is in memory, and then by what must be read. A later call ends
  // this one.
  async function update() {
    const updateNumber = ++updateCount;
    updateControls();
    const [a, b] = await Promise.all([
      loadFrame(state.a),
      isComparing() ? loadFrame(sideB()) : null,
    ]).catch((error) => {
      reportError(error, updateNumber);
      return [null, null];
    });
    if (updateNumber !== updateCount) return;
    if (!a) {
      picture.hidden = true;
      return showNotice("no frames of this look, rig and turntable");
    }
    review.showProvenance($("provenance"), a, b);
    const isCached = renderer && review.cachedPixels(a.key) && (!b || review.cachedPixels(b.key));
    if (isCached) return draw(a, b);
    const source = `data/frames/${a.key}.jpg`;
    if (!renderer || (state.mode === "picture" && state.stops === 0 && state.behind === 0)) {
      if (picture.getAttribute("src") !== source) picture.src = source;
      picture.hidden = false;
    }
    resizeStage(findReel(state.a));
    if (!renderer) return;
    clearTimeout(noticeTimer);
    noticeTimer = setTimeout(() => showNotice("reading …"), 400);
    // Wait a moment, so that nothing is read while the pointer moves on.
    await new Promise((resolve) => setTimeout(resolve, state.playing ? 0 : 60));
    if (updateNumber !== updateCount) return;
    try {
      await Promise.all([a, b].filter(Boolean).map((frame) => review.loadPixels(frame.key)));
      if (updateNumber === updateCount) draw(a, b);
    } catch (error) {
      reportError(error, updateNumber);
    }
  }

  // The ratios z of the frames on the canvas, and the key of these frames; see review.noiseRatios.
  let ratios = null,
    ratiosKey = "";
  // Draw the frames `a` and `b` (or null), whose pixels are in the cache.
  function draw(a, b) {
    const [pixelsA, pixelsB] = [a, b].map((frame) => frame && review.cachedPixels(frame.key));
    pixels = { a: pixelsA, b: pixelsB };
    const pairKey = b && state.mode === "noise" ? `${a.key} ${b.key} ${state.square}` : "";
    if (pairKey !== ratiosKey) {
      ratios = pairKey && review.noiseRatios(pixels.a, pixels.b, state.square);
      ratiosKey = pairKey;
    }
    renderer.draw(pixels.a, pixels.b, { ...state, amplify: 2 ** state.amplify });
    picture.hidden = true;
    showNotice("");
    resizeStage(pixels.a);
    showLegend(b);
    showCursorValues();
    prefetchFrames();
    document.body.dataset.drawn = stateText();
    review.drawnKeys = [a.key, b ? b.key : ""];
  }

  // Read the frames of the turntable that follow, as many as half the cache holds.
  let prefetchedScript = "";
  async function prefetchFrames() {
    const reel = findReel(state.a);
    if (!reel || prefetchedScript === reel.script) return;
    prefetchedScript = reel.script;
    const frames = await review.loadScript(reel.script, reel.script);
    const count = Math.min(frames.length, review.frameCapacity(10 * reel.width * reel.height));
    for (let offset = 1; offset < count && prefetchedScript === reel.script; offset++) {
      const { key } = frames[wrap(state.frame + offset, frames.length)];
      await review.loadPixels(key).catch(() => null);
    }
  }

  let noticeTimer = 0;
  function showNotice(text) {
    clearTimeout(noticeTimer);
    $("notice").textContent = text;
    $("notice").hidden = !text;
  }

  function reportError(error, updateNumber) {
    if (updateNumber === updateCount) showNotice(error.message);
  }

  // Show a line that explains the colours of a difference, or why there is none.
  function showLegend(b) {
    const target = $("legend");
    target.hidden = state.mode === "picture" || (state.mode === "wipe" && Boolean(b));
    if (target.hidden) return;
    delete target.dataset.share;
    if (!b)
      target.textContent = findReel(sideB())
        ? `B has no frame ${frameNumber()}`
        : "B has no frames here";
    else if (pixels.a.width !== pixels.b.width || pixels.a.height !== pixels.b.height)
      target.textContent = "A and B differ in size";
    else if (state.mode === "difference")
      target.textContent = `(A − B) × ${2 ** state.amplify}, grey where equal`;
    else {
      const share = ratios && review.shareBeyond(pixels.a, pixels.b, ratios, 3);
      target.textContent = ratios
        ? `${(100 * share).toFixed(2)} % of the asset beyond z = 3; noise alone: at most 0.3 %`
        : "the error of a frame is not known: it was rendered without, or by another version";
      if (ratios) target.dataset.share = share;
    }
  }

  // Set the size of the picture on the page by the zoom, and the positions of wipe and cursor.
  function resizeStage({ width, height }) {
    const scale =
      state.zoom === "fit"
        ? Math.min(stage.clientWidth / width, Math.max(200, 0.68 * innerHeight) / height)
        : Number(state.zoom) / devicePixelRatio;
    frameBox.style.width = `${Math.round(width * scale)}px`;
    frameBox.style.height = `${Math.round(height * scale)}px`;
    frameBox.classList.toggle("pixelated", state.zoom !== "fit");
    $("handle").hidden = state.mode !== "wipe";
    $("handle").style.left = `${100 * state.split}%`;
    $("cursor").hidden = !state.cursor || !state.cursor.pinned;
    if (state.cursor) {
      $("cursor").style.left = `${(100 * (state.cursor.x + 0.5)) / width}%`;
      $("cursor").style.top = `${(100 * (state.cursor.y + 0.5)) / height}%`;
    }
  }

  function showCursorValues() {
    if (!state.cursor || !pixels.a) return;
    const x = clamp(state.cursor.x, 0, pixels.a.width - 1),
      y = clamp(state.cursor.y, 0, pixels.a.height - 1);
    review.showValues($("values"), x, y, pixels.a, pixels.b, renderer.codeValues(x, y), ratios);
  }

  const sideLabel = (side) =>
    `${side.look} / ${side.rig}${versions.length > 1 ? ` (${versions[side.version].name})` : ""}`;
  // Set the controls, the cells and the URL to the state.
  function updateControls() {
    const reel = findReel(state.a),
      count = reel ? reel.count : 1;
    state.frame = clamp(state.frame, 0, count - 1);
    $("frame-slider").max = count - 1;
    $("frame-slider").value = state.frame;
    const missing = reel && reel.numbers[count - 1] !== count;
    $("frame-slider").setAttribute("aria-valuetext", `frame ${state.frame + 1} of ${count}`);
    $("frame-text").textContent =
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
    for (const [side, selects] of Object.entries(sideSelects)) {
      for (const [key, select] of Object.entries(selects))
        select.value = state[side][key] === null ? "" : String(state[side][key]);
    }
    const other = sideB();
    $("tag-a").textContent = `A  ${sideLabel(state.a)}`;
    $("tag-b").textContent = `B  ${sideLabel(other)}`;
    $("tag-b").hidden = !isComparing();
    stage.setAttribute(
      "aria-label",
      `${sideLabel(state.a)}, ${state.turntable}, frame ${state.frame + 1} of ${count}` +
        (isComparing() ? `, ${state.mode} against ${sideLabel(other)}` : ""),
    );
    updateGrid(
      (look, rig) => findReel({ ...state.a, look, rig }),
      frameNumber(),
      state.a,
      isComparing() ? other : null,
    );
    writeUrl();
  }

  const URL_KEYS = [
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
  function writeUrl() {
    const parameters = new URLSearchParams();
    for (const side of ["a", "b"]) parameters.set(side, JSON.stringify(Object.values(state[side])));
    for (const key of URL_KEYS) parameters.set(key, state[key]);
    try {
      history.replaceState(null, "", `#${parameters}`);
    } catch {
      // Some browsers refuse to change the URL of a file.
    }
  }

  function readUrl() {
    const parameters = new URLSearchParams(location.hash.slice(1));
    try {
      for (const side of ["a", "b"]) {
        if (!parameters.has(side)) continue;
        const [version, look, rig] = JSON.parse(parameters.get(side));
        const isVersion =
          versions[version] &&
          (names.looks.includes(look) || (side === "b" && look === null)) &&
          (names.rigs.includes(rig) || (side === "b" && rig === null));
        if (isVersion) state[side] = { version, look, rig };
      }
    } catch {
      // The URL is not one of this page.
    }
    for (const key of URL_KEYS) {
      if (!parameters.has(key)) continue;
      const value =
        typeof state[key] === "number" ? Number(parameters.get(key)) : parameters.get(key);
      if (typeof value === "number" ? Number.isFinite(value) : value) state[key] = value;
    }
    if (!names.turntables.includes(state.turntable)) state.turntable = firstReel.turntable;
    if (!(state.mode in review.MODES)) state.mode = "picture";
    state.frame = Math.max(0, Math.floor(state.frame));
  }

  // Change entries of the state, and show it.
  const setState = (changes) => {
    const number = frameNumber();
    Object.assign(state, changes);
    // If A's reel is another one now, it shows the frame of the same number, or the last before it.
    const reel = findReel(state.a);
    if (reel && !("frame" in changes))
      state.frame = Math.max(
        0,
        reel.numbers.findLastIndex((other) => other <= number),
      );
    update();
  };
  const setSide = (side, changes) => setState({ [side]: { ...state[side], ...changes } });
  const stepIn = (list, value, step) => list[wrap(list.indexOf(value) + step, list.length)];
  const stepFrame = (step) => {
    const reel = findReel(state.a);
    if (reel) setState({ frame: wrap(state.frame + step, reel.count) });
  };
  const stepLook = (step) => setSide("a", { look: stepIn(names.looks, state.a.look, step) });
  const stepRig = (step) => setSide("a", { rig: stepIn(names.rigs, state.a.rig, step) });
  const stepTurntable = () => setState({ turntable: stepIn(names.turntables, state.turntable, 1) });
  const toggleMode = (mode) => setState({ mode: state.mode === mode ? "picture" : mode });
  const swapSides = () => setState({ a: sideB(), b: { ...state.a } });
  const changeExposure = (step) => setState({ stops: clamp(state.stops + step, -8, 8) });

  let playTimer = 0;
  function setPlaying(playing) {
    clearInterval(playTimer);
    if (playing) playTimer = setInterval(() => stepFrame(1), 1000 / 12);
    setState({ playing });
  }

  function setCursor(x, y, pinned) {
    state.cursor = { x, y, pinned };
    if (pixels.a) resizeStage(pixels.a);
    showCursorValues();
  }
  function moveCursor(dx, dy) {
    if (!pixels.a) return;
    const { x, y } = state.cursor || { x: pixels.a.width >> 1, y: pixels.a.height >> 1 };
    setCursor(clamp(x + dx, 0, pixels.a.width - 1), clamp(y + dy, 0, pixels.a.height - 1), true);
  }

  // Fill an element with radio buttons that set an entry of the state; `entries` are [value, text].
  function fillRadios(target, key, entries) {
    target.replaceChildren(
      ...entries.map(([value, text]) =>
        makeElement(
          "button",
          {
            type: "button",
            role: "radio",
            "data-radio": `${key}=${value}`,
            on: { click: () => setState({ [key]: value }) },
          },
          text,
        ),
      ),
    );
    target.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      const values = entries.map(([value]) => value);
      setState({ [key]: stepIn(values, state[key], step) });
      target.querySelector('[aria-checked="true"]').focus();
    });
  }
  fillRadios(
    $("turntables"),
    "turntable",
    names.turntables.map((name) => [name, name]),
  );
  $("turntables").hidden = names.turntables.length < 2;
  fillRadios($("modes"), "mode", [
    ["picture", "Picture"],
    ["wipe", "Wipe"],
    ["difference", "Difference"],
    ["noise", "z (noise)"],
  ]);

  // Add selects that set version, look and rig of a side; return the selects by these names.
  function addSelects(side) {
    const sameAsA = side === "b" ? [["", "as A"]] : [];
    const lists = {
      version:
        versions.length > 1
          ? versions.map((version, number) => [String(number), version.name])
          : null,
      look: [...sameAsA, ...names.looks.map((name) => [name, name])],
      rig: [...sameAsA, ...names.rigs.map((name) => [name, name])],
    };
    const selects = {};
    for (const [key, entries] of Object.entries(lists)) {
      if (!entries) continue;
      selects[key] = makeElement(
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
        ...entries.map(([value, text]) => makeElement("option", { value }, text)),
      );
      $(`choose-${side}`).append(selects[key]);
    }
    return selects;
  }
  const sideSelects = { a: addSelects("a"), b: addSelects("b") };

  const updateGrid = review.createGrid($("cells"), names, (look, rig, asB) => {
    const changes = asB ? { b: { ...state.b, look, rig } } : { a: { ...state.a, look, rig } };
    if (asB && !isComparing()) changes.mode = "wipe";
    setState(changes);
    if (!asB) $("viewer").scrollIntoView({ block: "nearest" });
  });
  if (index.changes) {
    $("changes").hidden = false;
    const counts = index.changes.filter((change) => change.state === "changed").length;
    $("changes-title").textContent =
      `Changes since ${versions[1].name}: ${counts} of ${index.changes.length} turntables`;
    review.showChanges($("changes-table"), index.changes, (change) => {
      const reel = reels.get([0, change.look, change.rig, change.turntable].join("\n"));
      setState({
        a: { version: 0, look: change.look, rig: change.rig },
        b: { version: 1, look: null, rig: null },
        turntable: change.turntable,
        frame: Math.max(0, reel.numbers.indexOf(change.frame)),
        mode: change.state === "new" ? "picture" : "noise",
      });
      $("viewer").scrollIntoView({ block: "start" });
    });
  }

  // The entries of the state that inputs set, by the ids of the inputs.
  const INPUTS = {
    "frame-slider": "frame",
    split: "split",
    amplify: "amplify",
    exposure: "stops",
    behind: "behind",
    square: "square",
  };
  for (const [id, key] of Object.entries(INPUTS))
    $(id).addEventListener("input", (event) => setState({ [key]: Number(event.target.value) }));
  $("zoom").addEventListener("change", (event) => setState({ zoom: event.target.value }));
  $("play").addEventListener("click", () => setPlaying(!state.playing));
  $("swap").addEventListener("click", swapSides);
  $("open-help").addEventListener("click", () => $("help").showModal());

  const page = {
    state,
    names,
    stage,
    frameBox,
    size: () => pixels.a || findReel(state.a),
    reel: () => findReel(state.a),
    setState,
    setSide,
    stepFrame,
    stepLook,
    stepRig,
    stepTurntable,
    toggleMode,
    swapSides,
    changeExposure,
    setPlaying,
    setCursor,
    moveCursor,
  };
  review.followPointer(page);
  review.followKeys(page);
  addEventListener("resize", () => pixels.a && resizeStage(pixels.a));
  addEventListener("hashchange", () => {
    readUrl();
    update();
  });

  document.title = `${index.title}: review`;
  $("title").textContent = index.title;
  const formatCount = (list, noun) => `${list.length} ${noun}${list.length === 1 ? "" : "s"}`;
  $("summary").textContent = [
    formatCount(names.looks, "look"),
    formatCount(names.rigs, "rig"),
    formatCount(names.turntables, "turntable"),
    `view ${index.view.name}`,
    ...(versions.length > 1 ? [`against ${versions[1].name}`] : []),
  ].join(" · ");
  $("problems").append(
    ...versions
      .flatMap((version) => version.problems)
      .map((problem) => makeElement("li", {}, problem)),
  );
  $("problems").hidden = !$("problems").childElementCount;
  review.state = state;
  readUrl();
  update();
};
