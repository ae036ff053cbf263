// A view of surfaces by three.js: it turns on a drag or by the arrow keys, zooms by two fingers, + and -, and by the wheel
// once it has been clicked; before, the wheel scrolls the page. Needs WebGL 2.
//
// A scene has `meshes`, `axes`, `view` and how far it reaches, in units of half its size; of one over time also `frames` and `data`. `orientation` turns the surfaces
// before the view does (three rows), and `onDrag` and `onView` are told. A mesh is {wall, position, normal, toLine, toFilm,
// covered, film, bare, index}: whole numbers, as base64, as an array, or as [offset, length] in `data`.
function showTurningView(root, scene) {
  const canvas = root.querySelector("canvas"), hint = root.querySelector(".hint"), stage = canvas.parentNode;
  const gl = canvas.getContext("webgl2", {alpha: true, antialias: true, preserveDrawingBuffer: true});  // a print shows it
  if (!gl) {
    stage.remove();
    root.querySelectorAll(".of-view").forEach(one => one.remove());
    hint.textContent = scene.without || "This browser has no WebGL 2: the surfaces cannot be shown here. ParaView opens the files in surfaces/.";
    return;
  }
  const FRAME = scene.reach || 1.25, DISTANCE = 10, ZOOMS = [1, 12];
  const renderer = new THREE.WebGLRenderer({canvas, context: gl});
  const space = new THREE.Scene(), turned = new THREE.Group(), camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.1, 30);
  renderer.setClearColor(0, 0);  // the page shows through
  space.add(turned);

  const vertexShader = `
    attribute vec3 covered, film, bare;
    attribute float toLine, toFilm;  // to the contact line, positive where oil touches; to films, positive over them
    varying vec3 facing, coveredColor, filmColor, bareColor;
    varying vec2 sides;
    void main() {
      facing = normalMatrix * normal;
      coveredColor = covered;
      filmColor = film;
      bareColor = bare;
      sides = vec2(toLine, toFilm);
      gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
    }`;
  const fragmentShader = `
    uniform float gloss, opacity;
    varying vec3 facing, coveredColor, filmColor, bareColor;
    varying vec2 sides;
    void main() {
      if (gloss > 0.0 && sides.x < 0.0) discard;  // of a liquid what lies at the wall
      vec3 n = normalize(facing);
      if (n.z < 0.0) n = -n;  // of both sides
      vec3 light = normalize(vec3(-0.35, 0.55, 0.75));
      float lit = 0.45 + 0.4 * max(dot(n, light), 0.0) + 0.15 * max(n.z, 0.0);
      float shine = gloss * pow(max(dot(n, normalize(light + vec3(0.0, 0.0, 1.0))), 0.0), 40.0);
      vec3 under = mix(coveredColor, filmColor, smoothstep(-0.04, 0.04, sides.y));
      gl_FragColor = vec4(mix(bareColor, under, smoothstep(-0.04, 0.04, sides.x)) * lit + shine, opacity);
    }`;
  // Of the wall the far side is drawn whole, the near one as far as the reader wants it: one looks into an open eye.
  function paint(wall, side) {
    const material = new THREE.ShaderMaterial({vertexShader, fragmentShader, side, transparent: true,
      uniforms: {gloss: {value: wall ? 0 : 0.35}, opacity: {value: 1}}});
    material.forceSinglePass = true;
    return material;
  }
  function setOpacity(mesh, value) {
    mesh.material.uniforms.opacity.value = value;
    mesh.material.depthWrite = value >= 1;
    mesh.visible = value > 0;
  }

  let blob = null;
  function numbers(data, Kind) {
    if (typeof data === "string") return new Kind(Uint8Array.from(atob(data), letter => letter.charCodeAt(0)).buffer);
    return Array.isArray(data) ? new Kind(blob, data[0], data[1]) : data;
  }
  const KINDS = [["position", 3, Int16Array], ["normal", 3, Int8Array], ["toLine", 1, Int8Array], ["toFilm", 1, Int8Array],
                 ["covered", 3, Uint8Array], ["film", 3, Uint8Array], ["bare", 3, Uint8Array]];
  function evenly(value, count, Kind) {
    if (!value.length) return new Kind(count).fill(value);
    const found = new Kind(count * value.length);
    for (let k = 0; k < found.length; k++) found[k] = k < value.length ? value[k] : found[k - value.length];
    return found;
  }

  // Set what is given of a mesh; the rest stays. A color is one for all, or one for every point by its place in a ramp.
  function fill(geometry, mesh) {
    for (const [name, parts, Kind] of KINDS) {
      if (mesh[name] === undefined) continue;
      geometry.setAttribute(name, new THREE.BufferAttribute(numbers(mesh[name], Kind), parts, true));
    }
    if (mesh.index !== undefined) geometry.setIndex(new THREE.BufferAttribute(numbers(mesh.index, Uint16Array), 1));
    const count = geometry.getAttribute("position").count;
    for (const name of ["covered", "film", "bare"]) {
      const places = mesh[`${name}Places`], ramp = scene.ramp && numbers(scene.ramp, Uint8Array);
      if (places !== undefined) {
        const found = numbers(places, Uint8Array), colors = new Uint8Array(3 * count);
        for (let k = 0; k < count; k++) colors.set(ramp.subarray(3 * found[k], 3 * found[k] + 3), 3 * k);
        geometry.setAttribute(name, new THREE.BufferAttribute(colors, 3, true));
      } else if (mesh[`${name}Color`] !== undefined) {
        geometry.setAttribute(name, new THREE.BufferAttribute(evenly(mesh[`${name}Color`], count, Uint8Array), 3, true));
      }
    }
    const standing = {toLine: [127, 1, Int8Array], toFilm: [-127, 1, Int8Array]};
    for (const [name, [value, parts, Kind]] of Object.entries(standing)) {
      const known = geometry.getAttribute(name);
      if (!known || known.count !== count) geometry.setAttribute(name, new THREE.BufferAttribute(evenly(value, count, Kind), parts, true));
    }
    for (const name of ["film", "bare"]) {
      const known = geometry.getAttribute(name);
      if (!known || known.count !== count) geometry.setAttribute(name, geometry.getAttribute("covered"));
    }
    if (mesh.position !== undefined && mesh.normal === undefined) {
      geometry.deleteAttribute("normal");  // it would be kept at its old length
      geometry.computeVertexNormals();
    }
  }

  function made(mesh) {
    const geometry = new THREE.BufferGeometry();
    fill(geometry, mesh);
    const sides = mesh.wall ? [THREE.BackSide, THREE.FrontSide] : [THREE.DoubleSide];
    const drawn = sides.map(side => new THREE.Mesh(geometry, paint(mesh.wall, side)));
    drawn.forEach((one, k) => {
      one.frustumCulled = false;
      one.renderOrder = mesh.wall ? 2 * k : 1;  // the far wall, what is in it, the near wall
      setOpacity(one, k ? 0 : 1);
      turned.add(one);
    });
    return {mesh, geometry, drawn, shown: true};
  }
  let meshes = [];

  let [azimuth, elevation] = scene.view, waiting = false, lastSize = [];
  function orient(rows) {
    const [a, b, c] = rows;
    turned.quaternion.setFromRotationMatrix(new THREE.Matrix4().set(...a, 0, ...b, 0, ...c, 0, 0, 0, 0, 1));
  }
  if (scene.orientation) orient(scene.orientation);
  const labels = scene.axes.map(([text, direction]) => {
    const label = document.createElement("span");
    label.textContent = text;
    stage.append(label);
    return {label, direction: new THREE.Vector3(...direction)};
  });

  function place() {
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    camera.position.set(DISTANCE * ce * sa, DISTANCE * se, DISTANCE * ce * ca);
    camera.lookAt(0, 0, 0);
  }
  place();
  const controls = new THREE.OrbitControls(camera, canvas);
  Object.assign(controls, {enablePan: false, enableZoom: false, enableRotate: !scene.onDrag, minZoom: ZOOMS[0],
                           maxZoom: ZOOMS[1], minPolarAngle: 0.07, maxPolarAngle: Math.PI - 0.07});
  controls.addEventListener("change", () => {
    const {x, y, z} = camera.position;
    [azimuth, elevation] = [Math.atan2(x, z), Math.asin(y / DISTANCE)];
    if (scene.onView) scene.onView([azimuth, elevation]);
    redraw();
  });
  canvas.addEventListener("focus", () => { controls.enableZoom = true; });
  canvas.addEventListener("blur", () => { controls.enableZoom = false; });
  canvas.addEventListener("pointerdown", () => { canvas.focus({preventScroll: true}); });

  function draw() {
    waiting = false;
    const wide = canvas.clientWidth, high = canvas.clientHeight, shorter = Math.min(wide, high);
    if (!shorter) return;
    const size = [wide, high, devicePixelRatio || 1];
    if (size.join() !== lastSize.join()) {  // a canvas is emptied by that
      renderer.setPixelRatio(size[2]);
      renderer.setSize(wide, high, false);
      lastSize = size;
    }
    const [right, top] = [FRAME * wide / shorter, FRAME * high / shorter];
    Object.assign(camera, {left: -right, right, top, bottom: -top});
    camera.updateProjectionMatrix();
    turned.updateMatrixWorld();
    camera.updateMatrixWorld();
    for (const {drawn, shown} of meshes) {
      for (const one of drawn) one.visible = shown && one.material.uniforms.opacity.value > 0 && one.geometry.index.count > 0;
    }
    renderer.render(space, camera);
    const at = new THREE.Vector3();
    for (const {label, direction} of labels) {
      at.copy(direction).applyQuaternion(turned.quaternion);
      label.style.opacity = at.dot(camera.position) > 0.05 * DISTANCE ? 1 : 0.45;
      at.project(camera);
      label.style.left = `${50 + 50 * at.x}%`;
      label.style.top = `${50 - 50 * at.y}%`;
    }
  }
  function redraw() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }
  function look(view, told = true) {
    [azimuth, elevation] = view;
    place();
    controls.update();
    if (told && scene.onView) scene.onView(view);
    redraw();
  }
  function turn(sideways, upward) {
    if (scene.onDrag) scene.onDrag(sideways, upward);
    else look([azimuth - sideways, Math.max(-1.5, Math.min(1.5, elevation + upward))]);
  }
  function zoom(factor) {
    camera.zoom = factor ? Math.max(ZOOMS[0], Math.min(ZOOMS[1], factor * camera.zoom)) : 1;
    redraw();
  }

  if (scene.onDrag) {
    let last = null;
    canvas.addEventListener("pointerdown", event => {
      last = event;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", event => {
      if (!last || event.pointerId !== last.pointerId) return;
      turn(0.01 * (event.clientX - last.clientX), 0.01 * (event.clientY - last.clientY));
      last = event;
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { last = null; });
  }
  canvas.addEventListener("keydown", event => {
    const ways = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]};
    const zooms = {"+": 1.25, "=": 1.25, "-": 0.8, "0": 0};
    if (event.key in ways) turn(...ways[event.key]);
    else if (event.key in zooms) zoom(zooms[event.key]);
    else return;
    event.preventDefault();
  });
  root.querySelectorAll("input[type=checkbox]").forEach((box, number) => box.addEventListener("change", () => {
    meshes[number].shown = box.checked;
    redraw();
  }));
  root.querySelectorAll("[data-view]").forEach((button, number) => button.addEventListener("click", () => {
    look(scene.views[number][1]);
  }));
  root.querySelectorAll("[data-zoom]").forEach(button => button.addEventListener("click", () => {
    zoom(Number(button.dataset.zoom));
  }));
  root.querySelectorAll("[data-opacity]").forEach(slider => slider.addEventListener("input", () => {
    const near = slider.dataset.opacity === "wall";
    for (const {mesh, drawn} of meshes) {
      if (near && mesh.fades && mesh.wall) setOpacity(drawn[1], slider.valueAsNumber);
      if (!near && !mesh.wall) setOpacity(drawn[0], slider.valueAsNumber);
    }
    redraw();
  }));

  // Frames over time.
  function showFrame(number) {
    scene.frames[number].meshes.forEach((changes, which) => { if (changes) fill(meshes[which].geometry, changes); });
    redraw();
  }
  function playThrough() {
    const slider = root.querySelector("[data-time]"), button = root.querySelector("[data-play]"), told = root.querySelector(".when");
    let playing = null;
    const show = () => {
      showFrame(slider.valueAsNumber);
      told.textContent = scene.frames[slider.value].time;
      slider.setAttribute("aria-valuetext", told.textContent);
    };
    const stop = () => {
      clearInterval(playing);
      playing = null;
      button.textContent = "Play";
    };
    slider.addEventListener("input", () => { stop(); show(); });
    button.addEventListener("click", () => {
      if (playing) return stop();
      if (slider.value === slider.max) slider.value = 0;
      button.textContent = "Pause";
      playing = setInterval(() => {
        slider.stepUp();
        show();
        if (slider.value === slider.max) stop();
      }, 150);
    });
    show();
  }

  async function start() {
    if (scene.data) {
      const packed = Uint8Array.from(atob(scene.data), letter => letter.charCodeAt(0));
      blob = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
    }
    meshes = scene.meshes.map(made);
    if (scene.frames) playThrough();
    new ResizeObserver(redraw).observe(canvas);
    draw();
    root.dataset.ready = "";
  }
  start();

  return {
    look: view => look(view, false),
    orient(rows) { orient(rows); redraw(); },
    replace(number, mesh) {
      meshes[number].geometry.dispose();
      fill(meshes[number].geometry, mesh);
      redraw();
    },
  };
}
