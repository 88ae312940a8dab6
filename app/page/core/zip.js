// Several files as one: a zip archive without compression.

const table = Uint32Array.from({ length: 256 }, (_, byte) => {
  let value = byte;
  for (let bit = 0; bit < 8; bit++) value = value & 1 ? (value >>> 1) ^ 0xedb88320 : value >>> 1;
  return value;
});

/** CRC-32 of ISO 3309, as zip archives have it. @param {Uint8Array<ArrayBuffer>} content */
const checksum = (content) => {
  let value = 0xffffffff;
  for (const byte of content) value = table[(value ^ byte) & 255] ^ (value >>> 8);
  return (value ^ 0xffffffff) >>> 0;
};

/** Numbers of 2 and 4 bytes, low byte first. @param {[number, number][]} fields */
const header = (fields) => {
  const view = new DataView(new ArrayBuffer(fields.reduce((sum, [size]) => sum + size, 0)));
  let at = 0;
  for (const [size, value] of fields) {
    if (size === 2) view.setUint16(at, value, true);
    else view.setUint32(at, value, true);
    at += size;
  }
  return view;
};

const UTF8 = 0x800, STORED = 0, VERSION = 20, FIRST_DAY = 33; // 1980-01-01

/** @param {{name: string, content: Uint8Array<ArrayBuffer>}[]} files */
export function zip(files) {
  const parts = [], entries = [];
  let at = 0;
  for (const { name, content } of files) {
    const called = new TextEncoder().encode(name), crc = checksum(content);
    /** @type {[number, number][]} */
    const about = [[2, VERSION], [2, UTF8], [2, STORED], [2, 0], [2, FIRST_DAY], [4, crc], [4, content.length],
      [4, content.length], [2, called.length], [2, 0]];
    parts.push(header([[4, 0x04034b50], ...about]), called, content);
    entries.push(header([[4, 0x02014b50], [2, VERSION], ...about, [2, 0], [2, 0], [2, 0], [4, 0], [4, at]]), called);
    at += 30 + called.length + content.length;
  }
  const size = entries.reduce((sum, entry) => sum + entry.byteLength, 0), count = files.length;
  const end = header([[4, 0x06054b50], [2, 0], [2, 0], [2, count], [2, count], [4, size], [4, at], [2, 0]]);
  return new Blob([...parts, ...entries, end], { type: "application/zip" });
}
