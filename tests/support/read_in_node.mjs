// What the page reads from a recording, and its check of the messages: all of those in the file, then with a byte changed.

import fs from "fs";
import { Replay, readRecording } from "./replay.mjs";

const bytes = new Uint8Array(fs.readFileSync(process.argv[2])), found = readRecording(bytes);
const why = (change) => { try { readRecording(change(bytes.slice())); return null; } catch (error) { return error.message; } };
const [stream] = found.messages.find(([topic]) => topic.includes("pointer"));
const check = (change) => {
  const replay = new Replay([{ stream }], found), seen = [], skipped = [], tick = { tick: 0, clear() {} };
  tick.messages = () => found.messages.filter(([topic, at]) => topic !== stream && at === tick.tick - 1).map(([topic, , data]) => ({ stream: topic, bytes: change(data) }));
  while (replay.apply(tick, ([number, place, buttons]) => seen.push([tick.tick, number, ...place, buttons]), (count) => { skipped.push([tick.tick, count]); tick.tick += count; })) {
    tick.tick++;
    replay.check(tick);
  }
  return { outcome: replay.outcome, seen: seen.length, first: seen[0], skipped };
};
console.log(JSON.stringify({
  program: found.program, messages: found.messages.length, ticks: found.ticks,
  whole: check((data) => data), changed: check((data) => { const other = data.slice(); other[other.length - 1] ^= 1; return other; }),
  cut: why((data) => data.slice(0, 5000)), foreign: why((data) => { data[0] = 0; return data; }),
}));
