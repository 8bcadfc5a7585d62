// The field of given.json filled by fill.js, and that of a part of its vertices, which is none.

import fs from "fs";
import { Filled } from "./fill.mjs";

const { points, nodes, moved, landmarks } = JSON.parse(fs.readFileSync("given.json"));
const filled = new Filled(Float32Array.from(points), landmarks);
const all = filled.fill(Int32Array.from(nodes), Float64Array.from(moved));
const some = filled.fill(Int32Array.from(nodes.slice(1, 40)), Float64Array.from(moved.slice(3, 120)));
console.log(JSON.stringify([[...all], some]));
