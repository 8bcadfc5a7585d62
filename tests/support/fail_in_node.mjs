// Takes the memory for arrays from the tick of the folder `site`, and presses. Prints what is known then.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const touch = await load((name) => fs.promises.readFile(`site/${name}`, "utf-8"));
touch.tick.code.place_heap(64, 64);
const [x, y, z] = touch.about.pointers[0].begin;
touch.point([x, y, z - 0.03]);
const went = touch.step(1), { failed, time } = touch, again = touch.step(1);
const stands = touch.time === time;
touch.begin();
console.log(JSON.stringify({ went, failed, time, again, stands, afresh: touch.failed, steps: touch.step(0.1) }));
