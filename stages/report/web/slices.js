// The CT in three planes with the labels' outlines on it; the layout is documented at Slices in
// slices.hpp. Pixels outside the CT stay empty.
"use strict";

// Where the letters of a plane stand, and the direction in which its slices are counted.
const planeAxes = {axial: {left: "R", right: "L", top: "A", bottom: "P", across: ["I", "S"]},
                   coronal: {left: "R", right: "L", top: "S", bottom: "I", across: ["A", "P"]},
                   sagittal: {left: "A", right: "P", top: "S", bottom: "I", across: ["R", "L"]}};

// `colours`: by label id.
viscera.showSlices = async function (base64, meta, colours) {
  const bytes = await viscera.inflated(base64);
  const redraws = [];
  let at = 0;
  for (const plane of meta.planes) {
    const pixels = plane.width * plane.height;
    const slices = plane.at_mm.map(() => ({grey: bytes.subarray(at, at + pixels),
                                           ids: bytes.subarray(at + pixels, at += 2 * pixels)}));
    redraws.push(addPlane(plane, slices, meta, colours));
  }
  if (at !== bytes.length) throw new Error("the slices in this page are incomplete");
  for (const redraw of redraws) redraw();
};

function addPlane(plane, slices, meta, colours) {
  const axes = planeAxes[plane.name], middle = Math.floor(slices.length / 2);
  const canvas = viscera.element("canvas", {role: "img"});
  canvas.style.aspectRatio = plane.width + " / " + plane.height;
  const letters = ["left", "right", "top", "bottom"].map(side =>
    viscera.element("span", {class: "side-" + side, "aria-hidden": "true"}, axes[side]));
  const slider = viscera.element("input", {type: "range", min: 0, max: slices.length - 1, step: 1,
    value: middle, "aria-label": plane.name + " slice"});
  const place = viscera.element("output", {});
  document.getElementById("slices-planes").append(viscera.element("figure", {},
    viscera.element("figcaption", {}, viscera.words(plane.name), " ", place),
    viscera.element("div", {class: "slice-box"}, canvas, ...letters), slider));

  // Unmagnified first: the canvas then scales it, and the outlines stay sharp.
  const small = document.createElement("canvas");
  small.width = plane.width;
  small.height = plane.height;
  function draw() {
    const slice = slices[Number(slider.value)], mm = plane.at_mm[Number(slider.value)];
    const text = `${mm < 0 ? axes.across[0] : axes.across[1]}\u00a0${Math.abs(mm).toFixed(1)}\u00a0mm`;
    place.textContent = text;
    slider.setAttribute("aria-valuetext", text);
    const present = meta.ids.filter((_, i) => slice.ids.includes(i + 1)).length;
    canvas.setAttribute("aria-label", `CT, ${plane.name} at ${text}, outlines of ${present} labels`);
    const image = new ImageData(plane.width, plane.height);
    slice.grey.forEach((grey, i) => image.data.set([grey, grey, grey, grey ? 255 : 0], 4 * i));
    small.getContext("2d").putImageData(image, 0, 0);
    const scale = Math.max(1, Math.round(canvas.clientWidth * (window.devicePixelRatio || 1) /
                                         plane.width));
    canvas.width = scale * plane.width;
    canvas.height = scale * plane.height;
    const context = canvas.getContext("2d");
    context.drawImage(small, 0, 0, canvas.width, canvas.height);
    context.scale(scale, scale);
    context.lineWidth = 1.6 / Math.sqrt(scale);
    context.lineCap = "square";
    meta.ids.forEach((id, i) => outline(context, plane, slice.ids, i + 1, colours.get(id)));
  }
  slider.addEventListener("input", draw);
  new ResizeObserver(draw).observe(canvas);
  return draw;
}

// The pixel edges between a label and what is no label, or a larger one: each edge once.
function outline(context, plane, ids, label, colour) {
  const {width, height} = plane;
  const of = (x, y) => x < 0 || y < 0 || x >= width || y >= height ? 0 : ids[y * width + x];
  const edge = other => other < label;
  context.beginPath();
  for (let y = 0; y < height; ++y) {
    for (let x = 0; x < width; ++x) {
      if (ids[y * width + x] !== label) continue;
      if (edge(of(x - 1, y))) { context.moveTo(x, y); context.lineTo(x, y + 1); }
      if (edge(of(x + 1, y))) { context.moveTo(x + 1, y); context.lineTo(x + 1, y + 1); }
      if (edge(of(x, y - 1))) { context.moveTo(x, y); context.lineTo(x + 1, y); }
      if (edge(of(x, y + 1))) { context.moveTo(x, y + 1); context.lineTo(x + 1, y + 1); }
    }
  }
  context.strokeStyle = colour;
  context.stroke();
}

// The labels in their colours, with what the CT measures in each, and how much of them it covers.
viscera.slicesLegend = function (report, colours) {
  const {centre, width} = report.slices.window_hu, image = viscera.metric(report, "labels", "image");
  const hu = value => viscera.number(Math.round(value));
  const names = new Map(viscera.labelRows(report).map(row => [row.id, row.name]));
  const measured = new Map((image ? image.labels : []).map(label => [label.id, label]));
  for (const id of report.slices.ids) {
    const swatch = viscera.element("span", {class: "swatch", "aria-hidden": "true"});
    swatch.style.background = colours.get(id);
    const m = measured.get(id);
    const text = m ? ` ${hu(m.mean_hu)} ± ${hu(m.deviation_hu)}\u00a0HU` : "";
    document.getElementById("slices-labels").append(viscera.element("li", {}, swatch,
      names.get(id) || "label " + id, viscera.element("small", {}, text)));
  }
  let note = `Window ${hu(centre - width / 2)} to ${hu(centre + width / 2)} HU.`;
  if (measured.size) note += " Beside the names: mean and standard deviation within the label.";
  if (image && image.covered < 1) {
    note += ` ⚠ ${viscera.number(Number((100 * (1 - image.covered)).toPrecision(2)))} % of the ` +
      "labelled voxels lie outside of the CT.";
  }
  document.getElementById("slices-note").textContent = note;
};
