// @ts-check
// Cameras of the viewport, as lookdev/scene/camera.py defines them: angles in degrees, lengths in
// metres, z up. The functions also return what the shaders need of a camera and of rotations.

const radians = (degrees) => (degrees * Math.PI) / 180;
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
/** Return the vector a + scale * b. */
export const sum = (a, b, scale = 1) => a.map((x, i) => x + scale * b[i]);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Return half the width of the frame at depth 1. */
export const halfWidth = (camera) => Math.tan(radians(camera.fov) / 2);

/** Return the camera's unit vectors to the right, up and backwards. */
export function basis(camera) {
  const azimuth = radians(camera.azimuth - 90),
    elevation = radians(camera.elevation),
    roll = radians(camera.roll);
  const right = [-Math.sin(azimuth), Math.cos(azimuth), 0];
  const level = Math.cos(elevation);
  const back = [level * Math.cos(azimuth), level * Math.sin(azimuth), Math.sin(elevation)];
  const up = cross(back, right);
  const rollAxis = (a, b, sign) =>
    a.map((x, i) => Math.cos(roll) * x + sign * Math.sin(roll) * b[i]);
  return [rollAxis(right, up, 1), rollAxis(up, right, -1), back];
}

/** Return the camera's position. */
export const position = (camera) => sum(camera.target, basis(camera)[2], camera.distance);

/** Return the camera after an orbit about its pivot, counter-clockwise seen from above. */
export function orbit(camera, degrees) {
  const [x, y] = camera.pivot,
    turn = radians(degrees);
  const [dx, dy] = [camera.target[0] - x, camera.target[1] - y];
  const target = [
    x + Math.cos(turn) * dx - Math.sin(turn) * dy,
    y + Math.sin(turn) * dx + Math.cos(turn) * dy,
  ];
  return { ...camera, target: [...target, camera.target[2]], azimuth: camera.azimuth + degrees };
}

/**
 * Return the camera after a rotation about its target, by degrees of azimuth and of elevation
 * (`rise`). The elevation stops before the poles, where the vector to the right is undefined.
 */
export function rotate(camera, degrees, rise) {
  const elevation = Math.max(-89.9, Math.min(89.9, camera.elevation + rise));
  return { ...camera, azimuth: camera.azimuth + degrees, elevation };
}

/**
 * Return the camera after the pointer has moved to the right (`across`) and up (`along`), as
 * fractions of the frame's width: points at the target's depth follow the pointer.
 */
export function pan(camera, across, along) {
  const [right, up] = basis(camera),
    width = 2 * halfWidth(camera) * camera.distance;
  return { ...camera, target: sum(sum(camera.target, right, -across * width), up, -along * width) };
}

/** Return the camera nearer to its target by a factor. */
export const zoom = (camera, factor) => ({ ...camera, distance: camera.distance / factor });

// The sample points are Roberts' additive recurrence in four dimensions: each point is the one
// before it plus STEPS, modulo 1. A seed shifts all points at random (Cranley and Patterson 1976).
const STEPS = [1, 2, 3, 4].map((k) => 1.1673039782614187 ** -k);
// Return the shift, in [0, 1), of coordinate k of the points of a seed.
function randomShift(seed, k) {
  let x = Math.imul(seed + 1, 0x9e3779b9) ^ Math.imul(k + 1, 0x632be5ab); // Wellons' "lowbias32"
  x = Math.imul(x ^ (x >>> 16), 0x7feb352d);
  x = Math.imul(x ^ (x >>> 15), 0x846ca68b);
  return ((x ^ (x >>> 16)) >>> 0) / 2 ** 32;
}
const samplePoint = (number, seed) =>
  STEPS.map((step, k) => (randomShift(seed, k) + step * (number + 1)) % 1);

/**
 * Return the uniforms that describe the view of a camera. Positions are relative to `center`, that
 * of the asset. The asset stands still: the camera orbits by `-element` degrees instead. All pixels
 * of a view are sampled at one point of their area and of the lens, that of `number` in the
 * sequence of `seed`; with `centred`, in the middle of their area. `depths` are the nearest and the
 * farthest depth of the asset, which is inside a ball of `radius`.
 */
export function viewUniforms(
  camera,
  { element, center, radius, width, height, number, seed, centred = false },
) {
  const orbited = orbit(camera, -element);
  const [right, up, back] = basis(orbited),
    half = halfWidth(orbited);
  const [lensU, lensV, ...area] = samplePoint(number, seed);
  const [u, v] = centred ? [0.5, 0.5] : area;
  const phi = 2 * Math.PI * lensV,
    lensOffset = camera.lens ? 0.5 * camera.lens.aperture * Math.sqrt(lensU) : 0;
  const lensPoint = [lensOffset * Math.cos(phi), lensOffset * Math.sin(phi)];
  const focus = camera.lens ? camera.lens.focus : 1;
  const eye = sum(position(orbited), center, -1);
  const distance = Math.hypot(...eye);
  return {
    right: right.map((x) => x / half),
    up: up.map((x) => x / half),
    back,
    eye: sum(sum(eye, right, lensPoint[0]), up, lensPoint[1]),
    place: [0, 1].map((k) => -2 * camera.shift[k] - (2 * ([u, v][k] - 0.5)) / width),
    lens: lensPoint.map((x) => x / focus / half),
    depths: [
      Math.max(1e-3 * camera.distance, distance - 1.01 * radius - lensOffset),
      distance + 1.01 * radius + lensOffset,
    ],
    aspect: width / height,
    size: [width, height],
  };
}

/**
 * Return the sine and cosine of the rotation of the lights that rotate with the rig, by `lighting`
 * degrees, and of the other lights: four numbers. Rotations are relative to the asset, which is
 * itself rotated by `element` degrees.
 */
export function lightRotations(element, lighting) {
  return [lighting - element, -element].flatMap((angle) => [
    Math.sin(radians(angle)),
    Math.cos(radians(angle)),
  ]);
}
