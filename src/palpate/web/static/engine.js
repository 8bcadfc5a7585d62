// The engine behind the page where there is no server: the tick runs in a worker of the page, as WebAssembly.
//
// All files are scripts, so that a folder opened without a network works; each is loaded when it is needed, once. The same interface
// as the file of this name in views/page/static.

import { readRecording } from "/replay.js";

const site = globalThis.palpateSite, texts = new Map(), waiting = new Map();

// Called by each file of data.
globalThis.palpateData = (hash, text) => texts.set(hash, text);

function load(hash) {
  return new Promise((resolve, reject) => {
    const script = document.createElement("script");
    script.src = `data/${hash}.js`;
    script.onload = () => { script.remove(); texts.has(hash) ? resolve(texts.get(hash)) : reject(new Error(`data/${hash}.js is damaged`)); texts.delete(hash); };
    script.onerror = () => reject(new Error(`data/${hash}.js is missing`));
    document.head.append(script);
  });
}

export function connect({ told, came }) {
  const text = globalThis.palpateWorker, worker = new Worker(URL.createObjectURL(new Blob([text], { type: "text/javascript" })));
  const say = (what) => told({ kind: "status", text: what, keep: true, panel: null });
  let chosen = site.variants.find(({ first }) => first), running = chosen, switching = 0, alive = false; // the variant asked for last, and the one that came
  let used = null, after = null, halted = false; // the device, what follows when its exchange has ended, whether its run has stopped

  const give = (file) => new Promise((resolve) => { waiting.set(file.hash, resolve); worker.postMessage({ file }); });
  // A file that the worker has, or that is on its way.
  const files = new Map();
  function bring(hash) {
    if (!files.has(hash)) files.set(hash, load(hash).then((text) => give({ hash, text })).then(({ why }) => {
      if (why) throw new Error(`the file ${hash} of this folder is damaged: ${why}`);
    }).catch((error) => { files.delete(hash); throw error; }));
    return files.get(hash);
  }

  // Start a variant, after its files have come. device: what the worker opens for it.
  async function begin(variant, recording, device) {
    const mine = ++switching;
    chosen = variant;
    alive = false;
    halted = false;
    if (used && !variant.device) { after = () => begin(variant, recording); worker.postMessage({ device: null }); return; }
    say("loading");
    try {
      await Promise.all(variant.files.map(bring));
      if (mine !== switching) return;
      running = variant;
      worker.postMessage({ begin: { hash: variant.hash, code: site.code, recording, device } });
      alive = true;
    } catch (error) {
      if (mine === switching) chosen = running;
      say(`stopped: ${error.message}`);
    }
  }

  // The variant that differs from this one in what is asked for, or why there is none. Another scene or organ starts with its
  // effects, a hard case with those of the graph where it has no others.
  function change({ body, effect, scene, organ, hard, device }) {
    const wish = { scene: scene ?? chosen.scene, organ: organ ?? chosen.organ, body: body ?? chosen.body, case: hard ?? null };
    wish.device = hard === undefined && (device ?? chosen.device);
    const moved = scene !== undefined || organ !== undefined;
    const first = site.variants.find((one) => one.scene === wish.scene && one.organ === wish.organ && one.first);
    const effects = { ...(moved ? first : chosen).effects, ...(effect ? { [effect[0]]: effect[1] } : {}) };
    const near = site.variants.filter((one) => Object.entries(wish).every(([key, value]) => one[key] === value));
    const same = (one) => Object.entries(one.effects).every(([name, on]) => effects[name] === on);
    const found = near.find(same) ?? (moved ? first : hard === undefined ? undefined : near[0]);
    if (found) begin(found, undefined, device ? used : undefined);
    else say(`not in this folder: ${wish.body} with ${Object.entries(effects).map(([name, on]) => `${name} ${on ? "on" : "off"}`).join(", ")}`);
  }

  // Let the user choose a raw-HID device, and start the variant in which it is the hand; or leave it. The worker exchanges
  // the reports, so that the picture does not delay them.
  async function attach(on) {
    if (!on) { if (used) change({ device: false }); return; }
    try {
      const [found] = await navigator.hid.requestDevice({ filters: [site.hid] });
      if (!found || used) return;
      used = { vendorId: found.vendorId, productId: found.productId, ...site.hid };
      told({ kind: "device", on: true });
      change({ device: true });
    } catch (error) { say(`no device: ${error.message}`); }
  }

  // The exchange has ended. why: what happened to the device; "": it was asked to. A run of a lost device stops, and its recording
  // remains; reset starts one of the pointer.
  function detached(why) {
    const next = after;
    used = after = null;
    told({ kind: "device", on: false });
    if (next) return next();
    halted = true;
    say(`stopped: the raw-HID device: ${why || "it was left"}; reset starts again without it`);
  }

  window.addEventListener("pagehide", () => { if (used) worker.postMessage({ device: null }); });

  // Run the touch of a recording again, which has the hash of its program.
  async function replay(file) {
    try {
      const recording = readRecording(new Uint8Array(await file.arrayBuffer())), variant = site.variants.find(({ program }) => program === recording.program);
      if (!variant) throw new Error("another page made it: expected a recording of this folder");
      if (variant.device) throw new Error("a device made it: `palpate replay` computes it again");
      begin(variant, { name: file.name, ...recording });
    } catch (error) { say(`${file.name}: ${error.message}`); }
  }

  worker.onmessage = ({ data }) => {
    if (data.told) told(data.told);
    else if (data.came) { came(data.came); requestAnimationFrame(() => worker.postMessage({ drawn: true })); }
    else if (data.file) save(data.file);
    else if (data.ended !== undefined) detached(data.ended);
    else { waiting.get(data.have)(data); waiting.delete(data.have); }
  };
  worker.onerror = ({ message }) => say(`stopped: ${message}`);
  document.addEventListener("visibilitychange", () => worker.postMessage({ hidden: document.hidden }));
  begin(chosen);
  return {
    downloads: true,
    devices: Boolean(site.hid && navigator.hid),
    takes: (order) => alive || !(order.point || order.reset || order.download), // while a variant is loaded, another one or a recording
    send(order) {
      if (order.body || order.effect || order.hard || order.scene !== undefined || order.organ !== undefined || (order.reset && chosen.case)) change(order);
      else if (order.reset && halted) change({ device: false });
      else if (order.device !== undefined) attach(order.device);
      else if (order.replay) replay(order.replay);
      else if (order.point || order.reset || order.download) worker.postMessage(order);
    },
  };
}

function save({ name, parts }) {
  const link = document.createElement("a");
  link.download = name; link.href = URL.createObjectURL(new Blob(parts, { type: "application/octet-stream" }));
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}
