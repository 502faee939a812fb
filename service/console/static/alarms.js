// The list of alarms in the words of ISA-18.2.
import { command, evidence, feed, out, selection, shelve } from "./common.js";
import { call, clock, make, mark, may, moment, place, say } from "./dom.js";
import { CLASSES, HELD } from "./feed.js";
import { plain, reason } from "./words.js";

const rows = document.querySelector("#alarms tbody");
const held = document.querySelector("#held tbody");
const records = document.querySelector("#records tbody");
const filters = document.querySelector(".filters");
let chosen = null;
let key = "";
let version = -1;
let asking = false;

const id = (alarm) => `${alarm.camera}/${alarm.roi}/${alarm.class}`;
const RANK = ["UNACKNOWLEDGED", "RETURNED", "LATCHED", "ACKNOWLEDGED", "NORMAL", "UNKNOWN"];

function all() {
  return feed.regions().flatMap((region) => region.alarms.map((alarm) => ({
    ...alarm, camera: region.camera, roi: region.roi, silent: feed.status(region) === "SILENT",
  })));
}

function buttons(alarm) {
  if (!may("operator")) return [];
  const act = (text, run, shown) => (shown ? make("button", { type: "button", onclick: (event) => { event.stopPropagation(); run(); } }, text) : null);
  return [
    act("Acknowledge", () => command(alarm, "ack"), alarm.state === "UNACKNOWLEDGED" || alarm.state === "RETURNED"),
    act("Reset", () => command(alarm, "reset"), alarm.state === "LATCHED"),
    act("Shelve", () => shelve(alarm), !HELD.includes(alarm.state)),
    act("Unshelve", () => command(alarm, "unshelve"), alarm.state === "SHELVED"),
    act("Out of service", () => out(alarm), alarm.state !== "OUT_OF_SERVICE"),
    act("Put back", () => command(alarm, "service", { state: "in" }), alarm.state === "OUT_OF_SERVICE"),
  ];
}

function row(alarm, cells) {
  const shape = make("span", { class: "mark" });
  mark(shape, alarm.silent ? "SILENT" : alarm.state === "NORMAL" ? "CLEAR" : { lump: "LUMP", blind: "BLIND", system: "SYSTEM", blocked: "BLOCKED" }[alarm.class]);
  const found = alarm.raised?.evidence ? make("button", { type: "button", onclick: (event) => { event.stopPropagation(); evidence(alarm); } }, "Evidence") : null;
  return make("tr", { class: alarm.class, "data-id": id(alarm), "data-state": alarm.state, "aria-selected": String(chosen === id(alarm)), onclick: () => choose(id(alarm)) },
    make("td", { class: "state" }, shape, ` ${alarm.silent && alarm.state === "NORMAL" ? "not known" : plain(alarm.state)}${alarm.silent ? " (SILENT)" : ""}`),
    make("td", {}, `${place(alarm)} ${alarm.class}`), ...cells.map((text) => make("td", { class: "free" }, text)),
    make("td", {}, make("div", { class: "actions" }, ...buttons(alarm), found)));
}

function deed(last) {
  return last ? `${plain(last.change)} ${clock(last.time)}${last.actor ? ` by ${last.actor}` : ""}` : "";
}

function show() {
  const given = new FormData(filters);
  const found = all().filter((one) => (!given.get("camera") || one.camera === given.get("camera")) && (!given.get("class") || one.class === given.get("class")));
  const open = found.filter((one) => !HELD.includes(one.state) && (given.get("show") === "all" || !["NORMAL", "UNKNOWN"].includes(one.state)));
  const unknown = [...new Set(found.filter((one) => one.silent).map(place))];
  open.sort((a, b) => RANK.indexOf(a.state) - RANK.indexOf(b.state) || CLASSES.indexOf(a.class) - CLASSES.indexOf(b.class) || String(b.raised?.time).localeCompare(String(a.raised?.time)));
  // What is held is shown whatever the filters say: it must not be forgotten.
  const kept = all().filter((one) => HELD.includes(one.state));
  selection.current = [...open, ...kept].find((one) => id(one) === chosen) ?? null;
  const fresh = JSON.stringify([open, kept, chosen, unknown]);
  if (fresh === key) return;
  key = fresh;
  const focused = document.activeElement?.closest?.("tr")?.dataset.id;
  rows.replaceChildren(...open.map((one) => row(one, [one.raised ? moment(one.raised.time) : "", reason(one.last?.reason) || size(one), deed(one.last)])));
  held.replaceChildren(...kept.map((one) => row(one, [one.last?.until ? moment(one.last.until) : "until put back", one.last?.reason ?? "", one.last?.actor ?? ""])));
  const none = document.getElementById("none");
  none.hidden = open.length > 0 && unknown.length === 0;
  say(none, unknown.length ? `SILENT: what the alarms of ${unknown.join(", ")} do is not known.` : "Every alarm is NORMAL.");
  say(document.getElementById("none-held"), unknown.length ? "None that is known." : "None.");
  document.getElementById("none-held").hidden = kept.length > 0;
  if (focused) [...document.querySelectorAll("tr")].find((one) => one.dataset.id === focused)?.querySelector("button")?.focus();
}

function size(alarm) {
  return alarm.raised?.longest_mm && alarm.class === "lump" ? `${Math.round(alarm.raised.longest_mm)} mm` : "";
}

function choose(one) {
  chosen = one;
  show();
}

function step(by) {
  const ids = [...document.querySelectorAll("#alarms tbody tr, #held tbody tr")].map((one) => one.dataset.id);
  const at = ids.indexOf(chosen);
  if (ids.length) choose(ids[Math.min(ids.length - 1, Math.max(0, at < 0 ? 0 : at + by))]);
}

async function latest() {
  if (asking || feed.snapshot === null || feed.snapshot.alarm_version === version) return;
  const fresh = feed.snapshot.alarm_version;
  asking = true;
  let told = null;
  try {
    told = await call("/api/v1/alarms");
  } catch {
    return; // the next turn asks again
  } finally {
    asking = false;
  }
  version = fresh;
  records.replaceChildren(...told.records.slice(0, 100).map(({ time, data }) => make("tr", {},
    make("td", {}, moment(time)), make("td", {}, `${data.camera} / ${data.roi} ${data.class}`), make("td", {}, plain(data.change)), make("td", {}, plain(data.state)),
    make("td", { class: "free" }, data.actor ?? ""), make("td", { class: "free" }, reason(data.reason)),
    make("td", {}, data.evidence ? make("a", { href: `/evidence/${encodeURIComponent(data.camera)}/${encodeURIComponent(data.roi)}/${data.evidence}` }, "look") : ""))));
}

filters.addEventListener("change", () => { key = ""; show(); });
feed.listeners.push(show, latest);
selection.keys = { ArrowDown: () => step(1), ArrowUp: () => step(-1) };
