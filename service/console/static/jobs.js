// What lists of work and the page of one have in common.
import { call, clock, make, toast } from "./dom.js";

export const active = (job) => ["queued", "running"].includes(job.state);

export function bar(job) {
  if (job.state !== "running") return [make("span", {}, job.said)];
  const { stage, done, total } = job.progress ?? { stage: "begins", done: 0, total: null };
  const given = total ? { value: done / total, max: 1 } : {};
  return [make("progress", { "aria-label": `Progress of ${job.kind}`, ...given }), make("span", { class: "note" }, total ? `${stage} ${done} of ${total}` : stage)];
}

export async function act(path, method, then) {
  try {
    await call(path, method, method === "DELETE" ? undefined : {});
    await then();
  } catch (error) {
    toast(error.message, true);
  }
}

export function row(job, changed) {
  const address = `/api/v1/jobs/${job.id}`;
  return make("tr", { "data-job": job.id, "data-state": job.state },
    make("td", { class: "state" }, job.state), make("td", {}, make("a", { href: `/jobs/${job.id}` }, job.kind)), make("td", {}, job.about),
    make("td", {}, job.by), make("td", {}, clock(job.asked)), make("td", { class: "progress" }, ...bar(job)),
    make("td", { class: "actions" }, active(job)
      ? make("button", { type: "button", "aria-label": `Cancel ${job.kind} of ${job.about}`, onclick: () => act(`${address}/cancel`, "POST", changed) }, "Cancel")
      : make("button", { type: "button", "aria-label": `Remove ${job.kind} of ${job.about}`, onclick: () => act(address, "DELETE", changed) }, "Remove")));
}
