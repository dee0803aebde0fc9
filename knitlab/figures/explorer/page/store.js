// What the page shows, and who is told when it changes.

export class Store {
  constructor(state) {
    this.state = state;
    this.views = [];
    this.changed = new Set();
  }

  /** Call `view(state, changed)` after every change, with the names of what has changed. */
  show(view) {
    this.views.push(view);
  }

  /** Change some entries; all views are told once, before the next frame. */
  set(entries) {
    for (const [name, value] of Object.entries(entries)) {
      if (this.state[name] === value) continue;
      this.state[name] = value;
      this.changed.add(name);
    }
    if (this.changed.size && !this.waiting) {
      this.waiting = true;
      requestAnimationFrame(() => this.tell());
    }
  }

  /** Tell all views; `all` as if everything had changed. */
  tell(all = false) {
    const changed = all ? new Set(Object.keys(this.state)) : this.changed;
    this.changed = new Set();
    this.waiting = false;
    for (const view of this.views) view(this.state, changed);
  }
}

/** Whether any of these entries has changed. */
export function anyOf(changed, ...names) {
  return names.some((name) => changed.has(name));
}
