// Draws region, lip and belt points on a still; the result is a change of the configuration file.
import { region } from "./common.js";
import { call, make, may, say, toast } from "./dom.js";

const main = document.getElementById("main");
const where = { camera: main.dataset.camera, roi: main.dataset.roi };
const address = `${region(where)}/region`;
const canvas = document.getElementById("stage");
const context = canvas.getContext("2d");
const HOW = {
  polygon: "Drag a corner; click on an edge for a new one; Delete removes it.",
  lip: "Drag the two ends of the line over which lumps fall; the first two clicks set them.",
  points: "Click on points of the belt whose places you know, four at least, and enter their millimetres.",
  entries: "Where targets start: click for a new zone, drag its corners, click on an edge for a new one; Delete removes a corner, and a zone with its third.",
  exits: "Where a target ends when it is missed once: click for a new zone, drag its corners; Delete removes a corner, and a zone with its third.",
};
const ZONES = ["entries", "exits"];
const ZONE = 0.06;
let still = null;
let base = "";
let mode = "polygon";
let shape = { polygon: [], lip: [], points: [], points_mm: [], entries: [], exits: [] };
let first = "";
let chosen = null; // [which of the mode's lists, which point]
let dragging = false;
let grid = [];
let waits = 0;

const size = () => [canvas.width, canvas.height];
// The lists of points of a mode: one, but for zones.
const lists = (name = mode) => (ZONES.includes(name) ? shape[name] : [shape[name]]);
const closed = (name = mode) => name === "polygon" || ZONES.includes(name);

function line(points, closed, colour, width, dash = []) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  points.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](x * canvas.width, y * canvas.height));
  if (closed) context.closePath();
  context.stroke();
  context.setLineDash([]);
}

function draw() {
  const scale = Math.max(1, canvas.width / 960);
  if (still) context.drawImage(still, 0, 0, canvas.width, canvas.height);
  for (const ends of grid) line(ends, false, "#7fd0ff", scale);
  line(shape.polygon, true, "#ffffff", 2.5 * scale);
  line(shape.lip, false, "#ffd24d", 3 * scale, [10 * scale, 6 * scale]);
  for (const zone of shape.entries) line(zone, true, "#8fe39a", 2 * scale, [4 * scale, 4 * scale]);
  for (const zone of shape.exits) line(zone, true, "#ff9d6b", 2 * scale, [4 * scale, 4 * scale]);
  for (const [name, colour] of [["polygon", "#ffffff"], ["lip", "#ffd24d"], ["points", "#7fd0ff"], ["entries", "#8fe39a"], ["exits", "#ff9d6b"]]) {
    lists(name).forEach((points, which) => points.forEach(([x, y], i) => {
      const on = name === mode && chosen?.[0] === which && chosen[1] === i;
      context.beginPath();
      context.arc(x * canvas.width, y * canvas.height, (name === mode ? 7 : 4) * scale, 0, 7);
      context.fillStyle = on ? "#ff4d5e" : colour;
      context.fill();
      context.strokeStyle = "#000";
      context.lineWidth = 1.5 * scale;
      context.stroke();
      if (name === "points") {
        context.font = `bold ${14 * scale}px sans-serif`;
        context.fillText(String(i + 1), x * canvas.width + 10 * scale, y * canvas.height - 8 * scale);
      }
    }));
  }
}

function table() {
  const rows = document.querySelector("#points tbody");
  document.getElementById("points").hidden = mode !== "points";
  rows.replaceChildren(...shape.points.map((_, i) => make("tr", {}, make("td", {}, String(i + 1)), ...[0, 1].map((axis) => {
    const input = make("input", { type: "number", step: "1", "aria-label": `point ${i + 1}, ${axis ? "along" : "across"}, mm` });
    input.value = shape.points_mm[i]?.[axis] ?? 0;
    input.addEventListener("input", () => { shape.points_mm[i][axis] = Number(input.value); changed(); });
    return make("td", {}, input);
  }))));
}

function change() {
  const given = { base, size: size(), polygon: shape.polygon };
  if (shape.lip.length === 2 && shape.points.length >= 4) Object.assign(given, { lip: shape.lip, points: shape.points, points_mm: shape.points_mm });
  // Zones are relative to the region: when it moves, they are written anew so that they stay where they are.
  const before = JSON.parse(first);
  const moved = JSON.stringify(before.polygon) !== JSON.stringify(shape.polygon);
  for (const name of ZONES) if ((moved && shape[name].length) || JSON.stringify(before[name]) !== JSON.stringify(shape[name])) given[name] = shape[name];
  return given;
}

function changed() {
  draw();
  clearTimeout(waits);
  waits = setTimeout(preview, 250);
}

async function preview() {
  const save = document.getElementById("save");
  const wrong = document.getElementById("wrong");
  if (JSON.stringify(shape) === first) {
    save.disabled = true;
    say(document.getElementById("diff"), "no change");
    say(wrong, "");
    return;
  }
  try {
    const told = await call(`${address}/preview`, "POST", change());
    say(wrong, "");
    show(told);
    save.disabled = told.diff.length === 0;
  } catch (error) {
    save.disabled = true;
    say(wrong, error.message);
  }
}

function show(told) {
  grid = told.fit?.grid ?? [];
  say(document.getElementById("fit"), told.fit ? `The belt fits within ${told.fit.missed_px} px; the camera sees ${told.fit.view_deg} degrees across.` : "");
  document.getElementById("diff").replaceChildren(...told.diff.slice(2).map((text) => make("span", { class: text[0] === "+" ? "in" : text[0] === "-" ? "out" : "same" }, text)));
  draw();
}

function at(event) {
  const box = canvas.getBoundingClientRect();
  const clip = (value) => Math.round(10000 * Math.min(1, Math.max(0, value))) / 10000;
  return [clip((event.clientX - box.left) / box.width), clip((event.clientY - box.top) / box.height)];
}

const every = () => lists().flatMap((points, which) => points.map((place, i) => [which, i, place]));

function near([x, y]) {
  const [w, h] = size();
  const far = 14 * Math.max(1, w / 960);
  const found = every().find(([, , [a, b]]) => Math.hypot((a - x) * w, (b - y) * h) < far);
  return found ? found.slice(0, 2) : null;
}

function edge([x, y]) {
  const [w, h] = size();
  let best = [Infinity, 0, 0];
  lists().forEach((points, which) => points.forEach(([ax, ay], i) => {
    const [bx, by] = points[(i + 1) % points.length];
    const [dx, dy] = [(bx - ax) * w, (by - ay) * h];
    const t = Math.min(1, Math.max(0, ((x - ax) * w * dx + (y - ay) * h * dy) / (dx * dx + dy * dy || 1)));
    const away = Math.hypot((x - ax) * w - t * dx, (y - ay) * h - t * dy);
    if (away < best[0]) best = [away, which, i];
  }));
  return best;
}

function begun([x, y]) {
  const clip = (value) => Math.round(10000 * Math.min(1, Math.max(0, value))) / 10000;
  const corners = [[-1, -1], [1, -1], [1, 1], [-1, 1]].map(([a, b]) => [clip(x + a * ZONE), clip(y + b * ZONE)]);
  return [shape[mode].push(corners) - 1, 2];
}

canvas.addEventListener("pointerdown", (event) => {
  const place = at(event);
  chosen = near(place);
  if (chosen === null) {
    const [away, which, i] = closed() ? edge(place) : [Infinity, 0, 0];
    if (away < 12 * Math.max(1, canvas.width / 960)) {
      lists()[which].splice(i + 1, 0, place);
      chosen = [which, i + 1];
    } else if (mode === "lip" && shape.lip.length < 2) chosen = [0, shape.lip.push(place) - 1];
    else if (mode === "points" && shape.points.length < 64) { chosen = [0, shape.points.push(place) - 1]; shape.points_mm.push([0, 0]); table(); }
    else if (ZONES.includes(mode) && shape[mode].length < 16) chosen = begun(place);
  }
  dragging = chosen !== null;
  if (dragging) canvas.setPointerCapture(event.pointerId);
  changed();
});
canvas.addEventListener("pointermove", (event) => { if (dragging) { lists()[chosen[0]][chosen[1]] = at(event); changed(); } });
canvas.addEventListener("pointerup", () => { dragging = false; });
canvas.addEventListener("keydown", (event) => {
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  if (event.altKey && event.key === "n") {
    const all = every();
    const now = all.findIndex(([which, i]) => chosen?.[0] === which && chosen[1] === i);
    chosen = all.length ? all[(now + 1) % all.length].slice(0, 2) : null;
  } else if (event.key === "Insert" && ZONES.includes(mode) && shape[mode].length < 16) chosen = begun([0.5, 0.5]);
  else if (event.key === "Delete" && chosen !== null && (mode !== "polygon" || shape.polygon.length > 3)) {
    const [which, i] = chosen;
    const points = lists()[which];
    points.splice(i, 1);
    if (mode === "points") shape.points_mm.splice(i, 1);
    if (ZONES.includes(mode) && points.length < 3) shape[mode].splice(which, 1);
    chosen = null;
    table();
  } else if (steps[event.key] && chosen !== null) {
    const by = event.shiftKey ? 10 : 1;
    const points = lists()[chosen[0]];
    points[chosen[1]] = points[chosen[1]].map((value, axis) => Math.round(10000 * Math.min(1, Math.max(0, value + (by * steps[event.key][axis]) / size()[axis]))) / 10000);
  } else return;
  event.preventDefault();
  event.stopPropagation();
  changed();
});

function choose(name) {
  mode = name;
  chosen = null;
  for (const button of document.querySelectorAll("[data-mode]")) button.setAttribute("aria-pressed", String(button.dataset.mode === name));
  say(document.getElementById("how"), HOW[name]);
  table();
  draw();
}

async function picture() {
  const answer = await fetch(`/api/v1/cameras/${encodeURIComponent(where.camera)}/picture`);
  if (answer.status !== 200) {
    if (!still) setTimeout(picture, 1000); // a camera that is being started anew comes in a while
    return toast("No picture comes from this camera.", true);
  }
  still = await createImageBitmap(await answer.blob());
  canvas.width = still.width;
  canvas.height = still.height;
  canvas.dataset.still = "";
  return draw();
}

async function load() {
  const told = await call(address);
  base = told.base;
  shape = { polygon: told.polygon, lip: told.calibration?.lip ?? [], points: told.calibration?.points ?? [], points_mm: told.calibration?.points_mm ?? [], entries: told.zones?.entries ?? [], exits: told.zones?.exits ?? [] };
  for (const name of ZONES) document.querySelector(`[data-mode=${name}]`).hidden = !told.zones;
  first = JSON.stringify(shape);
  grid = [];
  choose(mode);
  canvas.dataset.ready = "";
  preview();
}

document.getElementById("save").addEventListener("click", async () => {
  try {
    const told = await call(address, "POST", change());
    toast(`Written. The old file is ${told.kept}.`);
    await load();
  } catch (error) {
    say(document.getElementById("wrong"), error.message);
  }
});
document.getElementById("undo").addEventListener("click", load);
document.getElementById("fresh").addEventListener("click", picture);
for (const button of document.querySelectorAll("[data-mode]")) button.addEventListener("click", () => choose(button.dataset.mode));
if (!may("engineer")) document.getElementById("save").hidden = true;
await picture();
await load();
