// Saves the latest labels, one request after the other; what somebody else has changed is never overwritten.
import { call, say } from "./dom.js";

const WAIT_MS = 400;

export class Saver {
  constructor(address, status, wrong) {
    this.address = address;
    this.status = status;
    this.wrong = wrong;
    this.revision = 0;
    this.waiting = null;
    this.timer = 0;
    this.running = null;
    window.addEventListener("beforeunload", (event) => { if (this.waiting || this.running) event.preventDefault(); });
  }

  save(labels) {
    this.waiting = labels;
    say(this.status, "not saved yet");
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.send(), WAIT_MS);
  }

  async settled() {
    clearTimeout(this.timer);
    if (this.waiting) this.send();
    while (this.running) await this.running;
    if (this.waiting) throw new Error("The labels are not saved.");
  }

  send() {
    if (this.running || !this.waiting) return;
    this.running = this.sent().finally(() => {
      this.running = null;
      if (this.again) this.send();
    });
  }

  async sent() {
    const labels = this.waiting;
    this.again = false;
    try {
      const told = await call(this.address, "POST", { revision: this.revision, labels });
      this.revision = told.revision;
      if (this.waiting === labels) this.waiting = null;
      this.again = this.waiting !== null;
      say(this.status, this.waiting ? "not saved yet" : "saved");
      say(this.wrong, "");
    } catch (error) {
      say(this.status, "not saved");
      say(this.wrong, error.message);
    }
  }
}
