// Shapes between those of the tables, as pipeline/explorer/lookup.py finds them too. It draws nothing and needs no page.
// A field has a row for every latitude and a column for every meridian; lengths are in m, angles in degrees.
"use strict";

const radians = Math.PI / 180;
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);
const turned = (value, whole) => ((value % whole) + whole) % whole;

async function inflated(base64) {
  const packed = Uint8Array.from(atob(base64), letter => letter.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

// Direction of gravity in a head whose face was raised by a pitch and whose right ear was lowered by a roll.
function gravity(pitch, roll) {
  const [p, r] = [pitch * radians, roll * radians];
  return [-Math.cos(p) * Math.sin(r), -Math.cos(p) * Math.cos(r), -Math.sin(p)];
}

function direction(meridian, latitude) {
  const [around, down] = [meridian * radians, latitude * radians];
  return [Math.sin(down) * Math.sin(around), Math.sin(down) * Math.cos(around), -Math.cos(down)];
}

// Between two values, numbers or lists of them.
const mix = (one, other, share) => typeof one === "number" ? one + share * (other - one)
  : one.map((value, k) => value + share * (other[k] - value));

function explorerModel(known) {
  const {tilts, fills, azimuths, latitudes: rows, meridians: columns, lattice} = known;
  const step = 180 / (rows - 1), size = rows * columns, last = Math.round(known.ora / step);
  const half = columns / 2 + 1, stored = rows * half, inLattice = lattice.reduce((product, one) => product * one, 1);

  // An eye of the tables: its measures, and the tables of its tamponades once they are unpacked.
  async function eyeOf(data) {
    const wall = new Float32Array((await inflated(data.wall)).buffer), tables = {};
    for (const [name, packed] of Object.entries(data.tables)) {
      const bytes = await inflated(packed), nodes = bytes.length / (stored + inLattice + 10), first = nodes * stored;
      const end = first + nodes * inLattice, row = lattice[2];
      for (let k = 0; k < first; k++) if (k % half) bytes[k] += bytes[k - 1];  // differences along a row
      for (let k = first; k < end; k++) if ((k - first) % row) bytes[k] += bytes[k - 1];
      tables[name] = {margin: bytes.subarray(0, first), depth: bytes.subarray(first, end), doubt: bytes.subarray(end)};
    }
    return {...data, wall, tables, length: Number(data.name)};
  }

  // An eye of any length, between those of the tables: its measures, and of a tamponade the tables around it with weights.
  function eyeBetween(eyes, length) {
    const lengths = eyes.map(one => one.length), [[one, ofOne], [other, ofOther]] = between(length, lengths), eye = {length};
    for (const [name, value] of Object.entries(eyes[one])) {
      if (typeof value === "number" || value instanceof Float32Array || Array.isArray(value)) eye[name] = mix(value, eyes[other][name], ofOther);
    }
    eye.tablesOf = name => {
      const having = eyes.filter(each => each.tables[name]);
      return having.length ? between(length, having.map(each => each.length)).filter(([, weight]) => weight)
        .map(([k, weight]) => ({...having[k].tables[name], weight})) : null;
    };
    return {...eye, volume: mix(Math.cbrt(eyes[one].volume), Math.cbrt(eyes[other].volume), ofOther) ** 3, length};
  }

  function between(value, nodes) {
    if (nodes.length < 2) return [[0, 1], [0, 0]];
    let index = 0;
    while (index < nodes.length - 2 && nodes[index + 1] <= value) index++;
    const share = clamp((value - nodes[index]) / (nodes[index + 1] - nodes[index]), 0, 1);
    return [[index, 1 - share], [index + 1, share]];
  }

  // Where a tamponade goes, and the directions of the tables around it with their weights.
  function place(toward) {
    const meridian = turned(Math.atan2(toward[0], toward[1]) / radians, 360), cosine = Math.cos(meridian * radians) ** 2;
    const tilt = Math.acos(clamp(-toward[2], -1, 1)) / radians, nodes = [];
    for (const [one, ofTilt] of between(tilt, tilts)) {
      [cosine, 1 - cosine].forEach((ofAzimuth, two) => {
        if (ofTilt * ofAzimuth) nodes.push([(one * azimuths + two) * fills.length, ofTilt * ofAzimuth]);
      });
    }
    // The meridian to whose sides the contact line lies alike, on an equator that is oval.
    const mirror = Math.atan2(known.oval * Math.sin(meridian * radians), Math.cos(meridian * radians)) / radians;
    return {meridian, mirror, nodes};
  }

  const spreadOf = fill => Math.asin(Math.sqrt(fill)), spread = fills.map(spreadOf);

  // Tables, nodes and weights of a place, at a share of each of two fills; null where one of the shapes was not found.
  function mixed(tables, where, ofFills) {
    const nodes = [];
    for (const table of tables) for (const [three, ofFill] of ofFills) for (const [first, weight] of where.nodes) {
      if (weight * ofFill) nodes.push([table, first + three, table.weight * weight * ofFill]);
    }
    return nodes.every(([table, node]) => table.margin[node * stored]) ? nodes : null;
  }

  const toMargin = value => known.reach * (value - 128) / 127;
  const toDepth = value => known.deepest * (value - 128) / 127;
  const doubtOf = nodes => Array.from({length: 10}, (_, k) => nodes.reduce(
    (sum, [table, node, weight]) => sum + weight * table.doubt[10 * node + k], 0));

  // The margin with meridians that count from 12 o'clock.
  function marginOf(nodes, where) {
    const sum = new Float64Array(stored), found = new Float32Array(size);
    for (const [table, node, weight] of nodes) {
      for (let k = 0; k < stored; k++) sum[k] += weight * table.margin[node * stored + k];
    }
    for (let column = 0; column < columns; column++) {
      const [first, second, share] = columnsOf(column * step, where);
      for (let row = 0; row < rows; row++) {
        found[row * columns + column] = toMargin((1 - share) * sum[row * half + first] + share * sum[row * half + second]);
      }
    }
    return found;
  }

  // The two columns of a table beside a meridian of the eye, and the share of the second: one side mirrors the other.
  function columnsOf(meridian, where) {
    const from = (meridian - where.mirror) / step, first = Math.floor(from);
    return [...[first, first + 1].map(k => { const one = turned(k, columns); return Math.min(one, columns - one); }), from - first];
  }

  // How deep the points of the lattice lie in the tamponade, on both sides.
  function depthOf(nodes) {
    const [along, side, front] = lattice, wide = 2 * side - 1, found = new Float32Array(along * wide * front);
    const sum = new Float64Array(inLattice);
    for (const [table, node, weight] of nodes) {
      for (let k = 0; k < inLattice; k++) sum[k] += weight * toDepth(table.depth[node * inLattice + k]);
    }
    for (let i = 0; i < along; i++) for (let j = 0; j < wide; j++) for (let k = 0; k < front; k++) {
      found[(i * wide + j) * front + k] = sum[(i * side + Math.abs(j - side + 1)) * front + k];
    }
    return found;
  }

  function lookUp(eye, tables, toward, fill) {
    const where = place(toward), nodes = mixed(tables, where, between(spreadOf(fill), spread));
    if (!nodes) return null;
    const doubt = doubtOf(nodes), order = toward[1] < 0 ? [0, 2, 1, 3] : [0, 1, 2, 3], margin = marginOf(nodes, where);
    return {margin, depth: () => depthOf(nodes), meridian: where.meridian, shares: shares(eye, margin),
            low: order.map(k => known.shareStep * doubt[k]), high: order.map(k => known.shareStep * doubt[4 + k]),
            shift: [8, 9].map(k => known.shiftStep * doubt[k])};
  }

  // A value of a field, or of one with twice the rows and columns, at a meridian and a latitude.
  function at(values, meridian, latitude) {
    const many = values.length === size ? columns : 2 * columns, width = 360 / many;
    const [x, y] = [turned(meridian, 360) / width, clamp(latitude / width, 0, many / 2)];
    const row = Math.min(Math.floor(y), many / 2 - 1), column = Math.floor(x) % many, next = (column + 1) % many;
    const [across, down] = [x - Math.floor(x), y - row];
    const of = k => (1 - across) * values[k * many + column] + across * values[k * many + next];
    return (1 - down) * of(row) + down * of(row + 1);
  }

  // A field with twice the rows and columns, as smooth as cubics make it.
  function doubled(values) {
    const many = 2 * columns, found = new Float32Array(many * (2 * rows - 1));
    for (let row = 0; row < rows; row++) {
      const of = column => values[row * columns + (column + columns) % columns];
      for (let column = 0; column < columns; column++) {
        found[2 * row * many + 2 * column] = of(column);
        found[2 * row * many + 2 * column + 1] = (9 * (of(column) + of(column + 1)) - of(column - 1) - of(column + 2)) / 16;
      }
    }
    // Beyond a pole the rows go on at the opposite meridian.
    const of = (row, column) => row < 0 ? found[-2 * row * many + (column + columns) % many]
      : row >= rows ? found[2 * (2 * (rows - 1) - row) * many + (column + columns) % many] : found[2 * row * many + column];
    for (let row = 0; row < rows - 1; row++) {
      for (let column = 0; column < many; column++) {
        found[(2 * row + 1) * many + column] = (9 * (of(row, column) + of(row + 1, column)) - of(row - 1, column)
          - of(row + 2, column)) / 16;
      }
    }
    return found;
  }

  // Share of a triangle in which a linear function is positive.
  function positive(a, b, c) {
    const low = Math.min(a, b, c), high = Math.max(a, b, c), middle = Math.max(Math.min(a, b), Math.min(Math.max(a, b), c));
    if (low > 0) return 1;
    if (high <= 0) return 0;
    if (middle <= 0) return high * high / ((high - low) * (high - middle));
    return 1 - low * low / ((high - low) * (middle - low));
  }

  function area([x, y, z], [bx, by, bz], [cx, cy, cz]) {
    const [ux, uy, uz, vx, vy, vz] = [bx - x, by - y, bz - z, cx - x, cy - y, cz - z];
    return 0.5 * Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx);
  }

  // Cells between circles of latitude, two triangles each: their sizes, once for an eye.
  function cells(eye, latitudes) {
    const points = latitudes.map(latitude => Array.from({length: columns}, (_, column) => {
      const far = at(eye.wall, step * column, latitude);
      return direction(step * column, latitude).map(part => part * far);
    })), found = [];
    for (let row = 1; row < latitudes.length; row++) {
      for (let column = 0; column < columns; column++) {
        const next = (column + 1) % columns, a = points[row - 1][column], c = points[row][next];
        found.push([area(a, points[row][column], c), area(a, c, points[row - 1][next])]);
      }
    }
    return found;
  }

  function bands(margin, latitudes, sizes) {
    const values = latitudes.map(latitude => Float64Array.from({length: columns}, (_, k) => at(margin, step * k, latitude)));
    return sizes.map((size, number) => {
      const row = Math.floor(number / columns), column = number % columns, next = (column + 1) % columns;
      const [a, b, c, d] = [values[row][column], values[row + 1][column], values[row + 1][next], values[row][next]];
      return size[0] * positive(a, b, c) + size[1] * positive(a, c, d);
    });
  }

  // Covered shares of the retina, its superior and inferior half, and the macula.
  function shares(eye, margin) {
    if (!eye.cells) {
      const whole = Array.from({length: last + 1}, (_, k) => k * step);
      const macula = [...whole.filter(one => one < eye.macula), eye.macula];
      eye.cells = [whole, macula].map(latitudes => [latitudes, cells(eye, latitudes)]);
    }
    const [[whole, sizes], [macula, around]] = eye.cells;
    const touched = bands(margin, whole, sizes), centered = bands(margin, macula, around);
    const upper = number => Math.cos((number % columns + 0.5) * step * radians) > 0;
    const share = (covered, all, chosen) => covered.reduce((sum, one, k) => sum + (chosen(k) ? one : 0), 0)
      / all.reduce((sum, one, k) => sum + (chosen(k) ? one[0] + one[1] : 0), 0);
    return [share(touched, sizes, () => true), share(touched, sizes, upper), share(touched, sizes, k => !upper(k)),
            share(centered, around, () => true)];
  }

  // Points on a break and its edge: [meridian, latitude].
  function pointsOf(tear) {
    const low = Math.max(tear.latitude - 0.5 * tear.height, 0), high = tear.latitude + 0.5 * tear.height, found = [];
    const half = Math.min(0.5 * tear.width * 30, 180);
    for (const [count, many] of [[1 + Math.ceil((high - low) / 2.5), 1 + Math.ceil(2 * half / 2.5)]]) {
      for (let k = 0; k < count; k++) for (let j = 0; j < many; j++) {
        found.push([tear.hour * 30 + half * (many > 1 ? 2 * j / (many - 1) - 1 : 0),
                    low + (high - low) * (count > 1 ? k / (count - 1) : 0)]);
      }
    }
    return found;
  }

  // How far the tamponade reaches beyond all points of a break, m; negative where it does not reach one.
  const beyond = (margin, points) => Math.min(...points.map(([meridian, latitude]) => at(margin, meridian, latitude)));

  // The smallest fill from which on the tamponade reaches beyond a break: the fill and what it may be, low and high.
  // Below the first fill it is 0, above the last 1; null where shapes were not found.
  function smallestFill(tables, toward, points, wanted) {
    const where = place(toward), reached = [];
    const corners = points.map(([meridian, latitude]) => {
      const y = clamp(latitude / step, 0, rows - 1), row = Math.min(Math.floor(y), rows - 2);
      return [row * half, y - row, ...columnsOf(meridian, where)];
    });
    for (let three = 0; three < fills.length; three++) {
      const nodes = mixed(tables, where, [[three, 1]]);
      if (!nodes) return null;
      let least = Infinity;
      for (const [row, down, first, second, across] of corners) {
        let sum = 0;
        for (const [{margin}, node, weight] of nodes) {
          const here = node * stored + row, below = here + half;
          sum += weight * ((1 - down) * ((1 - across) * margin[here + first] + across * margin[here + second])
            + down * ((1 - across) * margin[below + first] + across * margin[below + second]));
        }
        least = Math.min(least, toMargin(sum));
      }
      const shift = doubtOf(nodes).slice(8).map(one => one * known.shiftStep);
      reached.push([least, least + shift[1], least - shift[0]]);
    }
    return [0, 1, 2].map(which => {
      const margin = reached.map(one => one[which] - wanted);
      const bare = margin.findLastIndex(one => one <= 0);
      if (bare < 0) return 0;
      if (bare === fills.length - 1) return 1;
      const share = -margin[bare] / (margin[bare + 1] - margin[bare]);
      return Math.sin(spread[bare] + share * (spread[bare + 1] - spread[bare])) ** 2;
    });
  }

  return {eyeOf, eyeBetween, lookUp, at, doubled, pointsOf, beyond, smallestFill, rows, columns, step, lattice};
}

if (typeof module !== "undefined") module.exports = {explorerModel, gravity, direction, clamp, turned, radians};
