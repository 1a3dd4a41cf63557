// @ts-check
// The pointer and keys on the viewport's picture: they orbit, pan and zoom the camera, pick a part,
// and rotate the light.

import { pan, rotate, zoom } from "./viewport/camera.js";

const DEGREES = 0.4; // of rotation for each pixel of a drag
const STILL = 4; // pixels within which a press is a click

/**
 * Act on the pointer and keys of a canvas, which shows `viewport`. `turnLight` is called with
 * degrees, and `pick` with a position in pixels of the picture. `frameCamera` returns the camera
 * of the job's frames.
 */
export function followPointer(canvas, viewport, { turnLight, pick, frameCamera }) {
  followDrags(canvas, viewport, turnLight, pick);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      if (viewport.camera)
        viewport.setCamera(zoom(viewport.camera, Math.exp(-0.0015 * event.deltaY)));
    },
    { passive: false },
  );
  const cameras = {
    ArrowLeft: () => rotate(viewport.camera, -5, 0),
    ArrowRight: () => rotate(viewport.camera, 5, 0),
    ArrowUp: () => rotate(viewport.camera, 0, 5),
    ArrowDown: () => rotate(viewport.camera, 0, -5),
    "+": () => zoom(viewport.camera, 1.1),
    "-": () => zoom(viewport.camera, 1 / 1.1),
    f: frameCamera,
  };
  canvas.addEventListener("keydown", (event) => {
    if (!viewport.camera || event.ctrlKey || event.metaKey) return;
    if (event.shiftKey && ["ArrowLeft", "ArrowRight"].includes(event.key))
      turnLight(event.key === "ArrowLeft" ? -5 : 5);
    else if (cameras[event.key]) viewport.setCamera(cameras[event.key]());
    else return;
    event.preventDefault();
  });
}

/** Return the effect of a drag, by the button and the keys that are held when it begins. */
function dragKind({ button, shiftKey, ctrlKey, metaKey }) {
  if (shiftKey) return "light";
  return button !== 0 || ctrlKey || metaKey ? "pan" : "orbit";
}

/** Act on drags of the pointer, and on clicks, which are drags of less than `STILL` pixels. */
function followDrags(canvas, viewport, turnLight, pick) {
  let drag = null;
  canvas.addEventListener("pointerdown", (event) => {
    if (!viewport.camera) return;
    canvas.setPointerCapture(event.pointerId);
    canvas.focus();
    drag = { x: event.offsetX, y: event.offsetY, distance: 0, kind: dragKind(event) };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!drag) return;
    const [dx, dy] = [event.offsetX - drag.x, event.offsetY - drag.y];
    drag.distance += Math.abs(dx) + Math.abs(dy);
    [drag.x, drag.y] = [event.offsetX, event.offsetY];
    if (drag.distance < STILL) return;
    if (drag.kind === "light") turnLight(DEGREES * dx);
    else if (drag.kind === "pan")
      viewport.setCamera(pan(viewport.camera, dx / canvas.clientWidth, -dy / canvas.clientWidth));
    else viewport.setCamera(rotate(viewport.camera, -DEGREES * dx, DEGREES * dy));
  });
  const endDrag = (event) => {
    const isClick = drag && drag.distance < STILL && drag.kind === "orbit";
    if (isClick && event.type === "pointerup") {
      pick(
        (event.offsetX / canvas.clientWidth) * canvas.width,
        (event.offsetY / canvas.clientHeight) * canvas.height,
      );
    }
    drag = null;
  };
  canvas.addEventListener("pointerup", endDrag);
  canvas.addEventListener("pointercancel", endDrag);
}
