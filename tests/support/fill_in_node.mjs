// The field of given.json filled by fill.js after those of other vertices, that of a part of its vertices, which is none, and the
// number of vertices whose nearest ones were searched for in each.

import fs from "fs";
import { Filled } from "./fill.mjs";

const { points, fields, landmarks } = JSON.parse(fs.readFileSync("given.json"));
const filled = new Filled(Float32Array.from(points), landmarks), search = filled.nearest.bind(filled), searched = [];
filled.nearest = (...given) => { searched[searched.length - 1]++; search(...given); };
const fill = (nodes, moved) => { searched.push(0); return filled.fill(Int32Array.from(nodes), Float64Array.from(moved)); };
const all = fields.map(({ nodes, moved }) => [...fill(nodes, moved)]);
const { nodes, moved } = fields[0], some = fill(nodes.slice(1, 40), moved.slice(3, 120));
console.log(JSON.stringify([all, some, searched, [...fill(nodes, moved)]]));
