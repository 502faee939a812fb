// A sound until the alarm is acknowledged: quick high notes for a lump, a slow low one for what cannot see.
// A browser plays nothing before a click, so the button says whether it is on.
const PATTERNS = {
  lump: { every: 2.5, notes: [[880, 0, 0.16], [1175, 0.2, 0.16], [880, 0.4, 0.16], [1175, 0.6, 0.22]] },
  blind: { every: 5, notes: [[294, 0, 0.5], [247, 0.6, 0.7]] },
  silent: { every: 5, notes: [[247, 0, 0.25], [247, 0.4, 0.25], [247, 0.8, 0.25]] },
};

// Each page is a new one for the browser: the wish for sound is kept, or going to the list of alarms would silence it.
const KEPT = "lumpwatch sound";

function kept() {
  try {
    return localStorage.getItem(KEPT) === "on";
  } catch {
    return false; // a browser that keeps nothing
  }
}

function keep(wish) {
  try {
    localStorage.setItem(KEPT, wish ? "on" : "off");
  } catch {
    // then it holds for this page alone
  }
}

export class Sound {
  constructor(button) {
    this.button = button;
    this.context = null;
    this.next = 0;
    this.kind = "";
    this.wish = kept();
    button.addEventListener("click", () => this.toggle());
    for (const gesture of ["pointerdown", "keydown"]) {
      document.addEventListener(gesture, (event) => { if (this.wish && !this.on && !button.contains(event.target)) this.begin(); }, true);
    }
    if (this.wish) this.begin();
    this.tell();
  }

  get on() {
    return this.context !== null && this.context.state === "running";
  }

  // A browser may let it wait for a click or key, however long that takes.
  begin() {
    if (!this.context) {
      this.context = new AudioContext();
      this.context.addEventListener("statechange", () => { this.next = 0; this.tell(); });
    }
    this.context.resume();
  }

  toggle() {
    this.wish = !(this.wish && this.on);
    keep(this.wish);
    if (this.wish) this.begin();
    else this.context.suspend();
    this.tell();
  }

  tell() {
    const waits = this.wish && !this.on;
    this.button.textContent = this.on ? "Sound on" : waits ? "Sound waits for a key" : "Sound off";
    this.button.classList.toggle("waits", waits);
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
