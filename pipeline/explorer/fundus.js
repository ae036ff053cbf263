// The map of the fundus, as pipeline/pictures/fundus_map.py draws it.
"use strict";

function fundusMap(canvas, model, known) {
  const pen = canvas.getContext("2d"), front = 135, css = color => `rgb(${color})`;
  let sizes = null;

  // A color as a pixel holds it: red first, in memory.
  const pixelOf = ([red, green, blue]) => (255 << 24 | blue << 16 | green << 8 | red) >>> 0;

  // Where the pixels are, once for a size of the canvas: two neighbors in a row of a field, and the shares of the second and
  // of the next row.
  function pixels(size) {
    if (sizes && sizes.size === size) return sizes;
    const small = size / (window.devicePixelRatio || 1) < 260, unit = size / 100;
    const scale = (0.5 * size - (small ? 8 : 6) * unit) / front, columns = model.columns;
    const inside = [], first = [], second = [], across = [], down = [], pale = [];
    for (let row = 0; row < size; row++) {
      for (let column = 0; column < size; column++) {
        const [right, up] = [column + 0.5 - 0.5 * size, 0.5 * size - row - 0.5], angle = Math.hypot(right, up) / scale;
        if (angle >= front) continue;
        const x = turned(Math.atan2(right, up) / radians, 360) / model.step, y = angle / model.step;
        const from = Math.floor(x) % columns, above = Math.floor(y);
        inside.push(row * size + column);
        first.push(above * columns + from);
        second.push(above * columns + (from + 1) % columns);
        across.push(x - Math.floor(x));
        down.push(y - above);
        pale.push(angle > known.ora ? 1 : 0);
      }
    }
    sizes = {size, small, unit, scale, inside: Uint32Array.from(inside), first: Uint16Array.from(first),
             second: Uint16Array.from(second), across: Float32Array.from(across), down: Float32Array.from(down),
             pale: Uint8Array.from(pale)};
    return sizes;
  }

  function place([meridian, latitude]) {
    const {size, scale} = sizes;
    return [0.5 * size + scale * latitude * Math.sin(meridian * radians),
            0.5 * size - scale * latitude * Math.cos(meridian * radians)];
  }

  function draw(eye, margin, shift, covered, tear, right) {
    const ratio = window.devicePixelRatio || 1, size = Math.min(Math.round(ratio * canvas.clientWidth), 900);
    if (!size) return;
    if (canvas.width !== size) canvas.width = canvas.height = size;
    const {small, unit, scale, inside, first, second, across, down, pale} = pixels(size), columns = model.columns;
    const image = pen.createImageData(size, size), painted = new Uint32Array(image.data.buffer);
    const side = new Int8Array(size * size), ink = pixelOf(known.colors.ink);
    const shades = Uint32Array.from([known.colors.aqueous, covered].flatMap(
      color => [color, color.map(part => part + 0.25 * (255 - part))]), pixelOf);
    for (let k = 0; k < inside.length; k++) {
      const a = first[k], b = second[k], share = across[k], pixel = inside[k];
      const above = margin[a] + share * (margin[b] - margin[a]);
      const value = above + down[k] * (margin[a + columns] + share * (margin[b + columns] - margin[a + columns]) - above);
      const hatched = value < shift[0] && value > -shift[1] && ((pixel % size + Math.floor(pixel / size)) / unit) % 2 < 1;
      side[pixel] = value > 0 ? 1 : -1;
      painted[pixel] = shades[((value > 0) !== hatched ? 2 : 0) + pale[k]];
    }
    const thick = Math.max(1, Math.round(0.35 * unit));
    for (let k = 0; k < inside.length; k++) {
      const pixel = inside[k];
      if (side[pixel] * side[pixel + 1] !== -1 && side[pixel] * side[pixel + size] !== -1) continue;
      for (let r = -thick + 1; r <= thick; r++) for (let c = -thick + 1; c <= thick; c++) {
        const one = pixel + r * size + c;
        if (side[one]) painted[one] = ink;
      }
    }
    pen.putImageData(image, 0, 0);
    chart(eye, unit, scale, small, right);
    if (tear) outline(tear, unit);
  }

  function chart(eye, unit, scale, small, right) {
    const text = getComputedStyle(canvas).color, ink = css(known.colors.ink), faint = css(known.colors.faint);
    const middle = 0.5 * sizes.size;
    function circle(angle, color, width, [x, y] = [middle, middle]) {
      pen.strokeStyle = color;
      pen.lineWidth = width;
      pen.beginPath();
      pen.arc(x, y, scale * angle, 0, 2 * Math.PI);
      pen.stroke();
    }
    function write(words, [x, y], height, color, halo, align = "center") {
      pen.font = `${height}px sans-serif`;
      pen.textAlign = align;
      pen.textBaseline = "middle";
      if (halo) {
        pen.lineWidth = 0.9 * unit;
        pen.lineJoin = "round";
        pen.strokeStyle = "#fff";
        pen.strokeText(words, x, y);
      }
      pen.fillStyle = color;
      pen.fillText(words, x, y);
    }
    for (let hour = 1; hour <= 12; hour++) {
      pen.strokeStyle = faint;
      pen.lineWidth = 0.3 * unit;
      pen.beginPath();
      pen.moveTo(...place([30 * hour, known.ora - 8]));
      pen.lineTo(...place([30 * hour, front]));
      pen.stroke();
      if (!small) write(hour, place([30 * hour, front + 3.2 * unit / scale]), 3.6 * unit, text);
      else if (hour % 3 === 0) write(hour, place([30 * hour, front + 4.2 * unit / scale]), 6.5 * unit, text);
    }
    circle(front, faint, 0.3 * unit);
    const disc = place([right ? 90 - eye.disc[1] : 270 + eye.disc[1], eye.disc[0]]);
    for (const angle of [known.ora, 90, eye.macula]) circle(angle, ink, 0.35 * unit);
    circle(eye.disc[2], ink, 0.35 * unit, disc);
    if (small) return;
    const [left, other] = right ? ["temporal", "nasal"] : ["nasal", "temporal"];
    for (const [word, x, align] of [[left, unit, "left"], [other, 99 * unit, "right"]]) {
      for (const [half, y] of [["superior", 3], ["inferior", 93.5]]) {
        write(half, [x, y * unit], 3 * unit, text, false, align);
        write(word, [x, (y + 3.6) * unit], 3 * unit, text, false, align);
      }
    }
    for (const [word, spot] of [["disc", [disc[0], disc[1] - 9 * scale]], ["macula", place([180, 20])],
                                ["equator", place([15, 82])], ["ora serrata", place([15, 107])]]) {
      write(word, spot, 3 * unit, ink, true);
    }
  }

  function outline(tear, unit) {
    const half = Math.min(15 * tear.width, 180), low = Math.max(tear.latitude - 0.5 * tear.height, 0);
    const high = tear.latitude + 0.5 * tear.height, middle = 30 * tear.hour, along = Array.from({length: 41}, (_, k) => k / 20 - 1);
    const points = [...along.map(k => [middle + half * k, low]), ...along.map(k => [middle - half * k, high])].map(place);
    for (const [color, width] of [["#fff", 1.6], [css(known.colors.tear), 0.9]]) {
      pen.strokeStyle = color;
      pen.lineWidth = width * unit;
      pen.lineJoin = "round";
      pen.beginPath();
      points.forEach((point, k) => k ? pen.lineTo(...point) : pen.moveTo(...point));
      pen.closePath();
      pen.stroke();
    }
  }

  // Clock hour and latitude under a pointer.
  function under(event) {
    const box = canvas.getBoundingClientRect(), scale = sizes.scale * box.width / sizes.size;
    const [right, up] = [event.clientX - box.left - 0.5 * box.width, 0.5 * box.height - (event.clientY - box.top)];
    return [turned(Math.atan2(right, up) / radians, 360) / 30, Math.hypot(right, up) / scale];
  }

  return {draw, under};
}
