// The frames of a clip as pictures: what is looked at first, the next few after it, and no more than a bounded number.
const KEPT = 40;
const AHEAD = 4;

export class Frames {
  constructor(address, count, came) {
    this.address = address;
    this.count = count;
    this.came = came;
    this.kept = new Map();
    this.wanted = 1;
    this.busy = false;
  }

  get(frame) {
    return this.kept.get(frame) ?? null;
  }

  want(frame) {
    this.wanted = frame;
    if (!this.busy) this.fetch();
  }

  next() {
    for (let frame = this.wanted; frame <= Math.min(this.count, this.wanted + AHEAD); frame += 1) if (!this.kept.has(frame)) return frame;
    return null;
  }

  async fetch() {
    this.busy = true;
    for (let frame = this.next(); frame !== null; frame = this.next()) {
      try {
        const answer = await fetch(`${this.address}/frames/${frame}.jpg`);
        if (!answer.ok) throw new Error(String(answer.status));
        this.kept.set(frame, await createImageBitmap(await answer.blob()));
      } catch {
        if (frame === this.wanted) break; // the next step asks again
        this.kept.set(frame, null);
      }
      while (this.kept.size > KEPT) {
        const [oldest, picture] = this.kept.entries().next().value;
        picture?.close();
        this.kept.delete(oldest);
      }
      if (frame === this.wanted) this.came();
    }
    this.busy = false;
  }
}
