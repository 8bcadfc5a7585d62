// Loads the folder `site` with the options of the argument; prints the error, or null.

import fs from "fs";
import { load } from "./site/palpate.mjs";

const read = (name) => fs.promises.readFile(`site/${name}`, "utf-8");
const error = await load(read, JSON.parse(process.argv[2])).then(() => null, ({ message }) => message);
console.log(JSON.stringify(error));
