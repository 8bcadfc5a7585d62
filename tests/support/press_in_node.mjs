// Presses the organ of the folder `site` by its library, and records that. Arguments: options of `load`, depth [m], recording.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const [options, depth, file] = process.argv.slice(2);
const touch = await load((name) => fs.promises.readFile(`site/${name}`, "utf-8"), JSON.parse(options));
const { begin } = touch.about.pointers[0], down = [begin[0], begin[1], begin[2] - Number(depth)], forces = [];
for (let k = 0; k < 1500; k++) {
  if (k % 20 === 0) touch.point(k < 200 || k > 1300 ? begin : down);
  if (!touch.step()) throw new Error(JSON.stringify(touch.failed));
  forces.push(touch.contact().load);
}
fs.writeFileSync(file, new Uint8Array(await touch.recording().arrayBuffer()));
const { nodes, displacement } = touch.surface(), { vertices, normals, triangles } = touch.mesh;
touch.begin();
touch.point(down);
touch.step(0.5);
console.log(JSON.stringify({
  forces, nodes: nodes.length, displacement: displacement.length, vertices: vertices.length / 3, normals: normals.length / 3,
  largest: Math.max(...triangles), again: touch.contact().load, time: touch.time, effects: touch.effects, body: touch.body,
}));
