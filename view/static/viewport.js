// Which part of the floor the map shows: panned by one finger or mouse, zoomed by two, by the wheel, or by keys.
// The map's x (forward) is up and its y (left) is to the left.

const CLOSEST = 400, FARTHEST = .05, EASE_MS = 180, TAP_PX = 6; // px per metre
const SIDES_PX = 60, ABOVE_PX = 62, BELOW_PX = 46; // of the map: room for names, buttons and the scale

export class Viewport {
  // mode: "fit" shows all, "follow" keeps the robot in the middle, "free" stays. changed(): something to draw.
  // tapped(left, top): a finger or mouse came and went in one place.
  constructor(canvas, changed, modeChanged, tapped) {
    Object.assign(this, { canvas, changed, modeChanged, tapped });
    this.mode = "fit";
    this.now = { x: 1.5, y: 0, scale: 80 };
    this.goal = { ...this.now };
    this.pointers = new Map();
    canvas.addEventListener("pointerdown", (event) => this.down(event));
    canvas.addEventListener("pointermove", (event) => this.move(event));
    canvas.addEventListener("pointerup", (event) => this.up(event));
    canvas.addEventListener("pointercancel", (event) => { this.pointers.delete(event.pointerId); this.tap = null; });
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.key(event));
  }

  toScreen(x, y) {
    const { now, canvas } = this;
    return [canvas.clientWidth / 2 - (y - now.y) * now.scale, canvas.clientHeight / 2 - (x - now.x) * now.scale];
  }

  toFloor(left, top) {
    const { now, canvas } = this;
    return [now.x + (canvas.clientHeight / 2 - top) / now.scale, now.y + (canvas.clientWidth / 2 - left) / now.scale];
  }

  setMode(mode) {
    this.mode = mode;
    this.modeChanged(mode);
    this.changed();
  }

  // Show a box of the floor {x0, y0, x1, y1} in metres, all of it below the buttons and above the scale.
  fit({ x0, y0, x1, y1 }) {
    const { clientWidth, clientHeight } = this.canvas;
    const width = Math.max(clientWidth - 2 * SIDES_PX, 40), height = Math.max(clientHeight - ABOVE_PX - BELOW_PX, 40);
    const scale = clamp(Math.min(width / Math.max(y1 - y0, 1), height / Math.max(x1 - x0, 1), 160));
    this.goal = { x: (x0 + x1) / 2 + (ABOVE_PX - BELOW_PX) / 2 / scale, y: (y0 + y1) / 2, scale };
  }

  shows(x, y) {
    const [left, top] = this.toScreen(x, y);
    return left >= 0 && top >= ABOVE_PX / 2 && left <= this.canvas.clientWidth && top <= this.canvas.clientHeight;
  }

  look(x, y) { Object.assign(this.goal, { x, y }); }

  // Move towards the goal; true while there is some way left.
  ease(passedMs) {
    const share = 1 - Math.exp(-passedMs / EASE_MS);
    let left = 0;
    for (const key of ["x", "y", "scale"]) {
      const gap = this.goal[key] - this.now[key];
      this.now[key] += share * gap;
      left = Math.max(left, Math.abs(gap) * (key === "scale" ? 1 / this.now.scale : this.now.scale / 100));
    }
    if (left < 1e-3) this.now = { ...this.goal };
    return left >= 1e-3;
  }

  zoom(factor, left = this.canvas.clientWidth / 2, top = this.canvas.clientHeight / 2) {
    const [x, y] = this.toFloor(left, top);
    this.now.scale = clamp(this.now.scale * factor);
    const [after_x, after_y] = this.toFloor(left, top);
    if (this.mode === "follow") {
      this.goal.scale = this.now.scale;
      return this.changed();
    }
    this.now.x += x - after_x;
    this.now.y += y - after_y;
    this.free();
  }

  free() {
    this.goal = { ...this.now };
    this.setMode("free");
  }

  down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.tap = this.pointers.size === 1 ? [event.offsetX, event.offsetY] : null;
  }

  up(event) {
    this.pointers.delete(event.pointerId);
    if (this.tap) this.tapped(...this.tap);
    this.tap = null;
  }

  move(event) {
    const before = this.pointers.get(event.pointerId), after = [event.offsetX, event.offsetY];
    if (!before) return;
    if (this.tap && Math.hypot(after[0] - this.tap[0], after[1] - this.tap[1]) <= TAP_PX) return;
    this.tap = null;
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    this.pointers.set(event.pointerId, after);
    const hands = other ? 2 : 1; // each of two fingers moves the middle by half
    this.now.y += (after[0] - before[0]) / this.now.scale / hands;
    this.now.x += (after[1] - before[1]) / this.now.scale / hands;
    this.free();
    if (other) {
      const factor = Math.hypot(after[0] - other[0], after[1] - other[1]) / Math.max(1, Math.hypot(before[0] - other[0], before[1] - other[1]));
      this.zoom(factor, (after[0] + other[0]) / 2, (after[1] + other[1]) / 2);
    }
  }

  wheel(event) {
    event.preventDefault();
    const pixels = event.deltaY * (event.deltaMode === 1 ? 16 : 1);
    this.zoom(Math.exp(-pixels * (event.ctrlKey ? .01 : .0015)), event.offsetX, event.offsetY);
  }

  key(event) {
    const step = 60 / this.now.scale, ways = { ArrowUp: [step, 0], ArrowDown: [-step, 0], ArrowLeft: [0, step], ArrowRight: [0, -step] };
    if (event.key === "+" || event.key === "=") this.zoom(1.25);
    else if (event.key === "-") this.zoom(.8);
    else if (event.key === "Enter" || event.key === " ") this.tapped(this.canvas.clientWidth / 2, this.canvas.clientHeight / 2);
    else if (ways[event.key]) {
      this.now.x += ways[event.key][0];
      this.now.y += ways[event.key][1];
      this.free();
    } else return;
    event.preventDefault();
  }
}

function clamp(scale) { return Math.min(CLOSEST, Math.max(FARTHEST, scale)); }
