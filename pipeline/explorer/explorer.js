// The page: what is set, in controls and in the link, and what is shown of it.
"use strict";

const percent = share => `${Math.round(100 * share)}`;
const span = (low, high) => percent(low) === percent(high) ? "" : ` (${percent(low)} to ${percent(high)})`;
const degrees = value => `${Math.round(value)}°`;

// What a link may hold: a name, words for a message, and how a text is read; a range of numbers, or names.
function settingsOf(known) {
  const fills = known.fills.map(fill => 100 * fill);
  const number = (name, words, low, high, unit) => ({name, words, low, high, unit});
  return {
    numbers: [number("fill", "fill", fills[0], fills[fills.length - 1], " %"),
              number("eye", "length of the eye", Number(known.eyes[0].name), Number(known.eyes[known.eyes.length - 1].name), " mm"),
              number("pitch", "raise of the face", -90, 90, "°"), number("roll", "tilt to a shoulder", -180, 180, "°")],
    tear: [number("hour", "clock hour of the break", 0.25, 12, " o'clock"),
           number("latitude", "place of the break", 0, known.ora, "° from the posterior pole"),
           number("width", "width of the break", 0.25, 12, " clock hours"),
           number("height", "height of the break", 2, 60, "°")],
    choices: [{name: "tamponade", words: "tamponade", names: known.tamponades},
              {name: "side", words: "side", names: {right: {words: "right eye"}, left: {words: "left eye"}}}],
  };
}

// The setting of a link, and a sentence for everything in it that is not here.
function readLink(text, start, known) {
  const {numbers, tear, choices} = settingsOf(known), found = {...start, tear: start.tear && {...start.tear}}, said = [];
  const of = (value, {words, low, high, unit}, standing) => {
    const read = value.trim() === "" ? NaN : Number(value);
    if (!Number.isFinite(read)) {
      said.push(`The link gives "${value}" for the ${words}, which is not a number: ${standing}${unit} is shown.`);
      return standing;
    }
    const shown = clamp(read, low, high);
    if (shown !== read) {
      said.push(`The link asks for ${read}${unit} as the ${words}, but it must be ${low} to ${high}: ${shown}${unit} is shown.`);
    }
    return shown;
  };
  for (const part of text.replace(/^#/, "").split("&").filter(Boolean)) {
    const [name, ...rest] = part.split("=");
    let value = rest.join("=");
    try { value = decodeURIComponent(value); } catch { /* as it is */ }
    value = value.slice(0, 60);
    const choice = choices.find(one => one.name === name), range = numbers.find(one => one.name === name);
    if (choice && Object.hasOwn(choice.names, value)) {
      found[name] = value;
    } else if (choice) {
      said.push(`The link names "${value}" as ${choice.words}, which is not here: ${choice.names[found[name]].words} is shown. `
        + `Possible: ${Object.keys(choice.names).join(", ")}.`);
    } else if (range) {
      found[name] = of(value, range, found[name]);
    } else if (name === "break" && value === "none") {
      found.tear = null;
    } else if (name === "break") {
      const parts = value.split(","), standing = found.tear || known.start.tear;
      if (parts.length !== 4) {
        said.push(`The link gives "${value}" for the break, which is not hour, latitude, width and height: `
          + "the break that is drawn is shown.");
        found.tear = {...standing};
      } else {
        found.tear = Object.fromEntries(tear.map((one, k) => [one.name, of(parts[k], one, standing[one.name])]));
      }
    } else {
      said.push(`The link sets "${name.slice(0, 60)}", which this page does not know: it is left out.`);
    }
  }
  const missing = withoutTable(found, known);
  if (missing) {
    said.push(missing.said);
    found.eye = missing.eye;
  }
  if (found.tear && within(found.tear, known) !== found.tear.latitude) {
    said.push("The break of the link reaches beyond the ora serrata: it is shown farther back.");
    found.tear.latitude = within(found.tear, known);
  }
  return {found, said};
}

// Where there are no tables of a tamponade around an eye: what is said, and the length of an eye that has some.
function withoutTable(set, known) {
  const lengths = known.eyes.filter(one => one.tables[set.tamponade]).map(one => Number(one.name));
  const {words} = known.tamponades[set.tamponade];
  if (!lengths.length) return {eye: set.eye, said: `There is no table of ${words}.`};
  const [low, high] = [lengths[0], lengths[lengths.length - 1]], eye = clamp(set.eye, low, high);
  if (eye === set.eye) return null;
  const some = low === high ? `an eye of ${low} mm` : `eyes of ${low} to ${high} mm`;
  return {eye, said: `There are tables of ${words} for ${some} only: an eye of ${eye} mm is shown.`};
}

// The latitude of a break that ends at the ora serrata at the latest.
const within = (tear, known) => Math.min(tear.latitude, known.ora - 0.5 * tear.height);

function linkOf(set) {
  const round = value => +value.toFixed(2), {tear} = set;
  return `#fill=${round(set.fill)}&tamponade=${set.tamponade}&eye=${round(set.eye)}&side=${set.side}&pitch=${round(set.pitch)}`
    + `&roll=${round(set.roll)}&break=${tear ? [tear.hour, tear.latitude, tear.width, tear.height].map(round).join(",") : "none"}`;
}

// A posture in words: that of a button if it is near, else how the face and the ears lie.
function postureWords(set, known) {
  const down = gravity(set.pitch, set.roll);
  const along = one => gravity(one.pitch, one.roll).reduce((sum, part, k) => sum + part * down[k], 0);
  const near = known.postures.find(one => along(one) > Math.cos(3 * radians));
  if (near) return near.words;
  const words = [];
  if (Math.abs(set.pitch) >= 3) words.push(`face ${set.pitch > 0 ? "up" : "down"} ${degrees(Math.abs(set.pitch))}`);
  if (Math.abs(set.roll) >= 3 && Math.abs(set.pitch) < 87) {
    words.push(Math.abs(set.roll) > 177 ? "upside down" : `${set.roll > 0 ? "right" : "left"} ear down ${degrees(Math.abs(set.roll))}`);
  }
  return words.join(", ") || "upright";
}

function clockWords(hour) {
  const minutes = Math.round(60 * hour) % 60, whole = Math.floor(hour + 1e-6) % 12 || 12;
  return minutes ? `${whole}:${String(minutes).padStart(2, "0")}` : `${whole} o'clock`;
}

function tearWords(tear, right) {
  const x = Math.sin(tear.hour * 30 * radians), y = Math.cos(tear.hour * 30 * radians);
  const row = y > 0.3 ? "superior" : y < -0.3 ? "inferior" : "";
  const column = Math.abs(x) > 0.3 ? ((x > 0) === right ? "nasal" : "temporal") : "";
  return `${clockWords(tear.hour)}${row || column ? `, ${[row, column].filter(Boolean).join(" ")}` : ""}`;
}

function fillWords(fill, known) {
  if (fill <= known.fills[0]) return `${percent(known.fills[0])} % or less`;
  const last = known.fills[known.fills.length - 1];
  return fill >= last ? `more than ${100 * last} %` : `${Math.round(100 * fill)} %`;
}

// The smallest fill in words, with what it may be.
function neededWords(needed, known) {
  if (!needed) return "not known";
  const [fill, low, high] = [needed[0], Math.max(needed[1] - known.fillError, 0), Math.min(needed[2] + known.fillError, 1)];
  const words = fillWords(fill, known), first = fillWords(low, known), last = fillWords(high, known);
  if (first === last) return words;
  return first === words ? `${words} (up to ${last.replace("more than", "above")})`
    : `${words} (${first.replace(/ %$/, "")} to ${last.replace("more than", "above")})`;
}

async function showExplorer(known) {
  const root = document.querySelector(".explorer"), find = selector => root.querySelector(selector);
  const message = find(".message");
  if (typeof DecompressionStream === "undefined") {
    message.textContent = "This browser is too old for this page. Firefox 113, Chrome 80, Safari 16.4 and later show it.";
    message.hidden = false;
    return;
  }
  const model = explorerModel(known), eyes = await Promise.all(known.eyes.map(model.eyeOf)), between = {};
  const eyeOf = length => between[length] = between[length] || model.eyeBetween(eyes, length);
  let said = [], waiting = false, {found: set} = readLink("", known.start, known);
  const map = fundusMap(find(".fundus canvas"), model, known), surfaces = {};
  const color = name => known.tamponades[name].color;

  // Views of the eye and of the head, which are seen from the same side.
  const empty = wall => ({...packedMesh([], []), ...plain([0, 0, 0]), wall});
  let view = known.view;
  const head = showTurningView(find(".head"), {meshes: [headSurface()], axes: [], views: [], view,
    without: known.without,
    onDrag(sideways, upward) {
      const [ca, sa] = [Math.cos(view[0]), Math.sin(view[0])];
      const pitch = clamp(set.pitch + (sa * sideways - ca * upward) / radians, -90, 90);
      change({pitch, roll: turned(set.roll - (ca * sideways + sa * upward) / radians + 180, 360) - 180});
    }});
  const shape = showTurningView(find(".shape"), {meshes: [empty(false), empty(true), empty(false)], axes: known.axes, views: known.views,
    without: known.without, view, onView(next) { view = next; if (head) head.look(next); }});

  function change(changes) {
    set = {...set, ...changes};
    const missing = withoutTable(set, known);
    said = missing ? [missing.said] : [];
    if (missing) set.eye = missing.eye;
    find(".copied").textContent = "";
    redraw();
  }
  function redraw() {
    if (!waiting) requestAnimationFrame(update);
    waiting = true;
  }

  function update() {
    waiting = false;
    const eye = eyeOf(set.eye), tables = eye.tablesOf(set.tamponade), kind = known.tamponades[set.tamponade];
    const down = gravity(set.pitch, set.roll), toward = down.map(part => kind.floats ? -part : part);
    const fill = set.fill / 100, looked = tables && model.lookUp(eye, tables, toward, fill), {tear} = set;
    message.hidden = !said.length;
    message.replaceChildren(...said.map(sentence => element("p", sentence)));
    writeControls();
    const posture = postureWords(set, known);
    if (!looked) {
      find(".answer").textContent = tables
        ? `No shape at rest was found for ${kind.words}, ${set.fill} %, ${posture}. Try another fill or posture.`
        : `There is no table of ${kind.words}. Try something else.`;
      root.classList.add("without");
      return;
    }
    root.classList.remove("without");
    find(".answer").textContent = `${kind.words[0].toUpperCase()}${kind.words.slice(1)}, ${+set.fill.toFixed(1)} %, ${posture}: `
      + `${percent(looked.shares[0])} % of the retina touched`;
    // Less of one half and more of the other: that is no other contact angle, but another shape.
    const {low: less, high: more} = looked;
    find(".several").hidden = Math.max(Math.min(less[1], more[2]), Math.min(more[1], less[2])) < known.other;
    looked.shares.forEach((share, k) => {
      const row = find(".shares").children[k], error = known.shareErrors[k];
      const [low, high] = [Math.max(share - looked.low[k] - error, 0), Math.min(share + looked.high[k] + error, 1)];
      row.querySelector("b").textContent = `${percent(share)} %`;
      row.querySelector("small").textContent = span(low, high);
      row.querySelector(".bar i").style.width = `${100 * share}%`;
      Object.assign(row.querySelector(".bar u").style, {left: `${100 * low}%`, width: `${100 * (high - low)}%`});
    });
    const doubt = looked.shift.map(one => one + known.lineError);
    map.draw(eye, looked.margin, doubt, color(set.tamponade), tear, set.side === "right");
    if (shape) {
      const made = surfaces[set.eye] = surfaces[set.eye] || eyeSurfaces(model, eye);
      shape.orient(turnOf(set));
      head.orient(turnOf(set));
      shape.replace(0, made.tamponade(looked.depth(), looked.meridian, color(set.tamponade).map(
        (part, k) => 0.7 * part + 0.3 * known.colors.aqueous[k])));
      shape.replace(1, made.wall(looked.margin, color(set.tamponade), known.colors.aqueous));
      shape.replace(2, made.tear(tear, known.colors.tear));
    }
    showTear(tables, kind, looked, toward, doubt);
    writeLink();
  }

  // Rows of the turn of the head: first the right ear is lowered, then the face is raised.
  function turnOf({pitch, roll}) {
    const [cp, sp] = [Math.cos(pitch * radians), Math.sin(pitch * radians)];
    const [cr, sr] = [Math.cos(roll * radians), Math.sin(roll * radians)];
    return [[cr, -sr, 0], [cp * sr, cp * cr, sp], [-sp * sr, -sp * cr, cp]];
  }

  function showTear(tables, kind, looked, toward, doubt) {
    const {tear} = set, verdict = find(".verdict"), body = find(".needed tbody");
    find(".with-break").hidden = !tear;
    find(".without-break").hidden = Boolean(tear);
    verdict.className = "verdict";
    if (!tear) {
      find(".answer").append(".");
      return;
    }
    const points = model.pointsOf(tear), margin = model.beyond(looked.margin, points), mm = value => (1e3 * value).toFixed(1);
    const [low, high] = [margin - doubt[0], margin + doubt[1]], far = 1e3 * known.reach, where = tearWords(tear, set.side === "right");
    const sure = low > 0 || high < 0, covered = margin > 0;
    const said = sure ? covered ? "covered" : "not covered" : "borderline", unsure = sure ? "" : ", within what is uncertain";
    find(".answer").append(`; the break is ${said}.`);
    verdict.classList.add(sure ? (covered ? "yes" : "no") : "maybe");
    const reach = Math.abs(margin) > 0.98 * known.reach ? `more than ${far - 0.5} mm`
      : `${mm(Math.abs(margin))} mm`;
    verdict.replaceChildren(
      element("b", said[0].toUpperCase() + said.slice(1)),
      element("span", covered ? `The ${kind.words} reaches ${reach} beyond the break at ${where}${unsure}.`
        : `The ${kind.words} ends ${reach} short of the farthest edge of the break at ${where}${unsure}.`));
    const needed = model.smallestFill(tables, toward, points, known.wanted);
    find(".smallest").replaceChildren("Smallest fill that covers it in this posture: ", element("b", neededWords(needed, known)),
      needed && needed[0] > known.largestFill ? `. More than ${percent(known.largestFill)} % is hardly got in.` : ".");
    const asked = JSON.stringify([tear, set.tamponade, set.eye]);
    if (body.dataset.of === asked) return;
    body.dataset.of = asked;
    const rows = known.postures.map(one => {
      const down = gravity(one.pitch, one.roll);
      return [one, model.smallestFill(tables, down.map(part => kind.floats ? -part : part), points, known.wanted)];
    });
    const least = Math.min(...rows.map(([, found]) => found ? found[0] : 2));
    body.replaceChildren(...rows.map(([one, found]) => {
      const row = document.createElement("tr"), button = element("button", one.words), cell = document.createElement("td");
      button.type = "button";
      button.addEventListener("click", () => change({pitch: one.pitch, roll: one.roll}));
      cell.append(button);
      row.append(cell, element("td", neededWords(found, known)));
      if (found && found[0] <= least + 0.005 && found[0] <= known.largestFill) row.className = "best";
      return row;
    }));
  }

  function element(tag, text) {
    const made = document.createElement(tag);
    made.textContent = text;
    return made;
  }

  // Controls: every slider has the name of what it sets, and its number beside it.
  const sliders = [...root.querySelectorAll("input[type=range]")];
  const words = {
    fill: () => `${+set.fill.toFixed(1)} % = ${(set.fill / 100 * eyeOf(set.eye).volume).toFixed(1)} mL, with ${
      ((1 - set.fill / 100) * eyeOf(set.eye).volume).toFixed(1)} mL of aqueous`,
    eye: () => `${set.eye} mm, ${eyeOf(set.eye).volume.toFixed(1)} mL`,
    pitch: () => Math.abs(set.pitch) < 0.5 ? "straight ahead" : `face ${set.pitch > 0 ? "up" : "down"} ${degrees(Math.abs(set.pitch))}`,
    roll: () => Math.abs(set.roll) < 0.5 ? "none" : `${set.roll > 0 ? "right" : "left"} ear down ${degrees(Math.abs(set.roll))}`,
    hour: () => tearWords(set.tear, set.side === "right"),
    latitude: () => `${degrees(set.tear.latitude)} from the macula`,
    width: () => `${+set.tear.width.toFixed(2)} clock hour${set.tear.width === 1 ? "" : "s"}, ${
      (set.tear.width * 30 * radians * Math.sin(set.tear.latitude * radians)
      * 1e3 * eyeOf(set.eye).globe).toFixed(1)} mm`,
    height: () => `${degrees(set.tear.height)}, ${(set.tear.height * radians * 1e3 * eyeOf(set.eye).globe).toFixed(1)} mm`,
  };
  function moveTear(changes) {
    const tear = {...(set.tear || known.start.tear), ...changes};
    tear.hour = turned(tear.hour - 0.01, 12) + 0.01;
    tear.latitude = Math.max(within(tear, known), 0);
    change({tear});
  }
  for (const slider of sliders) {
    slider.addEventListener("input", () => {
      const value = {[slider.name]: Number(slider.value)};
      if (slider.closest(".of-break")) moveTear(value); else change(value);
    });
  }
  function writeControls() {
    for (const slider of sliders) {
      const values = slider.closest(".of-break") ? set.tear : set;
      if (!values) continue;
      slider.value = values[slider.name];
      const told = words[slider.name]();
      slider.closest("label").querySelector("output").textContent = told;
      slider.setAttribute("aria-valuetext", told);
    }
    for (const choice of root.querySelectorAll("input[type=radio]")) choice.checked = set[choice.name] === choice.value;
    find("input[name=break]").checked = Boolean(set.tear);
    find(".of-break").hidden = !set.tear;
    const now = postureWords(set, known);
    for (const button of root.querySelectorAll(".postures button")) {
      button.setAttribute("aria-pressed", String(button.textContent === now));
    }
    find(".now").textContent = now;
    root.style.setProperty("--tamponade", `rgb(${color(set.tamponade)})`);
    find(".key .kind").textContent = known.tamponades[set.tamponade].words;
  }
  for (const choice of root.querySelectorAll("input[type=radio]")) {
    choice.addEventListener("change", () => change({[choice.name]: choice.value}));
  }
  find("input[name=break]").addEventListener("change", event => change({tear: event.target.checked ? {...known.start.tear} : null}));
  known.postures.forEach(one => {
    const button = element("button", one.words);
    button.type = "button";
    button.addEventListener("click", () => change({pitch: one.pitch, roll: one.roll}));
    find(".postures").append(button);
  });

  // The break is moved on the map, by a pointer or by the arrow keys.
  const chart = find(".fundus canvas");
  let held = null;
  function moveTo(event) {
    const [hour, latitude] = map.under(event);
    moveTear({hour: Math.round(4 * hour) / 4 || 12, latitude: Math.round(Math.min(latitude, known.ora))});
  }
  chart.addEventListener("pointerdown", event => {
    held = event.pointerId;
    chart.setPointerCapture(held);
    moveTo(event);
  });
  chart.addEventListener("pointermove", event => { if (event.pointerId === held) moveTo(event); });
  for (const end of ["pointerup", "pointercancel"]) chart.addEventListener(end, () => { held = null; });
  chart.addEventListener("keydown", event => {
    const {hour, latitude} = set.tear || known.start.tear;
    const ways = {ArrowLeft: {hour: hour - 0.25}, ArrowRight: {hour: hour + 0.25},
                  ArrowUp: {latitude: latitude + 5}, ArrowDown: {latitude: latitude - 5}};
    if (!ways[event.key]) return;
    event.preventDefault();
    moveTear(ways[event.key]);
  });

  // The link.
  let writing = null;
  function writeLink() {
    clearTimeout(writing);
    writing = setTimeout(() => {
      try { history.replaceState(null, "", linkOf(set)); } catch { /* some viewers of files forbid it */ }
    }, 200);
  }
  function readHash() {
    const read = readLink(location.hash, known.start, known);
    set = read.found;
    said = read.said;
    redraw();
  }
  window.addEventListener("hashchange", readHash);
  find(".copy").addEventListener("click", async () => {
    const link = location.href.split("#")[0] + linkOf(set), told = find(".copied");
    try {
      await navigator.clipboard.writeText(link);
      told.textContent = "The link is copied.";
    } catch {
      told.textContent = link;
    }
  });
  new ResizeObserver(redraw).observe(chart);
  root.classList.add("ready");
  readHash();
}

if (typeof module !== "undefined") {
  Object.assign(globalThis, require("./model.js"));
  module.exports = {readLink, linkOf, withoutTable, postureWords, neededWords, fillWords};
}
