// Small helpers for the document. Text from outside becomes text nodes, never markup.
export const body = document.body;
export const may = (role) => ["viewer", "operator", "engineer"].indexOf(body.dataset.role) >= ["viewer", "operator", "engineer"].indexOf(role);

export function make(tag, attributes = {}, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

export function say(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

export function set(node, name, value) {
  if (value === null || value === undefined || value === false) node.removeAttribute(name);
  else if (node.getAttribute(name) !== String(value === true ? "" : value)) node.setAttribute(name, value === true ? "" : value);
}

const SHAPES = {
  CLEAR: [["circle", { cx: 12, cy: 12, r: 9, fill: "none", stroke: "currentColor", "stroke-width": 2.5 }]],
  LUMP: [["path", { d: "M12 1 L23 22 H1 Z", fill: "currentColor" }]],
  BLIND: [["rect", { x: 2, y: 2, width: 20, height: 20, fill: "none", stroke: "currentColor", "stroke-width": 3 }], ["path", { d: "M3 21 L21 3", stroke: "currentColor", "stroke-width": 3 }]],
  SILENT: [["circle", { cx: 12, cy: 12, r: 9.5, fill: "none", stroke: "currentColor", "stroke-width": 3, "stroke-dasharray": "4 3" }], ["path", { d: "M7 12 h10", stroke: "currentColor", "stroke-width": 3 }]],
  BLOCKED: [["path", { d: "M7 1 H17 L23 7 V17 L17 23 H7 L1 17 V7 Z", fill: "currentColor" }]],
  SYSTEM: [["path", { d: "M12 2 L22 12 L12 22 L2 12 Z", fill: "none", stroke: "currentColor", "stroke-width": 3 }]],
};

export function mark(holder, name) {
  if (holder.dataset.shape === name) return;
  holder.dataset.shape = name;
  const space = "http://www.w3.org/2000/svg";
  const svg = document.createElementNS(space, "svg");
  svg.setAttribute("viewBox", "0 0 24 24");
  svg.setAttribute("aria-hidden", "true");
  for (const [tag, attributes] of SHAPES[name] ?? SHAPES.SYSTEM) {
    const part = document.createElementNS(space, tag);
    for (const [key, value] of Object.entries(attributes)) part.setAttribute(key, value);
    svg.append(part);
  }
  holder.replaceChildren(svg);
}

let fading = 0;
export function toast(text, bad = false) {
  const box = document.getElementById("toast");
  box.textContent = text;
  box.classList.toggle("bad", bad);
  box.hidden = false;
  clearTimeout(fading);
  fading = setTimeout(() => { box.hidden = true; }, bad ? 12000 : 4000);
}

// A console that was started anew knows no session of before: any page begins one. False where a login is needed.
export async function renew() {
  const me = await fetch("/api/v1/me");
  if (!me.ok) return me.status !== 401;
  const told = await me.json();
  if (told.csrf) body.dataset.csrf = told.csrf;
  return true;
}

// A request to the API; what changes something carries the token of the session.
export async function call(path, method = "GET", content = undefined, again = true) {
  const headers = method === "GET" ? {} : { "X-CSRF-Token": body.dataset.csrf };
  const raw = content instanceof Blob;
  if (content !== undefined) headers["Content-Type"] = raw ? "application/octet-stream" : "application/json";
  const answer = await fetch(path, { method, headers, body: content === undefined ? undefined : raw ? content : JSON.stringify(content) }).catch(() => {
    throw new Error(`no connection to the console${method === "GET" ? "" : ": whether it was done is seen when it is back"}`);
  });
  const told = answer.status === 204 ? null : await answer.json().catch(() => null);
  if (answer.status === 403 && again && told?.error?.startsWith("X-CSRF-Token")) {
    await fetch("/health");
    await renew();
    return call(path, method, content, false);
  }
  if (!answer.ok) throw new Error(told?.error ?? `the console answers ${answer.status}`);
  return told;
}

// Times stand in the site's zone on every page, whatever the computer is set to; Swedish is written as ISO 8601 is.
const told = (options) => {
  try {
    return new Intl.DateTimeFormat("sv-SE", { ...options, timeZone: body.dataset.zone });
  } catch {
    return new Intl.DateTimeFormat("sv-SE", { ...options, timeZone: "UTC", timeZoneName: "short" }); // a zone that the browser does not know
  }
};
const TIME = { hour: "2-digit", minute: "2-digit", second: "2-digit" };
const clocks = [told(TIME), told({ ...TIME, year: "numeric", month: "2-digit", day: "2-digit" })];
export const clock = (iso) => clocks[0].format(new Date(iso));
export const moment = (iso) => clocks[1].format(new Date(iso));
export const place = (one) => `${one.camera} / ${one.roi}`;
