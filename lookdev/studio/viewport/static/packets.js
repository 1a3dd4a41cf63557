// @ts-check
// The reader of packets, which are messages of the server with a header and arrays of float32, as
// lookdev/studio/packets.py writes them.

/** Return the entries of a packet's header, its `arrays` by name, and their `shapes` by name. */
export function parsePacket(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  let offset = 4 + length;
  const arrays = {},
    shapes = {};
  for (const [name, shape] of header.arrays) {
    const count = shape.reduce((a, b) => a * b, 1);
    arrays[name] = new Float32Array(buffer, offset, count);
    shapes[name] = shape;
    offset += 4 * count;
  }
  return { ...header, arrays, shapes };
}
