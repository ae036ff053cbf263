// A view of surfaces that turns on a drag, or by the arrow keys. It needs WebGL and nothing else.
// Of a scene `orientation` turns the surfaces before the view does (three rows), and `onDrag` and `onView` are told.
function showTurningView(root, scene) {
  const canvas = root.querySelector("canvas"), hint = root.querySelector(".hint");
  const gl = canvas.getContext("webgl", {preserveDrawingBuffer: true});  // a print shows what is drawn
  if (!gl) {
    root.querySelector(".stage").remove();
    hint.textContent = scene.without || "This browser has no WebGL: the surfaces cannot be shown here. ParaView opens the files in surfaces/.";
    return;
  }

  const vertexShader = `
    attribute vec3 position, normal, covered, bare;
    attribute float toLine;  // to the contact line, positive where oil touches
    uniform mat3 turn;
    uniform vec2 scale;
    varying vec3 facing, coveredColor, bareColor;
    varying float side;
    void main() {
      vec3 seen = turn * position;
      facing = turn * normal;
      coveredColor = covered;
      bareColor = bare;
      side = toLine;
      gl_Position = vec4(scale * seen.xy, -0.4 * seen.z, 1.0);
    }`;
  const fragmentShader = `
    precision mediump float;
    uniform float gloss;
    varying vec3 facing, coveredColor, bareColor;
    varying float side;
    void main() {
      if (gloss > 0.0 && side < 0.0) discard;  // of a liquid what lies at the wall
      vec3 n = normalize(facing) * (gl_FrontFacing ? 1.0 : -1.0);
      vec3 light = normalize(vec3(-0.35, 0.55, 0.75));
      float lit = 0.45 + 0.4 * max(dot(n, light), 0.0) + 0.15 * max(n.z, 0.0);
      float shine = gloss * pow(max(dot(n, normalize(light + vec3(0.0, 0.0, 1.0))), 0.0), 40.0);
      vec3 color = mix(bareColor, coveredColor, smoothstep(-0.04, 0.04, side));
      gl_FragColor = vec4(color * lit + shine, 1.0);
    }`;
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertexShader], [gl.FRAGMENT_SHADER, fragmentShader]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  const uniform = name => gl.getUniformLocation(program, name);

  // Data is base64, or an array that is here already.
  function buffer(target, data) {
    const bytes = typeof data === "string" ? Uint8Array.from(atob(data), letter => letter.charCodeAt(0)) : data;
    const made = gl.createBuffer();
    gl.bindBuffer(target, made);
    gl.bufferData(target, bytes, gl.STATIC_DRAW);
    return {made, length: bytes.byteLength};
  }
  const loaded = mesh => ({
    wall: mesh.wall, shown: true, index: buffer(gl.ELEMENT_ARRAY_BUFFER, mesh.index),
    arrays: [["position", 3, gl.SHORT], ["normal", 3, gl.BYTE], ["toLine", 1, gl.BYTE],
             ["covered", 3, gl.UNSIGNED_BYTE], ["bare", 3, gl.UNSIGNED_BYTE]].map(
      ([name, parts, type]) => [name, parts, type, buffer(gl.ARRAY_BUFFER, mesh[name])]),
  });
  const meshes = scene.meshes.map(loaded);

  let [azimuth, elevation] = scene.view, waiting = false;
  let orientation = scene.orientation || [[1, 0, 0], [0, 1, 0], [0, 0, 1]];
  const labels = scene.axes.map(([text, direction]) => {
    const label = document.createElement("span");
    label.textContent = text;
    canvas.parentNode.append(label);
    return {label, direction};
  });

  function attribute(name, parts, type, {made}) {
    const place = gl.getAttribLocation(program, name);
    gl.bindBuffer(gl.ARRAY_BUFFER, made);
    gl.enableVertexAttribArray(place);
    gl.vertexAttribPointer(place, parts, type, true, 0, 0);
  }

  function draw() {
    waiting = false;
    const ratio = window.devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
    canvas.width = Math.round(ratio * wide);
    canvas.height = Math.round(ratio * high);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);  // the page shows through
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    const [ca, sa, ce, se] = [Math.cos(azimuth), Math.sin(azimuth), Math.cos(elevation), Math.sin(elevation)];
    const [right, up, toward] = [[ca, 0, -sa], [-se * sa, ce, -se * ca], [ce * sa, se, ce * ca]].map(
      row => [0, 1, 2].map(k => row.reduce((sum, part, j) => sum + part * orientation[j][k], 0)));
    const shorter = Math.min(wide, high), scale = [0.8 * shorter / wide, 0.8 * shorter / high];
    gl.uniformMatrix3fv(uniform("turn"), false, [0, 1, 2].flatMap(k => [right[k], up[k], toward[k]]));
    gl.uniform2fv(uniform("scale"), scale);
    for (const mesh of meshes) {
      if (!mesh.shown) continue;
      // Of the wall only the side that faces away is drawn: the view is into an open eye, from wherever one looks.
      mesh.wall ? gl.enable(gl.CULL_FACE) : gl.disable(gl.CULL_FACE);
      gl.cullFace(gl.FRONT);
      gl.uniform1f(uniform("gloss"), mesh.wall ? 0 : 0.35);
      for (const array of mesh.arrays) attribute(...array);
      gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, mesh.index.made);
      gl.drawElements(gl.TRIANGLES, mesh.index.length / 2, gl.UNSIGNED_SHORT, 0);
    }
    const along = (one, other) => one.reduce((sum, number, k) => sum + number * other[k], 0);
    for (const {label, direction} of labels) {
      label.style.left = `${50 + 50 * scale[0] * along(right, direction)}%`;
      label.style.top = `${50 - 50 * scale[1] * along(up, direction)}%`;
      label.style.opacity = along(toward, direction) > 0.05 ? 1 : 0.45;
    }
  }
  function redraw() {
    if (!waiting) requestAnimationFrame(draw);
    waiting = true;
  }
  function look(view) {
    [azimuth, elevation] = view;
    if (scene.onView) scene.onView(view);
    redraw();
  }
  function turn(sideways, upward) {
    if (scene.onDrag) scene.onDrag(sideways, upward);
    else look([azimuth - sideways, Math.max(-1.5, Math.min(1.5, elevation + upward))]);
  }

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
  canvas.addEventListener("keydown", event => {
    const ways = {ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1]};
    if (!(event.key in ways)) return;
    event.preventDefault();
    turn(...ways[event.key]);
  });
  root.querySelectorAll("input").forEach((box, number) => box.addEventListener("change", () => {
    meshes[number].shown = box.checked;
    redraw();
  }));
  root.querySelectorAll("button").forEach((button, number) => button.addEventListener("click", () => {
    look(scene.views[number][1]);
  }));
  new ResizeObserver(redraw).observe(canvas);
  draw();

  return {
    look: view => { [azimuth, elevation] = view; redraw(); },
    orient: rows => { orientation = rows; redraw(); },
    replace(number, mesh) {
      const old = meshes[number];
      for (const {made} of [old.index, ...old.arrays.map(array => array[3])]) gl.deleteBuffer(made);
      meshes[number] = {...loaded(mesh), shown: old.shown};
      redraw();
    },
  };
}
