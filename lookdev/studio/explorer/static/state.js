// @ts-check
// What the page shows: surfaces, kind of plot, options, light. All of it is in the URL, as words of
// the command line.

const formatNumber = (value) => Number(value.toPrecision(7)).toString();
const formatValue = (value) =>
  Array.isArray(value)
    ? value.map(formatNumber).join("/")
    : typeof value === "number"
      ? formatNumber(value)
      : value;

// The words of a surface: label, base, and the parameters that are given.
export const wordsOf = (surface, hasLabel = false) => {
  const parameters = Object.entries(surface.given).map(
    ([name, value]) => `${name}=${formatValue(value)}`,
  );
  const words = parameters.length ? `${surface.base}:${parameters.join(",")}` : surface.base;
  return hasLabel && surface.label ? `${surface.label}=${words}` : words;
};

export const nameOf = (surface) =>
  surface.label ||
  (surface.given.file ?? surface.base).replace(/^uploads\/[0-9a-f]{8}-/, "").replace(/^.*\//, "");

export const state = {
  offered: null,
  surfaces: [],
  selected: 0,
  kind: "cartesian",
  options: {},
  light: "dome",
  lightAngles: [35, 40], // degrees from the view, and of azimuth
  turn: [-0.6, 0.42], // of the lobe: azimuth and elevation, radians
};

let number = 0;
const listeners = new Set();
export const onChange = (listener) => listeners.add(listener);

let writing = 0;
// Tell the listeners of a change: "surfaces", "kind", "options", "parameter", "selected", "light",
// "turn"; `detail` is passed on.
export const notify = (change, detail = {}) => {
  for (const listener of listeners) listener(change, detail);
  clearTimeout(writing);
  writing = setTimeout(writeUrl, 250);
};

export const selectedSurface = () => state.surfaces[state.selected];
export const visibleSurfaces = () =>
  state.surfaces.filter((surface) => !surface.hidden && !surface.error);

export const colorOf = (surface) => {
  const color = state.offered.colors[surface.color % state.offered.colors.length];
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  return color === "#000000"
    ? dark
      ? "#f2f2f2"
      : "#1a1a1a"
    : dark && color === "#0072b2"
      ? "#3aa0e0"
      : color;
};

export const addSurface = (described, hidden = false) => {
  const used = new Set(state.surfaces.map((surface) => surface.color));
  let color = 0;
  while (used.has(color) && color < state.offered.colors.length - 1) color++;
  const surface = { id: ++number, color, hidden, error: "", open: new Set(), ...described };
  state.surfaces.push(surface);
  return surface;
};

// The options of the current kind that are not at their defaults.
export const changedOptions = () => {
  const { uses } = state.offered.kinds[state.kind];
  return Object.fromEntries(
    uses
      .map((name) => [name, option(name)])
      .filter(([name, value]) => value !== state.offered.options[name]),
  );
};
// On spheres theta and phi are those of the light, which the hand turns, too.
const ofLight = (name) => (state.kind === "sphere" ? ["theta", "phi"].indexOf(name) : -1);
export const option = (name) =>
  ofLight(name) >= 0
    ? state.lightAngles[ofLight(name)]
    : (state.options[name] ?? state.offered.options[name]);
export const setOption = (name, value) => {
  if (ofLight(name) >= 0) state.lightAngles[ofLight(name)] = value;
  else state.options[name] = value;
};

export const urlOf = () => {
  const query = new URLSearchParams();
  for (const surface of state.surfaces) query.append("s", wordsOf(surface, true));
  query.set("kind", state.kind);
  if (state.selected) query.set("on", `${state.selected}`);
  const hidden = state.surfaces.flatMap((surface, index) => (surface.hidden ? [index] : []));
  if (hidden.length) query.set("hide", hidden.join(","));
  for (const [name, value] of Object.entries(state.options))
    if (value !== state.offered.options[name]) query.set(name, value);
  if (state.light === "point") query.set("light", "point");
  query.set("at", state.lightAngles.map((angle) => Math.round(angle)).join(","));
  query.set("turn", state.turn.map((angle) => angle.toFixed(2)).join(","));
  return `${location.pathname}${location.search}#${query}`;
};

const writeUrl = () => {
  if (state.surfaces.length) history.replaceState(null, "", urlOf());
};

const pair = (text, usual) => {
  const numbers = (text ?? "").split(",").map(Number);
  return numbers.length === 2 && numbers.every(Number.isFinite) ? numbers : usual;
};

// What the URL says; what it says wrongly is left out.
export const readUrl = () => {
  const query = new URLSearchParams(location.hash.slice(1));
  const { options, choices, kinds } = state.offered;
  if (query.get("kind") in kinds) state.kind = query.get("kind");
  for (const [name, usual] of Object.entries(options)) {
    const text = query.get(name);
    if (text === null) continue;
    if (typeof usual === "boolean") state.options[name] = text === "true";
    else if (typeof usual === "number" && Number.isFinite(Number(text)))
      state.options[name] = Number(text);
    else if (choices[name]?.includes(text)) state.options[name] = text;
  }
  state.light = query.get("light") === "point" ? "point" : "dome";
  state.lightAngles = pair(query.get("at"), state.lightAngles);
  state.turn = pair(query.get("turn"), state.turn);
  return {
    words: query.getAll("s"),
    on: Number(query.get("on")) || 0,
    hidden: (query.get("hide") ?? "").split(",").filter(Boolean).map(Number),
  };
};
