// One step from alarm to evidence: the clip with what was decided, the curve, the verdict by one key.
import { region, selection } from "./common.js";
import { call, make, may, moment, say, toast } from "./dom.js";
import { curve, objects } from "./curve.js";

const main = document.getElementById("main");
const where = { camera: main.dataset.camera, roi: main.dataset.roi, class: "lump" };
const address = `${region(where)}/evidence/${main.dataset.id}`;
const video = document.getElementById("clip");
const overlay = document.getElementById("overlay");
const note = document.getElementById("clip-note");
let told = null;

function draw(at) {
  const frames = told.frames;
  let i = frames.findIndex((one) => one.time_s > at + 0.02);
  i = i < 0 ? frames.length - 1 : Math.max(0, i - 1);
  const state = frames[i];
  overlay.width = video.videoWidth;
  overlay.height = video.videoHeight;
  overlay.style.height = `${video.clientHeight}px`;
  const context = overlay.getContext("2d");
  const scale = video.videoWidth / told.crop[2];
  objects(context, state.objects, (x, y) => [(x - told.crop[0]) * scale, (y - told.crop[1]) * scale], Math.max(0.7, video.videoWidth / 960));
  const last = frames.at(-1).time_s;
  curve(document.getElementById("curve"), frames.map((one) => [one.time_s, one.existence]), frames[0].time_s, Math.max(last, 0.1), null, at);
  say(note, `${state.state}, existence ${Math.round(100 * state.existence)} %, ${at.toFixed(2)} s of ${last.toFixed(1)} s`);
}

function follow() {
  const step = (_, frame) => {
    draw(frame.mediaTime);
    video.requestVideoFrameCallback(step);
  };
  video.requestVideoFrameCallback(step);
  video.addEventListener("seeked", () => draw(video.currentTime));
  video.addEventListener("loadeddata", () => { video.dataset.ready = ""; draw(video.currentTime); });
}

async function verdict(outcome) {
  if (!may("operator")) return;
  try {
    const done = await call(`${region(where)}/commands/verdict`, "POST", {
      verdict: outcome, evidence: main.dataset.id, note: document.getElementById("note").value,
    });
    say(document.getElementById("verdict"), done.verdict);
    toast(`Verdict: ${done.verdict}`);
  } catch (error) {
    toast(error.message, true);
  }
}

for (const button of document.querySelectorAll("[data-verdict]")) {
  button.disabled = !may("operator");
  button.addEventListener("click", () => verdict(button.dataset.verdict));
}
selection.keys = {
  t: () => verdict("true"), f: () => verdict("false"), u: () => verdict("unsure"),
  " ": () => { if (video.paused) video.play(); else video.pause(); },
  ArrowRight: () => { video.pause(); video.currentTime += 0.1; }, ArrowLeft: () => { video.pause(); video.currentTime -= 0.1; },
};

function fact(name, value) {
  return make("div", {}, make("dt", {}, name), make("dd", {}, value));
}

// A clip is written after the post-roll: right after the alarm it is waited for.
async function load(tries) {
  try {
    const meta = await call(address);
    say(document.getElementById("when"), moment(meta.time));
    say(document.getElementById("verdict"), meta.verdict ?? "none yet");
    document.getElementById("facts").replaceChildren(
      fact("alarm", `${meta.class} ${meta.sequence}`), fact("frames", String(meta.frames)),
      fact("existence", `${Math.round(100 * meta.existence)} %`), fact("prior", meta.prior ? `version ${meta.prior}` : "defaults"));
    told = await call(`${address}/curve.json`);
    video.src = `${address}/clip.mp4`;
    say(note, "making the clip playable");
    follow();
    video.play().catch(() => {});
  } catch (error) {
    say(note, tries ? `waiting for the clip: ${error.message}` : error.message);
    if (tries) setTimeout(() => load(tries - 1), 1000);
  }
}
video.addEventListener("error", () => say(note, "the clip cannot be played"));
load(30);
