// Plays the vibration of a texture: the fluctuation of the friction on each finger, as `actuator.SoundCard` does on a sound card.

const GAIN = 2.0; // [1/N] full scale per newton, limited to full scale
const AHEAD = 0.06, MOST = 0.3; // [s] between a block and its sound, at first and at most; later blocks are left out

export class Sound {
  constructor(button) {
    this.button = button; this.context = null; this.next = 0; this.played = 0;
    button.addEventListener("click", () => this.toggle());
  }

  // Whether the run has a vibration.
  offer(on) {
    this.button.hidden = !on;
    if (!on && this.context) this.toggle();
  }

  // A context can only begin when the user asks for it.
  toggle() {
    if (this.context) { this.context.close(); this.context = null; } else { this.context = new AudioContext(); this.next = 0; }
    this.button.setAttribute("aria-pressed", String(Boolean(this.context)));
  }

  // A frame: the samples [N] of each finger since the last frame, and their rate [Hz].
  take(fingers) {
    const heard = fingers.filter(({ vibration }) => vibration?.length);
    if (!this.context || !heard.length) return;
    const { sampling } = heard[0], count = Math.max(...heard.map(({ vibration }) => vibration.length));
    const buffer = this.context.createBuffer(1, count, sampling), samples = buffer.getChannelData(0), now = this.context.currentTime;
    for (const { vibration } of heard) vibration.forEach((force, k) => { samples[k] = Math.min(Math.max(samples[k] + GAIN * force, -1), 1); });
    if (this.next < now) this.next = now + AHEAD;
    if (this.next > now + MOST) return;
    const source = this.context.createBufferSource();
    source.buffer = buffer; source.connect(this.context.destination); source.start(this.next);
    this.next += count / sampling; this.played += count;
  }
}
