// Presses with all fingers for a number of ticks by the library of the folder `site`, and writes the frame and the recording.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const touch = await load((name) => fs.promises.readFile(`site/${name}`, "utf-8"));
touch.about.pointers.forEach(({ begin: [x, y, z] }, finger) => touch.point([x + 0.004, y + 0.002, z - 0.03], { finger }));
touch.step(Number(process.argv[2]) / touch.rate);
fs.writeFileSync("frame", new Uint8Array(touch.frame()));
fs.writeFileSync("page.mcap", new Uint8Array(await touch.recording().arrayBuffer()));
console.log(JSON.stringify(touch.failed));
