// What states, reasons and changes are called on every page.
const BLIND = {
  starting: "starting: too little seen yet", unfit: "region does not fit the picture", no_stream: "no picture comes", stale: "pictures come late", filter: "the filter fails",
  overload: "too slow to judge", frozen: "picture does not change", dark: "too dark", glare: "glare", moved: "camera has moved", dusty: "dust", hidden: "view is covered",
  blurred: "blurred", exposure: "exposure jumped", few_frames: "too few pictures to find a lump",
};
const OTHERS = {
  standing: "material stands in the mouth", lump: "a lump has not gone through", another_lump: "another lump", latency: "decisions come late", proof: "a proof test failed", prior: "a prior fails",
};

export const reason = (name) => BLIND[name] ?? OTHERS[name] ?? name ?? "";
export const plain = (name) => String(name ?? "").replaceAll("_", " ");
export const CLASS = { lump: "LUMP", blind: "BLIND", system: "SYSTEM", blocked: "BLOCKED" };

// Why a mouth counts as blocked, in a few words.
export function blockage(region) {
  const told = region.state?.blockage;
  if (!told) return "";
  return [reason(told.reason), told.stood_s >= 1 ? `for ${Math.floor(told.stood_s)} s` : ""].filter(Boolean).join(" ");
}

// A region that was never taught is no better than the net that ships: CLEAR means less there.
export const untrained = (region) => Boolean(region.state?.frame) && region.state.trained === false;
