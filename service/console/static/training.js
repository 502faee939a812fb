// Clips in, a prior out: training, replay, backtest, reference and proof test, and what becomes of each version.
import { region } from "./common.js";
import { call, make, moment, say, toast } from "./dom.js";
import { active, row as jobRow } from "./jobs.js";

const byId = (id) => document.getElementById(id);
const main = byId("main");
const where = { camera: main.dataset.camera, roi: main.dataset.roi };
const priors = `${region(where)}/priors`;
const reference = `/api/v1/cameras/${encodeURIComponent(where.camera)}/reference`;
let jobs = [];
let clips = [];
const shown = new Map();

// Replaces the rows of a table only when they have changed: a button that is being pressed stays where it is.
function fill(table, rows, make_) {
  const text = JSON.stringify(rows);
  if (shown.get(table) === text) return;
  shown.set(table, text);
  byId(table).tBodies[0].replaceChildren(...rows.map(make_));
}

const usable = (clip) => clip.lumps > 0 || clip.empty;
const picked = () => [...document.querySelectorAll("#clips input:checked")].map((box) => box.value);

function clipRow(clip) {
  const labels = clip.lumps ? `${clip.lumps} lumps` : clip.empty ? "no lump comes" : "not labelled";
  return make("tr", {},
    make("td", {}, make("input", { type: "checkbox", value: clip.id, "aria-label": `Use ${clip.name}`, checked: usable(clip) })),
    make("td", {}, make("a", { href: `/clips/${clip.id}` }, clip.name)), make("td", { class: "number" }, (clip.frames / clip.fps).toFixed(1)), make("td", {}, labels));
}

async function order(given) {
  say(byId("wrong"), "");
  try {
    await call("/api/v1/jobs", "POST", { camera: where.camera, ...given });
    await work();
  } catch (error) {
    say(byId("wrong"), error.message);
  }
}

async function decide(given) {
  try {
    toast((await call(priors, "POST", given)).did);
    await versions();
  } catch (error) {
    toast(error.message, true);
  }
}

const button = (text, label, act) => make("button", { type: "button", "aria-label": label, onclick: act }, text);

function priorRow(prior) {
  const n = prior.version;
  const name = n ? `version ${n}` : "the stated defaults";
  const free = prior.state === "" && !prior.refused;
  return make("tr", { "data-version": n, "data-state": prior.state },
    make("td", { class: "state" }, prior.state || (prior.untried ? "never in use" : "")), make("td", {}, n ? String(n) : "stated defaults"),
    make("td", {}, prior.created ? moment(prior.created) : ""), make("td", {}, prior.refused ?? prior.source ?? ""), make("td", { class: "number" }, prior.lumps === undefined ? "" : String(prior.lumps)),
    make("td", { class: "actions" }, prior.report ? make("a", { class: "button", href: `${priors}/${n}/report`, "aria-label": `Report of ${name}` }, "Report") : null,
      free && n ? button("Shadow", `Run ${name} in shadow`, () => decide({ do: "shadow", version: n })) : null,
      free ? button("Use", `Use ${name}`, () => decide({ do: "use", version: n })) : null));
}

async function versions() {
  const told = await call(priors);
  fill("priors", [...told.versions, { version: 0, state: told.in_use === 0 ? "in use" : "" }], priorRow);
  say(byId("problems"), told.problems.join("; "));
  byId("trial").hidden = !told.trial;
  if (told.trial) {
    say(document.querySelector("#trial .version"), String(told.trial.version));
    say(document.querySelector("#trial pre"), told.trial.lines.length ? told.trial.lines.join("\n") : "nothing was counted yet: is the daemon running?");
    byId("promote").onclick = () => decide({ do: "promote", version: told.trial.version });
    byId("drop").onclick = () => decide({ do: "drop", version: told.trial.version });
  }
  byId("deeds").replaceChildren(...told.deeds.map((deed) => make("li", {}, `${moment(deed.time)}, ${deed.actor}: ${deed.did}`)));
}

async function limits() {
  const told = await call(reference);
  say(byId("reference"), told.in_use ? `Version ${told.in_use} is in use.` : "None was learned yet: what a fit picture looks like is judged by stated limits.");
  byId("limits").hidden = !told.limits.length;
  fill("limits", told.limits, (one) => make("tr", {}, make("td", {}, one.light), make("td", {}, one.roi), make("td", {}, one.measure),
    make("td", { class: "number" }, one.usual.toPrecision(3)), make("td", { class: "number" }, `${one.sign} ${one.unfit.toPrecision(3)}`)));
}

async function work() {
  const before = jobs.filter(active).length;
  jobs = (await call("/api/v1/jobs")).jobs;
  fill("jobs", jobs, (job) => jobRow(job, work));
  byId("none").hidden = jobs.length > 0;
  if (jobs.filter(active).length < before) await Promise.all([versions(), limits()]);
}

byId("train").addEventListener("submit", (event) => {
  event.preventDefault();
  const form = event.target.elements;
  order({ kind: "train", roi: where.roi, clips: picked(), folds: Number(form.folds.value), then: form.then.value });
});
const ORDERS = {
  replay: async () => {
    const shadow = document.querySelector("#trial:not([hidden]) .version")?.textContent;
    if (!picked().length) say(byId("wrong"), "choose a clip");
    for (const clip of picked()) await order({ kind: "replay", clip, shadow: shadow ? Number(shadow) : null });
  },
  backtest: () => order({ kind: "backtest", roi: where.roi, clips: picked() }),
  reference: () => order({ kind: "reference", clips: picked() }),
};
for (const node of document.querySelectorAll("[data-work]")) node.addEventListener("click", () => ORDERS[node.dataset.work]());
byId("proof").addEventListener("click", async () => {
  byId("proof").disabled = true;
  say(byId("proved"), "a synthetic lump runs down the belt; this takes a minute or two");
  try {
    const told = await call(`${region(where)}/commands/proof`, "POST", {});
    const warned = told.warning_s === null ? "no alarm" : `${told.warning_s.toFixed(1)} s of warning`;
    say(byId("proved"), `Proof test: ${told.outcome}${told.reason ? ` (${told.reason})` : ""}, ${warned}, existence up to ${told.existence.toFixed(2)}. ${told.shows}`);
  } catch (error) {
    say(byId("proved"), error.message);
  }
  byId("proof").disabled = false;
});

clips = (await call("/api/v1/clips")).clips.filter((clip) => clip.camera === where.camera);
fill("clips", clips, clipRow);
await Promise.all([work(), versions(), limits()]);
main.dataset.ready = "";
for (let turn = 0; ; turn += 1) {
  await new Promise((resolve) => setTimeout(resolve, 1000));
  if (document.hidden) continue;
  try {
    if (jobs.some(active) || turn % 5 === 0) await work();
    if (turn % 5 === 0) await versions();
  } catch (error) {
    say(byId("wrong"), error.message);
  }
}
