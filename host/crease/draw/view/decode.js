"use strict";
// The other half of pack.py: base64, gzip, planes of bytes, folded differences, steps.

async function inflate(base64) {
  const text = atob(base64.trim());
  const raw = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) raw[i] = text.charCodeAt(i);
  const stream = new Blob([raw]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Row-major numbers of one array: Int32Array for integers, else Float64Array.
function unpack(bytes, { start, rows, columns, width, step }) {
  const size = rows * columns;
  const values = new Int32Array(size);
  for (let c = 0; c < columns; c++) {
    let sum = 0;
    for (let i = 0; i < rows; i++) {
      let folded = 0;
      for (let k = width - 1; k >= 0; k--) folded = (folded << 8) | bytes[start + k * size + c * rows + i];
      sum += (folded >>> 1) ^ -(folded & 1);
      values[i * columns + c] = sum;
    }
  }
  return step === 1 ? values : Float64Array.from(values, (v) => v * step);
}

// All arrays by name; "group.name" becomes data.group.name.
async function decodeArrays(base64, header) {
  const bytes = await inflate(base64);
  const data = {};
  for (const [path, place] of Object.entries(header)) {
    const [group, name] = path.split(".");
    const values = unpack(bytes, place);
    if (name === undefined) data[group] = values;
    else (data[group] ??= {})[name] = values;
  }
  return data;
}

// Running sums: where the entries of each tick begin, one more than there are ticks.
function starts(counts) {
  const at = new Uint32Array(counts.length + 1);
  for (let i = 0; i < counts.length; i++) at[i + 1] = at[i] + counts[i];
  return at;
}
