// A plan and its earlier states. Changes of one value that follow each other closely are undone together.
const TOGETHER = 1000; // ms

export class History {
  constructor(plan) {
    this.plan = plan;
    this.before = [];
    this.after = [];
    this.key = null;
    this.time = 0;
  }
  change(key, edit) {
    const now = performance.now();
    if (key === null || key !== this.key || now - this.time > TOGETHER) this.before.push(JSON.stringify(this.plan));
    this.key = key;
    this.time = now;
    this.after = [];
    edit(this.plan);
  }
  undo() { return this.step(this.before, this.after); }
  redo() { return this.step(this.after, this.before); }
  step(from, to) {
    if (!from.length) return false;
    to.push(JSON.stringify(this.plan));
    this.plan = JSON.parse(from.pop());
    this.key = null;
    return true;
  }
}
