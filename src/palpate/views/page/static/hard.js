// Runs a hard case: when its run has begun, the pointer presses at once, slides and lifts; then the outcome is reported.

const $ = (id) => document.getElementById(id);
const PRESS = 0.3, SLIDE = 1.3, LIFT = 2.0, END = 3.0; // [s] of the run, when each stage begins
const MIDDLE = [0, 0.1], ASIDE = 0.25; // place of the pointer in the picture, and the length of its slide

export class HardCases {
  // order: sends a request to the engine; point: sends the pointer.
  constructor(order, point) {
    this.point = point; this.running = null;
    $("hard").addEventListener("click", () => order({ hard: $("case").value }));
  }

  // A run has begun. hard: the cases that can be chosen; case: the one that this run is.
  begin({ hard, case: name, limit }) {
    const chosen = name ?? $("case").value;
    $("case").replaceChildren(...(hard ?? []).map((one) => new Option(one.title, one.name, false, one.name === chosen)));
    $("cases").hidden = !hard?.length;
    const found = (hard ?? []).find((one) => one.name === name);
    this.running = found ? { ...found, limit, stage: 0, hand: 0, contact: 0, after: 0, finite: true } : null;
    if (found) $("outcome").textContent = `${found.title}: running`;
  }

  // What the pointer does instead of that of the page; null: no case runs.
  get aim() {
    const one = this.running;
    if (!one) return null;
    const slide = Math.min(Math.max((one.time - SLIDE) / (LIFT - SLIDE), 0), 1) || 0;
    return { x: MIDDLE[0] + ASIDE * slide, y: MIDDLE[1], down: one.time >= PRESS && one.time < LIFT, depth: one.depth };
  }

  // A frame of the run: every finger with its curve since the last frame, and the displaced surface.
  take(fingers, displacement) {
    const one = this.running;
    if (!one) return;
    one.time = fingers[0].time;
    for (const { f, force = [0, 0, 0], tip = [] } of fingers) {
      one.hand = Math.max(one.hand, Math.hypot(...force)); one.contact = Math.max(one.contact, ...f);
      one.finite &&= [...f, ...force, ...tip].every(Number.isFinite);
    }
    one.finite &&= displacement.every(Number.isFinite);
    one.after = Math.max(...fingers.map(({ force = [0, 0, 0] }) => Math.hypot(...force)));
    this.point();
    if (one.time >= END) this.finish(one);
  }

  finish({ title, finite, hand, contact, after, limit }) {
    this.running = null; this.point();
    const bound = limit ? ` (limit ${limit} N${hand > limit ? ", exceeded" : ""})` : "";
    $("outcome").textContent = `${title}: ${finite ? "all numbers finite" : "a number is not finite"}, hand at most ${hand.toFixed(2)} N${bound}, contact at most ${contact.toFixed(2)} N, ${after.toFixed(2)} N after the lift`;
  }

  // The run has stopped; why: its status.
  fail(why) {
    if (!this.running) return;
    $("outcome").textContent = `${this.running.title}: ${why}`;
    this.running = null;
  }
}
