// Several runs in one 3D view, each its outer surface in its own colour, at one time. Coordinates are
// LPS mm; the projection is parallel.
"use strict";

// `runs`: [{meta, data, colour [r, g, b]}] with meta and data as geometry.js unpacks them.
viscera.createOverlay = function (canvas, runs) {
  const renderer = new THREE.WebGLRenderer({canvas, antialias: true});
  const scene = new THREE.Scene();
  const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.1, 1000);
  camera.up.set(0, 0, 1);
  const lamp = new THREE.DirectionalLight(0xffffff, 0.75);
  lamp.position.set(0.4, 0.7, 1);
  camera.add(lamp);
  scene.add(camera, new THREE.HemisphereLight(0xffffff, 0x8090a0, 0.55));
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
      const times = surface.meta.times_s;
      let best = 0;
      times.forEach((t, i) => {
        if (Math.abs(t - time) < Math.abs(times[best] - time)) best = i;
      });
      place(surface, best);
    }
    request();
  }

  const lo = [0, 1, 2].map(k => Math.min(...runs.map(r => r.meta.box_lo_mm[k])));
  const hi = [0, 1, 2].map(k =>
    Math.max(...runs.map(r => r.meta.box_lo_mm[k] + 65535 * r.meta.step_mm[k])));
  const centre = new THREE.Vector3(...lo.map((l, k) => (l + hi[k]) / 2));
  const radius = Math.hypot(...lo.map((l, k) => hi[k] - l)) / 2;
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableKeys = false;
  controls.screenSpacePanning = true;
  controls.target.copy(centre);
  camera.position.copy(centre).add(new THREE.Vector3(-0.35, -1, 0.3).setLength(4 * radius));
  camera.near = radius / 10;
  camera.far = 10 * radius;
  controls.update();

  let pending = false, drawn = null;
  function request() {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      renderer.render(scene, camera);
      if (drawn) drawn();
    });
  }
  function resize() {
    const {clientWidth: w, clientHeight: h} = canvas;
    if (w === 0 || h === 0) return;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(w, h, false);
    const half = 0.85 * radius;
    camera.top = half;
    camera.bottom = -half;
    camera.right = half * w / h;
    camera.left = -half * w / h;
    camera.updateProjectionMatrix();
    request();
  }
  function turn(across, up) {
    const {x, y, z} = camera.position.clone().sub(controls.target);
    const s = new THREE.Spherical().setFromVector3(new THREE.Vector3(x, z, -y));
    s.theta += across;
    s.phi = Math.min(Math.max(s.phi + up, 0.01), Math.PI - 0.01);
    const v = new THREE.Vector3().setFromSpherical(s);
    camera.position.copy(controls.target).add(new THREE.Vector3(v.x, -v.z, v.y));
    controls.update();
    request();
  }
  function zoom(factor) {
    camera.zoom = Math.min(Math.max(camera.zoom * factor, 0.2), 50);
    camera.updateProjectionMatrix();
    request();
  }
  canvas.addEventListener("keydown", event => {
    const keys = {ArrowLeft: () => turn(-0.1, 0), ArrowRight: () => turn(0.1, 0),
                  ArrowUp: () => turn(0, -0.1), ArrowDown: () => turn(0, 0.1),
                  "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15)};
    if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
    keys[event.key]();
    event.preventDefault();
  });
  controls.addEventListener("change", request);
  new ResizeObserver(resize).observe(canvas);
  function theme() {
    const style = getComputedStyle(document.documentElement);
    renderer.setClearColor(style.getPropertyValue("--view-bg").trim());
    request();
  }
  theme();
  resize();
  setTime(0);
  return {
    setTime, theme,
    setVisible(i, on) { surfaces[i].mesh.visible = on; request(); },
    onDrawn(callback) { drawn = callback; request(); },
  };
};
