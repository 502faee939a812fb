// From camera to alarm: each stage with its last time, rate and latency, and what to do.
import { feed } from "./common.js";
import { make } from "./dom.js";
import { plain, reason as why } from "./words.js";

const holder = document.getElementById("health");
const rates = new Map();
const TODO = {
  no_stream: "Camera, cable, network: is it on, does its address answer?", stale: "Network or load of the camera.", frozen: "Restart the camera or the recorder that repeats its picture.",
  dark: "Lamps, exposure of the camera.", glare: "Sun, lamps, exposure.", moved: "Put the camera back, or draw the regions anew and learn a new reference.", dusty: "Wait for the dust, water the feed.",
  hidden: "Remove what is before the camera, clean the lens.", blurred: "Clean the lens, focus.", overload: "Give the machine more, or the camera fewer frames a second.", unfit: "The picture has another size than the region was drawn for.",
  filter: "Read the daemon's log; train again.", starting: "Wait; then see the source's failures.", few_frames: "The camera sends too few frames.", exposure: "Nothing; often: fix the exposure.",
};

function rate(region) {
  const known = rates.get(region.roi + region.camera) ?? [];
  const last = known.at(-1);
  if (!last || last[1] !== region.state.frame) known.push([performance.now() / 1000, region.state.frame]);
  while (known.length > 2 && known.at(-1)[0] - known[0][0] > 6) known.shift();
  rates.set(region.roi + region.camera, known);
  if (known.length < 2) return null;
  return (known.at(-1)[1] - known[0][1]) / (known.at(-1)[0] - known[0][0]);
}

function stage(name, fine, text, todo = "") {
  return make("li", { class: fine ? "panel" : "panel bad" }, make("strong", {}, name), make("br"), text, ...(fine || !todo ? [] : [make("br"), make("em", {}, todo)]));
}

function standing(alarms) {
  const others = alarms.filter((one) => one.state !== "NORMAL");
  return others.length ? others.map((one) => `${one.class} ${plain(one.state)}`).join(", ") : "all NORMAL";
}

function show() {
  const parts = [];
  for (const [id, camera] of Object.entries(feed.snapshot?.cameras ?? {})) {
    const regions = feed.regions().filter((one) => one.camera === id);
    const quiet = feed.quiet(id);
    const heard = camera.valid_s !== null && quiet <= camera.valid_s;
    const stages = [
      stage("console", feed.linked(), feed.linked() ? "this page hears the console" : "this page hears nothing", "Is `lumpwatch console` running?"),
      stage("monitor", heard && camera.valid, heard ? `heartbeat ${quiet.toFixed(1)} s ago${camera.valid ? "" : ", not valid"}` : `no heartbeat for ${Math.floor(quiet)}\u00a0s`, "Is the daemon running, and its bus reachable? See its log and /readyz."),
    ];
    for (const region of regions) {
      const status = feed.status(region);
      const speed = rate(region);
      const reason = region.state.reason;
      const age = region.state.timing?.age_s;
      stages.push(
        stage(`camera → ${region.roi}`, !["no_stream", "stale", "starting"].includes(reason) && status !== "SILENT", speed === null ? status === "SILENT" ? "not known" : "no frame yet" : `frame ${region.state.frame}, ${speed.toFixed(1)} frames/s`, TODO[reason] ?? ""),
        stage(`decision ${region.roi}`, status === "CLEAR" || status === "LUMP" || status === "BLOCKED", `${status}${reason ? ` (${why(reason)})` : ""}${status === "SILENT" || age === undefined || age === null ? "" : `, ${Math.round(1000 * age)} ms after capture`}`, TODO[reason] ?? "Nothing valid is heard of this region."),
        stage(`prior ${region.roi}`, Boolean(region.state.trained), status === "SILENT" ? "not known" : region.state.trained ? `version ${region.state.prior}` : "untrained: the net that ships, alone", status === "SILENT" ? "Nothing valid is heard of this region." : "A minute of labels teaches it: see Commissioning."),
        stage(`alarm ${region.roi}`, status !== "SILENT" && region.alarms.find((one) => one.class === "system")?.state === "NORMAL", status === "SILENT" ? "not known" : standing(region.alarms), status === "SILENT" ? "Nothing valid is heard of this region." : `System alarm: ${why(region.alarms.find((one) => one.class === "system")?.last?.reason) || "decisions come late, or a proof test failed"}.`),
      );
    }
    parts.push(make("h2", {}, id), make("ul", { class: "stages" }, ...stages));
  }
  holder.replaceChildren(...parts);
}
feed.listeners.push(show);
