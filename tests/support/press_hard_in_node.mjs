// Presses at once to the depth of a hard case of the folder `site`, slides and lifts, as the page does. Argument: name of the case.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const [hard] = process.argv.slice(2), touch = await load((name) => fs.promises.readFile(`site/${name}`, "utf-8"), { hard });
const [x, y, z] = touch.about.pointers[0].begin, { hard: cases, limit } = touch.head, { depth } = cases.find(({ name }) => name === hard);
const hand = [], forces = [], goals = [[300, 0, 0.007], [1000, 0, 0.007 + depth], [700, 0.02, 0.007 + depth], [1000, 0, 0]];
for (const [ticks, aside, down] of goals) {
  touch.point([x + aside, y, z - down]);
  for (let k = 0; k < ticks && touch.step(); k++) { hand.push(Math.hypot(...touch.contact().force)); forces.push(touch.contact().load); }
}
console.log(JSON.stringify({ hand, forces, limit, failed: touch.failed }));
