// A metre grid on the floor over a picture that stands still: dragged until it lies flat, it gives the camera's height and pitch.
import { button, byId, element } from "/dom.js";

const RADIANS = Math.PI / 180, NEAREST_M = .2, FARTHEST_M = 8, ASIDE_M = 4, STEP_M = .1, BEHIND = .05;
const HEIGHT = { least: .05, most: 3, step: .01 }, PITCH = { least: -45, most: 85, step: .1 };
const LINE = "#4db8ff", UNDER = "rgba(16, 19, 23, .7)", HORIZON = "#ff6b6b";

export class FloorGrid {
  constructor(picture, ask, notice) {
    Object.assign(this, { picture, ask, notice, open: false });
    byId("lay-grid").onclick = () => (this.open ? this.stop() : this.start());
    const { stack } = picture;
    stack.addEventListener("pointerdown", (event) => this.grab(event));
    stack.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"]) stack.addEventListener(end, () => { this.from = null; });
  }

  about(info) {
    Object.assign(this, { lens: info.lens, mount: { ...info.mount }, size: info.picture_px });
    this.stop();
  }

  start() {
    this.open = true;
    this.before = { ...this.mount };
    this.picture.grid = this;
    this.picture.stack.dataset.grid = "";
    this.sliders = { height_m: slider(HEIGHT), pitch_deg: slider(PITCH) };
    this.shown = { height_m: element("output"), pitch_deg: element("output") };
    for (const [key, input] of Object.entries(this.sliders)) input.oninput = () => this.set({ [key]: Number(input.value) });
    const acts = element("div", "", "acts");
    const keep = button("Save", null, "main");
    keep.type = "submit";
    acts.append(keep, button("Cancel", () => this.stop()));
    byId("mount-form").replaceChildren(
      element("p", "Drag until the lines lie flat on the floor, 1 m apart: up or down tilts, left or right changes the height. A door is about 0.8 m wide.", "muted"),
      row("Height", this.sliders.height_m, this.shown.height_m), row("Pitch", this.sliders.pitch_deg, this.shown.pitch_deg), acts,
    );
    byId("mount-form").onsubmit = (event) => { event.preventDefault(); this.save(); };
    this.show(true);
    this.set({});
    this.sliders.pitch_deg.focus();
  }

  stop() {
    if (this.open) this.mount = this.before;
    this.close();
  }

  close() {
    const focused = byId("mount-form").contains(document.activeElement);
    Object.assign(this, { open: false, from: null });
    this.picture.grid = null;
    delete this.picture.stack.dataset.grid;
    this.show(false);
    if (focused) byId("lay-grid").focus();
    this.picture.drawBoxes();
  }

  show(on) {
    byId("mount-form").hidden = !on;
    byId("lay-grid").setAttribute("aria-pressed", on);
  }

  set(change) {
    Object.assign(this.mount, change);
    this.mount.height_m = within(this.mount.height_m, HEIGHT);
    this.mount.pitch_deg = within(this.mount.pitch_deg, PITCH);
    for (const key of ["height_m", "pitch_deg"]) this.sliders[key].value = this.mount[key];
    this.shown.height_m.value = `${this.mount.height_m.toFixed(2)} m`;
    this.shown.pitch_deg.value = `${Math.abs(this.mount.pitch_deg).toFixed(1)}° ${this.mount.pitch_deg < 0 ? "up" : "down"}`;
    this.picture.drawBoxes();
  }

  grab({ clientX, clientY, pointerId }) {
    if (!this.open) return;
    this.picture.stack.setPointerCapture?.(pointerId);
    this.from = { x: clientX, y: clientY, ...this.mount };
  }

  // The horizon follows the pointer up and down; to the right the squares grow, as nearer the floor.
  drag({ clientX, clientY }) {
    if (!this.from) return;
    const { stack } = this.picture, scale = Math.min(stack.clientWidth / this.size[0], stack.clientHeight / this.size[1]);
    const down = Math.atan((clientY - this.from.y) / scale / this.lens.fy) / RADIANS;
    this.set({ pitch_deg: this.from.pitch_deg - down, height_m: this.from.height_m * Math.exp(-(clientX - this.from.x) / stack.clientWidth) });
  }

  async save() {
    const { height_m, pitch_deg } = this.mount;
    const saved = await this.ask("PUT", "mount", { height_m, pitch_deg });
    if (!saved) return;
    this.close();
    this.notice(`Saved. The next run: --camera-file ${saved.path}`);
  }

  // A direction or point seen from the lens, in axes forward, left, up: to pixels, null where it is not before the lens.
  project([forward, left, up]) {
    const { fx, fy, cx, cy, distortion: { model, coefficients } } = this.lens;
    const [cp, sp] = turn(this.mount.pitch_deg), [cr, sr] = turn(this.mount.roll_deg);
    const depth = cp * forward - sp * up, above = sp * forward + cp * up;
    if (depth < BEHIND) return null;
    const x = -(cr * left + sr * above) / depth, y = -(cr * above - sr * left) / depth;
    const [k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0] = model === "none" ? [] : coefficients;
    const r2 = x * x + y * y;
    if (model === "equidistant") { // whose coefficients are k1, k2, k3, k4
      const away = Math.sqrt(r2), angle = Math.atan(away), a2 = angle * angle;
      const stretch = away > 0 ? angle * (1 + a2 * (k1 + a2 * (k2 + a2 * (p1 + a2 * p2)))) / away : 1;
      return [fx * x * stretch + cx, fy * y * stretch + cy];
    }
    const radial = (1 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1 + r2 * (k4 + r2 * (k5 + r2 * k6)));
    const [xr, yr] = [x * radial, y * radial];
    const [tx, ty] = ["brown_conrady", "rational"].includes(model) ? [x, y] : [xr, yr];
    return [fx * (xr + 2 * p1 * tx * ty + p2 * (r2 + 2 * tx * tx)) + cx, fy * (yr + p1 * (r2 + 2 * ty * ty) + 2 * p2 * tx * ty) + cy];
  }

  floor(x, y) { return this.project([x, y, -this.mount.height_m]); }

  draw(pen, scale) {
    const across = range(-ASIDE_M, ASIDE_M, 1), ahead = range(1, FARTHEST_M, 1);
    const fine = range(NEAREST_M, FARTHEST_M, STEP_M), wide = range(-ASIDE_M, ASIDE_M, STEP_M);
    const lines = [...across.map((y) => fine.map((x) => this.floor(x, y))), ...ahead.map((x) => wide.map((y) => this.floor(x, y)))];
    const horizon = range(-60, 60, 2).map((deg) => this.project([Math.cos(deg * RADIANS), Math.sin(deg * RADIANS), 0]));
    for (const [colour, width] of [[UNDER, 3.5], [LINE, 1.5]]) trace(pen, lines, colour, width, scale);
    for (const [colour, width] of [[UNDER, 3.5], [HORIZON, 1.5]]) trace(pen, [horizon], colour, width, scale);
  }
}

function trace(pen, lines, colour, width, scale) {
  Object.assign(pen, { strokeStyle: colour, lineWidth: width });
  pen.setLineDash([]);
  pen.beginPath();
  for (const line of lines) {
    let last = null;
    for (const point of line) {
      if (point) pen[last ? "lineTo" : "moveTo"](point[0] * scale, point[1] * scale);
      last = point;
    }
  }
  pen.stroke();
}

function turn(degrees) { return [Math.cos(degrees * RADIANS), Math.sin(degrees * RADIANS)]; }
function range(first, last, step) { return Array.from({ length: Math.round((last - first) / step) + 1 }, (_, index) => first + index * step); }
function within(value, { least, most }) { return Math.min(most, Math.max(least, value)); }

function slider({ least, most, step }) {
  const input = element("input");
  Object.assign(input, { type: "range", min: least, max: most, step });
  return input;
}

function row(name, input, value) {
  const label = element("label", name);
  label.append(input, value);
  return label;
}
