// @ts-check
// Cameras, as lookdev/scene/camera.py has them: degrees, metres, z up.

const radians = (degrees) => (degrees * Math.PI) / 180;
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const sum = (a, b, scale = 1) => a.map((x, i) => x + scale * b[i]);
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** Return half the width of the frame at depth 1. */
export const reach = (camera) => Math.tan(radians(camera.fov) / 2);

/** The unit vectors to the right, up and backwards. */
export function frame(camera) {
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

/** The point of view. */
export const position = (camera) => sum(camera.target, frame(camera)[2], camera.distance);

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
 * Return the camera after a rotation about its target; it stops before the poles, where right has
 * no direction.
 */
export function rotate(camera, degrees, rise) {
  const elevation = Math.max(-89.9, Math.min(89.9, camera.elevation + rise));
  return { ...camera, azimuth: camera.azimuth + degrees, elevation };
}

/**
 * Return the camera, moved by shares of the frame's width: points at the target's depth follow the
 * pointer.
 */
export function pan(camera, across, along) {
  const [right, up] = frame(camera),
    width = 2 * reach(camera) * camera.distance;
  return { ...camera, target: sum(sum(camera.target, right, -across * width), up, -along * width) };
}

/** Return the camera nearer to its target by a factor. */
export const zoom = (camera, factor) => ({ ...camera, distance: camera.distance / factor });

// Roberts' additive recurrence in four dimensions, shifted at random by a seed (Cranley and
// Patterson 1976).
const STEPS = [1, 2, 3, 4].map((k) => 1.1673039782614187 ** -k);
function shift(seed, k) {
  let x = Math.imul(seed + 1, 0x9e3779b9) ^ Math.imul(k + 1, 0x632be5ab); // Wellons' "lowbias32"
  x = Math.imul(x ^ (x >>> 16), 0x7feb352d);
  x = Math.imul(x ^ (x >>> 15), 0x846ca68b);
  return ((x ^ (x >>> 16)) >>> 0) / 2 ** 32;
}
const point = (number, seed) => STEPS.map((step, k) => (shift(seed, k) + step * (number + 1)) % 1);

/**
 * The uniforms of a frame: sample `number` of each pixel's area, or its middle, and of the lens,
 * about `center`.
 */
export function view(
  camera,
  { element, center, radius, width, height, number, seed, centred = false },
) {
  const orbited = orbit(camera, -element);
  const [right, up, back] = frame(orbited),
    half = reach(orbited);
  const [lensU, lensV, ...area] = point(number, seed);
  const [u, v] = centred ? [0.5, 0.5] : area;
  const around = 2 * Math.PI * lensV,
    out = camera.lens ? 0.5 * camera.lens.aperture * Math.sqrt(lensU) : 0;
  const within = [out * Math.cos(around), out * Math.sin(around)];
  const focus = camera.lens ? camera.lens.focus : 1;
  const middle = sum(position(orbited), center, -1);
  const away = Math.hypot(...middle);
  return {
    right: right.map((x) => x / half),
    up: up.map((x) => x / half),
    back,
    eye: sum(sum(middle, right, within[0]), up, within[1]),
    place: [0, 1].map((k) => -2 * camera.shift[k] - (2 * ([u, v][k] - 0.5)) / width),
    lens: within.map((x) => x / focus / half),
    depths: [
      Math.max(1e-3 * camera.distance, away - 1.01 * radius - out),
      away + 1.01 * radius + out,
    ],
    aspect: width / height,
    size: [width, height],
  };
}

/** Sines and cosines of the turns of the lights that turn with the rig, and of those that stay. */
export function turns(element, lighting) {
  return [lighting - element, -element].flatMap((angle) => [
    Math.sin(radians(angle)),
    Math.cos(radians(angle)),
  ]);
}
