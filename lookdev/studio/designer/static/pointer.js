// @ts-check
// The pointer and keys on the picture: they orbit, pan, zoom, pick, and turn the light.

import { pan, rotate, zoom } from "./viewport/camera.js";

const DEGREES = 0.4; // of a pixel
const STILL = 4; // pixels within which a press is a click

/**
 * Follow the pointer on a canvas. `turnLight` is called with degrees, `pick` with a position in
 * pixels; `frameCamera` returns the camera that frames the asset as the job does.
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

/** The kind of a drag, by the button and the keys that are held as it begins. */
function dragKind({ button, shiftKey, ctrlKey, metaKey }) {
  if (shiftKey) return "light";
  return button !== 0 || ctrlKey || metaKey ? "pan" : "orbit";
}

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
