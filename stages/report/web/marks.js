// Rings around places, of one size on the screen and drawn over everything; one of them may be
// pointed out by a larger ring.
"use strict";

// `count` rings at placeOf(0), placeOf(1), …, which is asked again by move().
viscera.createMarks = function (scene, pixelRatio, count, placeOf) {
  const picture = document.createElement("canvas");
  picture.width = picture.height = 64;
  const context = picture.getContext("2d");
  context.lineWidth = 11;
  context.strokeStyle = "#ffffff";
  context.arc(32, 32, 25, 0, 2 * Math.PI);
  context.stroke();
  const map = new THREE.CanvasTexture(picture);
  const position = new THREE.BufferAttribute(new Float32Array(3 * count), 3);
  function rings(pixels) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", position);
    const points = new THREE.Points(geometry, new THREE.PointsMaterial({size: pixels * pixelRatio,
      map, sizeAttenuation: false, transparent: true, depthTest: false, depthWrite: false}));
    points.frustumCulled = false;
    points.renderOrder = 4;
    scene.add(points);
    return points;
  }
  const all = rings(15), one = rings(34);
  one.visible = false;
  function move() {
    for (let m = 0; m < count; ++m) position.array.set(placeOf(m), 3 * m);
    position.needsUpdate = true;
  }
  move();
  return {
    move,
    colour(css) { for (const points of [all, one]) points.material.color.set(css); },
    show(on) { all.visible = on; },
    pointOut(m) {
      one.visible = m !== undefined;
      if (one.visible) one.geometry.setDrawRange(m, 1);
    },
  };
};
