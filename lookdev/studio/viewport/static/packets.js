// @ts-check
// Packets of the server, as lookdev/studio/packets.py writes them: a header, and named arrays of
// floats.

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
