// One piece of work: how far it is, what it says, and what came of it.
import "./common.js";
import { call, make, say } from "./dom.js";
import { act, active } from "./jobs.js";
import { Thresholds } from "./thresholds.js";

const byId = (id) => document.getElementById(id);
const { job } = byId("main").dataset;
const address = `/api/v1/jobs/${job}`;
const NAMES = { "report.html": "Report", "proposals.html": "Pictures of the proposals", "lumps.csv": "Lumps (CSV)", "summary.json": "Summary", "shadow.json": "Shadow", "states.jsonl": "States", "alarms.jsonl": "Alarms", "backtest.json": "Backtest (JSON)", "proposals.txt": "Proposals (MOTChallenge)" };
let shown = "";

async function results(files) {
  byId("files").replaceChildren(...files.filter((file) => NAMES[file]).map((file) => make("li", {}, make("a", { class: "button", href: `${address}/files/${file}` }, NAMES[file]))));
  if (files.includes("overlay.mp4")) {
    byId("overlay").hidden = false;
    byId("overlay").querySelector("video").src = `${address}/files/overlay.mp4`;
  }
  if (files.includes("existence.png")) {
    byId("existence").hidden = false;
    byId("existence").querySelector("img").src = `${address}/files/existence.png`;
  }
  if (files.includes("backtest.json")) {
    const found = await call(`${address}/files/backtest.json`);
    if (found.results.length) {
      byId("backtest").hidden = false;
      new Thresholds(found).show();
    }
  }
}

async function load() {
  const told = await call(address);
  say(byId("state"), told.state);
  say(byId("why"), told.said);
  say(byId("log"), told.log || "nothing yet");
  byId("cancel").hidden = !active(told);
  byId("bar").hidden = told.state !== "running";
  const { stage, done, total } = told.progress ?? { stage: "begins", done: 0, total: null };
  const progress = byId("bar").querySelector("progress");
  if (total) progress.value = done / total;
  else progress.removeAttribute("value");
  say(byId("stage"), total ? `${stage} ${done} of ${total}` : stage);
  const files = told.files.join();
  if (!active(told) && files !== shown) {
    shown = files;
    await results(told.files);
  }
  byId("main").dataset.state = told.state;
  return active(told);
}

byId("cancel").addEventListener("click", () => act(`${address}/cancel`, "POST", load));
while (await load()) await new Promise((resolve) => setTimeout(resolve, 1000));
