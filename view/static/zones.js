// Named parts of the floor: drawn by tapping their corners on the map, listed with the objects in them.
import { button, byId, element } from "/dom.js";
import { nameOf } from "/objects.js";

export class Zones {
  constructor(map, ask, undoable) {
    Object.assign(this, { map, ask, undoable });
    map.cornersChanged = () => this.told();
    byId("draw").onclick = () => (map.corners ? this.stop() : this.start());
    this.clear();
  }

  clear() {
    this.stop();
    this.drawn = "";
    byId("zones").hidden = true;
  }

  start() {
    this.map.corners = [];
    this.map.redraw();
    byId("draw").setAttribute("aria-pressed", true);
    const bar = byId("drawing"), name = element("input");
    Object.assign(name, { placeholder: "Name of the zone", maxLength: 80 });
    name.setAttribute("aria-label", "Name of the zone");
    name.onkeydown = ({ key }) => { if (key === "Enter") this.save(); };
    name.oninput = () => this.told();
    Object.assign(this, { name, words: element("p"), keep: button("Save zone", () => this.save()) });
    bar.replaceChildren(this.words, name, button("Corner back", () => { this.map.corners.pop(); this.map.redraw(); this.told(); }),
      button("Cancel", () => this.stop()), this.keep);
    bar.hidden = false;
    this.told();
  }

  stop() {
    this.map.corners = null;
    this.map.redraw();
    byId("draw").setAttribute("aria-pressed", false);
    byId("drawing").hidden = true;
  }

  told() {
    const count = this.map.corners.length;
    this.words.textContent = count < 3 ? `Tap the corners on the map: ${count} of at least 3` : `${count} corners`;
    this.keep.disabled = count < 3 || !this.name.value.trim();
  }

  async save() {
    if (this.keep.disabled) return;
    if (await this.ask("POST", "zones", { name: this.name.value.trim(), corners_m: this.map.corners })) this.stop();
  }

  update(zones, objects) {
    const told = zones.map((zone) => ({ ...zone, inside: zone.objects.map((id) => nameOf(objects.get(id) ?? { id })) }));
    const key = JSON.stringify(told.map(({ id, name, inside }) => [id, name, inside]));
    if (key === this.drawn) return;
    this.drawn = key;
    byId("zones").hidden = !zones.length;
    const list = element("ul");
    list.append(...told.map((zone) => this.row(zone)));
    byId("zones").replaceChildren(element("h2", "Zones"), list);
  }

  row({ id, name, corners_m, inside }) {
    const row = element("li"), which = element("span", "", "which");
    which.append(element("b", name), element("span", ` ${inside.length ? inside.join(", ") : "nothing in it"}`, "muted small"));
    const rename = button("Rename", () => {
      const input = element("input");
      Object.assign(input, { value: name, maxLength: 80 });
      input.setAttribute("aria-label", `Name of ${name}`);
      const keep = () => this.ask("PUT", `zones/${encodeURIComponent(id)}`, { name: input.value.trim(), corners_m });
      input.onkeydown = (event) => { if (event.key === "Enter") keep(); };
      row.replaceChildren(input, button("Save", keep));
      input.focus();
    });
    row.append(which, rename, button("Delete", async () => {
      const gone = await this.ask("DELETE", `zones/${encodeURIComponent(id)}`);
      if (gone) this.undoable(`Zone ${name} is deleted`, () => this.ask("POST", "zones", { name, corners_m }));
    }));
    return row;
  }
}
