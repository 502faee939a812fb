// Clips: recorded from a camera or taken from a file.
import "./common.js";
import { call, make, moment, say, toast } from "./dom.js";

const byId = (id) => document.getElementById(id);
const record = byId("record");
const upload = byId("upload");
let known = "";

function labels(clip) {
  if (clip.lumps) return `${clip.lumps} ${clip.lumps === 1 ? "lump" : "lumps"}`;
  return clip.empty ? "no lump comes" : clip.proposed ? `${clip.proposed} proposals` : "none";
}

function row(clip) {
  const missed = clip.missed ? `, ${clip.missed} pictures missed` : "";
  return make("tr", { "data-clip": clip.id },
    make("td", {}, make("a", { href: `/clips/${clip.id}` }, clip.name)), make("td", {}, clip.camera),
    make("td", { class: "number" }, (clip.frames / clip.fps).toFixed(1)), make("td", { class: "number" }, String(clip.frames)),
    make("td", {}, `${clip.width} x ${clip.height}${missed}`), make("td", {}, labels(clip)), make("td", {}, `${clip.by}, ${moment(clip.made)}`),
    make("td", { class: "actions" }, make("a", { class: "button", href: `/clips/${clip.id}`, "aria-label": `Label ${clip.name}` }, "Label"),
      make("button", { type: "button", "aria-label": `Remove ${clip.name}`, onclick: () => remove(clip) }, "Remove")));
}

async function remove(clip) {
  if (!window.confirm(`Remove ${clip.name} and its labels?`)) return;
  try {
    await call(`/api/v1/clips/${clip.id}`, "DELETE");
    await load();
  } catch (error) {
    toast(error.message, true);
  }
}

async function load() {
  const told = await call("/api/v1/clips");
  const text = JSON.stringify(told.clips);
  if (text !== known) {
    known = text;
    byId("clips").tBodies[0].replaceChildren(...told.clips.map(row));
    byId("none").hidden = told.clips.length > 0;
  }
  say(byId("room"), `Room for ${Math.max(0, Math.floor(told.room / 1048576))} MiB more.`);
  const one = told.recordings[record.elements.camera.value];
  byId("stop").disabled = !one?.runs;
  if (one) say(byId("recording"), one.error || (one.runs ? `${one.at_s.toFixed(0)} of ${one.seconds} s, ${one.pictures} pictures` : "recorded"));
  return Object.values(told.recordings).some((recording) => recording.runs);
}

async function follow() {
  while (await load()) await new Promise((resolve) => setTimeout(resolve, 500));
}

record.addEventListener("submit", async (event) => {
  event.preventDefault();
  try {
    await call(`/api/v1/cameras/${encodeURIComponent(record.elements.camera.value)}/recording`, "POST", { seconds: Number(record.elements.seconds.value) });
    await follow();
  } catch (error) {
    say(byId("recording"), error.message);
  }
});
byId("stop").addEventListener("click", () => call(`/api/v1/cameras/${encodeURIComponent(record.elements.camera.value)}/recording`, "DELETE").then(follow));
upload.addEventListener("submit", async (event) => {
  event.preventDefault();
  const file = upload.elements.file.files[0];
  say(byId("uploading"), `taking ${file.name}`);
  try {
    const query = new URLSearchParams({ name: file.name, camera: upload.elements.camera.value });
    await call(`/api/v1/clips?${query}`, "POST", file);
    say(byId("uploading"), `${file.name} is here`);
    upload.reset();
    await load();
  } catch (error) {
    say(byId("uploading"), error.message);
  }
});
await follow();
byId("main").dataset.ready = "";
