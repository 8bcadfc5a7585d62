// Curves of the last seconds, the pins of a display as bars, a map of the receptors, and screenshots.

import { ramp } from "/scene.js";

const SPAN = 6; // [s]
const style = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function fresh(canvas) {
  const ratio = window.devicePixelRatio || 1, box = canvas.getBoundingClientRect();
  const paint = canvas.getContext("2d"), width = Math.floor(box.width * ratio), height = Math.floor(box.height * ratio);
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  else paint.reset();
  paint.scale(ratio, ratio); paint.font = "11px system-ui, sans-serif";
  return { paint, w: box.width, h: box.height };
}

// Captions above a curve: its quantity and largest value on the left; its time span on the right, if there is room.
function caption(paint, w, left, right) {
  paint.fillStyle = style("--faint"); paint.fillText(left, 0, 10);
  paint.textAlign = "right";
  if (paint.measureText(`${left}  ${right}`).width < w) paint.fillText(right, w, 10);
}

const BASE = 14; // [px] room for the labels of the time axis

// Ticks with labels: at most 3 round values between low and high on the left, and round times [s] at the bottom.
function ticks(paint, w, h, x, y, [low, high], [begin, end], origin = 0) {
  paint.fillStyle = style("--faint"); paint.strokeStyle = style("--line"); paint.lineWidth = 1; paint.setLineDash([]);
  paint.beginPath();
  for (const value of round(low, high, 3)) {
    paint.moveTo(0, y(value)); paint.lineTo(w, y(value));
    if (y(value) > 20 && value !== 0) paint.fillText(String(value), 1, y(value) - 2);
  }
  for (const time of round(begin - origin, end - origin, Math.max(2, Math.floor(w / 40)))) {
    const at = x(time + origin);
    paint.moveTo(at, h - BASE); paint.lineTo(at, h - BASE + 4);
    paint.textAlign = at < 14 ? "left" : at > w - 14 ? "right" : "center";
    paint.fillText(`${time}${time === 0 || at > w - 14 ? " s" : ""}`, at, h - 1);
  }
  paint.textAlign = "left"; paint.stroke();
}

// Multiples of 1, 2 or 5 times a power of ten from low to high: the finest step with at most `count` of them.
export function round(low, high, count) {
  const span = Math.max(high - low, 1e-12), power = 10 ** Math.floor(Math.log10(span / count));
  const step = [1, 2, 5, 10].map((k) => k * power).find((s) => Math.floor(high / s + 1e-9) - Math.ceil(low / s - 1e-9) < count) ?? 20 * power;
  const out = [], digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  for (let k = Math.ceil(low / step - 1e-9); k <= high / step + 1e-9; k++) out.push(Number((k * step).toFixed(digits)) + 0);
  return out;
}

// The curve of the first finger is solid, those of the others are dashed.
const stroke = (paint, colour, finger) => { paint.strokeStyle = colour; paint.setLineDash(finger ? [4 / finger, 2] : []); paint.beginPath(); };

export class Strip {
  constructor(canvas, name, unit, colour, least) { Object.assign(this, { canvas, name, unit, colour, least, lines: [] }); }

  clear() { this.lines = []; }

  add(times, values, finger = 0) {
    let line = (this.lines[finger] ??= { times: [], values: [] });
    if (times.length && times[0] < line.times.at(-1)) this.lines[finger] = line = { times: [], values: [] };
    line.times.push(...times); line.values.push(...values);
    const old = line.times.findIndex((t) => t > line.times.at(-1) - SPAN);
    if (old > 0) { line.times.splice(0, old); line.values.splice(0, old); }
  }

  draw(band) {
    const { paint, w, h } = fresh(this.canvas), now = this.lines[0]?.times.at(-1) ?? 0;
    let high = this.least;
    for (const { values } of this.lines) for (const v of values) if (v > high) high = v;
    if (band) high = Math.max(high, band[1]);
    const x = (t) => w - ((now - t) / SPAN) * w, y = (v) => h - BASE - (v / high) * (h - 15 - BASE);
    ticks(paint, w, h, x, y, [0, high], [now - SPAN, now], now);
    if (band) { paint.fillStyle = this.colour + "33"; paint.fillRect(0, y(band[1]), w, y(band[0]) - y(band[1])); }
    paint.lineWidth = 1.8; paint.lineJoin = "round";
    this.lines.forEach(({ times, values }, finger) => {
      stroke(paint, this.colour, finger);
      const step = Math.max(1, Math.floor(values.length / (2 * w)));
      for (let i = 0; i < values.length; i += step) {
        let top = values[i];
        for (let k = i; k < Math.min(i + step, values.length); k++) top = Math.max(top, values[k]);
        paint.lineTo(x(times[i]), y(top));
      }
      paint.stroke();
    });
    caption(paint, w, `${this.name} to ${high.toPrecision(2)} ${this.unit}`, `last ${SPAN} s`);
  }
}

// A curve over a whole recording, with a cursor at the current time.
export class Record {
  constructor(canvas, name, unit, colour, lines) { Object.assign(this, { canvas, name, unit, colour, lines }); }

  draw(now, band) {
    const { paint, w, h } = fresh(this.canvas), { times } = this.lines[0], [begin, end] = [times[0], times.at(-1)];
    let low = 0, high = 1e-9;
    for (const { values } of this.lines) for (const v of values) { if (v > high) high = v; if (v < low) low = v; }
    const x = (t) => ((t - begin) / Math.max(end - begin, 1e-9)) * w, y = (v) => h - BASE - ((v - low) / (high - low)) * (h - 15 - BASE);
    ticks(paint, w, h, x, y, [low, high], [begin, end]);
    paint.lineWidth = 1.4; paint.lineJoin = "round";
    this.lines.forEach((line, finger) => {
      stroke(paint, this.colour, finger);
      line.times.forEach((t, i) => paint.lineTo(x(t), y(line.values[i])));
      paint.stroke();
    });
    paint.setLineDash([]);
    if (band) { paint.fillStyle = this.colour + "33"; paint.fillRect(x(now) - 6, y(band[1]), 12, y(band[0]) - y(band[1])); }
    paint.strokeStyle = style("--ink"); paint.lineWidth = 1; paint.beginPath(); paint.moveTo(x(now), 12); paint.lineTo(x(now), h - BASE); paint.stroke();
    caption(paint, w, `${this.name} to ${high.toPrecision(2)} ${this.unit}`, `${begin.toFixed(1)} to ${end.toFixed(1)} s`);
  }
}

export function bars(canvas, heights) {
  canvas.hidden = !heights;
  if (!heights) return;
  const { paint, w, h } = fresh(canvas), rows = heights.length, columns = heights[0].length;
  const all = heights.flat(), low = Math.min(...all), span = Math.max(Math.max(...all) - low, 1e-4);
  const wide = w / (columns + 0.4 * rows), room = h - 20; // below the caption
  heights.forEach((row, r) => row.forEach((value, c) => {
    const tall = 4 + ((value - low) / span) * 0.6 * room, left = c * wide + 0.4 * r * wide, foot = h - (rows - 1 - r) * (0.4 * room / rows);
    paint.fillStyle = `hsl(205 60% ${38 + 30 * (r / Math.max(rows - 1, 1))}%)`;
    paint.fillRect(left, foot - tall, 0.8 * wide, tall);
  }));
  caption(paint, w, `pins, lowest to highest: ${(1e3 * span).toFixed(2)} mm`, "");
}

// A map of the finger's receptors, coloured by firing rate [1/s]: SA1 and RA1 as dots, PC as rings.
export function spots(canvas, receptors, rates, means) {
  canvas.hidden = !rates?.length || !receptors?.x;
  if (canvas.hidden) return;
  const { paint, w, h } = fresh(canvas), reach = Math.max(...receptors.x.map(Math.abs), ...receptors.y.map(Math.abs), 1e-3);
  const scale = (h / 2 - 10) / reach, most = Math.max(...rates, 50);
  rates.forEach((rate, i) => {
    const kind = receptors.kind[i], share = rate / most;
    paint.strokeStyle = paint.fillStyle = share < 0.01 ? style("--faint") : `hsl(${30 - 40 * share} 80% ${62 - 30 * share}%)`;
    paint.beginPath();
    paint.arc(w / 2 + scale * receptors.x[i], h / 2 + 6 - scale * receptors.y[i], share < 0.01 ? 0.8 : [2.6, 1.7, 3.4][kind], 0, 7);
    if (kind === 2) paint.stroke(); else paint.fill();
  });
  const text = means.map((mean, kind) => `${["SA1", "RA1", "PC"][kind]} ${mean.toFixed(0)}`).join(", ");
  caption(paint, w, `spikes per second: ${text}`, "");
}

// Save a scene, which must just have been drawn, as a PNG with lines of text and a colour bar from 0 to `top` of `what`.
export function shot(scene, lines, top, what, name) {
  const { canvas, labels } = scene, ratio = canvas.width / canvas.clientWidth, paper = document.createElement("canvas"), paint = paper.getContext("2d");
  const high = canvas.clientHeight, line = 19, scale = document.createElement("canvas");
  Object.assign(paper, { width: canvas.width, height: canvas.height + Math.round((line * (lines.length + 1) + 14) * ratio) });
  paint.fillStyle = style("--ground"); paint.fillRect(0, 0, paper.width, paper.height);
  paint.drawImage(canvas, 0, 0); paint.scale(ratio, ratio);
  paint.font = "14px system-ui, sans-serif"; paint.fillStyle = style("--ink"); paint.textBaseline = "middle";
  for (const { textContent, style: { left, top: at } } of labels) paint.fillText(textContent, parseFloat(left) + 17, parseFloat(at));
  lines.forEach((text, k) => paint.fillText(text, 12, high + 12 + k * line));
  Object.assign(scale, { width: 180, height: 12 }); ramp(scale);
  const y = high + 12 + lines.length * line;
  paint.fillText("0", 12, y); paint.drawImage(scale, 26, y - 6); paint.fillText(`${top}  ${what}`, 212, y);
  const link = document.createElement("a");
  link.download = `${name.replace(/^.*\//, "").replace(/\.mcap$/, "")}.png`; link.href = paper.toDataURL("image/png"); link.click();
}
