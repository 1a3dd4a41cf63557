// @ts-check
// The state of the Explorer's page: its surfaces, the kind of plot, options and lights. The URL of
// the page has all of it.

const formatNumber = (value) => Number(value.toPrecision(7)).toString();
const formatValue = (value) =>
  Array.isArray(value)
    ? value.map(formatNumber).join("/")
    : typeof value === "number"
      ? formatNumber(value)
      : value;

// Return the words of a surface, which is its text on the command line: its base, such as a model
// or a preset, the parameters that the user has given, and with `hasLabel` its label.
export const wordsOf = (surface, hasLabel = false) => {
  const parameters = Object.entries(surface.given).map(
    ([name, value]) => `${name}=${formatValue(value)}`,
  );
  const words = parameters.length ? `${surface.base}:${parameters.join(",")}` : surface.base;
  return hasLabel && surface.label ? `${surface.label}=${words}` : words;
};

// Return the name of a surface for the user: its label, or its base or file without folders.
export const nameOf = (surface) =>
  surface.label ||
  (surface.given.file ?? surface.base).replace(/^uploads\/[0-9a-f]{8}-/, "").replace(/^.*\//, "");

export const state = {
  catalogue: null, // what the server offers: lookdev.studio.explorer.catalogue
  surfaces: [], // as the server describes them, with id, color, hidden and open groups
  selected: 0, // the index of the selected surface
  kind: "cartesian",
  options: {},
  light: "dome", // or "point"
  exact: false, // whether the exact frame replaces the sphere
  lightAngles: [35, 40], // of the point light, in degrees: from the view, and its azimuth
  lobeAngles: [-0.6, 0.42], // azimuth and elevation of the lobe, radians
};

let lastId = 0;
const listeners = new Set();
export const onChange = (listener) => listeners.add(listener);

let writeTimer = 0;
// Call the listeners with a change and its detail, and write the URL soon. Changes are "surfaces",
// "kind", "options", "parameter", "selected", "light", "turn" (of the lobe), "label", "form" (a
// token of a model), "duplicate" (of a surface) and "theme".
export const notify = (change, detail = {}) => {
  for (const listener of listeners) listener(change, detail);
  clearTimeout(writeTimer);
  writeTimer = setTimeout(writeUrl, 250);
};

export const selectedSurface = () => state.surfaces[state.selected];
export const visibleSurfaces = () => state.surfaces.filter((surface) => !surface.hidden);

// Return the colour of a surface in plots, which is lighter on a dark page if it is too dark there.
export const colorOf = (surface) => {
  const color = state.catalogue.colors[surface.color % state.catalogue.colors.length];
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  return color === "#000000"
    ? dark
      ? "#f2f2f2"
      : "#1a1a1a"
    : dark && color === "#0072b2"
      ? "#3aa0e0"
      : color;
};

// Add a surface as the server describes it, with the first free colour; return it.
export const addSurface = (description, hidden = false) => {
  const usedColors = new Set(state.surfaces.map((surface) => surface.color));
  let color = 0;
  while (usedColors.has(color) && color < state.catalogue.colors.length - 1) color++;
  const surface = { id: ++lastId, color, hidden, open: new Set(), ...description };
  state.surfaces.push(surface);
  return surface;
};

export const removeSurface = (index) => {
  state.surfaces.splice(index, 1);
  const selected = state.selected - (index < state.selected ? 1 : 0);
  state.selected = Math.max(0, Math.min(selected, state.surfaces.length - 1));
  notify("surfaces");
};

// Return the options of the current kind of plot that differ from their defaults.
export const changedOptions = () => {
  const { uses } = state.catalogue.kinds[state.kind];
  return Object.fromEntries(
    uses
      .map((name) => [name, option(name)])
      .filter(([name, value]) => value !== state.catalogue.options[name]),
  );
};

// Return the index in `lightAngles` that an option sets, or -1: in the plot of spheres, theta and
// phi are the angles of the light.
const lightAngleIndex = (name) => (state.kind === "sphere" ? ["theta", "phi"].indexOf(name) : -1);
export const option = (name) =>
  lightAngleIndex(name) >= 0
    ? state.lightAngles[lightAngleIndex(name)]
    : (state.options[name] ?? state.catalogue.options[name]);
export const setOption = (name, value) => {
  if (lightAngleIndex(name) >= 0) state.lightAngles[lightAngleIndex(name)] = value;
  else state.options[name] = value;
};

// Return the URL of the page with its state.
export const pageUrl = () => {
  const query = new URLSearchParams();
  for (const surface of state.surfaces) query.append("s", wordsOf(surface, true));
  query.set("kind", state.kind);
  if (state.selected) query.set("on", `${state.selected}`);
  const hidden = state.surfaces.flatMap((surface, index) => (surface.hidden ? [index] : []));
  if (hidden.length) query.set("hide", hidden.join(","));
  for (const [name, value] of Object.entries(state.options))
    if (value !== state.catalogue.options[name]) query.set(name, value);
  if (state.light === "point") query.set("light", "point");
  query.set("at", state.lightAngles.map((angle) => Math.round(angle)).join(","));
  query.set("turn", state.lobeAngles.map((angle) => angle.toFixed(2)).join(","));
  return `${location.pathname}${location.search}#${query}`;
};

const writeUrl = () => {
  if (state.surfaces.length) history.replaceState(null, "", pageUrl());
};

// Return the two numbers in a text, or the default value.
const parsePair = (text, defaultValue) => {
  const numbers = (text ?? "").split(",").map(Number);
  return numbers.length === 2 && numbers.every(Number.isFinite) ? numbers : defaultValue;
};

// Set the state to what is valid in the URL, except for the surfaces. Return the words of the
// surfaces, the index of the selected one, and the indices of the hidden ones.
export const readUrl = () => {
  const query = new URLSearchParams(location.hash.slice(1));
  const { options, choices, kinds } = state.catalogue;
  if (query.get("kind") in kinds) state.kind = query.get("kind");
  for (const [name, defaultValue] of Object.entries(options)) {
    const text = query.get(name);
    if (text === null) continue;
    if (typeof defaultValue === "boolean") state.options[name] = text === "true";
    else if (typeof defaultValue === "number" && Number.isFinite(Number(text)))
      state.options[name] = Number(text);
    else if (choices[name]?.includes(text)) state.options[name] = text;
  }
  state.light = query.get("light") === "point" ? "point" : "dome";
  state.lightAngles = parsePair(query.get("at"), state.lightAngles);
  state.lobeAngles = parsePair(query.get("turn"), state.lobeAngles);
  return {
    words: query.getAll("s"),
    selected: Number(query.get("on")) || 0,
    hidden: (query.get("hide") ?? "").split(",").filter(Boolean).map(Number),
  };
};
