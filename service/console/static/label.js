// Boxes of lumps on the frames of a clip, by mouse and keyboard; every change is saved by itself.
import { boxAt, ghost, isKey, neighbour, newId, span, withKey, withoutKey } from "./boxes.js";
import { selection } from "./common.js";
import { call, make, say } from "./dom.js";
import { Frames } from "./frames.js";
import { Saver } from "./saver.js";

const byId = (id) => document.getElementById(id);
const main = byId("main");
const { clip, camera } = main.dataset;
const size = [Number(main.dataset.width), Number(main.dataset.height)];
const [count, fps] = [Number(main.dataset.frames), Number(main.dataset.fps)];
const address = `/api/v1/clips/${clip}`;
const canvas = byId("stage");
const context = canvas.getContext("2d");
const lanes = byId("lanes");
const scale = Math.max(1, size[0] / 960);
const GRIP = 12 * scale;
const PATIENCE_MS = 1000;

let labels = { tracks: [], proposals: [], empty: false };
let frame = 1;
let chosen = null; // { kind: "tracks" | "proposals", id }
let drag = null;
let playing = 0;
const past = [];
const frames = new Frames(address, count, () => draw());
const saver = new Saver(`${address}/labels`, byId("saved"), byId("wrong"));

const found = () => (chosen ? labels[chosen.kind].find((track) => track.id === chosen.id) ?? null : null);
const all = () => [...labels.tracks.map((track) => ["tracks", track]), ...labels.proposals.map((track) => ["proposals", track])];
// The box of what is chosen in this frame; of a lump that has none here the place where it is likely to be.
const here = () => {
  const track = found();
  return track ? boxAt(track, frame) ?? (chosen.kind === "tracks" ? ghost(track, frame, size) : null) : null;
};

function change(next, keep = true) {
  if (keep) past.push(labels);
  if (past.length > 100) past.shift();
  labels = next;
  byId("undo").disabled = past.length === 0;
  saver.save(labels);
  show();
}

function put(kind, track) {
  const others = labels[kind].filter((one) => one.id !== track.id);
  change({ ...labels, empty: false, [kind]: [...others, track].sort((a, b) => a.id - b.id) });
}

function add(box) {
  const track = withKey({ id: newId([...labels.tracks, ...labels.proposals]), keys: [], ignored: [], existence: null }, frame, box, size);
  chosen = { kind: "tracks", id: track.id };
  put("tracks", track);
}

function place(box) {
  const track = found();
  if (track) put(chosen.kind, withKey(track, frame, box, size));
}

function drop(kind, id) {
  if (chosen?.kind === kind && chosen.id === id) chosen = null;
  change({ ...labels, [kind]: labels[kind].filter((track) => track.id !== id) });
}

function judge(accepted) {
  const track = chosen?.kind === "proposals" ? found() : null;
  if (!track) return false;
  const rest = labels.proposals.filter((one) => one !== track);
  const tracks = accepted ? [...labels.tracks, track].sort((a, b) => a.id - b.id) : labels.tracks;
  const next = rest[0];
  chosen = next ? { kind: "proposals", id: next.id } : null;
  change({ ...labels, proposals: rest, tracks, empty: accepted ? false : labels.empty });
  if (next) look(middle(next));
  return true;
}

const middle = (track) => Math.round((span(track)[0] + span(track)[1]) / 2);

function look(number) {
  frame = Math.min(count, Math.max(1, number));
  byId("frame").value = frame;
  say(byId("number"), String(frame));
  say(byId("time"), ((frame - 1) / fps).toFixed(2));
  frames.want(frame);
  show();
}

function choose(kind, id) {
  chosen = { kind, id };
  const track = found();
  if (track && !boxAt(track, frame)) look(kind === "proposals" ? middle(track) : span(track)[0]);
  else show();
}

function draw() {
  const picture = frames.get(frame);
  if (picture) context.drawImage(picture, 0, 0, ...size);
  canvas.dataset.frame = picture ? String(frame) : "";
  context.font = `bold ${Math.round(15 * scale)}px sans-serif`;
  for (const [kind, track] of all()) {
    const mine = chosen?.kind === kind && chosen.id === track.id;
    const there = boxAt(track, frame);
    const box = mine ? (!drag?.fresh && drag?.box) || here() : there;
    if (!box) continue;
    context.globalAlpha = there || drag ? 1 : 0.6;
    context.strokeStyle = kind === "proposals" ? "#ffd24d" : mine ? "#ffffff" : "#7fd0ff";
    context.lineWidth = (mine ? 3 : 2) * scale;
    context.setLineDash(kind === "proposals" ? [8 * scale, 5 * scale] : isKey(track, frame) ? [] : [2 * scale, 3 * scale]);
    context.strokeRect(box.x, box.y, box.w, box.h);
    context.setLineDash([]);
    context.fillStyle = context.strokeStyle;
    context.fillText(kind === "proposals" ? `${track.id}?` : String(track.id), box.x + 3 * scale, box.y - 5 * scale);
    if (mine) for (const [x, y] of corners(box)) context.fillRect(x - GRIP / 4, y - GRIP / 4, GRIP / 2, GRIP / 2);
    context.globalAlpha = 1;
  }
  if (drag?.fresh && drag.box) {
    context.strokeStyle = "#ffffff";
    context.lineWidth = 2 * scale;
    context.strokeRect(drag.box.x, drag.box.y, drag.box.w, drag.box.h);
  }
}

const corners = (box) => [[box.x, box.y], [box.x + box.w, box.y], [box.x + box.w, box.y + box.h], [box.x, box.y + box.h]];

function drawLanes() {
  const pen = lanes.getContext("2d");
  const rows = all();
  const height = Math.max(14, Math.min(24, 240 / Math.max(1, rows.length)));
  lanes.height = Math.max(30, rows.length * height);
  const x = (number) => ((number - 1) / Math.max(1, count - 1)) * (lanes.width - 4) + 2;
  rows.forEach(([kind, track], row) => {
    const [first, last] = span(track);
    const mine = chosen?.kind === kind && chosen.id === track.id;
    pen.fillStyle = kind === "proposals" ? "#b08600" : mine ? "#1c4f82" : "#7d8790";
    pen.fillRect(x(first), row * height + 3, Math.max(2, x(last) - x(first)), height - 6);
    pen.fillStyle = "#1c2126";
    for (const key of track.keys) pen.fillRect(x(key.frame) - 1, row * height + 1, 2, height - 2);
  });
  pen.fillStyle = "#8a0014";
  pen.fillRect(x(frame) - 1, 0, 2, lanes.height);
}

function row([kind, track]) {
  const [first, last] = span(track);
  const name = kind === "proposals" ? `${track.id}? ${(track.existence ?? 0).toFixed(2)}` : `lump ${track.id}`;
  return make("tr", { "aria-selected": String(chosen?.kind === kind && chosen.id === track.id), "data-kind": kind, "data-id": track.id },
    make("td", {}, name), make("td", {}, `${first} to ${last}`), make("td", { class: "number" }, String(track.keys.length)),
    make("td", { class: "actions" }, make("button", { type: "button", "aria-label": `Show ${name}`, onclick: () => choose(kind, track.id) }, "Show"),
      kind === "tracks" ? make("button", { type: "button", "aria-label": `Remove ${name}`, onclick: () => drop(kind, track.id) }, "Remove") : null));
}

function show() {
  draw();
  drawLanes();
  const focused = document.activeElement?.getAttribute("aria-label");
  byId("lumps").tBodies[0].replaceChildren(...all().map(row));
  if (focused && document.activeElement === document.body) document.querySelector(`#lumps [aria-label="${focused}"]`)?.focus();
  say(byId("proposed"), labels.proposals.length ? `${labels.proposals.length} to judge` : "none to judge");
  const proposal = chosen?.kind === "proposals";
  byId("accept").disabled = byId("refuse").disabled = !proposal;
  byId("empty").checked = labels.empty;
  byId("empty").disabled = labels.tracks.length > 0;
  const box = here();
  byId("box").disabled = !box;
  for (const input of byId("box").querySelectorAll("input")) if (input !== document.activeElement) input.value = box ? Math.round(10 * box[input.name]) / 10 : "";
}

function at(event) {
  const shown = canvas.getBoundingClientRect();
  return [((event.clientX - shown.left) / shown.width) * size[0], ((event.clientY - shown.top) / shown.height) * size[1]];
}

const within = (box, [x, y]) => x >= box.x && x <= box.x + box.w && y >= box.y && y <= box.y + box.h;

canvas.addEventListener("pointerdown", (event) => {
  canvas.focus();
  const spot = at(event);
  const box = here();
  const corner = box ? corners(box).findIndex(([x, y]) => Math.hypot(x - spot[0], y - spot[1]) < GRIP) : -1;
  if (corner >= 0) drag = { corner, box, spot, from: box };
  else {
    const hit = box && within(box, spot) ? [chosen.kind, found()] : all().find(([, track]) => { const one = boxAt(track, frame); return one && within(one, spot); });
    if (hit) {
      chosen = { kind: hit[0], id: hit[1].id };
      const start = here();
      drag = { corner: -1, box: start, spot, from: start };
    } else drag = { fresh: true, spot, box: null };
  }
  canvas.setPointerCapture(event.pointerId);
  show();
});
canvas.addEventListener("pointermove", (event) => {
  if (!drag) return;
  const [x, y] = at(event);
  const [dx, dy] = [x - drag.spot[0], y - drag.spot[1]];
  if (drag.fresh) drag.box = { x: Math.min(x, drag.spot[0]), y: Math.min(y, drag.spot[1]), w: Math.abs(dx), h: Math.abs(dy) };
  else if (drag.corner < 0) drag.box = { ...drag.from, x: drag.from.x + dx, y: drag.from.y + dy };
  else {
    const [ax, ay] = corners(drag.from)[(drag.corner + 2) % 4];
    drag.box = { x: Math.min(x, ax), y: Math.min(y, ay), w: Math.abs(x - ax), h: Math.abs(y - ay) };
  }
  drag.moved = drag.moved || Math.hypot(dx, dy) > 2;
  draw();
});
canvas.addEventListener("pointerup", () => {
  const done = drag;
  drag = null;
  if (!done?.moved || !done.box || done.box.w < 3 || done.box.h < 3) return show();
  return done.fresh ? add(done.box) : place(done.box);
});
canvas.addEventListener("pointercancel", () => { drag = null; show(); });

function step(by) {
  const order = all();
  if (!order.length) return;
  const now = order.findIndex(([kind, track]) => chosen?.kind === kind && chosen.id === track.id);
  const [kind, track] = order[(now + by + order.length) % order.length];
  choose(kind, track.id);
}

function jump(by) {
  const track = found();
  const to = track ? neighbour(track, frame, by) : undefined;
  if (to !== undefined) look(to);
}

function undo() {
  if (!past.length) return;
  change(past.pop(), false);
}

const ARROWS = { ArrowLeft: [-2, 0], ArrowRight: [2, 0], ArrowUp: [0, -2], ArrowDown: [0, 2] };
Object.assign(selection.keys, {
  " ": (event) => (event.target.closest("button, a, input") ? false : play()),
  b: () => add({ x: size[0] * 0.45, y: size[1] * 0.45, w: size[0] * 0.1, h: size[1] * 0.1 }),
  k: () => { const box = here(); if (box) place(box); },
  Escape: () => { chosen = null; show(); },
  y: () => judge(true), x: () => judge(false), z: undo,
  ",": () => step(-1), ".": () => step(1), "[": () => jump(-1), "]": () => jump(1),
  PageUp: () => look(frame - 10), PageDown: () => look(frame + 10), Home: () => look(1), End: () => look(count),
  Delete: (event) => {
    const track = found();
    if (!track) return;
    const rest = event.shiftKey || !isKey(track, frame) ? null : withoutKey(track, frame);
    if (rest) put(chosen.kind, rest);
    else if (event.shiftKey || isKey(track, frame)) drop(chosen.kind, track.id);
  },
});
document.addEventListener("keydown", (event) => {
  if (!ARROWS[event.key] || event.altKey || event.target.closest("input, select, textarea, pre, .scroll") || document.querySelector("dialog[open]")) return;
  const [dx, dy] = ARROWS[event.key];
  const box = here();
  if (event.ctrlKey && event.shiftKey) { if (box) place({ ...box, w: box.w + dx, h: box.h + dy }); }
  else if (event.shiftKey) { if (box) place({ ...box, x: box.x + dx, y: box.y + dy }); }
  else if (dx && !event.ctrlKey) look(frame + dx / 2);
  else return;
  event.preventDefault();
});

function play() {
  clearInterval(playing);
  playing = playing ? 0 : setInterval(() => { if (frames.get(frame)) { if (frame >= count) play(); else look(frame + 1); } }, 1000 / Math.min(fps, 12));
  byId("play").setAttribute("aria-pressed", String(Boolean(playing)));
}

byId("play").addEventListener("click", play);
byId("undo").addEventListener("click", undo);
byId("before").addEventListener("click", () => jump(-1));
byId("behind").addEventListener("click", () => jump(1));
byId("frame").addEventListener("input", (event) => look(Number(event.target.value)));
byId("empty").addEventListener("change", (event) => change({ ...labels, empty: event.target.checked }));
byId("accept").addEventListener("click", () => judge(true));
byId("refuse").addEventListener("click", () => judge(false));
for (const button of document.querySelectorAll("[data-go]")) button.addEventListener("click", () => look(frame + Number(button.dataset.go)));
for (const input of byId("box").querySelectorAll("input")) input.addEventListener("change", () => {
  const box = here();
  if (box && input.value !== "" && Number.isFinite(Number(input.value))) place({ ...box, [input.name]: Number(input.value) });
});

async function load() {
  const told = await call(address);
  labels = told.labels;
  saver.revision = told.revision;
  past.length = 0;
  if (chosen && !found()) chosen = null;
  if (!chosen && labels.proposals.length) chosen = { kind: "proposals", id: labels.proposals[0].id };
  look(chosen && !here() ? middle(found()) : frame);
  canvas.dataset.ready = "";
}

// Proposals come from a job: until it is over this page only waits for it.
async function watch(job) {
  for (;;) {
    const told = await call(`/api/v1/jobs/${job}`);
    const far = told.progress?.total ? ` ${Math.round((100 * told.progress.done) / told.progress.total)} %` : "";
    say(byId("working"), told.state === "done" ? "" : `proposals: ${told.state}${far} ${told.said}`);
    if (!["queued", "running"].includes(told.state)) return told.state === "done" ? load() : undefined;
    await new Promise((resolve) => setTimeout(resolve, PATIENCE_MS));
  }
}

byId("suggest").addEventListener("click", async () => {
  say(byId("wrong"), "");
  try {
    await saver.settled();
    const job = await call("/api/v1/jobs", "POST", { kind: "suggest", camera, roi: byId("roi").value, clip });
    await watch(job.id);
  } catch (error) {
    say(byId("wrong"), error.message);
  }
});
byId("take").addEventListener("change", async (event) => {
  const file = event.target.files[0];
  event.target.value = "";
  if (!file) return;
  say(byId("wrong"), "");
  try {
    await saver.settled();
    await call(`${address}/labels.txt?revision=${saver.revision}`, "POST", file);
    await load();
  } catch (error) {
    say(byId("wrong"), error.message);
  }
});

await load();
const waiting = (await call("/api/v1/jobs")).jobs.find((job) => job.kind === "suggest" && job.order.clip === clip && ["queued", "running"].includes(job.state));
if (waiting) watch(waiting.id);
