// Tracks as the server keeps them: key frames in order, and between two of them the box moves and grows evenly.
const SIDES = ["x", "y", "w", "h"];

export const span = (track) => [track.keys[0].frame, track.keys.at(-1).frame];

// The box of a track in a frame, or null outside of its first and last key frame.
export function boxAt(track, frame) {
  const [first, last] = span(track);
  if (frame < first || frame > last) return null;
  const after = track.keys.findIndex((key) => key.frame >= frame);
  const b = track.keys[after];
  if (b.frame === frame) return b;
  const a = track.keys[after - 1];
  const share = (frame - a.frame) / (b.frame - a.frame);
  return Object.fromEntries([["frame", frame], ...SIDES.map((side) => [side, a[side] + share * (b[side] - a[side])])]);
}

// Where a lump is likely to be beyond its first or last key frame: as it moved between the two next to it.
export function ghost(track, frame, [width, height]) {
  const late = frame > span(track)[1];
  const [a, b] = late ? track.keys.slice(-2) : track.keys.slice(0, 2).reverse();
  const near = b ?? a;
  const far = b ? a : null;
  const share = far ? (frame - near.frame) / (near.frame - far.frame) : 0;
  const on = (side) => (far ? near[side] + share * (near[side] - far[side]) : near[side]);
  const inside = (value, most) => Math.min(Math.max(0, value), Math.max(0, most));
  return { x: inside(on("x"), width - near.w), y: inside(on("y"), height - near.h), w: near.w, h: near.h };
}

export const isKey = (track, frame) => track.keys.some((key) => key.frame === frame);

// The track with this box as a key frame; the box is kept inside of the picture.
export function withKey(track, frame, box, [width, height]) {
  const round = (value) => Math.round(100 * value) / 100;
  const w = Math.min(Math.max(2, box.w), width);
  const h = Math.min(Math.max(2, box.h), height);
  const key = { frame, x: round(Math.min(Math.max(0, box.x), width - w)), y: round(Math.min(Math.max(0, box.y), height - h)), w: round(w), h: round(h) };
  const keys = [...track.keys.filter((one) => one.frame !== frame), key].sort((a, b) => a.frame - b.frame);
  return { ...track, keys };
}

// The track without this key frame; null where none is left.
export function withoutKey(track, frame) {
  const keys = track.keys.filter((one) => one.frame !== frame);
  return keys.length ? { ...track, keys } : null;
}

export const newId = (tracks) => Math.max(0, ...tracks.map((track) => track.id)) + 1;

export function neighbour(track, frame, step) {
  const frames = track.keys.map((key) => key.frame);
  return step > 0 ? frames.find((one) => one > frame) : frames.findLast((one) => one < frame);
}
