// Places set on the map by taps, or with the keyboard at the cross in its middle: one at a time, with a bar of words and buttons.
import { button, byId, element } from "/dom.js";

export class Placing {
  constructor(map) {
    this.map = map;
    map.cornersChanged = () => { this.task?.moved?.(this.tapped()); this.changed(); };
    byId("drawing").addEventListener("keydown", ({ key }) => { if (key === "Escape") this.stop(); });
    document.addEventListener("keydown", ({ key, target }) => {
      if (!this.task || target !== map.canvas) return;
      if (key === "Escape") this.stop();
      if (key === "Backspace") this.back();
    });
  }

  // task: {kind: zone, pose or point, most, words(count), ready(count), fields: [elements], save: text, done(points)}.
  start(task) {
    this.stop();
    this.task = task;
    Object.assign(this.map, { corners: [], placing: task.kind });
    this.map.redraw();
    const bar = byId("drawing");
    this.words = element("p");
    this.keep = button(task.save, () => this.finish(), "main");
    const back = button("Take back", () => this.back()), cancel = button("Cancel", () => this.stop());
    for (const field of task.fields ?? []) {
      field.addEventListener("keydown", ({ key }) => { if (key === "Enter") this.finish(); });
      field.addEventListener("input", () => { task.typed?.(); this.changed(); });
    }
    bar.replaceChildren(this.words, ...(task.fields ?? []), back, cancel, this.keep);
    bar.hidden = false;
    this.started?.();
    this.map.canvas.focus();
    this.changed();
  }

  stop() {
    const was = this.task;
    this.task = null;
    Object.assign(this.map, { corners: null, placing: null });
    this.map.redraw();
    byId("drawing").hidden = true;
    was?.stopped?.();
  }

  back() {
    if (!this.map.corners.length) return;
    this.map.corners.pop();
    this.map.redraw();
    this.changed();
  }

  changed() {
    const { task, map } = this;
    if (!task) return;
    const count = map.corners.length;
    this.words.textContent = task.words(count);
    this.keep.disabled = !task.ready(count);
    map.redraw();
  }

  // The points so far; one too many begins anew.
  tapped() {
    const { corners } = this.map, { most } = this.task;
    if (most && corners.length > most) corners.splice(0, corners.length, corners.at(-1));
    return corners;
  }

  async finish() {
    if (this.keep.disabled) return;
    const task = this.task;
    if (await task.done(this.map.corners)) if (this.task === task) this.stop();
  }
}

// A labelled field for a bar or a form.
export function field(name, input, unit = "") {
  const label = element("label", "", "field");
  label.append(element("span", name), input, ...(unit ? [element("span", unit, "muted")] : []));
  return label;
}

export function number(value, step, least, most) {
  const input = element("input");
  Object.assign(input, { type: "number", step, value });
  if (least !== undefined) input.min = least;
  if (most !== undefined) input.max = most;
  return input;
}
