// The page of `palpate view`: requests the frames of a time and draws them, one picture for each recording.

import { Scene, each, figures, fingers, lines, offer, painted, ramp } from "/scene.js";
import { Record, bars, shot, spots } from "/charts.js";

const $ = (id) => document.getElementById(id);
const STEP = 0.001; // [s]
const reels = [];
let socket, wanted = null, waiting = 0, time = 0, begin = 0, end = 1, playing = false, before = 0;
const READING = "reading the recordings";
const page = { frames: 0, reels, get time() { return time; }, get playing() { return playing; } };
window.palpate = page; // for tests and the browser's console

function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}/socket${location.search}`);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { $("status").textContent = READING; };
  socket.onmessage = ({ data }) => {
    if (typeof data === "string") { $("status").textContent = JSON.parse(data).text; waiting = 0; } else take(data);
  };
  socket.onclose = () => { playing = false; $("status").textContent = "palpate view has ended: start it again"; };
}

function take(data) {
  const length = new DataView(data).getUint32(0, true), head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
  const [a, b, c] = head.sizes, at = 4 + length;
  const indices = new Uint32Array(data, at, a), first = new Float32Array(data, at + 4 * a, b), second = new Float32Array(data, at + 4 * (a + b), c);
  if (head.kind === "mesh") return open(head, indices, first, second);
  const reel = reels[head.reel];
  reel.newest = { head, nodes: indices, displacement: first, pressure: second };
  if ($("status").textContent === READING && reels.every(({ newest }) => newest)) $("status").textContent = "";
  waiting = Math.max(0, waiting - 1);
  if (!waiting) { show(); ask(); }
}

function open(head, triangles, places, normals) {
  const node = $("reel").content.firstElementChild.cloneNode(true), pick = (name) => node.querySelector(name);
  $("reels").append(node);
  const scene = new Scene(pick("canvas.scene"));
  scene.mesh(places, normals, triangles);
  pick("h2").textContent = `${head.name} · ${head.body.split(".").pop()}`;
  const courses = (of) => each(head).map((one) => ({ times: one.t, values: of(one) }));
  const strips = [
    new Record(pick(".forces"), "normal force", "N", "#2f7fb8", courses(({ f }) => f)),
    new Record(pick(".depths"), "indentation", "mm", "#c2506a", courses(({ s }) => s.map((x) => 1e3 * x))),
  ];
  reels[head.reel] = { scene, strips, pick, about: head };
  offer($("colour"), (name) => reels.every(({ about }) => about.colours.includes(name)));
  handle(pick("canvas.scene"));
  document.title = `${reels.map((r) => r.about.name).join(" | ")}: palpate`;
  begin = Math.min(...reels.map((r) => r.about.t[0])); end = Math.max(...reels.map((r) => r.about.t.at(-1)));
  Object.assign($("time"), { min: begin, max: end, step: STEP });
  seek(begin);
}

function seek(to) { time = Math.min(Math.max(to, begin), end); wanted = time; ask(); }

function ask() {
  if (wanted === null || waiting || socket.readyState !== WebSocket.OPEN) return;
  waiting = reels.length; socket.send(JSON.stringify({ at: wanted })); wanted = null;
}

function show() {
  page.frames++;
  const shown = reels.filter((reel) => reel.newest);
  const { most, text, what } = painted(shown.map(({ scene, newest }) => [scene, newest]), $("colour").value);
  $("top").textContent = text; $("what").textContent = what;
  for (const { newest, scene, strips, pick, about } of shown) {
    const { head } = newest;
    scene.full = most;
    for (const [name, text] of Object.entries(figures(head))) pick(`.${name}`).textContent = text;
    strips[0].draw(head.asked, head.load > 0 ? head.band : null); strips[1].draw(head.asked);
    bars(pick(".pins"), head.pins);
    spots(pick(".spikes"), about.receptors, head.rates, head.mean_rates);
  }
  $("time").value = time; $("now").textContent = `${time.toFixed(3)} s`;
  draw();
}

function draw() {
  for (const { newest, scene } of reels) scene.draw(fingers(newest));
}

function play(on) {
  playing = on; $("play").setAttribute("aria-pressed", String(on)); $("play").textContent = on ? "stop" : "play";
  if (on) { if (time >= end) seek(begin); before = performance.now(); requestAnimationFrame(go); }
}

function go(moment) {
  if (!playing) return;
  if (waiting) { requestAnimationFrame(go); return; } // the next frame shows the time that has passed until then
  const passed = Math.max(0, moment - before); before = moment;
  seek(time + 1e-3 * passed * Number($("speed").value));
  if (time >= end) play(false); else requestAnimationFrame(go);
}

// -- rotation, the same for all pictures -----------------------------------------------------------------------

function turn(dx, dy) {
  for (const { scene } of reels) { scene.azimuth -= 0.008 * dx; scene.height = Math.min(Math.max(scene.height + 0.008 * dy, -1.5), 1.5); }
  draw();
}

function handle(view) {
  let held = null;
  view.addEventListener("pointerdown", (event) => { view.setPointerCapture(event.pointerId); view.focus(); held = event; });
  view.addEventListener("pointermove", (event) => { if (held) { turn(event.clientX - held.clientX, event.clientY - held.clientY); held = event; } });
  for (const name of ["pointerup", "pointercancel"]) view.addEventListener(name, () => { held = null; });
  view.addEventListener("wheel", (event) => {
    event.preventDefault();
    for (const { scene } of reels) scene.distance *= Math.exp(0.001 * event.deltaY);
    draw();
  }, { passive: false });
  const steps = { ArrowLeft: [-12, 0], ArrowRight: [12, 0], ArrowUp: [0, -12], ArrowDown: [0, 12] };
  view.addEventListener("keydown", (event) => { if (steps[event.key]) { turn(...steps[event.key]); event.preventDefault(); } });
}

document.addEventListener("keydown", (event) => {
  if (event.target instanceof HTMLSelectElement || event.target instanceof HTMLButtonElement) return;
  if (event.key === " ") play(!playing);
  else if (event.key === ",") { play(false); seek(time - STEP); }
  else if (event.key === ".") { play(false); seek(time + STEP); }
  else return;
  event.preventDefault();
});
$("time").addEventListener("input", () => { play(false); seek(Number($("time").value)); });
$("play").addEventListener("click", () => play(!playing));
$("back").addEventListener("click", () => { play(false); seek(time - STEP); });
$("on").addEventListener("click", () => { play(false); seek(time + STEP); });
$("colour").addEventListener("change", show);
$("shot").addEventListener("click", () => {
  draw(); // WebGL clears its buffer after each display, so draw again
  for (const { scene, about, newest } of reels) {
    const name = `${about.name.replace(/\.mcap$/, "").replaceAll("/", "-")}-${time.toFixed(3)}s`;
    shot(scene, lines(newest.head, about), $("top").textContent, $("what").textContent || $("colour").value, name);
  }
});
window.addEventListener("resize", show);
ramp($("scale"));
connect();
