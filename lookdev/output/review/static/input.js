// @ts-check
// The pointer and the keys.
"use strict";

review.clamp = (value, low, high) => Math.min(high, Math.max(low, value));
review.wrap = (value, count) => ((value % count) + count) % count;

review.followPointer = (page) => {
  const { clamp, wrap } = review;
  const { state, stage, box, set, stepTurntable, setCursor } = page;
  // Dragging: the wipe in its mode, else the turntable; with shift held, the other turntable.
  let drag = null;
  const pixelAt = (event) => {
    const area = box.getBoundingClientRect(),
      size = page.size();
    const x = Math.floor(((event.clientX - area.left) / area.width) * size.width);
    const y = Math.floor(((event.clientY - area.top) / area.height) * size.height);
    return x >= 0 && y >= 0 && x < size.width && y < size.height ? [x, y] : null;
  };
  const splitAt = (event) => {
    const area = box.getBoundingClientRect();
    return clamp((event.clientX - area.left) / area.width, 0, 1);
  };
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !page.reel()) return;
    if (event.shiftKey) stepTurntable();
    drag = { x: event.clientX, frame: state.frame, moved: false };
    stage.setPointerCapture(event.pointerId);
    if (state.mode === "wipe") set({ split: splitAt(event) });
  });
  stage.addEventListener("pointermove", (event) => {
    const reel = page.reel();
    if (!reel) return;
    if (!drag) {
      const at =
        event.pointerType === "mouse" && !(state.cursor && state.cursor.pinned) && pixelAt(event);
      if (at) setCursor(...at, false);
      return;
    }
    const across = event.clientX - drag.x;
    drag.moved ||= Math.abs(across) > 4;
    if (!drag.moved) return;
    if (state.mode === "wipe") return set({ split: splitAt(event) });
    // the picture's width is a whole turn
    const by = Math.round((across / box.clientWidth) * reel.count);
    const frame = wrap(drag.frame + by, reel.count);
    if (frame !== state.frame) set({ frame });
  });
  const release = (event) => {
    if (drag && !drag.moved && event.type === "pointerup" && state.mode !== "wipe") {
      const at = pixelAt(event);
      if (at)
        setCursor(...at, !(state.cursor && state.cursor.pinned) || event.pointerType !== "mouse");
    }
    drag = null;
  };
  stage.addEventListener("pointerup", release);
  stage.addEventListener("pointercancel", release);
  box.addEventListener("dragstart", (event) => event.preventDefault());
};

review.followKeys = (page) => {
  const { clamp, make } = review;
  const {
    state,
    names,
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
  } = page;
  const help = document.getElementById("help");
  const KEYS = [
    [
      "ArrowLeft",
      "←",
      "previous frame; with shift, the pixel to the left",
      (e) => (e.shiftKey ? moveCursor(-1, 0) : step(-1)),
    ],
    [
      "ArrowRight",
      "→",
      "next frame; with shift, the pixel to the right",
      (e) => (e.shiftKey ? moveCursor(1, 0) : step(1)),
    ],
    [
      "ArrowUp",
      "↑",
      "previous look; with shift, the pixel above",
      (e) => (e.shiftKey ? moveCursor(0, -1) : stepName("look", -1)),
    ],
    [
      "ArrowDown",
      "↓",
      "next look; with shift, the pixel below",
      (e) => (e.shiftKey ? moveCursor(0, 1) : stepName("look", 1)),
    ],
    ["[", "[", "previous rig", () => stepName("rig", -1)],
    ["]", "]", "next rig", () => stepName("rig", 1)],
    ["t", "t", "next turntable", () => stepTurntable()],
    [" ", "space", "play, pause", () => play(!state.playing)],
    ["w", "w", "wipe from A to B", () => toggleMode("wipe")],
    [",", ",", "move the wipe left", () => set({ split: clamp(state.split - 0.05, 0, 1) })],
    [".", ".", "move the wipe right", () => set({ split: clamp(state.split + 0.05, 0, 1) })],
    ["d", "d", "difference of A and B", () => toggleMode("difference")],
    ["z", "z", "difference in units of noise", () => toggleMode("noise")],
    ["x", "x", "swap A and B", swap],
    ["+", "+", "brighter by a quarter of a stop", () => expose(0.25)],
    ["-", "−", "darker by a quarter of a stop", () => expose(-0.25)],
    ["0", "0", "exposure as rendered", () => set({ stops: 0 })],
    [
      "p",
      "p",
      "values of a pixel: the middle, or none",
      () =>
        state.cursor && state.cursor.pinned
          ? setCursor(state.cursor.x, state.cursor.y, false)
          : moveCursor(0, 0),
    ],
    ["Escape", "esc", "the plain picture", () => set({ mode: "picture" })],
    ["?", "?", "this list", () => help.showModal()],
  ];
  const actions = new Map(KEYS.map(([key, , , act]) => [key, act]));
  actions.set("=", actions.get("+"));
  document
    .getElementById("keys")
    .append(
      ...KEYS.flatMap(([, name, text]) => [
        make("dt", {}, make("kbd", {}, name)),
        make("dd", {}, text),
      ]),
      make("dt", {}, make("kbd", {}, "1"), " … ", make("kbd", {}, "9")),
      make("dd", {}, "one of the first looks"),
    );
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.open) return;
    const target = /** @type {Element} */ (event.target);
    if (target.matches("select")) return;
    if (target.matches("input") && event.key.startsWith("Arrow")) return;
    if (target.matches("button, a") && (event.key === " " || event.key === "Enter")) return;
    const look = /^[1-9]$/.test(event.key) ? names.looks[Number(event.key) - 1] : null;
    const act = look ? () => setSide("a", { look }) : actions.get(event.key);
    if (!act) return;
    event.preventDefault();
    act(event);
  });
};
