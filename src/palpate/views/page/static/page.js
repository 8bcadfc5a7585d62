// The page of `palpate touch` and `run --view`: receives frames, and sends samples of the pointer and switches.

import { Scene, each, figures, fingers, lines, offer, painted, ramp, sends, write } from "/scene.js";
import { Strip, bars, shot, spots } from "/charts.js";
import { panel } from "/panel.js";
import { Bodies, list } from "/model.js";
import { HardCases } from "/hard.js";
import { Sound } from "/sound.js";
import { connect } from "/engine.js";

const $ = (id) => document.getElementById(id);
const HOVER = 0.006; // [m] above the surface while nothing is pressed
const LOST = "Please tell the experimenter. Your answers up to now are stored.";
const ENOUGH = 27; // [1/s] sufficient frame rate; the server sends at most 30
const strips = [new Strip($("forces"), "normal force", "N", "#2f7fb8", 0.5), new Strip($("depths"), "indentation", "mm", "#c2506a", 2)];
const aim = { x: 0, y: 0.1, down: false, turning: false, fingers: new Map() };
const bodies = new Bodies(order), hard = new HardCases(order, () => point()), sound = new Sound($("sound"));
let scene, engine, about, newest, experiment, status = "connecting", paused = false, sample = 0, dirty = true, sent = new Map();

try { scene = new Scene($("view")); } catch (error) { $("status").textContent = error.message; throw error; }
const page = { frames: 0, latency: undefined, get newest() { return newest?.head; }, get about() { return about; }, scene, sound };
window.palpate = page; // for tests and the browser's console

function closed() {
  state(experiment ? "closed" : "the run has ended: start palpate touch again");
  if (experiment && !experiment.over) panel({ shown: -1, title: "The connection is lost", text: LOST }, order);
}

// Show the status of the run. A pause of the page is shown only while the run is active.
function state(text) {
  status = text;
  $("status").textContent = paused && text === "running" ? "paused: the run continues" : text;
}

function say(told) {
  if (told.kind === "status") {
    state(told.text);
    $("keep").setAttribute("aria-pressed", String(told.keep));
    experiment = told.panel; panel(experiment, order);
    if (told.text.startsWith("stopped")) hard.fail(told.text);
  } else if (told.kind === "figures") bodies.show(told.figures);
  else if (told.kind === "device") $("device").setAttribute("aria-pressed", String(told.on));
  else state(told.text);
}

function take(data) {
  const length = new DataView(data).getUint32(0, true), head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const [a, b, c] = head.sizes, at = 4 + length;
  const indices = new Uint32Array(data, at, a), first = new Float32Array(data, at + 4 * a, b), second = new Float32Array(data, at + 4 * (a + b), c);
  if (head.kind === "mesh") return begin(head, indices, first, second);
  if (!about || paused) return;
  const still = experiment && !experiment.show?.includes("deformation"); // the experiment hides the deformation
  newest = { head, nodes: still ? new Uint32Array() : indices, displacement: still ? new Float32Array() : first, pressure: still ? new Float32Array() : second };
  if (experiment && !experiment.show?.includes("force")) for (const one of each(head)) one.force = [0, 0, 0];
  tally.came++;
  each(head).forEach(({ t, f, s }, k) => { strips[0].add(t, f, k); strips[1].add(t, s.map((x) => 1e3 * x), k); });
  const answered = Math.max(...each(head).map((one) => one.sample ?? 0));
  if (answered && sent.has(answered)) {
    page.latency = performance.now() - sent.get(answered);
    for (const number of sent.keys()) if (number <= answered) sent.delete(number);
  }
  bodies.took(head.cost); hard.take(each(head), newest.displacement); sound.take(each(head));
  dirty = true;
}

function begin(head, triangles, places, normals) {
  about = head; newest = undefined; sent.clear(); page.latency = undefined; aim.sides = undefined;
  document.body.classList.toggle("watch", Boolean(head.watch)); // the page shows the run but cannot steer it
  scene.mesh(places, normals, triangles);
  strips.forEach((strip) => strip.clear());
  const names = head.bodies.includes(head.body) ? head.bodies : [head.body, ...head.bodies];
  $("body").replaceChildren(...names.map((name) => new Option(name.split(".").pop(), name, false, name === head.body)));
  for (const name of ["scene", "organ"]) {
    const offered = head[`${name}s`] ?? [];
    $(name).replaceChildren(...offered.map((one) => new Option(one, one, false, one === head[name])));
    $(name).parentElement.hidden = offered.length < 2;
  }
  const count = head.fingers.length, kept = $("finger").options.length === count + 1 ? $("finger").value : "-1";
  $("finger").replaceChildren(new Option("together", -1), ...head.fingers.map((name, k) => new Option(`${k + 1}: ${name.replace(/[-_.]?contact[-_.]?/i, "") || name}`, k)));
  $("finger").value = kept; $("finger").parentElement.hidden = count < 2;
  $("effects").replaceChildren(...Object.entries(head.effects ?? {}).map(([name, on]) => {
    const label = document.createElement("label"), box = Object.assign(document.createElement("input"), { type: "checkbox", checked: on });
    box.dataset.effect = name;
    box.addEventListener("change", () => order({ effect: [name, box.checked] }));
    label.append(box, name);
    return label;
  }));
  list(head.plan); bodies.begin(head); hard.begin(head); sound.offer(head.sounds);
  dirty = true; point();
}

function show() {
  requestAnimationFrame(show);
  gamepad(); pace(performance.now());
  if (!dirty) return;
  dirty = false; page.frames++; tally.drawn++;
  if (newest) {
    const { most, text, what } = painted([[scene, newest]], $("colour").value);
    scene.full = most; write($("top"), text); write($("what"), what);
    const { head } = newest;
    if (newest.nodes.length) offer($("colour"), sends(newest));
    tell(head);
  }
  draw();
}

// If the browser draws fewer frames than arrive, reduce the resolution: a smooth movement matters more than sharpness.
const tally = { came: 0, drawn: 0, since: performance.now() };
function pace(moment) {
  const seconds = 1e-3 * (moment - tally.since);
  if (seconds < 1) return;
  const came = tally.came / seconds, drawn = tally.drawn / seconds;
  if (came > ENOUGH && drawn < ENOUGH && !document.hidden) scene.sharp = Math.max(0.5, scene.sharp - 0.1);
  Object.assign(tally, { came: 0, drawn: 0, since: moment });
}

function draw() { scene.draw(fingers(newest)); }

function tell(head) {
  for (const [id, text] of Object.entries(figures(head))) write($(id), text);
  write($("beside"), `${head.time.toFixed(1)} s · ${head.late} late ticks${page.latency === undefined ? "" : ` · ${page.latency.toFixed(0)} ms from pointer to frame`}`);
  strips[0].draw(head.load > 0 ? head.band : null); strips[1].draw();
  bars($("pins"), head.pins);
  spots($("spikes"), about.receptors, head.rates, head.mean_rates);
}

// -- the pointer -----------------------------------------------------------------------------------------------

function point() {
  if (!about || about.watch || !engine.takes({ point: true }) || paused) return;
  const { x, y, down, depth } = hard.aim ?? { ...aim, depth: 1e-3 * Number($("press").value) };
  const hit = scene.pick(x, y);
  if (hit) aim.hit = hit;
  if (!aim.hit) return;
  const lift = about.thickness + (down && hit ? -depth : HOVER);
  sample++;
  if (newest) sent.set(sample, performance.now()); // before the first frame, the start of the run would count as latency
  if (sent.size > 500) sent.delete(sent.keys().next().value);
  for (const [finger, { place, normal }] of steered()) {
    engine.send({ point: [sample, place.map((x, i) => x + lift * normal[i]), down ? 1 : 0], finger });
  }
}

// The fingers that the pointer steers, and their goals: the chosen finger, or all. Each of several fingers stays on its side of
// the organ, under the pointer or opposite to it, so that none is dragged through the organ. On an open surface the fingers keep
// the distances that they have at the start.
function steered() {
  const { begins } = about, chosen = Number($("finger").value), other = begins.length > 1 ? scene.opposite(aim.hit) : null;
  aim.sides ??= begins.map((begin) => begin.map((x, i) => x - scene.centre[i]));
  const near = ({ normal }, k) => normal.reduce((sum, x, i) => sum + x * aim.sides[k][i], 0);
  const own = (k) => (other && near(other, k) > near(aim.hit, k) ? other : aim.hit);
  const beside = (k) => ({ ...aim.hit, place: aim.hit.place.map((x, i) => x + begins[k][i] - begins[0][i]) });
  const first = own(0), far = first === other ? aim.hit : other;
  const goals = chosen >= 0 ? [[chosen, own(chosen)]] : begins.map((_, k) => [k, k ? (other ? far : beside(k)) : first]);
  for (const [k, { normal }] of goals) aim.sides[k] = normal;
  return goals;
}

// Choose the finger to steer; the previous one stays where it is, pressing or not.
function choose(finger) {
  if (finger >= -1 && finger < about.fingers.length && about.fingers.length > 1) { $("finger").value = finger; point(); }
}

function order(what) { if (engine.takes(what)) engine.send(what); }

function place(event) {
  const box = $("view").getBoundingClientRect();
  aim.x = (2 * (event.clientX - box.left)) / box.width - 1; aim.y = 1 - (2 * (event.clientY - box.top)) / box.height;
}

function turn(dx, dy) {
  scene.azimuth -= 0.008 * dx; scene.height = Math.min(Math.max(scene.height + 0.008 * dy, -1.5), 1.5); dirty = true;
}

function press(by) {
  $("press").value = Number($("press").value) + by;
  $("pressed").textContent = `${$("press").value} mm`; point();
}

const view = $("view");
view.addEventListener("pointerdown", (event) => {
  view.setPointerCapture(event.pointerId); view.focus();
  aim.fingers.set(event.pointerId, event);
  aim.turning = event.button === 2 || event.shiftKey || aim.fingers.size > 1 || Boolean(about?.watch);
  aim.down = !aim.turning; if (aim.down) place(event);
  point();
});
view.addEventListener("pointermove", (event) => {
  const before = aim.fingers.get(event.pointerId);
  if (aim.turning) {
    if (before) { turn(event.clientX - before.clientX, event.clientY - before.clientY); aim.fingers.set(event.pointerId, event); }
  } else { place(event); point(); }
});
for (const name of ["pointerup", "pointercancel"]) view.addEventListener(name, (event) => {
  aim.fingers.delete(event.pointerId); aim.down = false;
  if (!aim.fingers.size) aim.turning = false;
  point();
});
view.addEventListener("contextmenu", (event) => event.preventDefault());
view.addEventListener("wheel", (event) => {
  event.preventDefault();
  if (event.ctrlKey) { scene.distance *= Math.exp(0.002 * event.deltaY); dirty = true; } else press(event.deltaY < 0 ? 0.5 : -0.5);
}, { passive: false });
const STEPS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
view.addEventListener("keydown", (event) => {
  const step = STEPS[event.key];
  if (step && (event.shiftKey || about?.watch)) turn(12 * step[0], -12 * step[1]);
  else if (step) { aim.x += 0.02 * step[0]; aim.y += 0.02 * step[1]; point(); }
  else if (event.key === " ") { if (!event.repeat) { aim.down = true; point(); } }
  else if (event.key === "+" || event.key === "=") press(0.5);
  else if (event.key === "-") press(-0.5);
  else if (/^\d$/.test(event.key)) choose(Number(event.key) - 1);
  else return;
  event.preventDefault();
});
view.addEventListener("keyup", (event) => { if (event.key === " ") { aim.down = false; point(); } });
window.addEventListener("blur", () => { aim.down = false; point(); });

// Left stick aims, right stick turns, a trigger or the first button presses, the shoulders set the depth.
const held = {};
function gamepad() {
  const pad = [...(navigator.getGamepads?.() ?? [])].find((one) => one?.axes.length >= 2);
  if (!pad) return;
  const [x, y, u = 0, v = 0] = pad.axes.map((a) => (Math.abs(a) > 0.15 ? a : 0)), on = (k) => Boolean(pad.buttons[k]?.pressed || pad.buttons[k]?.value > 0.1);
  const once = (k) => { const was = held[k]; held[k] = on(k); return held[k] && !was; };
  if (u || v) turn(-6 * u, 6 * v);
  if (once(5)) press(0.5);
  if (once(4)) press(-0.5);
  const down = on(0) || on(7), moved = x || y;
  aim.x = Math.min(Math.max(aim.x + 0.012 * x, -1), 1); aim.y = Math.min(Math.max(aim.y - 0.012 * y, -1), 1);
  if (moved || down !== Boolean(held.down)) { held.down = down; aim.down = down; point(); }
}

// -- switches --------------------------------------------------------------------------------------------------

$("press").addEventListener("input", () => press(0));
$("body").addEventListener("change", (event) => order({ body: event.target.value }));
for (const name of ["scene", "organ"]) $(name).addEventListener("change", (event) => order({ [name]: event.target.value }));
$("reset").addEventListener("click", () => order({ reset: true }));
$("keep").addEventListener("click", () => order({ keep: $("keep").getAttribute("aria-pressed") !== "true" }));
$("download").addEventListener("click", () => order({ download: true }));
$("replay").addEventListener("click", () => $("file").click());
$("file").addEventListener("change", () => { for (const file of $("file").files) order({ replay: file }); $("file").value = ""; });
$("device").addEventListener("click", () => order({ device: $("device").getAttribute("aria-pressed") !== "true" }));
$("colour").addEventListener("change", () => { dirty = true; });
$("pause").addEventListener("click", () => {
  if (!paused) { aim.down = false; point(); }
  sent.clear(); // frames are ignored during a pause, so no latency can be measured
  paused = !paused; $("pause").setAttribute("aria-pressed", String(paused));
  $("pause").textContent = paused ? "resume" : "pause"; state(status);
});
$("shot").addEventListener("click", () => {
  const sharp = scene.sharp;
  scene.sharp = 1; draw(); scene.sharp = sharp; // WebGL clears its buffer after each display, so draw again
  if (newest) shot(scene, lines(newest.head, about), $("top").textContent, $("what").textContent || $("colour").value, `${about.recording ?? "palpate"}`.replace(/\.mcap$/, "") + `-${newest.head.time.toFixed(3)}s`);
});
window.addEventListener("resize", () => { scene.sharp = 1; dirty = true; });
$("more").open = matchMedia("(min-width: 860px) and (min-height: 760px)").matches; // there is room
ramp($("scale"));
engine = connect({ told: say, came: take, closed });
for (const name of ["download", "replay"]) $(name).hidden = !engine.downloads;
$("device").hidden = !engine.devices;
$("keep").hidden = engine.downloads; // a page without a server writes no files
show();
