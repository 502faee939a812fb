// One camera: its newest picture with what was decided of that very frame.
import { command, evidence, feed, shelve } from "./common.js";
import { call, make, mark, may, say, set } from "./dom.js";
import { curve, objects } from "./curve.js";
import { HELD, feeding, largest, mouth, now, soonest } from "./feed.js";
import { blockage, plain, reason, untrained } from "./words.js";

const EVERY_S = 0.1;
const main = document.getElementById("main");
const camera = main.dataset.camera;
const shape = JSON.parse(main.dataset.shape);
const canvas = document.getElementById("view");
const context = canvas.getContext("2d");
const figure = canvas.parentElement;
const panels = new Map([...document.querySelectorAll(".region")].map((node) => [node.dataset.roi, node]));
const points = new Map();
const countdown = new Map();
let shownAt = -Infinity;

function draw(bitmap, about) {
  const [width, height] = about.size;
  if (canvas.width !== width || canvas.height !== height) {
    canvas.width = width;
    canvas.height = height;
  }
  const scale = Math.max(0.35, width / 640); // as large on the screen, whatever the camera sends
  context.drawImage(bitmap, 0, 0, width, height);
  for (const [roi, one] of Object.entries(shape)) {
    const state = about.states[roi];
    context.strokeStyle = state?.state === "LUMP" || state?.state === "BLOCKED" ? "#ff4d5e" : state?.state === "BLIND" ? "#f0c000" : "#dfe3e6";
    context.lineWidth = 2 * scale;
    context.beginPath();
    one.polygon.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](x * width, y * height));
    context.closePath();
    context.stroke();
    if (one.lip) {
      context.setLineDash([10 * scale, 6 * scale]);
      context.strokeStyle = "#ffffff";
      context.lineWidth = 3 * scale;
      context.beginPath();
      one.lip.forEach(([x, y], i) => context[i ? "lineTo" : "moveTo"](x * width, y * height));
      context.stroke();
      context.setLineDash([]);
    }
    if (state) objects(context, state.objects, (x, y) => [x, y], scale);
  }
  canvas.dataset.frame = about.frame;
  canvas.dataset.decided = Object.keys(about.states).join(" ");
}

async function pictures() {
  let after = -1;
  for (;;) {
    if (document.hidden) {
      await new Promise((resolve) => document.addEventListener("visibilitychange", resolve, { once: true }));
      continue;
    }
    const began = now();
    try {
      const answer = await fetch(`/api/v1/cameras/${encodeURIComponent(camera)}/picture?after=${after}`, { signal: AbortSignal.timeout(6000) });
      if (answer.status === 200) {
        const about = JSON.parse(answer.headers.get("X-Lumpwatch-Frame"));
        const bitmap = await createImageBitmap(await answer.blob());
        after = about.frame;
        draw(bitmap, about);
        bitmap.close();
        shownAt = now();
      } else if (answer.status === 401) await feed.ask();
      else if (answer.status !== 204) throw new Error("no picture");
    } catch {
      await new Promise((resolve) => setTimeout(resolve, 500));
    }
    const left = EVERY_S - (now() - began);
    if (left > 0) await new Promise((resolve) => setTimeout(resolve, 1000 * left));
  }
}

async function history(roi) {
  try {
    const told = await call(`/api/v1/cameras/${encodeURIComponent(camera)}/rois/${encodeURIComponent(roi)}/existence`);
    const at = now();
    points.set(roi, told.points.map(([ago, value]) => [at - ago, value]));
  } catch {
    points.set(roi, []);
  }
}

// What is NORMAL, and no lump alarm, takes one line together. Of a region that is silent nobody knows.
function alarms(node, region, heard) {
  const list = node.querySelector(".alarms-of");
  const key = JSON.stringify([heard, ...region.alarms.map((alarm) => [alarm.state, alarm.raised?.evidence])]);
  if (list.dataset.key === key) return;
  list.dataset.key = key;
  const quiet = region.alarms.filter((alarm) => alarm.class !== "lump" && ["NORMAL", "UNKNOWN"].includes(alarm.state));
  const others = region.alarms.filter((alarm) => !quiet.includes(alarm));
  const together = quiet.length ? [make("li", {}, make("span", {}, quiet.map((alarm) => alarm.class).join(", ")), make("span", { class: "state" }, heard ? "NORMAL" : "not known"))] : [];
  list.replaceChildren(...others.map((alarm) => {
    const one = { ...alarm, camera: region.camera, roi: region.roi };
    const act = (text, run, shown, role = "operator") => (shown && may(role) ? make("button", { type: "button", onclick: run }, text) : null);
    const waits = alarm.state === "UNACKNOWLEDGED" || alarm.state === "RETURNED";
    return make("li", {}, make("span", {}, alarm.class), make("span", { class: "state" }, heard || alarm.state !== "NORMAL" ? plain(alarm.state) : "not known"),
      act("Acknowledge", () => command(one, "ack"), waits), act("Shelve", () => shelve(one), !HELD.includes(alarm.state)),
      act("Unshelve", () => command(one, "unshelve"), alarm.state === "SHELVED"), act("Reset", () => command(one, "reset"), alarm.state === "LATCHED"),
      act("Evidence", () => evidence(one), Boolean(alarm.raised?.evidence), "viewer"));
  }), ...together);
}

function show() {
  const at = now();
  let silent = true;
  for (const region of feed.regions().filter((one) => one.camera === camera)) {
    const node = panels.get(region.roi);
    if (!node) continue;
    const status = feed.status(region);
    const heard = status !== "SILENT";
    silent &&= !heard;
    set(node, "data-status", status);
    mark(node.querySelector(".mark"), status);
    say(node.querySelector(".text"), status);
    say(node.querySelector(".detail"), status === "SILENT" ? feed.news(region) : status === "BLIND" ? reason(region.state.reason) : status === "BLOCKED" ? blockage(region) : [mouth(region), feeding(region)].filter(Boolean).join(" · "));
    say(node.querySelector(".untaught"), heard && untrained(region) ? "untrained: finds fewer lumps" : "");
    const lip = soonest(region);
    if (region.state.frame !== countdown.get(region.roi)?.frame) {
      countdown.set(region.roi, { frame: region.state.frame, at: at - (region.state.timing?.age_s ?? 0), lip });
    }
    const known = countdown.get(region.roi);
    const left = known?.lip === null || known === undefined ? null : known.lip - (at - known.at);
    say(node.querySelector(".lip"), heard && left !== null ? `${Math.max(0, left).toFixed(1)} s` : "–");
    const size = largest(region)?.size?.longest_mm;
    say(node.querySelector(".size"), heard && size ? `${Math.round(size)} mm` : "–");
    say(node.querySelector(".existence"), heard ? `${Math.round(100 * (region.state.existence ?? 0))} %` : "–");
    alarms(node, region, heard);
    const kept = points.get(region.roi);
    if (kept) {
      if (heard && feed.taken !== kept.taken) {
        kept.push([at, region.state.existence ?? 0]);
        kept.taken = feed.taken;
      }
      while (kept.length && at - kept[0][0] > 120) kept.shift();
      curve(node.querySelector(".curve"), kept, at - 120, at, shape[region.roi]?.raise_above ?? null);
    }
  }
  const old = at - shownAt > 3;
  figure.classList.toggle("silent", silent || old);
  const quiet = Math.floor(silent ? feed.quiet(camera) : at - Math.max(shownAt, feed.began));
  say(document.getElementById("view-note"), silent && feed.ended ? "SILENT: the login is over" : silent ? `SILENT: no news for ${quiet}\u00a0s` : shownAt > 0 ? `no picture for ${quiet}\u00a0s` : "no picture yet");
}

await Promise.all(Object.keys(shape).map(history));
feed.listeners.push(show);
pictures();
