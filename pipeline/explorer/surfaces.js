// Surfaces for the turning view: wall, oil, break and head, as whole numbers in units of half a scene.
"use strict";

const bytes = (values, Kind, scale, factor = 1) => {
  const found = new Kind(values.length);
  for (let k = 0; k < values.length; k++) found[k] = Math.round(clamp(scale * factor * values[k], -scale, scale));
  return found;
};

// A mesh of points (x, y, z one behind the other) and triangles (three numbers each), with smooth normals.
function packedMesh(points, triangles, wall, color, bare = color, toLine = null) {
  const count = points.length / 3, normal = new Float64Array(points.length);
  for (let k = 0; k < triangles.length; k += 3) {
    const [a, b, c] = [0, 1, 2].map(j => 3 * triangles[k + j]);
    const u = [0, 1, 2].map(j => points[b + j] - points[a + j]), v = [0, 1, 2].map(j => points[c + j] - points[a + j]);
    const face = [u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]];
    for (const corner of [a, b, c]) for (let j = 0; j < 3; j++) normal[corner + j] += face[j];
  }
  for (let k = 0; k < normal.length; k += 3) {
    const length = Math.hypot(normal[k], normal[k + 1], normal[k + 2]) || 1;
    for (let j = 0; j < 3; j++) normal[k + j] /= length;
  }
  const painted = one => Uint8Array.from({length: 3 * count}, (_, k) => typeof one[0] === "number" ? one[k % 3]
    : one[Math.floor(k / 3)][k % 3]);
  return {wall, position: bytes(points, Int16Array, 32767), normal: bytes(normal, Int8Array, 127),
          toLine: toLine ? bytes(toLine, Int8Array, 127) : new Int8Array(count).fill(127),
          covered: painted(color), bare: painted(bare), index: Uint16Array.from(triangles)};
}

// Triangles of a grid of rows and columns that closes around; a cell may be left out.
function cellsOf(rows, columns, chosen = () => true) {
  const found = [];
  for (let row = 0; row + 1 < rows; row++) {
    for (let column = 0; column < columns; column++) {
      const next = (column + 1) % columns;
      const [a, b, c, d] = [row * columns + column, (row + 1) * columns + column, (row + 1) * columns + next,
                            row * columns + next];
      if (chosen([a, b, c, d])) found.push(a, c, d, a, b, c);
    }
  }
  return found;
}

// A field with twice the points along an axis, as smooth as cubics make it; sizes of the three axes.
function finer(field, sizes, axis) {
  const count = sizes[axis], inner = sizes.slice(axis + 1).reduce((product, one) => product * one, 1);
  const outer = field.length / (count * inner), many = 2 * count - 1, found = new Float32Array(outer * many * inner);
  for (let o = 0; o < outer; o++) for (let i = 0; i < inner; i++) {
    const at = k => field[(o * count + k) * inner + i];
    const of = k => k < 0 ? 2 * at(0) - at(1) : k >= count ? 2 * at(count - 1) - at(count - 2) : at(k);
    for (let k = 0; k < count; k++) {
      found[(o * many + 2 * k) * inner + i] = at(k);
      if (k + 1 < count) {
        found[(o * many + 2 * k + 1) * inner + i] = (9 * (at(k) + at(k + 1)) - of(k - 1) - of(k + 2)) / 16;
      }
    }
  }
  return found;
}

// Points where a field is zero, one in every cell that it crosses, in steps of the field, and triangles between them.
function zeroOf(field, [along, side, front]) {
  const far = side * front, steps = [far, front, 1], number = new Int32Array(field.length), points = [], cells = [];
  const corners = [0, 1].flatMap(i => [0, 1].flatMap(j => [0, 1].map(k => [i, j, k])));
  const edges = corners.flatMap((one, a) => corners.flatMap((other, b) => a < b
    && one.reduce((sum, part, k) => sum + Math.abs(part - other[k]), 0) === 1 ? [[a, b]] : []));
  const offsets = corners.map(([i, j, k]) => i * far + j * front + k);
  for (let i = 0; i + 1 < along; i++) for (let j = 0; j + 1 < side; j++) for (let k = 0; k + 1 < front; k++) {
    const first = i * far + j * front + k;
    let inside = 0;
    for (let c = 0; c < 8; c++) if (field[first + offsets[c]] > 0) inside++;
    if (inside === 0 || inside === 8) continue;
    const sum = [0, 0, 0];
    let crossed = 0;
    for (const [a, b] of edges) {
      const one = field[first + offsets[a]], other = field[first + offsets[b]];
      if (one > 0 === other > 0) continue;
      const share = one / (one - other);
      for (let axis = 0; axis < 3; axis++) sum[axis] += corners[a][axis] + share * (corners[b][axis] - corners[a][axis]);
      crossed++;
    }
    points.push([i + sum[0] / crossed, j + sum[1] / crossed, k + sum[2] / crossed]);
    number[first] = points.length;
  }
  // Every edge of the field that is crossed has four cells around it.
  for (let i = 1; i + 1 < along; i++) for (let j = 1; j + 1 < side; j++) for (let k = 1; k + 1 < front; k++) {
    const here = i * far + j * front + k;
    for (let axis = 0; axis < 3; axis++) {
      const inside = field[here] > 0;
      if (inside === field[here + steps[axis]] > 0) continue;
      const [u, v] = [steps[(axis + 1) % 3], steps[(axis + 2) % 3]];
      const around = [here, here - u, here - u - v, here - v].map(one => number[one] - 1);
      if (around.some(one => one < 0)) continue;
      const [a, b, c, d] = inside ? around : around.reverse();
      cells.push(a, b, c, a, c, d);
    }
  }
  return {points, cells};
}

// Directions of the points of a wall.
const wallRays = (rows, columns) => Array.from({length: rows * columns}, (_, k) => direction(
  360 * (k % columns) / columns, 180 * Math.floor(k / columns) / (rows - 1)));
let rays = null;

function eyeSurfaces(model, eye) {
  const rows = 2 * model.rows - 1, columns = 2 * model.columns, {center, half} = eye;
  rays = rays || wallRays(rows, columns);
  const scaled = found => {
    const one = new Float64Array(3 * found.length);
    found.forEach((point, k) => { for (let j = 0; j < 3; j++) one[3 * k + j] = (point[j] - center[j]) / half; });
    return one;
  };
  const walls = scaled(rays.map((ray, k) => ray.map(part => part * eye.wall[k]))), around = cellsOf(rows, columns);

  const placeOf = ([x, y, z]) => [Math.atan2(x, y) / radians, Math.acos(clamp(-z / Math.hypot(x, y, z), -1, 1)) / radians];

  // Points of the free surface of a tamponade that goes to a meridian, m, in the frame of the eye, and triangles.
  function free(depth, meridian) {
    const [along, side, front] = model.lattice;
    let sizes = [along, 2 * side - 1, front], field = depth;
    for (let axis = 0; axis < 3; axis++) {
      field = finer(field, sizes, axis);
      sizes = sizes.map((one, k) => k === axis ? 2 * one - 1 : one);
    }
    const {points, cells} = zeroOf(field, sizes), [sine, cosine] = [Math.sin(meridian * radians), Math.cos(meridian * radians)];
    return {cells, points: points.map(point => {
      const [on, beside, ahead] = point.map((one, k) => eye.low[k] + 0.5 * eye.step[k] * (one - (k === 1 ? 2 * (side - 1) : 0)));
      return [sine * on + cosine * beside, cosine * on - sine * beside, ahead];
    })};
  }

  const painted = {};  // walls in the colors of a tamponade: only where it touches changes

  return {
    wall(margin, covered, bare) {
      painted[covered] = painted[covered] || packedMesh(walls, around, true, covered, bare);
      return {...painted[covered], toLine: bytes(model.doubled(margin), Int8Array, 127, 1e3)};
    },

    free,

    // The surface of the tamponade where it leaves the wall, up to the wall.
    tamponade(depth, meridian, color) {
      const {points, cells} = free(depth, meridian);
      const toWall = points.map(point => (model.at(eye.wall, ...placeOf(point)) - Math.hypot(...point)) / 1e-3);
      return packedMesh(scaled(points), cells, false, color, color, toWall);
    },

    // A band around a break.
    tear(tear, color) {
      if (!tear) return packedMesh(new Float64Array(9), [], true, color);
      const points = [];
      for (const wider of [-1, 1]) {
        const low = Math.max(tear.latitude - 0.5 * tear.height - wider, 0.2), high = tear.latitude + 0.5 * tear.height + wider;
        const across = wider / Math.max(Math.sin(tear.latitude * radians), 0.1);
        const spread = clamp(15 * tear.width + across, 0, 180), middle = 30 * tear.hour, along = 24;
        const outline = [];
        for (const [from, to] of [[[-1, low], [1, low]], [[1, low], [1, high]], [[1, high], [-1, high]], [[-1, high], [-1, low]]]) {
          for (let k = 0; k < along; k++) {
            const share = k / along, [side, latitude] = from.map((part, j) => part + share * (to[j] - part));
            outline.push([middle + spread * side, latitude]);
          }
        }
        points.push(...outline.map(([meridian, latitude]) => direction(meridian, latitude).map(
          part => part * 0.985 * model.at(eye.wall, meridian, latitude))));
      }
      const count = points.length / 2, cells = [];
      for (let k = 0; k < count; k++) {
        const next = (k + 1) % count;
        cells.push(k, next, count + next, k, count + next, count + k);
      }
      return packedMesh(scaled(points), cells, false, color);
    },
  };
}

// A head that looks ahead: x to the patient's left, y up, z to the front.
function headSurface() {
  const skin = [226, 188, 160], hair = [92, 74, 62], white = [250, 250, 250], iris = [50, 90, 130], lip = [196, 132, 118];
  const points = [], colors = [], triangles = [];
  function ball(center, radii, color, shape = (x, y, z) => [x, y, z], rows = 25, columns = 36) {
    const first = points.length / 3;
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const [x, y, z] = direction(360 * column / columns, 180 * row / (rows - 1)), moved = shape(x, y, z);
        points.push(...moved.map((part, k) => center[k] + radii[k] * part));
        colors.push(typeof color === "function" ? color(x, y, z) : color);
      }
    }
    triangles.push(...cellsOf(rows, columns).map(k => first + k));
  }
  const bump = (x, y, dx, dy, width) => Math.exp(-((x - dx) ** 2 + (y - dy) ** 2) / width ** 2);
  ball([0, 0.12, 0], [0.56, 0.72, 0.66], (x, y, z) => (y > 0.52 || (z < -0.05 && y > -0.42) || (z < 0.22 && y > 0.12))
    ? hair : skin, (x, y, z) => {
    const narrow = 1 - 0.3 * Math.max(-y, 0) ** 1.5, front = Math.max(z, 0);
    return [x * narrow, y * (y < 0 ? 1.02 : 1), z * (1 - 0.06 * Math.max(-y, 0))
      + front * (0.12 * bump(x, y, 0, -0.82, 0.22) - 0.1 * (bump(x, y, -0.36, 0.02, 0.2) + bump(x, y, 0.36, 0.02, 0.2)))];
  }, 61, 80);
  ball([0, 0.0, 0.66], [0.085, 0.19, 0.15], skin, (x, y, z) => [x * (1 - 0.45 * Math.max(y, 0)), y, z * (1 - 0.75 * Math.max(y, 0)) * 0.9]);
  ball([0, -0.29, 0.565], [0.17, 0.035, 0.06], lip);
  for (const side of [-1, 1]) {
    ball([0.205 * side, 0.135, 0.515], [0.1, 0.062, 0.09], white);
    ball([0.205 * side, 0.135, 0.572], [0.05, 0.05, 0.045], iris);
    ball([0.205 * side, 0.25, 0.555], [0.12, 0.022, 0.06], hair);
    ball([0.565 * side, 0.07, -0.06], [0.07, 0.18, 0.11], skin);
  }
  ball([0, -0.72, -0.14], [0.3, 0.42, 0.3], skin);
  for (let k = 1; k < points.length; k += 3) points[k] += 0.15;  // in the middle
  return packedMesh(Float64Array.from(points), triangles, false, colors);
}

if (typeof module !== "undefined") {
  Object.assign(globalThis, require("./model.js"));
  module.exports = {eyeSurfaces};
}
