// What the server tells, judged by the page's own clock: silence is never clear.
//
// A snapshot says how long ago each heartbeat came. From then on only this page's clock counts: when a heartbeat
// is older than it may be, the region is SILENT, whoever is gone: server, bus, monitor or camera.
import { renew } from "./dom.js";

const REOPEN_S = 3;

export const now = () => performance.now() / 1000;

export class Feed {
  constructor() {
    this.snapshot = null;
    this.began = now();
    this.told = -Infinity;
    this.heard = new Map();
    this.listeners = [];
    this.quickest = Infinity;
    this.ended = false;
    this.shown = this.began;
    this.open();
    setInterval(() => this.tick(), 250);
  }

  open() {
    this.source?.close();
    this.opened = now();
    this.quickest = Infinity;
    this.source = new EventSource("/api/v1/stream");
    this.source.onmessage = (event) => this.take(JSON.parse(event.data));
    this.source.onerror = () => this.ask();
  }

  // Whether the login is over: then only a new one helps, and the page says so instead of going away.
  async ask() {
    try {
      this.ended = !(await renew());
    } catch {
      // no connection: that is seen anyway
    }
  }

  take(snapshot) {
    const came = now();
    // Snapshots that waited somewhere on the way arrive later than the quickest one: they are that much older.
    const offset = came - snapshot.now_s;
    this.quickest = Math.min(this.quickest, offset);
    const late = offset - this.quickest;
    for (const [id, camera] of Object.entries(snapshot.cameras)) {
      if (camera.heard_ago_s !== null) this.heard.set(id, came - late - camera.heard_ago_s);
    }
    if (this.ended) this.ask(); // somebody has logged in again in another window
    this.told = came - late;
    this.taken = came;
    this.snapshot = snapshot;
    this.tick();
  }

  tick() {
    const at = now();
    if (at - Math.max(this.opened, this.taken ?? 0) > REOPEN_S) this.open();
    for (const listener of this.listeners) listener(this);
    this.shown = now(); // not reached where one of them fails
  }

  // Seconds since the last sign of life of a camera's monitor.
  quiet(camera) {
    return now() - (this.heard.get(camera) ?? this.began);
  }

  status(region) {
    const camera = this.snapshot?.cameras[region.camera];
    if (!camera || !this.heard.has(region.camera) || !camera.valid_s) return "SILENT";
    if (this.quiet(region.camera) > camera.valid_s || !camera.valid || camera.rois?.[region.roi] !== true) return "SILENT";
    return region.state?.state ?? "SILENT";
  }

  linked() {
    return !this.ended && now() - this.told <= REOPEN_S;
  }

  regions() {
    return this.snapshot?.regions ?? [];
  }

  news(region) {
    if (this.ended) return "the login is over";
    return `no news for ${Math.floor(this.quiet(region.camera))}\u00a0s`;
  }
}

const ORDER = { SILENT: 2, LUMP: 4, BLOCKED: 4, BLIND: 3, CLEAR: 0 };

// Worst first: what waits for an operator before what does not.
export function worst(feed) {
  const weight = (region) => {
    const status = feed.status(region);
    const waits = region.alarms.some((alarm) => alarm.state === "UNACKNOWLEDGED" || alarm.state === "RETURNED");
    return ORDER[status] * 2 + (waits ? 3 : 0);
  };
  return [...feed.regions()].sort((a, b) => weight(b) - weight(a));
}

// What the feed does, in a few words; empty where it is not known.
export function feeding(region) {
  const told = region.state?.feed;
  if (!told || told.state === "unknown") return "";
  const speed = told.state !== "running" ? "" : told.speed_mm_s !== null ? `${(told.speed_mm_s / 1000).toFixed(2)} m/s` : told.speed_px_s !== null ? `${Math.round(told.speed_px_s)} px/s` : "";
  const load = told.load === null || told.state === "empty" ? "" : `load ${Math.round(100 * told.load)} %`;
  return [`feed ${told.state}`, speed, load, told.agrees === false ? "the plant says otherwise" : ""].filter(Boolean).join(", ");
}

export const HELD = ["SHELVED", "SUPPRESSED", "OUT_OF_SERVICE"];
export const WAITS = ["UNACKNOWLEDGED", "RETURNED"];
export const CLASSES = ["lump", "blind", "system", "blocked"];

// What a mouth looks like, in words; nothing of a region that watches a belt.
export function mouth(region) {
  const told = region.state?.blockage;
  if (!told) return "";
  const stood = told.reason ? `, for ${Math.floor(told.stood_s)} s` : "";
  const lump = told.reason === "lump" ? "a lump stands in the mouth, " : "";
  return `${lump}${Math.round(100 * told.standing)} % of the mouth stands${stood}`;
}

// All alarms that wait to be acknowledged, the most urgent first.
export function waiting(feed) {
  const found = [];
  for (const region of feed.regions()) {
    for (const alarm of region.alarms) if (WAITS.includes(alarm.state)) found.push({ ...alarm, camera: region.camera, roi: region.roi });
  }
  const rank = (alarm) => (alarm.state === "UNACKNOWLEDGED" ? 0 : 10) + CLASSES.indexOf(alarm.class);
  return found.sort((a, b) => rank(a) - rank(b) || String(b.raised?.time).localeCompare(String(a.raised?.time)));
}

export function largest(region) {
  return (region.state.objects ?? []).reduce((most, one) => ((one.size?.longest_mm ?? 0) > (most?.size?.longest_mm ?? -1) ? one : most), null);
}

export function soonest(region) {
  return (region.state.objects ?? []).reduce((least, one) => (one.size && one.size.lip_s !== null && (least === null || one.size.lip_s < least) ? one.size.lip_s : least), null);
}
