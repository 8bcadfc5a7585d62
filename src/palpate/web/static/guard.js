// The last step before a command is sent to a device: the rules of src/palpate/drivers/guard.py, with the numbers that it has.
//
// A test gives both the same answers and commands. Times in ns; a sample has time, joints, position, buttons, homed and age.

const finite = (numbers) => numbers.every(Number.isFinite);
const above = (value, most) => most !== null && value > most; // null: no bound

export class Guard {
  // about: `describe_guard` of web/device.py.
  constructor(about) { this.about = about; this.reset(); }

  reset() {
    this.gain = 0; this.missed = 0; this.then = 0; this.usual = 0; // usual: [s] between the last two commands
    this.finite = []; this.stopped = true; this.share = 0; this.sent = []; this.rest = []; this.jointed = false; this.samples = [];
  }

  // Note the answer to the last command; null: it is missing.
  noteAnswer(sample) {
    if (!sample) { this.missed++; return; }
    this.missed = 0;
    if (!sample.homed) this.samples = [];
    else if (!this.samples.length || sample.time > this.samples.at(-1).time) {
      if (this.samples.push(sample) > this.about.history + 1) this.samples.shift();
      this.jointed = sample.joints.length > 0;
    }
  }

  // Why a command given at `given` must not be sent at `now`; empty if it may be sent.
  why(now, given) {
    const { limits, missed, silent, stale, deadman } = this.about, last = this.samples.at(-1);
    if (!last) return "not homed";
    if (this.missed >= missed || now - last.time > silent * 1e9) return "answers are missing";
    if (now - given > stale * 1e9) return "the command is old";
    if (deadman && !(last.buttons & deadman)) return "the dead-man button is not held";
    if (!finite(last.joints)) return "no angles";
    if (!this.rate("joints").every((rate) => Math.abs(rate) <= (limits.turn ?? Infinity))) return "too fast";
    if (last.position.length) {
      const [low, high] = limits.box;
      if (!last.position.every((x, i) => (low[i] ?? -Infinity) <= x && x <= (high[i] ?? Infinity))) return "outside its box";
      if (above(Math.hypot(...this.rate("position")), limits.speed)) return "too fast";
    }
    return "";
  }

  // The limited command for `now`; given: when the command was given.
  apply(command, now, given) {
    let stopped = Boolean(this.why(now, given));
    if (finite(command)) this.finite = command;
    else { stopped = true; command = this.finite.length ? this.finite : command.map(() => 0); }
    const { fall, ramp, limits } = this.about, wanted = this.limit(command), elapsed = this.pace(now, stopped);
    if (this.stopped && !stopped && this.sent.length) { this.share = 1; this.rest = this.sent.map((s, i) => s - this.gain * wanted[i]); }
    this.stopped = stopped;
    if (stopped) this.gain = Math.max(0, this.gain - elapsed / fall);
    else this.gain = ramp > 0 ? Math.min(1, this.gain + elapsed / ramp) : 1;
    this.share = Math.max(0, this.share - elapsed / fall);
    let sent = wanted.map((w) => this.gain * w);
    if (this.share > 0) sent = this.limit(sent.map((s, i) => s + this.share * this.rest[i]));
    const power = this.power(sent);
    if (above(power, limits.power)) sent = sent.map((c) => (limits.power / power) * c);
    this.sent = sent;
    return sent;
  }

  // Time [s] since the last command. After a pause it is a usual step unless the force must fall.
  pace(now, stopped) {
    const elapsed = this.then ? (now - this.then) * 1e-9 : 0, usual = this.usual;
    this.then = now; this.usual = elapsed;
    if (!stopped && elapsed > this.about.stale && 3 * usual > 0 && 3 * usual < elapsed) { this.stopped = true; return usual; }
    return elapsed;
  }

  // The command, at most the largest.
  limit(command) {
    const { limits } = this.about, largest = Math.max(...command.map(Math.abs));
    if (largest === 0) return command.map(() => 0);
    const joints = this.jointed && limits.torque !== null, most = joints ? limits.torque : limits.command;
    const length = joints || limits.each ? 1 : Math.hypot(...command.map((c) => c / largest));
    const scale = Math.min(1, most / length / largest);
    return command.map((c) => scale * c);
  }

  // Rates of joints [rad/s] and position [m/s] over the last samples; empty if unknown.
  rates() { return { joints: this.rate("joints"), position: this.rate("position") }; }

  rate(name) {
    const first = this.samples[0], last = this.samples.at(-1);
    if (!last || last.time <= first.time || first[name].length !== last[name].length) return [];
    return last[name].map((x, i) => ((x - first[name][i]) * 1e9) / (last.time - first.time));
  }

  // Power [W] that the command gives to the hand at the current rate.
  power(command) {
    if (!this.samples.length) return 0;
    return this.rate(this.samples.at(-1).joints.length ? "joints" : "position").reduce((sum, rate, i) => sum + rate * (command[i] ?? 0), 0);
  }
}
