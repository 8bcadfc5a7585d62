// Presses with all fingers for a number of ticks by the library of the folder `site`, and writes the frame and the recording. The
// second argument is how far each finger moves [m], in JSON.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const touch = await load((name) => fs.promises.readFile(`site/${name}`, "utf-8"));
const ways = JSON.parse(process.argv[3] ?? "[]");
touch.about.pointers.forEach(({ begin }, finger) => {
  const way = ways[finger] ?? [0.004, 0.002, -0.03];
  touch.point(begin.map((x, i) => x + way[i]), { finger });
});
touch.step(Number(process.argv[2]) / touch.rate);
fs.writeFileSync("frame", new Uint8Array(touch.frame()));
fs.writeFileSync("page.mcap", new Uint8Array(await touch.recording().arrayBuffer()));
console.log(JSON.stringify(touch.failed));
