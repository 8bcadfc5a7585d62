// An emulated raw-HID device behind `navigator.hid`, after docs/raw_hid.md, for the page and for its worker. No real device was
// at hand. A hand holds the grip at `place`, to which it moves at SPEED; the device applies each command until its watchdog ends.
(() => {
  const COUNT = 20e-6, UNIT = 1e-3, SPEED = 0.1, USB = 1; // [m] of a count, [N] of a unit, [m/s], [ms] until an answer arrives
  const device = { vendorId: 0x16c0, productId: 0x0486, collections: [{ usagePage: 0xffab, usage: 0x0200 }], opened: false, oninputreport: null };
  const hid = { ondisconnect: null, getDevices: async () => [device], requestDevice: async ({ filters: [{ usagePage, usage }] }) => (usagePage === 0xffab && usage === 0x0200 ? [device] : []) };
  Object.defineProperty(navigator, "hid", { value: hid, configurable: true });
  const inside = typeof window === "undefined", channel = new BroadcastChannel("emulated device");
  if (!inside) {
    const Plain = Blob;
    window.Blob = class extends Plain { constructor(parts, options) { super(options?.type === "text/javascript" ? [window.emulated, ";", ...parts] : parts, options); } };
    window.device = (order) => channel.postMessage(order);
    window.log = () => new Promise((done) => { channel.onmessage = ({ data }) => { if (data.log) done(data); }; channel.postMessage({ tell: true }); });
    return;
  }
  const crc = (bytes) => { let r = 0xffff; for (const b of bytes) for (let k = 0; k < 8; k++) r = ((r ^ (b >> k)) & 1) ? (r >>> 1) ^ 0x8408 : r >>> 1; return ~r & 0xffff; };
  let log = [], mode = "well", since = 0, place = [0, 0, 0.116], goal = place, moved = performance.now(), number = 0, closed = 0;
  channel.onmessage = ({ data }) => {
    if (data.goal) goal = data.goal;
    if (data.hold) goal = place;
    if (data.place) place = goal = data.place;
    if (data.mode) { mode = data.mode; since = performance.now(); }
    if (data.unplug) { mode = "silent"; since = performance.now(); device.opened = false; hid.ondisconnect?.({ device }); }
    if (data.tell) channel.postMessage({ log, since, closed, opened: device.opened });
  };
  device.open = async () => { device.opened = true; };
  device.close = async () => { device.opened = false; closed++; };
  const later = (ms, act) => { const end = performance.now() + ms, pipe = new MessageChannel(); pipe.port1.onmessage = () => (performance.now() >= end ? act() : pipe.port2.postMessage(0)); pipe.port2.postMessage(0); };
  device.sendReport = async (id, bytes) => {
    if (!device.opened) throw new Error("the device is not open");
    const view = new DataView(bytes.buffer, bytes.byteOffset), now = performance.now();
    const good = id === 0 && bytes.length === 64 && bytes[0] === 0x50 && bytes[1] === 1 && view.getUint16(62, true) === crc(bytes.subarray(0, 62));
    const flags = bytes[4], force = [0, 1, 2].map((i) => view.getInt16(8 + 2 * i, true) * UNIT);
    log.push({ now, good, flags, force, watchdog: view.getUint16(6, true), version: bytes[5] });
    const away = goal.map((x, i) => x - place[i]), far = Math.hypot(...away), share = far > 0 ? Math.min(1, (SPEED * 1e-3 * (now - moved)) / far) : 0;
    place = place.map((x, i) => x + share * away[i]); moved = now;
    if (mode === "silent") return;
    const answer = new Uint8Array(64), out = new DataView(answer.buffer);
    answer[0] = 0x50;
    if (flags & 4) {
      answer[1] = 3; out.setUint16(2, 1, true); answer[5] = 3;
      for (let i = 0; i < 3; i++) { out.setFloat32(6 + 4 * i, mode === "nan" ? NaN : COUNT, true); out.setFloat32(30 + 4 * i, UNIT, true); }
    } else {
      answer[1] = 2; out.setUint16(2, (number = (number + 1) & 0xffff), true); out.setUint16(4, view.getUint16(2, true), true);
      answer[6] = mode === "unhomed" ? 0 : mode === "fault" ? 5 : 1; answer[7] = 3; out.setUint32(8, Math.floor(1e3 * now) >>> 0, true);
      place.forEach((x, i) => out.setInt32(12 + 4 * i, Math.round(x / COUNT), true));
    }
    out.setUint16(62, crc(answer.subarray(0, 62)) ^ (mode === "damaged" ? 1 : 0), true);
    const sent = mode === "short" ? answer.slice(0, 62) : answer;
    later(USB, () => device.oninputreport?.({ reportId: 0, device, data: new DataView(sent.buffer) }));
  };
})();
