// Several runs in one 3D view, each its outer surface in its own colour, at one time. Coordinates are
// LPS mm; the projection is parallel.
"use strict";

// `runs`: [{meta, data, colour [r, g, b]}] with meta and data as geometry.js unpacks them.
viscera.createOverlay = function (canvas, runs) {
  const view = viscera.createView(canvas, () => view.show(0.85 * radius));
  const {scene} = view;
  const surfaces = runs.map(makeSurface);

  function makeSurface({meta, data, colour}) {
    let outer = [], begin = 0;
    for (const group of meta.groups) {
      const index = data.triangles.subarray(begin, begin += 3 * group.triangles);
      if (group.labels.length === 1) outer = outer.concat(Array.from(index));
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setIndex(outer);
    geometry.setAttribute("position",
      new THREE.BufferAttribute(new Float32Array(3 * meta.vertices), 3));
    const material = new THREE.MeshPhongMaterial({side: THREE.DoubleSide, shininess: 18,
      specular: 0x1c1c1c, transparent: true, opacity: 0.72, color: new THREE.Color(...colour)});
    const mesh = new THREE.Mesh(geometry, material);
    mesh.frustumCulled = false;
    scene.add(mesh);
    return {mesh, meta, data};
  }

  function place({mesh, meta, data}, frame) {
    const n = meta.vertices, xyz = mesh.geometry.attributes.position.array;
    const stored = data.frames.length ? data.frames[frame] : data.rest;
    for (let axis = 0; axis < 3; ++axis) {
      for (let i = 0; i < n; ++i) {
        xyz[3 * i + axis] = meta.box_lo_mm[axis] + meta.step_mm[axis] * stored[axis * n + i];
      }
    }
    mesh.geometry.attributes.position.needsUpdate = true;
    mesh.geometry.computeVertexNormals();
  }

  // The frame whose time is nearest; a run that has ended stays as it was.
  function setTime(time) {
    for (const surface of surfaces) {
      place(surface, viscera.nearest(surface.meta.times_s, time));
    }
    view.request();
  }

  const lo = [0, 1, 2].map(k => Math.min(...runs.map(r => r.meta.box_lo_mm[k])));
  const hi = [0, 1, 2].map(k =>
    Math.max(...runs.map(r => r.meta.box_lo_mm[k] + 65535 * r.meta.step_mm[k])));
  const centre = new THREE.Vector3(...lo.map((l, k) => (l + hi[k]) / 2));
  const radius = Math.hypot(...lo.map((l, k) => hi[k] - l)) / 2;
  view.look(new THREE.Vector3(-0.35, -1, 0.3).normalize(), centre, radius);
  view.theme();
  view.resize();
  setTime(0);
  return {
    setTime, theme: view.theme,
    setVisible(i, on) { surfaces[i].mesh.visible = on; view.request(); },
    onDrawn(callback) { view.onDrawn(callback); view.request(); },
  };
};
