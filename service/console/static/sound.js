// A sound until the alarm is acknowledged: quick high notes for a lump, a slow low one for what cannot see.
// A browser plays nothing before a click, so the button says whether it is on.
const PATTERNS = {
  lump: { every: 2.5, notes: [[880, 0, 0.16], [1175, 0.2, 0.16], [880, 0.4, 0.16], [1175, 0.6, 0.22]] },
  blind: { every: 5, notes: [[294, 0, 0.5], [247, 0.6, 0.7]] },
  silent: { every: 5, notes: [[247, 0, 0.25], [247, 0.4, 0.25], [247, 0.8, 0.25]] },
};

export class Sound {
  constructor(button) {
    this.button = button;
    this.context = null;
    this.next = 0;
    this.kind = "";
    button.addEventListener("click", () => this.toggle());
  }

  get on() {
    return this.context !== null && this.context.state === "running";
  }

  async toggle() {
    if (this.on) await this.context.suspend();
    else {
      this.context ??= new AudioContext();
      await this.context.resume();
      this.next = 0;
    }
    this.button.textContent = this.on ? "Sound on" : "Sound off";
    this.button.setAttribute("aria-pressed", String(this.on));
  }

  // Called again and again with what waits: "lump", "blind", "silent" or "".
  wanted(kind) {
    const changed = kind !== this.kind;
    this.kind = kind;
    this.button.dataset.sounding = this.on ? kind : "";
    if (!kind || !this.on) return;
    const pattern = PATTERNS[kind];
    const at = this.context.currentTime;
    if (!changed && at < this.next) return;
    this.next = at + pattern.every;
    for (const [pitch, after, lasts] of pattern.notes) {
      const tone = this.context.createOscillator();
      const gain = this.context.createGain();
      tone.frequency.value = pitch;
      tone.type = "triangle";
      gain.gain.setValueAtTime(0, at + after);
      gain.gain.linearRampToValueAtTime(0.35, at + after + 0.02);
      gain.gain.setValueAtTime(0.35, at + after + lasts - 0.04);
      gain.gain.linearRampToValueAtTime(0, at + after + lasts);
      tone.connect(gain).connect(this.context.destination);
      tone.start(at + after);
      tone.stop(at + after + lasts + 0.05);
    }
  }
}
