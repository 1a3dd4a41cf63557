// @ts-check
// The hand on the picture: orbit, pan, zoom, pick, and the light turned by shift-drag; the same by
// keys.

import { panned, rotated, zoomed } from "./viewport/camera.js";

const DEGREES = 0.4; // of a pixel
const STILL = 4; // pixels within which a press is a click

/** `turn` is called with degrees by which the light turns, `pick` with a place of the canvas. */
export function follow(canvas, viewport, { turn, pick, framed }) {
  let held = null;
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("pointerdown", (event) => {
    if (!viewport.camera) return;
    canvas.setPointerCapture(event.pointerId);
    canvas.focus();
    const pans = event.button !== 0 || event.ctrlKey || event.metaKey;
    held = {
      x: event.offsetX,
      y: event.offsetY,
      moved: 0,
      kind: event.shiftKey ? "light" : pans ? "pan" : "orbit",
    };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    const [dx, dy] = [event.offsetX - held.x, event.offsetY - held.y];
    held.moved += Math.abs(dx) + Math.abs(dy);
    [held.x, held.y] = [event.offsetX, event.offsetY];
    if (held.moved < STILL) return;
    if (held.kind === "light") turn(DEGREES * dx);
    else if (held.kind === "pan")
      viewport.setCamera(
        panned(viewport.camera, dx / canvas.clientWidth, -dy / canvas.clientWidth),
      );
    else viewport.setCamera(rotated(viewport.camera, -DEGREES * dx, DEGREES * dy));
  });
  const released = (event) => {
    if (held && held.moved < STILL && held.kind === "orbit" && event.type === "pointerup") {
      pick(
        (event.offsetX / canvas.clientWidth) * canvas.width,
        (event.offsetY / canvas.clientHeight) * canvas.height,
      );
    }
    held = null;
  };
  canvas.addEventListener("pointerup", released);
  canvas.addEventListener("pointercancel", released);
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      if (viewport.camera)
        viewport.setCamera(zoomed(viewport.camera, Math.exp(-0.0015 * event.deltaY)));
    },
    { passive: false },
  );
  const keys = {
    ArrowLeft: () => rotated(viewport.camera, -5, 0),
    ArrowRight: () => rotated(viewport.camera, 5, 0),
    ArrowUp: () => rotated(viewport.camera, 0, 5),
    ArrowDown: () => rotated(viewport.camera, 0, -5),
    "+": () => zoomed(viewport.camera, 1.1),
    "-": () => zoomed(viewport.camera, 1 / 1.1),
    f: framed,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!viewport.camera || event.ctrlKey || event.metaKey) return;
    if (event.shiftKey && ["ArrowLeft", "ArrowRight"].includes(event.key))
      turn(event.key === "ArrowLeft" ? -5 : 5);
    else if (keys[event.key]) viewport.setCamera(keys[event.key]());
    else return;
    event.preventDefault();
  });
}
