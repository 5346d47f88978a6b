// What every 3D view has: a renderer, lights, and a camera with parallel projection that mouse, touch
// and keys turn. Drawn only when something asks for it.
"use strict";

// `fit` is called when the canvas has another size. `moreKeys` maps keys to what they do.
viscera.createView = function (canvas, fit, moreKeys = {}) {
  const renderer = new THREE.WebGLRenderer({canvas, antialias: true});
  const scene = new THREE.Scene();
  const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.1, 1000);
  camera.up.set(0, 0, 1);
  const lamp = new THREE.DirectionalLight(0xffffff, 0.75);
  const sky = new THREE.HemisphereLight(0xffffff, 0x8090a0, 0.55);
  lamp.position.set(0.4, 0.7, 1);
  camera.add(lamp);
  scene.add(camera, sky);
  const controls = new THREE.OrbitControls(camera, canvas);
  controls.enableKeys = false;
  controls.screenSpacePanning = true;

  let pending = false;
  const drawn = [];
  function request() {
    if (pending) return;
    pending = true;
    requestAnimationFrame(() => {
      pending = false;
      renderer.render(scene, camera);
      for (const callback of drawn) callback(camera);
    });
  }
  function resize() {
    const {clientWidth: w, clientHeight: h} = canvas;
    if (w === 0 || h === 0) return;
    renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
    renderer.setSize(w, h, false);
    fit();
  }
  const aspect = () => canvas.clientWidth / Math.max(canvas.clientHeight, 1);
  // `half`: what is seen above the middle of the canvas, mm.
  function show(half) {
    camera.top = half;
    camera.bottom = -half;
    camera.right = half * aspect();
    camera.left = -half * aspect();
    camera.updateProjectionMatrix();
    request();
  }
  // At a sphere, LPS mm, from a direction of length 1.
  function look(direction, centre, radius) {
    controls.target.copy(centre);
    camera.position.copy(centre).addScaledVector(direction, 4 * radius);
    camera.near = radius / 10;
    camera.far = 10 * radius;
    camera.zoom = 1;
    controls.update();
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
                  "+": () => zoom(1.15), "=": () => zoom(1.15), "-": () => zoom(1 / 1.15),
                  ...moreKeys};
    if (!keys[event.key] || event.ctrlKey || event.metaKey) return;
    keys[event.key]();
    event.preventDefault();
  });
  controls.addEventListener("change", request);
  new ResizeObserver(resize).observe(canvas);

  // A colour of the page's theme.
  const themed = name =>
    getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  function theme() {
    renderer.setClearColor(themed("--view-bg"));
    request();
  }
  return {renderer, scene, camera, lamp, sky, request, resize, aspect, show, look, theme, themed,
          onDrawn: callback => drawn.push(callback)};
};
