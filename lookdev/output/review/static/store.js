// @ts-check
// What the page reads from disk: scripts that call review.put(), each once, and the numbers in
// them.
"use strict";

window.review = (() => {
  const waiting = new Map();
  const scripts = new Map();
  const decoded = new Map(); // the least recently used first
  const CACHE_BYTES = (navigator.deviceMemory || 4) >= 4 ? 512e6 : 128e6;
  let cachedBytes = 0;

  // Half floats as numbers; made once.
  const HALF = new Float32Array(65536);
  for (let h = 0; h < 65536; h++) {
    const exponent = (h >> 10) & 31,
      fraction = h & 1023;
    const value =
      exponent === 0
        ? fraction * 2 ** -24
        : exponent === 31
          ? fraction
            ? NaN
            : Infinity
          : (1 + fraction / 1024) * 2 ** (exponent - 15);
    HALF[h] = h >> 15 ? -value : value;
  }

  function put(name, value) {
    const resolve = waiting.get(name);
    waiting.delete(name);
    if (resolve) resolve(value);
  }

  // Return what a script puts under a name.
  function read(name, source) {
    if (!scripts.has(name)) {
      scripts.set(
        name,
        new Promise((resolve, reject) => {
          waiting.set(name, resolve);
          const element = document.createElement("script");
          element.src = source;
          element.onload = () => element.remove();
          element.onerror = () => {
            element.remove();
            scripts.delete(name);
            reject(new Error(`${source} cannot be read; 'lookdev review' makes it again`));
          };
          document.head.append(element);
        }),
      );
    }
    return scripts.get(name);
  }

  async function inflate(text) {
    const packed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  // Planes R, G, B, A and, where it is known, E; the high bytes of each before its low bytes.
  async function decode(key) {
    const entry = await read(key, `data/frames/${key}.js`);
    scripts.delete(key); // what is decoded is kept instead
    const bytes = await inflate(entry.data);
    const count = entry.width * entry.height;
    const plane = (number, target, offset, step) => {
      const high = 2 * number * count,
        low = high + count;
      for (let i = 0, j = offset; i < count; i++, j += step)
        target[j] = (bytes[high + i] << 8) | bytes[low + i];
    };
    const rgba = new Uint16Array(4 * count);
    for (let channel = 0; channel < 4; channel++) plane(channel, rgba, channel, 4);
    let error = null;
    if (entry.planes > 4) plane(4, (error = new Uint16Array(count)), 0, 1);
    return { key, width: entry.width, height: entry.height, rgba, error };
  }

  // Return the numbers of a frame, as a promise.
  function pixels(key) {
    if (decoded.has(key)) {
      const entry = decoded.get(key);
      decoded.delete(key);
      decoded.set(key, entry);
      return entry.promise;
    }
    const slot = { promise: null, value: null, bytes: 0 };
    slot.promise = decode(key).then(
      (value) => {
        slot.value = value;
        slot.bytes = value.rgba.byteLength + (value.error ? value.error.byteLength : 0);
        cachedBytes += slot.bytes;
        for (const [old, other] of decoded) {
          if (cachedBytes <= CACHE_BYTES || decoded.size <= 4) break;
          if (!other.value || other === slot) continue;
          decoded.delete(old);
          cachedBytes -= other.bytes;
        }
        return value;
      },
      (error) => {
        decoded.delete(key);
        throw error;
      },
    );
    decoded.set(key, slot);
    return slot.promise;
  }

  // Return the numbers of a frame if they are there already.
  function ready(key) {
    const slot = decoded.get(key);
    return slot ? slot.value : null;
  }

  return {
    HALF,
    put,
    read,
    pixels,
    ready,
    roomFor: (bytes) => Math.max(2, Math.floor(CACHE_BYTES / 2 / bytes)),
  };
})();
