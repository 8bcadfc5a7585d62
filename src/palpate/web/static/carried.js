// Where an organ that moves is shown, as views/carried.py: x -> R x + way of the points of its frame, from its Support.

export class Carried {
  constructor(way, turn = null) { this.way = way; this.turn = turn; }

  // The motion in a stream; null: no message yet.
  static by(tick, motion) {
    if (!motion || !tick.has(motion)) return null;
    const way = tick.read(motion, "displacement"), rotation = tick.read(motion, "rotation"), angle = Math.hypot(...rotation);
    if (!(angle > 0)) return new Carried(way);
    const [x, y, z] = [...rotation].map((r) => r / angle), s = Math.sin(angle), c = 2 * Math.sin(angle / 2) ** 2;
    const turn = [
      1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y, c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x,
      c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y),
    ];
    const centre = [...tick.read(motion, "centre")], moved = new Carried([0, 0, 0], turn).vector(centre);
    return new Carried(way.map((d, i) => d + centre[i] - moved[i]), turn);
  }

  // A vector of the organ's frame in the world.
  vector([x, y, z]) {
    const r = this.turn;
    return r ? [r[0] * x + r[1] * y + r[2] * z, r[3] * x + r[4] * y + r[5] * z, r[6] * x + r[7] * y + r[8] * z] : [x, y, z];
  }

  // A point [m] of the organ's frame in the world.
  point(at) { return this.vector(at).map((x, i) => x + this.way[i]); }
}

export const STILL = new Carried([0, 0, 0]);
