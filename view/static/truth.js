// The truth under the map of a run that knows it: the true path, true footprints, and which objects were missed.
import { markOf } from "/marks.js";

export class Truth {
  constructor() { this.set(null); }

  set(truth) { Object.assign(this, { path: [], rows: [] }, truth); }

  places() { return [...this.path, ...this.rows.flatMap(({ true_m, footprint_m }) => [...footprint_m, ...(true_m ? [true_m] : [])])]; }

  // items: the mapped objects by id, those that are shown.
  draw(pen, view, items, style) {
    pen.beginPath();
    for (const [x, y] of this.path) pen.lineTo(...view.toScreen(x, y));
    Object.assign(pen, { lineWidth: 1.5, strokeStyle: style.muted });
    pen.setLineDash([6, 5]);
    pen.stroke();
    pen.setLineDash([]);
    for (const { state, label, true_m, footprint_m, object_id } of this.rows.filter(({ true_m }) => true_m)) {
      const at = view.toScreen(...true_m), item = items.get(object_id), missed = state === "missed";
      pen.beginPath();
      for (const corner of footprint_m) pen.lineTo(...view.toScreen(...corner));
      if (footprint_m.length) pen.closePath();
      else pen.rect(at[0] - 7, at[1] - 7, 14, 14);
      Object.assign(pen, { strokeStyle: missed ? style.bad : style.muted, lineWidth: missed ? 2 : 1.2 });
      pen.setLineDash([2, 3]);
      pen.stroke();
      pen.setLineDash([]);
      if (missed) this.cross(pen, at, style);
      else if (item) {
        pen.beginPath();
        pen.moveTo(...at);
        pen.lineTo(...view.toScreen(item.x_m, item.y_m));
        Object.assign(pen, { strokeStyle: markOf(label).colour, lineWidth: 1.2 });
        pen.stroke();
      }
    }
  }

  // The missed ones, as far as a name on the map needs them.
  missed() {
    const rows = this.rows.filter(({ state, true_m }) => state === "missed" && true_m);
    return rows.map(({ label, true_m: [x_m, y_m] }) => ({ id: label, labels: { [label]: 1 }, x_m, y_m }));
  }

  cross(pen, [left, top], style) {
    pen.beginPath();
    for (const slope of [1, -1]) { pen.moveTo(left - 5, top - 5 * slope); pen.lineTo(left + 5, top + 5 * slope); }
    Object.assign(pen, { strokeStyle: style.bad, lineWidth: 2.5 });
    pen.stroke();
  }
}
