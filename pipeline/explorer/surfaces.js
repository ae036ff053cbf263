// Surfaces for the turning view: wall, oil, break and head, as whole numbers in units of half a scene.
"use strict";

const bytes = (values, Kind, scale) => Kind.from(values, value => Math.round(clamp(scale * value, -scale, scale)));

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

const STRIDE = 1.2e-3;      // m, along a ray to the wall

function eyeSurfaces(model, eye) {
  const step = 2.5, rows = 73, columns = 144, {center, half} = eye;
  const grid = Array.from({length: rows * columns}, (_, k) => [step * (k % columns), step * Math.floor(k / columns)]);
  const rays = grid.map(([meridian, latitude]) => direction(meridian, latitude));
  const scaled = found => Float64Array.from({length: 3 * found.length},
    (_, k) => (found[Math.floor(k / 3)][k % 3] - center[k % 3]) / half);
  const radius = grid.map(([meridian, latitude]) => model.at(eye.wall, meridian, latitude));
  const walls = scaled(rays.map((ray, k) => ray.map(part => part * radius[k]))), around = cellsOf(rows, columns);

  const placeOf = ([x, y, z]) => [Math.atan2(x, y) / radians, Math.acos(clamp(-z / Math.hypot(x, y, z), -1, 1)) / radians];

  // Distance of the wall from a point within, along a ray.
  function wallFrom(point, ray) {
    const outside = distance => {
      const there = point.map((part, j) => part + distance * ray[j]);
      return Math.hypot(...there) > model.at(eye.wall, ...placeOf(there));
    };
    let far = STRIDE;
    while (far < 2.6 * eye.globe && !outside(far)) far += STRIDE;  // the first wall: another may lie behind the lens
    let near = far - STRIDE;
    for (let k = 0; k < 9; k++) {
      const middle = 0.5 * (near + far);
      if (outside(middle)) far = middle; else near = middle;
    }
    return near;
  }

  // The same field with less of the steps of eight bits; what lies at the wall stays there.
  function evened(field) {
    const {rows, columns} = model;
    return Float32Array.from(field, (value, k) => {
      const row = Math.floor(k / columns), column = k % columns;
      if (value < 5e-5 || row === 0 || row === rows - 1) return value;
      let sum = 0;
      for (let r = -1; r <= 1; r++) for (let c = -1; c <= 1; c++) {
        const other = field[(row + r) * columns + (column + c + columns) % columns];
        if (other < 5e-5) return value;
        sum += (2 - Math.abs(r)) * (2 - Math.abs(c)) * other / 16;
      }
      return sum;
    });
  }

  return {
    wall(margin, covered, bare) {
      const toLine = Array.from(model.doubled(margin), one => one / 1e-3);
      return packedMesh(walls, around, true, covered, bare, toLine);
    },

    // The surface of the tamponade where it leaves the wall, up to the contact line.
    tamponade(gap, point, margin, color) {
      const gaps = model.doubled(evened(evened(gap))), fine = model.doubled(margin), toLine = [];
      const points = rays.map((ray, k) => {
        const wall = wallFrom(point, ray), distance = clamp(wall - gaps[k], 0, wall);
        toLine.push(-model.at(fine, ...placeOf(point.map((part, j) => part + wall * ray[j]))) / 1e-3);
        return ray.map((part, j) => point[j] + distance * part);
      });
      const cells = cellsOf(rows, columns, corners => corners.some(k => toLine[k] > 0));
      return packedMesh(scaled(points), cells, false, color, color, toLine);
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
