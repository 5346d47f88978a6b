// Unpacks what stands in the page as deflated base64, and the geometry of the 3D view, whose layout
// is documented at ViewerData in viewer_data.hpp.
"use strict";

viscera.inflated = async function (base64) {
  const text = atob(base64);
  const bytes = new Uint8Array(text.length);
  for (let i = 0; i < text.length; ++i) bytes[i] = text.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
};

// { triangles: Uint32Array, rest: Uint16Array, frames: [Uint16Array], ratios: [Uint8Array],
// stresses: [Uint8Array], none where they are not known, quality: Uint8Array };
// coordinates lie axis after axis: x of all vertices, then y, then z.
viscera.unpack = async function (base64, meta) {
  const bytes = await viscera.inflated(base64);
  const n = meta.vertices, frames = meta.times_s.length;
  const corners = 3 * meta.groups.reduce((sum, group) => sum + group.triangles, 0);
  const triangles = new Uint32Array(bytes.slice(0, 4 * corners).buffer);
  let at = 4 * corners;
  const positions = [];
  let before = new Uint16Array(3 * n);
  for (let f = 0; f <= frames; ++f) {
    const now = new Uint16Array(3 * n);
    for (let axis = 0; axis < 3; ++axis, at += 2 * n) {
      for (let i = 0, v = axis * n; i < n; ++i, ++v) {
        const zigzag = bytes[at + i] | bytes[at + n + i] << 8;
        now[v] = before[v] + (zigzag >> 1 ^ -(zigzag & 1));
      }
    }
    positions.push(now);
    before = now;
  }
  function values(count) {
    const list = [];
    let last = new Uint8Array(n);
    for (let f = 0; f < count; ++f, at += n) {
      const now = new Uint8Array(n);
      for (let i = 0; i < n; ++i) now[i] = last[i] + bytes[at + i];
      list.push(now);
      last = now;
    }
    return list;
  }
  const ratios = values(frames), stresses = values(meta.stress_range_kPa === null ? 0 : frames);
  const [quality] = values(1);
  if (at !== bytes.length) throw new Error("the geometry in this page is incomplete");
  return {triangles, rest: positions[0], frames: positions.slice(1), ratios, stresses, quality};
};

// Which of ascending times is nearest to a time.
viscera.nearest = function (times, time) {
  let best = 0;
  times.forEach((t, i) => { if (Math.abs(t - time) < Math.abs(times[best] - time)) best = i; });
  return best;
};
