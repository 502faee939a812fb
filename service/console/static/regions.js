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
};
let still = null;
let base = "";
let mode = "polygon";
let shape = { polygon: [], lip: [], points: [], points_mm: [] };
let first = "";
let chosen = null;
let dragging = false;
let grid = [];
let waits = 0;

const size = () => [canvas.width, canvas.height];
const list = () => shape[mode];

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
  for (const [name, colour] of [["polygon", "#ffffff"], ["lip", "#ffd24d"], ["points", "#7fd0ff"]]) {
    shape[name].forEach(([x, y], i) => {
      const on = name === mode && i === chosen;
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
    });
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

function near([x, y]) {
  const [w, h] = size();
  const far = 14 * Math.max(1, w / 960);
  const index = list().findIndex(([a, b]) => Math.hypot((a - x) * w, (b - y) * h) < far);
  return index < 0 ? null : index;
}

function edge([x, y]) {
  const [w, h] = size();
  let best = [Infinity, 0];
  shape.polygon.forEach(([ax, ay], i) => {
    const [bx, by] = shape.polygon[(i + 1) % shape.polygon.length];
    const [dx, dy] = [(bx - ax) * w, (by - ay) * h];
    const t = Math.min(1, Math.max(0, ((x - ax) * w * dx + (y - ay) * h * dy) / (dx * dx + dy * dy || 1)));
    const away = Math.hypot((x - ax) * w - t * dx, (y - ay) * h - t * dy);
    if (away < best[0]) best = [away, i];
  });
  return best;
}

canvas.addEventListener("pointerdown", (event) => {
  const place = at(event);
  chosen = near(place);
  if (chosen === null) {
    if (mode === "polygon") {
      const [away, i] = edge(place);
      if (away < 12 * Math.max(1, canvas.width / 960)) { shape.polygon.splice(i + 1, 0, place); chosen = i + 1; }
    } else if (mode === "lip" && shape.lip.length < 2) chosen = shape.lip.push(place) - 1;
    else if (mode === "points" && shape.points.length < 64) { chosen = shape.points.push(place) - 1; shape.points_mm.push([0, 0]); table(); }
  }
  dragging = chosen !== null;
  if (dragging) canvas.setPointerCapture(event.pointerId);
  changed();
});
canvas.addEventListener("pointermove", (event) => { if (dragging) { list()[chosen] = at(event); changed(); } });
canvas.addEventListener("pointerup", () => { dragging = false; });
canvas.addEventListener("keydown", (event) => {
  const steps = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  if (event.altKey && event.key === "n") chosen = list().length ? ((chosen ?? -1) + 1) % list().length : null;
  else if (event.key === "Delete" && chosen !== null && (mode !== "polygon" || list().length > 3)) {
    list().splice(chosen, 1);
    if (mode === "points") shape.points_mm.splice(chosen, 1);
    chosen = null;
    table();
  } else if (steps[event.key] && chosen !== null) {
    const by = event.shiftKey ? 10 : 1;
    list()[chosen] = list()[chosen].map((value, axis) => Math.round(10000 * Math.min(1, Math.max(0, value + (by * steps[event.key][axis]) / size()[axis]))) / 10000);
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
  if (answer.status !== 200) return toast("No picture comes from this camera.", true);
  still = await createImageBitmap(await answer.blob());
  canvas.width = still.width;
  canvas.height = still.height;
  return draw();
}

async function load() {
  const told = await call(address);
  base = told.base;
  shape = { polygon: told.polygon, lip: told.calibration?.lip ?? [], points: told.calibration?.points ?? [], points_mm: told.calibration?.points_mm ?? [] };
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
