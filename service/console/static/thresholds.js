// A backtest's curve: lumps announced in time and false alarms an hour at every threshold, with one of them chosen.
import { make, say } from "./dom.js";

const byId = (id) => document.getElementById(id);
const percent = (share) => (share === null ? "–" : `${(100 * share).toFixed(0)} %`);

export class Thresholds {
  constructor(found) {
    this.found = found;
    this.result = found.results[0];
    this.points = this.result.curve;
    this.slider = byId("slider");
    this.canvas = byId("curve");
  }

  show() {
    const used = this.result.configured.raise_above;
    const at = this.points.findIndex((point) => point.raise_above >= used - 1e-9);
    this.slider.max = this.points.length - 1;
    this.slider.value = at < 0 ? this.points.length - 1 : at;
    this.slider.addEventListener("input", () => this.choose());
    const best = this.result.recommended;
    const wanted = this.found.wanted_false_alarms_per_hour;
    const clips = `${(60 * this.found.hours).toFixed(1)} minutes of footage`;
    say(byId("advice"), best ? `${clips}: recommended ${best.raise_above}; in use ${used}.` : `${clips}: no threshold keeps false alarms below ${wanted} an hour; in use ${used}.`);
    this.choose();
  }

  choose() {
    const point = this.points[Number(this.slider.value)];
    say(byId("threshold"), String(point.raise_above));
    this.slider.setAttribute("aria-valuetext", `threshold ${point.raise_above}`);
    const figures = {
      "lumps announced in time": `${point.announced} of ${point.lumps}`, share: percent(point.detection_rate),
      "false alarms": String(point.false_alarms), "an hour": point.false_alarms_per_hour?.toFixed(1) ?? "–",
      "median warning": point.warning_median_s === null ? "–" : `${point.warning_median_s.toFixed(1)} s`,
    };
    byId("point").replaceChildren(...Object.entries(figures).map(([name, value]) => make("div", {}, make("dt", {}, name), make("dd", {}, value))));
    this.draw(point);
  }

  draw(chosen) {
    const pen = this.canvas.getContext("2d");
    const [width, height, pad] = [this.canvas.width, this.canvas.height, 84];
    const most = Math.max(1, ...this.points.map((point) => point.false_alarms_per_hour ?? 0));
    const x = (i) => pad + (i / Math.max(1, this.points.length - 1)) * (width - 2 * pad);
    const y = (share) => height - 40 - share * (height - 80);
    pen.clearRect(0, 0, width, height);
    pen.font = "20px sans-serif";
    pen.lineWidth = 1;
    pen.strokeStyle = "#9aa0a6";
    pen.fillStyle = "#1c2126";
    for (const share of [0, 0.5, 1]) {
      pen.beginPath(); pen.moveTo(pad, y(share)); pen.lineTo(width - pad, y(share)); pen.stroke();
      pen.textAlign = "right"; pen.fillText(`${100 * share} %`, pad - 6, y(share) + 7);
      pen.textAlign = "left"; pen.fillText((share * most).toFixed(most < 10 ? 1 : 0), width - pad + 6, y(share) + 7);
    }
    const line = (value, colour, dash) => {
      pen.strokeStyle = colour; pen.lineWidth = 3; pen.setLineDash(dash); pen.beginPath();
      this.points.forEach((point, i) => pen[i ? "lineTo" : "moveTo"](x(i), y(value(point))));
      pen.stroke(); pen.setLineDash([]);
    };
    line((point) => point.detection_rate ?? 0, "#1c4f82", []);
    line((point) => (point.false_alarms_per_hour ?? 0) / most, "#8a0014", [9, 6]);
    const i = this.points.indexOf(chosen);
    pen.strokeStyle = "#1c2126"; pen.lineWidth = 2; pen.beginPath(); pen.moveTo(x(i), y(0)); pen.lineTo(x(i), y(1)); pen.stroke();
    pen.textAlign = "center";
    for (const j of [0, Math.floor(this.points.length / 2), this.points.length - 1]) pen.fillText(String(this.points[j].raise_above), x(j), height - 12);
    pen.textAlign = "left"; pen.fillStyle = "#1c4f82"; pen.fillText("announced in time", pad + 10, 24);
    pen.fillStyle = "#8a0014"; pen.fillText("false alarms an hour", pad + 240, 24);
  }
}
