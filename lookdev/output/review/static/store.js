// @ts-check
// The store of the review page's data. A page from disk may not fetch files, so data are in
// scripts: each script calls review.put() once, with a name and a value. The store loads scripts,
// and decodes and caches the pixels of frames.
"use strict";

window.review = (() => {
  const resolvers = new Map(); // the functions that fulfil the promises in `scripts`, by name
  const scripts = new Map(); // the promises of scripts' values, by name
  const frameCache = new Map(); // { promise, value, bytes } by key, the least recently used first
  // By the memory in GiB, which not all browsers tell.
  const CACHE_BYTES = (navigator.deviceMemory || 4) >= 4 ? 512e6 : 128e6;
  let cachedBytes = 0;

  // The values of half floats, by their 16 bits.
  const HALF_TO_FLOAT = new Float32Array(65536);
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
    HALF_TO_FLOAT[h] = h >> 15 ? -value : value;
  }

  // Receive the value of a script.
  function put(name, value) {
    const resolve = resolvers.get(name);
    resolvers.delete(name);
    if (resolve) resolve(value);
  }

  // Return the value that a script puts under a name, as a promise.
  function loadScript(name, source) {
    if (!scripts.has(name)) {
      scripts.set(
        name,
        new Promise((resolve, reject) => {
          resolvers.set(name, resolve);
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

  // Return the bytes that a text has in base64, compressed by zlib.
  async function inflate(text) {
    const compressed = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([compressed]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  // Return the pixels of a frame by its key: RGBA and error, as the bits of half floats. Its script
  // has the planes R, G, B, A and, if the error is known, that of the error. In a plane, all high
  // bytes precede all low bytes.
  async function decodeFrame(key) {
    const entry = await loadScript(key, `data/frames/${key}.js`);
    scripts.delete(key); // the cache stores the decoded pixels instead
    const bytes = await inflate(entry.data);
    const count = entry.width * entry.height;
    const copyPlane = (number, target, offset, step) => {
      const high = 2 * number * count,
        low = high + count;
      for (let i = 0, j = offset; i < count; i++, j += step)
        target[j] = (bytes[high + i] << 8) | bytes[low + i];
    };
    const rgba = new Uint16Array(4 * count);
    for (let channel = 0; channel < 4; channel++) copyPlane(channel, rgba, channel, 4);
    let error = null;
    if (entry.planes > 4) copyPlane(4, (error = new Uint16Array(count)), 0, 1);
    return { key, width: entry.width, height: entry.height, rgba, error };
  }

  // Return the pixels of a frame by its key, as a promise; they stay in the cache.
  function loadPixels(key) {
    if (frameCache.has(key)) {
      const cached = frameCache.get(key);
      frameCache.delete(key);
      frameCache.set(key, cached);
      return cached.promise;
    }
    const entry = { promise: null, value: null, bytes: 0 };
    entry.promise = decodeFrame(key).then(
      (value) => {
        entry.value = value;
        entry.bytes = value.rgba.byteLength + (value.error ? value.error.byteLength : 0);
        cachedBytes += entry.bytes;
        for (const [otherKey, other] of frameCache) {
          if (cachedBytes <= CACHE_BYTES || frameCache.size <= 4) break;
          if (!other.value || other === entry) continue;
          frameCache.delete(otherKey);
          cachedBytes -= other.bytes;
        }
        return value;
      },
      (error) => {
        frameCache.delete(key);
        throw error;
      },
    );
    frameCache.set(key, entry);
    return entry.promise;
  }

  // Return the pixels of a frame, or null if they are not in the cache.
  function cachedPixels(key) {
    const entry = frameCache.get(key);
    return entry ? entry.value : null;
  }

  // Return the number of frames, of a size in bytes, that are loaded ahead: they fill half the
  // cache.
  function frameCapacity(bytes) {
    return Math.max(2, Math.floor(CACHE_BYTES / 2 / bytes));
  }

  return {
    HALF_TO_FLOAT,
    put,
    loadScript,
    loadPixels,
    cachedPixels,
    frameCapacity,
  };
})();
