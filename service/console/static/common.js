// What every page has: the feed, the strip with the most urgent alarm, sound, keys, and a watch over itself.
import { body, call, clock, mark, may, place, say, toast } from "./dom.js";
import { Feed, now, waiting } from "./feed.js";
import { Sound } from "./sound.js";
import { CLASS, plain, reason } from "./words.js";

const byId = (id) => document.getElementById(id);
export const feed = new Feed();
const sound = new Sound(byId("sound"));
const strip = byId("strip");
// A page may say which alarm its keys mean; else it is the most urgent one.
export const selection = { current: null, keys: {} };
let urgent = null;
let replacedAt = -Infinity;
const name = (alarm) => `${place(alarm)} ${alarm.class} ${alarm.raised?.id ?? ""}`;

export const region = (alarm) => `/api/v1/cameras/${encodeURIComponent(alarm.camera)}/rois/${encodeURIComponent(alarm.roi)}`;

// Without a connection another page cannot come: the browser's own error would stand there, silent, and stay.
function stays() {
  if (feed.linked() || feed.ended || !feed.snapshot) return false; // before the first news there is nothing to keep
  toast("No connection: this page stays, and catches up by itself.", true);
  return true;
}

export function go(address) {
  if (!stays()) location.href = address;
}

document.addEventListener("click", (event) => {
  if (event.target.closest("a[href]:not([href^='#'])") && stays()) event.preventDefault();
}, true);

export async function command(alarm, name, given = {}) {
  try {
    const done = await call(`${region(alarm)}/commands/${name}`, "POST", { class: alarm.class, ...given });
    toast(`${place(alarm)} ${alarm.class}: ${done.changes?.length ? done.changes.map(plain).join(", ") : `nothing to do: it is ${plain(done.alarm)}${by(alarm)}`}`);
    return done;
  } catch (error) {
    toast(`${place(alarm)}: ${error.message}`, true);
    return null;
  }
}

// Who was quicker.
function by(alarm) {
  const last = feed.regions().find((one) => place(one) === place(alarm))?.alarms.find((one) => one.class === alarm.class)?.last;
  return last?.actor ? `, ${plain(last.change)} by ${last.actor} ${clock(last.time)}` : "";
}

// Asks for a reason, and for how long where it ends by itself.
export function ask(title, alarm, lasts) {
  const dialog = byId("shelve");
  const form = dialog.querySelector("form");
  form.reset();
  dialog.querySelector("h2").textContent = title;
  dialog.querySelector(".target").textContent = `${place(alarm)}, ${alarm.class}`;
  dialog.querySelector(".until").hidden = !lasts;
  dialog.querySelector("button.primary").textContent = title;
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.addEventListener("close", () => {
      if (dialog.returnValue !== "do") return resolve(null);
      const given = { reason: form.elements.reason.value };
      if (lasts) given.for_s = Number(form.elements.for_s.value);
      return resolve(given);
    }, { once: true });
  });
}

export async function shelve(alarm) {
  const given = await ask("Shelve", alarm, true);
  if (given) await command(alarm, "shelve", given);
}

export async function out(alarm) {
  const given = await ask("Take out of service", alarm, false);
  if (given) await command(alarm, "service", { state: "out", ...given });
}

export function evidence(alarm) {
  const id = alarm.raised?.evidence;
  if (id) go(`/evidence/${encodeURIComponent(alarm.camera)}/${encodeURIComponent(alarm.roi)}/${id}`);
  else toast("There is no evidence of this alarm.");
}

function sentence(alarm) {
  const size = alarm.raised?.longest_mm ? `, ${Math.round(alarm.raised.longest_mm)} mm` : "";
  const why = alarm.class !== "lump" && alarm.last?.reason ? `, ${reason(alarm.last.reason)}` : "";
  return `${CLASS[alarm.class]} ${place(alarm)}${size}${why}${alarm.state === "RETURNED" ? " (over)" : ""}`;
}

function show() {
  const waits = waiting(feed);
  const before = urgent;
  urgent = waits[0] ?? null;
  if (urgent && before && name(urgent) !== name(before)) replacedAt = performance.now();
  if (urgent && (!before || name(urgent) !== name(before))) byId("keys").close(); // nothing stands before a new alarm
  say(byId("now"), `${clock(Date.now())} ${body.dataset.zone.split("/").at(-1).replaceAll("_", " ")}`);
  const silent = feed.regions().filter((one) => feed.status(one) === "SILENT");
  const link = byId("link");
  const linked = feed.linked();
  link.classList.toggle("gone", !linked);
  say(link, linked ? "connected" : feed.ended ? "login over: log in again" : feed.snapshot ? `no connection for ${Math.floor(feed.quietest ?? 0)} s` : "no connection");
  const active = waits.find((one) => one.state === "UNACKNOWLEDGED");
  const kind = active ? (active.class === "lump" || active.class === "blocked" ? "lump" : "blind") : silent.length && feed.snapshot ? "silent" : "";
  sound.wanted(kind);
  strip.hidden = !urgent && !(silent.length && feed.snapshot);
  strip.className = `strip ${urgent ? urgent.class : "silent"}${urgent?.state === "RETURNED" ? " over" : ""}`;
  const text = urgent ? sentence(urgent) : silent.length ? `SILENT ${place(silent[0])}: ${feed.news(silent[0])}${silent.length > 1 ? `, and ${silent.length - 1} more` : ""}` : "";
  say(strip.querySelector(".what"), text);
  mark(strip.querySelector(".mark"), urgent ? CLASS[urgent.class] : "SILENT");
  say(strip.querySelector(".when"), urgent?.raised ? `since ${clock(urgent.raised.time)}` : "");
  // An alarm that waits must not hide that nothing is heard any more.
  const also = urgent && feed.snapshot ? silent.map(place) : [];
  say(strip.querySelector(".more"), [waits.length > 1 ? `and ${waits.length - 1} more` : "", also.length > 1 ? `${also.length} regions SILENT` : also.length ? `SILENT: ${also[0]}` : ""].filter(Boolean).join(", "));
  strip.querySelector(".more").classList.toggle("silent", also.length > 0);
  const button = strip.querySelector("button");
  button.hidden = !urgent;
  button.disabled = !may("operator");
  // For screen readers: once when it changes, without running seconds.
  say(byId("said"), urgent ? [text, ...also.map((one) => `SILENT ${one}`)].join(". ") : silent.length && feed.snapshot ? `SILENT ${silent.map(place).join(", ")}` : "");
}
feed.listeners.push((one) => { one.quietest = performance.now() / 1000 - one.told; });
feed.listeners.push(show);

// If a script hangs, dies or fails, what stands on the page is old: then an animation, which needs no script, covers it.
const cover = byId("stopped");
cover.hidden = false;
const watch = cover.animate([{ opacity: 0 }, { opacity: 0, offset: 0.95 }, { opacity: 1 }], { duration: 6000, fill: "forwards" });
const alive = () => { if (now() - feed.shown < 1.5) watch.currentTime = 0; };
setInterval(alive, 1000);
document.addEventListener("visibilitychange", () => { // hidden pages get little time
  feed.tick();
  alive();
});

// Who answers one alarm must not answer the next by it: another one may take its place while the finger is on its way.
const SETTLES_MS = 700;
function meant(then) {
  const alarm = selection.current ?? urgent;
  if (!alarm || !may("operator")) return;
  if (!selection.current && performance.now() - replacedAt < SETTLES_MS) toast("Another alarm has just taken this place: look at it, and press again.", true);
  else then(alarm);
}

strip.querySelector("button").addEventListener("click", () => {
  if (urgent && performance.now() - replacedAt < SETTLES_MS) toast("Another alarm has just taken this place: look at it, and press again.", true);
  else if (urgent) command(urgent, "ack");
});
byId("link").addEventListener("click", () => { if (feed.ended) location.href = "/login"; });
byId("help").addEventListener("click", () => byId("keys").showModal());
byId("logout")?.addEventListener("click", async () => {
  await call("/logout", "POST");
  location.href = "/login";
});

const KEYS = {
  a: () => meant((alarm) => command(alarm, "ack")),
  s: () => meant(shelve),
  r: () => meant((alarm) => command(alarm, "reset")),
  e: () => { const alarm = selection.current ?? urgent; if (alarm) evidence(alarm); },
  n: () => sound.toggle(),
  o: () => go("/"),
  l: () => go("/alarms"),
  "?": () => byId("keys").showModal(),
};

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || document.querySelector("dialog[open]")) return;
  if (event.target.closest("input, textarea, select")) return;
  const name = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const act = selection.keys[name] ?? KEYS[name];
  if (!act) return;
  if (act(event) !== false) event.preventDefault();
});
