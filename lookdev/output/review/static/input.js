// @ts-check
// The pointer and the keys of the review page. `page` has the state of the page, and the functions
// that change it (viewer.js).
"use strict";

review.clamp = (value, low, high) => Math.min(high, Math.max(low, value));
// Return a whole number modulo `count`, which is never negative.
review.wrap = (value, count) => ((value % count) + count) % count;

// Act on the pointer over the picture.
review.followPointer = (page) => {
  const { clamp, wrap } = review;
  const { state, stage, frameBox, setState, stepTurntable, setCursor } = page;
  // In the mode "wipe", a drag moves the wipe. In other modes, it steps through the frames. A press
  // with shift held first shows the next turntable.
  let drag = null;
  const pixelAt = (event) => {
    const area = frameBox.getBoundingClientRect(),
      size = page.size();
    const x = Math.floor(((event.clientX - area.left) / area.width) * size.width);
    const y = Math.floor(((event.clientY - area.top) / area.height) * size.height);
    return x >= 0 && y >= 0 && x < size.width && y < size.height ? [x, y] : null;
  };
  const splitAt = (event) => {
    const area = frameBox.getBoundingClientRect();
    return clamp((event.clientX - area.left) / area.width, 0, 1);
  };
  stage.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !page.reel()) return;
    if (event.shiftKey) stepTurntable();
    drag = { x: event.clientX, frame: state.frame, hasMoved: false };
    stage.setPointerCapture(event.pointerId);
    if (state.mode === "wipe") setState({ split: splitAt(event) });
  });
  stage.addEventListener("pointermove", (event) => {
    const reel = page.reel();
    if (!reel) return;
    if (!drag) {
      const pixel =
        event.pointerType === "mouse" && !(state.cursor && state.cursor.pinned) && pixelAt(event);
      if (pixel) setCursor(...pixel, false);
      return;
    }
    const dx = event.clientX - drag.x;
    drag.hasMoved ||= Math.abs(dx) > 4;
    if (!drag.hasMoved) return;
    if (state.mode === "wipe") return setState({ split: splitAt(event) });
    // A drag across the whole picture is a whole turn.
    const step = Math.round((dx / frameBox.clientWidth) * reel.count);
    const frame = wrap(drag.frame + step, reel.count);
    if (frame !== state.frame) setState({ frame });
  });
  const endDrag = (event) => {
    if (drag && !drag.hasMoved && event.type === "pointerup" && state.mode !== "wipe") {
      const pixel = pixelAt(event);
      if (pixel)
        setCursor(
          ...pixel,
          !(state.cursor && state.cursor.pinned) || event.pointerType !== "mouse",
        );
    }
    drag = null;
  };
  stage.addEventListener("pointerup", endDrag);
  stage.addEventListener("pointercancel", endDrag);
  frameBox.addEventListener("dragstart", (event) => event.preventDefault());
};

// Act on keys, and list them in the dialog of help.
review.followKeys = (page) => {
  const { clamp, makeElement } = review;
  const { state, names } = page;
  const help = document.getElementById("help");
  const moveWipe = (step) => page.setState({ split: clamp(state.split + step, 0, 1) });
  const togglePin = () => {
    if (state.cursor && state.cursor.pinned) page.setCursor(state.cursor.x, state.cursor.y, false);
    else page.moveCursor(0, 0);
  };
  // The value of the key's event, the key's name, its description, and its action.
  const KEYS = [
    [
      "ArrowLeft",
      "←",
      "previous frame; with shift, the pixel to the left",
      ({ shiftKey }) => (shiftKey ? page.moveCursor(-1, 0) : page.stepFrame(-1)),
    ],
    [
      "ArrowRight",
      "→",
      "next frame; with shift, the pixel to the right",
      ({ shiftKey }) => (shiftKey ? page.moveCursor(1, 0) : page.stepFrame(1)),
    ],
    [
      "ArrowUp",
      "↑",
      "previous look; with shift, the pixel above",
      ({ shiftKey }) => (shiftKey ? page.moveCursor(0, -1) : page.stepLook(-1)),
    ],
    [
      "ArrowDown",
      "↓",
      "next look; with shift, the pixel below",
      ({ shiftKey }) => (shiftKey ? page.moveCursor(0, 1) : page.stepLook(1)),
    ],
    ["[", "[", "previous rig", () => page.stepRig(-1)],
    ["]", "]", "next rig", () => page.stepRig(1)],
    ["t", "t", "next turntable", page.stepTurntable],
    [" ", "space", "play, pause", () => page.setPlaying(!state.playing)],
    ["w", "w", "wipe from A to B", () => page.toggleMode("wipe")],
    [",", ",", "move the wipe left", () => moveWipe(-0.05)],
    [".", ".", "move the wipe right", () => moveWipe(0.05)],
    ["d", "d", "difference of A and B", () => page.toggleMode("difference")],
    ["z", "z", "difference in units of noise", () => page.toggleMode("noise")],
    ["x", "x", "swap A and B", page.swapSides],
    ["+", "+", "brighter by a quarter of a stop", () => page.changeExposure(0.25)],
    ["-", "−", "darker by a quarter of a stop", () => page.changeExposure(-0.25)],
    ["0", "0", "exposure as rendered", () => page.setState({ stops: 0 })],
    ["p", "p", "values of a pixel: the middle, or none", togglePin],
    ["Escape", "esc", "the plain picture", () => page.setState({ mode: "picture" })],
    ["?", "?", "this list", () => help.showModal()],
  ];
  const actions = new Map(KEYS.map(([key, , , act]) => [key, act]));
  actions.set("=", actions.get("+"));
  document
    .getElementById("keys")
    .append(
      ...KEYS.flatMap(([, name, text]) => [
        makeElement("dt", {}, makeElement("kbd", {}, name)),
        makeElement("dd", {}, text),
      ]),
      makeElement("dt", {}, makeElement("kbd", {}, "1"), " … ", makeElement("kbd", {}, "9")),
      makeElement("dd", {}, "one of the first looks"),
    );
  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || help.open) return;
    const target = /** @type {Element} */ (event.target);
    if (target.matches("select")) return;
    if (target.matches("input") && event.key.startsWith("Arrow")) return;
    if (target.matches("button, a") && (event.key === " " || event.key === "Enter")) return;
    const look = /^[1-9]$/.test(event.key) ? names.looks[Number(event.key) - 1] : null;
    const act = look ? () => page.setSide("a", { look }) : actions.get(event.key);
    if (!act) return;
    event.preventDefault();
    act(event);
  });
};
