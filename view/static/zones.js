// Parts of the floor, listed with the objects in them: zones, drawn by their corners on the map, and the rooms.
import { button, byId, element } from "/dom.js";
import { nameOf } from "/objects.js";

export const titleOf = ({ name, kind, id }) => name || kind || id;

export class Zones {
  constructor(map, placing, ask, undoable) {
    Object.assign(this, { map, placing, ask, undoable });
    byId("draw").onclick = () => (map.placing === "zone" ? placing.stop() : this.start());
    this.clear();
  }

  clear() {
    this.drawn = "";
    byId("zones").hidden = true;
  }

  // A tap inside a room that the floor plan shows offers its outline; else the corners are drawn one by one.
  start() {
    let rooms = [];
    this.ask("GET", "rooms").then((found) => { rooms = found ?? []; });
    const name = element("input"), room = button("Use this room", () => {
      this.map.corners.splice(0, 1, ...roomAt(rooms, this.map.corners[0]).corners_m);
      this.placing.changed();
    });
    room.hidden = true;
    Object.assign(name, { placeholder: "Name of the zone", maxLength: 80 });
    name.setAttribute("aria-label", "Name of the zone");
    byId("draw").setAttribute("aria-pressed", true);
    this.placing.start({
      kind: "zone", save: "Save zone", fields: [name, room],
      moved: (points) => { room.hidden = points.length !== 1 || !roomAt(rooms, points[0]); },
      words: (count) => count < 3 ? `Tap the corners on the map, or press Enter at the cross: ${count} of at least 3` : `${count} corners`,
      ready: (count) => count >= 3 && Boolean(name.value.trim()),
      stopped: () => byId("draw").setAttribute("aria-pressed", false),
      done: (corners_m) => this.ask("POST", "zones", { name: name.value.trim(), corners_m }),
    });
  }

  update(zones, rooms, objects) {
    const shown = [zones, rooms].map((areas) => areas.map((area) => {
      const inside = area.objects.map((id) => objects.get(id) ?? { id }), hidden = this.map.showDoubtful ? [] : inside.filter(({ doubtful }) => doubtful);
      const names = inside.filter((item) => !hidden.includes(item)).map(nameOf);
      return { ...area, inside: hidden.length ? [...names, `${hidden.length} doubtful`] : names };
    }));
    const key = JSON.stringify(shown.map((areas) => areas.map((area) => [area.id, titleOf(area), area.inside])));
    if (key === this.drawn || document.activeElement?.matches("#zones input")) return; // nor while a person types a name
    this.drawn = key;
    byId("zones").hidden = !zones.length && !rooms.length;
    byId("zones").replaceChildren(...shown.flatMap((areas, isRooms) => {
      const list = element("ul");
      list.append(...areas.map((area) => this.row(area, isRooms)));
      return areas.length ? [element("h2", isRooms ? "Rooms" : "Zones"), list] : [];
    }));
  }

  row(area, isRoom) {
    const { id, corners_m, inside } = area, name = titleOf(area);
    const row = element("li"), which = element("span", "", "which");
    which.append(element("b", name), element("span", ` ${inside.length ? inside.join(", ") : "nothing in it"}`, "muted small"));
    const rename = button("Rename", () => {
      const input = element("input");
      Object.assign(input, { value: area.name, maxLength: 80 });
      input.setAttribute("aria-label", `Name of ${name}`);
      const keep = () => {
        input.blur();
        const value = { name: input.value.trim() }, path = `${isRoom ? "rooms" : "zones"}/${encodeURIComponent(id)}`;
        return this.ask(isRoom ? "PATCH" : "PUT", path, isRoom ? value : { ...value, corners_m });
      };
      input.onkeydown = (event) => { if (event.key === "Enter") keep(); };
      row.replaceChildren(input, button("Save", keep));
      input.focus();
    });
    row.append(which);
    if (!this.ask) return row;
    row.append(rename);
    if (!isRoom) row.append(button("Delete", async () => {
      const gone = await this.ask("DELETE", `zones/${encodeURIComponent(id)}`);
      if (gone) this.undoable(`Zone ${name} is deleted`, () => this.ask("POST", "zones", { name, corners_m }));
    }));
    return row;
  }
}

function roomAt(rooms, place) { return rooms.find(({ corners_m }) => within(corners_m, place)); }

// Whether a polygon holds a point.
export function within(corners, [x, y]) {
  return corners.reduce((inside, [ax, ay], k) => {
    const [bx, by] = corners.at(k - 1);
    return (ay > y) !== (by > y) && x < ax + (y - ay) * (bx - ax) / (by - ay) ? !inside : inside;
  }, false);
}
