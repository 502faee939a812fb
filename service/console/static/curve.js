// A curve of existence from 0 to 1: points are [x, value], x from `from` to `to`.
export function curve(canvas, points, from, to, threshold, cursor = null) {
  const context = canvas.getContext("2d");
  const { width, height } = canvas;
  const x = (at) => ((at - from) / (to - from)) * width;
  const y = (value) => height - 8 - value * (height - 16);
  context.clearRect(0, 0, width, height);
  context.strokeStyle = "#9aa0a6";
  context.lineWidth = 1;
  for (const level of [0, 0.5, 1]) {
    context.beginPath();
    context.moveTo(0, y(level));
    context.lineTo(width, y(level));
    context.stroke();
  }
  if (threshold !== null) {
    context.strokeStyle = "#b3001b";
    context.setLineDash([6, 5]);
    context.beginPath();
    context.moveTo(0, y(threshold));
    context.lineTo(width, y(threshold));
    context.stroke();
    context.setLineDash([]);
  }
  context.strokeStyle = "#1c2126";
  context.lineWidth = 2;
  context.beginPath();
  let last = null;
  for (const [at, value] of points) {
    if (last === null || Math.abs(at - last) > 1.5) context.moveTo(x(at), y(value));
    else context.lineTo(x(at), y(value));
    last = at;
  }
  context.stroke();
  if (cursor !== null) {
    context.strokeStyle = "#1c4f82";
    context.beginPath();
    context.moveTo(x(cursor), 0);
    context.lineTo(x(cursor), height);
    context.stroke();
  }
}

// Objects of a frame: box, size and time to the lip. `to` maps full-frame pixels to the canvas.
export function objects(context, found, to, scale) {
  context.font = `bold ${Math.round(15 * scale)}px "DejaVu Sans", sans-serif`;
  for (const one of found ?? []) {
    const [x, y] = to(one.x, one.y);
    const [right, bottom] = to(one.x + one.w, one.y + one.h);
    const sure = one.existence >= 0.5;
    context.strokeStyle = "#000";
    context.lineWidth = 5 * scale;
    context.strokeRect(x, y, right - x, bottom - y);
    context.strokeStyle = sure ? "#ff4d5e" : "#ffffff";
    context.lineWidth = 2.5 * scale;
    context.strokeRect(x, y, right - x, bottom - y);
    const size = one.size?.longest_mm ? `${Math.round(one.size.longest_mm)} mm` : "";
    const lip = one.size && one.size.lip_s !== null ? `${Math.max(0, one.size.lip_s).toFixed(1)} s` : "";
    const text = [size, lip, `${Math.round(100 * one.existence)} %`].filter(Boolean).join("  ");
    const wide = context.measureText(text).width + 10 * scale;
    const top = Math.max(0, y - 24 * scale);
    const left = Math.max(0, Math.min(x, context.canvas.width - wide));
    context.fillStyle = "#000c";
    context.fillRect(left, top, wide, 22 * scale);
    context.fillStyle = "#fff";
    context.fillText(text, left + 5 * scale, top + 16 * scale);
  }
}
