// The robot's pose and the dock, set by a person: a place, then the way it faces, on the map or in numbers.
import { byId, element } from "/dom.js";
import { field, number } from "/placing.js";

const DEGREE = Math.PI / 180;

export class Robot {
  constructor(map, placing, ask, notice) {
    Object.assign(this, { map, placing, ask, notice });
    byId("set-pose").onclick = () => this.start("pose", "robot", "Set pose");
    byId("set-dock").onclick = () => this.start("dock", "dock", "Set dock");
  }

  start(address, what, save) {
    const before = address === "dock" && this.map.dock ? this.map.dock : this.map.pose ?? [0, 0, 0];
    const [x, y, yaw] = [number(before[0].toFixed(2), .05), number(before[1].toFixed(2), .05), number(Math.round(before[2] / DEGREE), 5)];
    const told = () => [x, y, yaw].map((input) => Number(input.value)), filled = () => [x, y, yaw].every((input) => input.value !== "");
    const show = () => { this.map.ghost = filled() ? [told()[0], told()[1], told()[2] * DEGREE] : null; };
    this.placing.start({
      kind: "pose", most: 2, save,
      fields: [field("x", x, "m"), field("y", y, "m"), field("facing", yaw, "°")],
      words: (count) => count === 0 ? `Tap where the ${what} is, or type its place` : count === 1 ? "Tap a point that it faces" : `Tap again to place the ${what} anew`,
      ready: filled,
      moved: (points) => {
        if (points.length >= 1) { x.value = points[0][0].toFixed(2); y.value = points[0][1].toFixed(2); }
        if (points.length === 2) yaw.value = Math.round(Math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0]) / DEGREE);
        show();
      },
      typed: show,
      stopped: () => { this.map.ghost = null; this.map.redraw(); },
      done: async () => {
        const [x_m, y_m, degrees] = told();
        const done = await this.ask("PUT", address, { x_m, y_m, yaw_rad: wrapped(degrees * DEGREE) });
        if (done) this.notice(address === "dock" ? "The dock is set: edgemap run --start dock begins there" : "The robot's pose is set");
        return done;
      },
    });
  }
}

function wrapped(angle) { return Math.atan2(Math.sin(angle), Math.cos(angle)); }
