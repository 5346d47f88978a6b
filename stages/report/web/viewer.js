// The 3D view: one vertex array shared by the outer surface and the interfaces between labels. An
// interface is drawn in the colour of its smaller label, or of the other one when that is hidden.
// Drawn only when something changed. Coordinates are LPS mm; the projection is parallel, so the
// scale bar holds everywhere.
"use strict";

viscera.createViewer = function (canvas, meta, data) {
  const n = meta.vertices;
  const view = viscera.createView(canvas, fit, {"0": () => look("oblique")});
  const {scene, camera, request} = view;

  const state = {frame: 0, colour: "label", translucent: true, edges: false, hidden: new Set()};
  const position = new THREE.BufferAttribute(new Float32Array(3 * n), 3);
  const colour = new THREE.BufferAttribute(new Float32Array(3 * n), 3);
  const largest = meta.labels.reduce((a, b) => b.rest_ml > a.rest_ml ? b : a).id;
  const colours = viscera.labelColours(meta.labels);
  const surfaces = makeSurfaces();
  const ranges = {}, markSets = [];

  // Outer and inner faces that meet in an edge must not share normals.
  function makeSurfaces() {
    const normals = {outer: new THREE.BufferAttribute(new Float32Array(3 * n), 3),
                     inner: new THREE.BufferAttribute(new Float32Array(3 * n), 3)};
    let begin = 0;
    return meta.groups.map(group => {
      const index = data.triangles.subarray(begin, begin += 3 * group.triangles);
      const geometry = new THREE.BufferGeometry();
      geometry.setIndex(new THREE.BufferAttribute(index, 1));
      geometry.setAttribute("position", position);
      geometry.setAttribute("normal", normals[group.labels.length === 1 ? "outer" : "inner"]);
      geometry.setAttribute("color", colour);
      const material = new THREE.MeshPhongMaterial({side: THREE.DoubleSide, shininess: 18,
        polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 1});
      const mesh = new THREE.Mesh(geometry, material);
      // Depth first: of a translucent surface only the nearest layer is then blended.
      const depth = new THREE.Mesh(geometry, new THREE.MeshBasicMaterial({colorWrite: false,
        side: THREE.DoubleSide, transparent: true, polygonOffset: true, polygonOffsetFactor: 1,
        polygonOffsetUnits: 1}));
      depth.renderOrder = 1;
      mesh.frustumCulled = depth.frustumCulled = false;
      scene.add(mesh, depth);
      return {labels: group.labels, index, mesh, depth, normal: geometry.attributes.normal};
    });
  }

  // The edges of one surface; made when they are first asked for.
  const lineMaterial = new THREE.LineBasicMaterial({transparent: true, opacity: 0.35});
  function makeLines(triangles) {
    const edges = new Set();
    for (let i = 0; i < triangles.length; i += 3) {
      for (let k = 0; k < 3; ++k) {
        const a = triangles[i + k], b = triangles[i + (k + 1) % 3];
        edges.add(a < b ? a * n + b : b * n + a);
      }
    }
    const index = new Uint32Array(2 * edges.size);
    let at = 0;
    for (const edge of edges) {
      index[at++] = Math.floor(edge / n);
      index[at++] = edge % n;
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(new THREE.BufferAttribute(index, 1));
    geometry.setAttribute("position", position);
    const lines = new THREE.LineSegments(geometry, lineMaterial);
    lines.frustumCulled = false;
    lines.renderOrder = 3;
    scene.add(lines);
    return lines;
  }

  const stored = () => data.frames.length ? data.frames[state.frame] : data.rest;
  const place = (frame, axis, i) => meta.box_lo_mm[axis] + meta.step_mm[axis] * frame[axis * n + i];

  // How far vertex i of a frame is from its place in the scan ("displacement"), or from where the
  // best rigid motion of the whole body would have put it ("shape"); mm.
  const still = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0];
  function distance(mode, frame, i) {
    const m = mode === "shape" && data.frames.length ? meta.rigid_motions[frame] : still;
    const rest = [0, 1, 2].map(axis => place(data.rest, axis, i));
    let sum = 0;
    for (let axis = 0; axis < 3; ++axis) {
      const row = 4 * axis;
      const moved = m[row] * rest[0] + m[row + 1] * rest[1] + m[row + 2] * rest[2] + m[row + 3];
      sum += (place(data.frames[frame] || data.rest, axis, i) - moved) ** 2;
    }
    return Math.sqrt(sum);
  }
  // Lazily: it looks at every frame, and the first picture does not need it.
  function rangeOf(mode) {
    if (ranges[mode]) return ranges[mode];
    let most = 0;
    for (let frame = 0; frame < data.frames.length; ++frame) {
      for (let i = 0; i < n; ++i) most = Math.max(most, distance(mode, frame, i));
    }
    return ranges[mode] = most || 1;
  }

  function updatePositions() {
    const frame = stored(), xyz = position.array;
    for (let axis = 0; axis < 3; ++axis) {
      for (let i = 0; i < n; ++i) xyz[3 * i + axis] = place(frame, axis, i);
    }
    position.needsUpdate = true;
    for (const surface of surfaces) surface.normal.array.fill(0);
    for (const surface of surfaces) addNormals(surface.index, surface.normal.array);
    for (const surface of surfaces) surface.normal.needsUpdate = true;
  }

  // Area-weighted; the shader brings them to unit length.
  function addNormals(index, normals) {
    const p = position.array;
    for (let t = 0; t < index.length; t += 3) {
      const a = 3 * index[t], b = 3 * index[t + 1], c = 3 * index[t + 2];
      const ux = p[b] - p[a], uy = p[b + 1] - p[a + 1], uz = p[b + 2] - p[a + 2];
      const vx = p[c] - p[a], vy = p[c + 1] - p[a + 1], vz = p[c + 2] - p[a + 2];
      const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
      for (const at of [a, b, c]) {
        normals[at] += x;
        normals[at + 1] += y;
        normals[at + 2] += z;
      }
    }
  }

  function updateColours() {
    if (state.colour === "label") return;
    const frame = state.frame;
    const bytes = {ratio: data.ratios[frame] || [], stress: data.stresses[frame] || [],
                   quality: data.quality}[state.colour];
    const map = state.colour === "ratio" ? "deviation" : "amount";
    const most = bytes ? 1 : rangeOf(state.colour);
    for (let i = 0; i < n; ++i) {
      const part = !bytes ? distance(state.colour, state.frame, i) / most
        : bytes.length ? bytes[i] / 254 : map === "deviation" ? 0.5 : 0;
      viscera.mapped(map, part, colour.array, 3 * i);
    }
    colour.needsUpdate = true;
  }

  function updateMaterials() {
    const byLabel = state.colour === "label";
    // A field's colours must stay those of the legend: little shade, and never brighter than given.
    view.lamp.intensity = byLabel ? 0.75 : 0.3;
    view.sky.intensity = byLabel ? 0.55 : 0.7;
    view.sky.groundColor.set(byLabel ? "#8090a0" : "#d8d8d8");
    const inner = surface => surface.labels.length > 1;
    const inside = surfaces.some(s => inner(s) && ![undefined, largest].includes(shownLabel(s)));
    for (const surface of surfaces) {
      const label = shownLabel(surface), {material} = surface.mesh;
      // The cavity that a hidden label leaves in the largest one would hang opaque in its glass.
      const cavity = inner(surface) && label === largest && state.translucent;
      const glass = state.translucent && inside && !inner(surface) && label === largest;
      surface.mesh.visible = label !== undefined && !cavity;
      surface.depth.visible = surface.mesh.visible && glass;
      if (state.edges && !surface.lines) surface.lines = makeLines(surface.index);
      if (surface.lines) surface.lines.visible = state.edges && surface.mesh.visible;
      surface.mesh.renderOrder = glass ? 2 : 0;
      material.transparent = glass;
      material.opacity = glass ? 0.42 : 1;
      material.vertexColors = byLabel ? THREE.NoColors : THREE.VertexColors;
      material.specular.set(byLabel ? "#1c1c1c" : "#000000");
      material.color.set(byLabel && label !== undefined ? colours.get(label) : "#ffffff");
      material.needsUpdate = true;
    }
  }
  function shownLabel(surface) {
    return surface.labels.find(label => !state.hidden.has(label));
  }

  // A whole run in view: the camera keeps still while the body moves through the box.
  const size = meta.step_mm.map(step => step * 65535);
  const centre = new THREE.Vector3(...meta.box_lo_mm.map((lo, k) => lo + size[k] / 2));
  const radius = Math.max(Math.hypot(...size) / 2, 1e-3);
  const directions = {A: [0, -1, 0], L: [1, 0, 0], S: [0, -0.001, 1], oblique: [0.55, -1, 0.4]};
  function look(name) {
    view.look(new THREE.Vector3(...directions[name]).normalize(), centre, radius);
    fit();
  }

  // The extent of the box as seen from the camera, with a margin.
  function fit() {
    camera.updateMatrixWorld();
    let across = 0, up = 0;
    const e = camera.matrixWorld.elements;
    for (let k = 0; k < 3; ++k) {
      across += Math.abs(e[k]) * size[k] / 2;
      up += Math.abs(e[4 + k]) * size[k] / 2;
    }
    view.show(1.12 * Math.max(up, across / view.aspect(), 1e-3));
  }

  function redraw() {
    updatePositions();
    for (const marks of markSets) marks.move();
    updateColours();
    request();
  }
  function restyle() {
    updateColours();
    updateMaterials();
    request();
  }
  function theme() {
    view.theme();
    lineMaterial.color.set(view.themed("--ink"));
    for (const marks of markSets) marks.colour(view.themed("--fail"));
    if (ground) ground.material.color.set(view.themed("--muted"));
  }
  // The plane on which the body lands: `clearance` mm below the lowest rest point, along `normal`.
  const gridCell = viscera.roundLength(radius / 4);
  let ground = null;
  function addGround(normal, clearance) {
    const up = new THREE.Vector3(...normal).normalize();
    let lowest = Infinity;
    for (let i = 0; i < n; ++i) {
      lowest = Math.min(lowest, up.x * place(data.rest, 0, i) + up.y * place(data.rest, 1, i) +
                                up.z * place(data.rest, 2, i));
    }
    const squares = 2 * Math.ceil(1.3 * radius / gridCell);
    ground = new THREE.GridHelper(squares * gridCell, squares);
    ground.material.vertexColors = THREE.NoColors;
    ground.material.transparent = true;
    ground.material.opacity = 0.22;
    ground.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), up);
    ground.position.copy(centre).addScaledVector(up, lowest - clearance - centre.dot(up));
    scene.add(ground);
    theme();
  }

  // Rings around places of the scan (LPS mm); each moves with the vertex that was nearest to it.
  // They are shown, and one of them (undefined: none) pointed out, by what is returned.
  function addMarks(places) {
    const away = (at, i) => at.reduce((sum, x, axis) =>
      sum + (place(data.rest, axis, i) - x) ** 2, 0);
    const nearest = places.map(at => {
      let best = 0;
      for (let i = 1; i < n; ++i) if (away(at, i) < away(at, best)) best = i;
      return best;
    });
    const moved = m => places[m].map((x, axis) =>
      x + place(stored(), axis, nearest[m]) - place(data.rest, axis, nearest[m]));
    const marks = viscera.createMarks(scene, view.renderer.getPixelRatio(), places.length, moved);
    markSets.push(marks);
    theme();
    return {
      show(on) { marks.show(on); request(); },
      pointOut(m) { marks.pointOut(m); request(); },
    };
  }

  theme();
  view.resize();
  look("oblique");
  redraw();
  restyle();
  return {
    addGround, addMarks, colours, gridCell, look, theme, range: rangeOf,
    onDrawn: view.onDrawn,
    setFrame(frame) { state.frame = frame; redraw(); },
    setColour(mode) { state.colour = mode; restyle(); },
    setTranslucent(on) { state.translucent = on; restyle(); },
    setEdges(on) { state.edges = on; restyle(); },
    setVisible(label, on) { state.hidden[on ? "delete" : "add"](label); restyle(); },
    millimetresPerPixel: () => (camera.top - camera.bottom) / camera.zoom / canvas.clientHeight,
  };
};

// The three body axes as the camera sees them: letters stand at the end they name.
viscera.drawTriad = function (svg, camera) {
  const e = camera.matrixWorldInverse.elements;
  const ends = [["L", 0, 1], ["R", 0, -1], ["P", 1, 1], ["A", 1, -1], ["S", 2, 1], ["I", 2, -1]];
  const ns = "http://www.w3.org/2000/svg";
  svg.replaceChildren();
  for (const [letter, axis, sign] of ends) {
    const x = sign * e[4 * axis], y = -sign * e[4 * axis + 1], towards = sign * e[4 * axis + 2];
    if (towards < -0.02) continue;  // of each axis the end that points to the viewer
    if (Math.hypot(x, y) < 0.15) continue;
    const line = document.createElementNS(ns, "line");
    line.setAttribute("x2", 27 * x);
    line.setAttribute("y2", 27 * y);
    const text = document.createElementNS(ns, "text");
    text.setAttribute("x", 38 * x);
    text.setAttribute("y", 38 * y);
    text.textContent = letter;
    svg.append(line, text);
  }
};
