// Objects corrected and added by hand: class, place, size and facing, in a form or on the map.
import { button, byId, element } from "/dom.js";
import { field, number } from "/placing.js";

const DEGREE = Math.PI / 180;

export class Corrections {
  constructor(map, placing, choose, ask, undoable) {
    Object.assign(this, { map, placing, choose, ask, undoable, labels: [] });
    byId("add").onclick = () => this.add();
  }

  about({ marks }) { this.labels = Object.keys(marks).sort(); }

  path({ id }) { return `objects/${encodeURIComponent(id)}`; }

  async change(item, what) {
    const done = await this.ask("PATCH", this.path(item), what);
    if (done) this.undoable(`${item.name || item.id} is corrected`, () => this.ask("POST", `${this.path(item)}/restore`, {}));
    return done;
  }

  // The fold in an object's card.
  form(item) {
    const fold = element("details", "", "correct"), form = element("div", "", "fields"), classes = this.classes(item.label);
    const [width, depth] = item.footprint_m, yaw = item.yaw_rad ?? null;
    const inputs = {
      x_m: number(item.x_m.toFixed(2), .05), y_m: number(item.y_m.toFixed(2), .05),
      width_m: number(width.toFixed(2), .05, .02, 20), depth_m: number(depth.toFixed(2), .05, .02, 20), height_m: number(Math.max(item.height_m, .02).toFixed(2), .05, .02, 20),
      yaw_rad: number(yaw === null ? "" : Math.round(yaw / DEGREE), 5),
    };
    inputs.yaw_rad.placeholder = "?";
    const before = Object.fromEntries(Object.entries(inputs).map(([key, input]) => [key, input.value]));
    const save = () => {
      const changed = Object.entries(inputs).filter(([key, input]) => input.value !== "" && input.value !== before[key]).map(([key]) => key);
      if (changed.some((key) => key === "x_m" || key === "y_m")) changed.push("x_m", "y_m");
      const what = Object.fromEntries(changed.map((key) => [key, Number(inputs[key].value) * (key === "yaw_rad" ? DEGREE : 1)]));
      if (classes.value !== item.label) what.label = classes.value;
      if (Object.keys(what).length) return this.change(item, what);
      return null;
    };
    form.onkeydown = ({ key, target }) => { if (key === "Enter" && target.tagName === "INPUT") save(); };
    form.append(field("Class", classes), field("x", inputs.x_m, "m"), field("y", inputs.y_m, "m"), field("Width", inputs.width_m, "m"),
      field("Depth", inputs.depth_m, "m"), field("Height", inputs.height_m, "m"), field("Facing", inputs.yaw_rad, "°"));
    const acts = element("div", "", "acts");
    acts.append(button("Save", save, "main"), button("Move on the map", () => this.move(item)));
    if (item.corrected) acts.append(button("As measured", () => this.ask("POST", `${this.path(item)}/restore`, {})));
    fold.append(element("summary", "Correct"), form, acts);
    return fold;
  }

  classes(chosen) {
    const list = element("select");
    list.append(...[...new Set([...this.labels, chosen])].filter(Boolean).sort().map((label) => new Option(label, label, label === chosen, label === chosen)));
    return list;
  }

  move(item) {
    const [x, y] = [number(item.x_m.toFixed(2), .05), number(item.y_m.toFixed(2), .05)];
    this.place(x, y, [], `Tap where ${item.name || item.id} is, or type its place`, "Move it", (x_m, y_m) => this.change(item, { x_m, y_m }));
  }

  add() {
    const [x, y] = [number("", .05), number("", .05)], classes = this.classes(this.labels.includes("chair") ? "chair" : this.labels[0]);
    this.place(x, y, [field("Class", classes)], "Tap where the object is, or type its place", "Add", async (x_m, y_m) => {
      const made = await this.ask("POST", "objects", { label: classes.value, x_m, y_m });
      if (made) {
        this.undoable(`${made.id} is on the map`, () => this.ask("DELETE", this.path(made)));
        this.wanted = made.id;
      }
      return made;
    });
  }

  place(x, y, fields, words, save, done) {
    this.placing.start({
      kind: "point", most: 1, save, fields: [...fields, field("x", x, "m"), field("y", y, "m")],
      words: () => words, ready: () => x.value !== "" && y.value !== "",
      moved: ([point]) => { if (point) { x.value = point[0].toFixed(2); y.value = point[1].toFixed(2); } },
      done: () => done(Number(x.value), Number(y.value)),
    });
  }
}
