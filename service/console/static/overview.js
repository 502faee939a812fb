// All regions, worst first.
import { feed, selection } from "./common.js";
import { make, mark, place, say, set } from "./dom.js";
import { feeding, largest, mouth, soonest, worst } from "./feed.js";
import { blockage, plain, reason, untrained } from "./words.js";

const list = document.getElementById("tiles");
const tiles = new Map();

function tile(region) {
  const key = place(region);
  if (!tiles.has(key)) {
    const parts = {
      where: make("a", { class: "where", href: `/cameras/${encodeURIComponent(region.camera)}` }, key),
      mark: make("span", { class: "mark" }), text: make("span", {}), detail: make("p", { class: "detail" }), note: make("p", { class: "untaught" }), alarm: make("p", { class: "alarm" }),
    };
    const item = make("li", { class: "tile" }, parts.where, make("p", { class: "word" }, parts.mark, parts.text), parts.detail, parts.note, parts.alarm);
    tiles.set(key, { item, ...parts });
  }
  return tiles.get(key);
}

function detail(region, status) {
  if (status === "SILENT") return feed.news(region);
  if (status === "BLIND") return reason(region.state.reason);
  if (status === "BLOCKED") return blockage(region);
  if (status === "CLEAR") return [mouth(region), feeding(region)].filter(Boolean).join(" · ");
  const size = largest(region)?.size?.longest_mm;
  const lip = soonest(region);
  return [size ? `${Math.round(size)} mm` : "", lip === null ? "" : `${Math.max(0, lip).toFixed(1)} s to the lip`].filter(Boolean).join(" · ");
}

function show() {
  const regions = worst(feed);
  list.classList.toggle("few", regions.length <= 4);
  regions.forEach((region, i) => {
    const one = tile(region);
    const status = feed.status(region);
    const stands = region.alarms.filter((alarm) => !["NORMAL", "UNKNOWN"].includes(alarm.state));
    const about = stands.find((alarm) => alarm.class === status.toLowerCase());
    set(one.item, "data-status", status);
    set(one.item, "data-unacked", stands.some((alarm) => alarm.state === "UNACKNOWLEDGED"));
    set(one.item, "data-acked", about && about.state !== "UNACKNOWLEDGED");
    mark(one.mark, status);
    say(one.text, status);
    say(one.detail, detail(region, status));
    say(one.note, status !== "SILENT" && untrained(region) ? "untrained: finds fewer lumps" : "");
    say(one.alarm, stands.map((alarm) => `${alarm.class}: ${plain(alarm.state)}`).join(" · "));
    if (list.children[i] !== one.item) {
      const focused = document.activeElement;
      list.insertBefore(one.item, list.children[i] ?? null);
      if (focused && one.item.contains(focused)) focused.focus();
    }
  });
}
feed.listeners.push(show);

function step(by) {
  const links = [...list.querySelectorAll("a.where")];
  const at = links.indexOf(document.activeElement);
  links[Math.min(links.length - 1, Math.max(0, at < 0 ? 0 : at + by))]?.focus();
}
selection.keys = { ArrowDown: () => step(1), ArrowRight: () => step(1), ArrowUp: () => step(-1), ArrowLeft: () => step(-1) };
