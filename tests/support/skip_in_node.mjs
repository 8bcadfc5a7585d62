// Presses the organ of the folder `site`, leaves out some time while the finger presses, goes on, and records that. Arguments: time [s]
// that is left out, recording.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const [gap, file] = process.argv.slice(2), touch = await load((name) => fs.promises.readFile(`site/${name}`, "utf-8"));
const [x, y, z] = touch.about.pointers[0].begin, forces = [], hand = [];
const step = (ticks) => {
  for (let k = 0; k < ticks; k++) {
    if (!touch.step()) throw new Error(JSON.stringify(touch.failed));
    const { load: force, force: on } = touch.contact();
    forces.push(force); hand.push(Math.hypot(...on));
  }
};
touch.point([x, y, z - 0.015]);
step(800);
touch.skip(Number(gap));
step(800);
touch.point([x, y, z]);
step(400);
fs.writeFileSync(file, new Uint8Array(await touch.recording().arrayBuffer()));
console.log(JSON.stringify({ forces, hand, time: touch.time, program: touch.about.recording.program }));
