// Surfaces for the turning view: wall, oil, break and head, as whole numbers in units of half a scene.
"use strict";

const bytes = (values, Kind, scale, factor = 1) => {
  const found = new Kind(values.length);
  for (let k = 0; k < values.length; k++) found[k] = Math.round(clamp(scale * factor * values[k], -scale, scale));
  return found;
};

// A mesh of points (x, y, z one behind the other) and triangles (three numbers each), with smooth normals.
function packedMesh(points, triangles) {
  const normal = new Float64Array(points.length);
  for (let k = 0; k < triangles.length; k += 3) {
    const a = 3 * triangles[k], b = 3 * triangles[k + 1], c = 3 * triangles[k + 2];
    const ux = points[b] - points[a], uy = points[b + 1] - points[a + 1], uz = points[b + 2] - points[a + 2];
    const vx = points[c] - points[a], vy = points[c + 1] - points[a + 1], vz = points[c + 2] - points[a + 2];
    const x = uy * vz - uz * vy, y = uz * vx - ux * vz, z = ux * vy - uy * vx;
    for (let j = 0; j < 3; j++) {
      const corner = 3 * triangles[k + j];
      normal[corner] += x;
      normal[corner + 1] += y;
      normal[corner + 2] += z;
    }
  }
  for (let k = 0; k < normal.length; k += 3) {
    const length = Math.hypot(normal[k], normal[k + 1], normal[k + 2]) || 1;
    for (let j = 0; j < 3; j++) normal[k + j] /= length;
  }
  return {position: bytes(points, Int16Array, 32767), normal: bytes(normal, Int8Array, 127),
          index: Uint16Array.from(triangles)};
}

// Colors of a mesh of which one side of the contact line is as the other.
const plain = color => ({coveredColor: color, bareColor: color});

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
  const offsets = corners.map(([i, j, k]) => i * far + j * front + k), within = new Uint8Array(field.length);
  for (let k = 0; k < field.length; k++) within[k] = field[k] > 0 ? 1 : 0;
  for (let i = 0; i + 1 < along; i++) for (let j = 0; j + 1 < side; j++) for (let k = 0; k + 1 < front; k++) {
    const first = i * far + j * front + k;
    let inside = 0, crossed = 0;
    for (let c = 0; c < 8; c++) inside += within[first + offsets[c]];
    if (inside === 0 || inside === 8) continue;
    const sum = [0, 0, 0];
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
      const inside = within[here];
      if (inside === within[here + steps[axis]]) continue;
      const [u, v] = [steps[(axis + 1) % 3], steps[(axis + 2) % 3]];
      const around = [here, here - u, here - u - v, here - v].map(one => number[one] - 1);
      if (around.some(one => one < 0)) continue;
      const [a, b, c, d] = inside ? around : around.reverse();
      cells.push(a, b, c, a, c, d);
    }
  }
  return {points, cells};
}

// Directions of the points of a wall, and its triangles: the same ones in every eye.
let rays = null, around = null;

function eyeSurfaces(model, eye) {
  const rows = 2 * model.rows - 1, columns = 2 * model.columns, {center, half} = eye;
  rays = rays || Array.from({length: rows * columns}, (_, k) => direction(
    360 * (k % columns) / columns, 180 * Math.floor(k / columns) / (rows - 1)));
  around = around || Uint16Array.from(cellsOf(rows, columns));
  const scaled = (points, factor = () => 1) => {
    const found = new Float64Array(3 * points.length);
    points.forEach((point, k) => {
      const by = factor(k);
      for (let j = 0; j < 3; j++) found[3 * k + j] = (by * point[j] - center[j]) / half;
    });
    return found;
  };
  const wall = packedMesh(scaled(rays, k => eye.wall[k]), around);

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

  return {
    wall: (margin, covered, bare) => ({...wall, coveredColor: covered, bareColor: bare,
                                       toLine: bytes(model.doubled(margin), Int8Array, 127, 1e3)}),

    free,

    // The surface of the tamponade where it leaves the wall, up to the wall.
    tamponade(depth, meridian, color) {
      const {points, cells} = free(depth, meridian);
      const toWall = points.map(point => (model.at(eye.wall, ...placeOf(point)) - Math.hypot(...point)) / 1e-3);
      return {...packedMesh(scaled(points), cells), ...plain(color), toLine: bytes(toWall, Int8Array, 127)};
    },

    // A band around a break.
    tear(tear, color) {
      if (!tear) return {...packedMesh([], []), ...plain(color)};
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
      return {...packedMesh(scaled(points), cells), ...plain(color)};
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
  return {...packedMesh(Float64Array.from(points), triangles), covered: Uint8Array.from(colors.flat())};
}

if (typeof module !== "undefined") {
  Object.assign(globalThis, require("./model.js"));
  module.exports = {eyeSurfaces};
}
