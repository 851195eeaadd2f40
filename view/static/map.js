// The map from above: grid, path, robot, objects, the chosen one's 95 % ellipse, and every sighting when asked for.
import { SeenFloor } from "/floor.js";
import { markOf, tracePath } from "/marks.js";
import { drawFootprint } from "/furniture.js";
import { byId, setText } from "/dom.js";
import { classDoubt, nameOf } from "/objects.js";
import { titleOf, within } from "/zones.js";
import { Path } from "/path.js";
import { Truth } from "/truth.js";
import { Viewport } from "/viewport.js";

const PICK_PX = 22, TOOLS_PX = 50, LONGEST_AXIS_M = 10, SIGHT_M = 3, TITLE_STEPS = 12;

export class FloorMap {
  // chosen(id or null): somebody picks an object.
  constructor(canvas, modeChanged, chosen) {
    this.canvas = canvas;
    this.pickedBy = chosen;
    this.floor = new SeenFloor();
    this.path = new Path();
    this.truth = new Truth();
    this.view = new Viewport(canvas, () => this.redraw(), modeChanged, (left, top) => this.tap(left, top));
    this.clear();
    for (const name of ["focus", "blur"]) canvas.addEventListener(name, () => this.redraw());
    new ResizeObserver(() => this.redraw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.style = null; this.redraw(); });
  }

  clear() {
    this.chosen = null;
    this.corners = null; // points that are being set: of a zone, a pose or an object
    this.placing = null; // what they are for: zone, pose or point
    this.ghost = null; // a pose that is being set
    this.dock = null;
    this.walls = [];
    this.forget();
  }

  forget() {
    this.objects = new Map();
    this.floor.clear();
    this.trail = [];
    this.zones = this.rooms = this.doors = [];
    this.sightings = [];
    this.seen = new Set();
    this.pose = this.from = this.poseCovariance = null;
    this.info = this.info ?? { chi2_95: 0, view_rad: 1, mount: { forward_m: 0, left_m: 0 } };
    this.redraw();
  }

  about(info) { this.info = info; }

  // Objects that are as likely nothing, or anywhere, only when asked for or chosen.
  shown() { return [...this.objects.values()].filter((item) => this.showDoubtful || !item.doubtful || item.id === this.chosen); }

  update(news) {
    if (news.moved) this.forget(); // all of it comes anew, in another frame
    for (const item of news.changed ?? []) this.objects.set(item.id, item);
    for (const id of news.gone ?? []) this.objects.delete(id);
    for (const name of ["zones", "rooms", "doors"]) this[name] = news[name] ?? this[name];
    if (news.dock !== undefined) this.dock = news.dock;
    if (news.floor) {
      this.floor.take(news.floor);
      this.walls = news.floor.walls;
    }
    this.trail.push(...news.trail);
    this.sightings.push(...(news.sightings ?? []));
    if (news.pose) {
      this.from = this.shownPose() ?? news.pose;
      this.pose = news.pose;
      this.poseCovariance = news.pose_covariance;
      this.poseAt = performance.now();
      this.glideMs = Math.min(150, 1000 / (news.rate_hz || 10));
      this.seen = new Set(news.boxes.map((box) => box.object));
    }
    this.redraw();
  }

  // The robot as it was at a picture of a finished run.
  replay({ pose, boxes }) {
    this.replayed = true;
    this.pose = this.from = pose;
    this.poseCovariance = null;
    this.seen = new Set(boxes.map((box) => box.object));
    this.redraw();
  }

  // The robot between its last two poses, so that it glides and does not jump.
  shownPose() {
    if (!this.pose) return null;
    const share = Math.min(1, (performance.now() - this.poseAt) / this.glideMs), [a, b] = [this.from, this.pose];
    const turn = Math.atan2(Math.sin(b[2] - a[2]), Math.cos(b[2] - a[2]));
    return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * turn];
  }

  choose(id) {
    this.chosen = id;
    if (!this.placing) this.ghost = null;
    const item = this.objects.get(id);
    if (item && !this.view.shows(item.x_m, item.y_m)) {
      this.view.setMode("free");
      this.view.look(item.x_m, item.y_m);
    }
    this.redraw();
  }

  // A finger draws a zone's corner, or picks the nearest object under it; the floor lets go of it.
  tap(left, top) {
    if (this.corners) {
      this.corners.push(this.view.toFloor(left, top));
      this.cornersChanged();
      return this.redraw();
    }
    const far = ({ x_m, y_m }) => { const [x, y] = this.view.toScreen(x_m, y_m); return Math.hypot(x - left, y - top); };
    const nearest = this.shown().sort((a, b) => far(a) - far(b))[0];
    this.pickedBy(nearest && far(nearest) <= PICK_PX ? nearest.id : null);
  }

  redraw() {
    if (!this.asked) this.asked = requestAnimationFrame((now) => this.draw(now));
  }

  extent() {
    const [x, y] = this.pose ?? [0, 0], xs = [], ys = [], limit = (variance) => Math.min(LONGEST_AXIS_M, Math.sqrt(this.info.chi2_95 * variance));
    const [[xx], [, yy]] = this.poseCovariance ?? [[0], [0, 0]], far = Math.max(.75, limit(xx));
    xs.push(x - far, x + far);
    ys.push(y - limit(yy), y + limit(yy));
    for (const { x_m, y_m, radius_m } of this.shown()) {
      xs.push(x_m - radius_m, x_m + radius_m);
      ys.push(y_m - radius_m, y_m + radius_m);
    }
    for (const [x, y] of [...this.zones, ...this.rooms].flatMap(({ corners_m }) => corners_m)) { xs.push(x); ys.push(y); }
    for (const place of [...this.floor.corners(), ...this.trail, ...this.truth.places()]) { xs.push(place[0]); ys.push(place[1]); }
    const least = (values) => values.reduce((a, b) => Math.min(a, b)), most = (values) => values.reduce((a, b) => Math.max(a, b));
    return { x0: least(xs), x1: most(xs), y0: least(ys), y1: most(ys) };
  }

  draw(now) {
    this.asked = null;
    const { canvas, view } = this, ratio = devicePixelRatio || 1, { clientWidth: width, clientHeight: height } = canvas;
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      [canvas.width, canvas.height] = [Math.round(width * ratio), Math.round(height * ratio)];
    }
    const robot = this.shownPose();
    const still = this.corners !== null; // while a person draws
    if (view.mode === "fit" && !still) view.fit(this.extent());
    if (view.mode === "follow" && robot && !still) view.look(robot[0], robot[1]);
    const moving = view.ease(Math.min(100, now - (this.drawnAt ?? now - 16)));
    this.drawnAt = now;
    this.style ??= readStyle();
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = "round";
    this.floor.draw(pen, this.view, this.style);
    const step = this.grid(pen, width, height);
    for (const room of this.rooms) this.zone(pen, room.corners_m, false, this.style.muted);
    for (const door of this.doors) this.door(pen, door);
    for (const zone of this.zones) this.zone(pen, zone.corners_m);
    this.path.draw(pen, view, this.trail, this.replayed ? null : robot, this.style);
    ["ramp-from", "ramp-to"].forEach((id, end) => setText(byId(id), this.path.ends(this.trail)[end]));
    this.truth.draw(pen, view, new Map(this.shown().map((item) => [item.id, item])), this.style);
    this.points(pen);
    for (const item of this.shown()) drawFootprint(pen, item, view, this.style, item.id === this.chosen);
    if (this.dock) this.home(pen, this.dock);
    if (robot) this.robot(pen, robot);
    this.things(pen, robot);
    if (this.corners && this.placing === "zone") this.zone(pen, this.corners, true);
    else if (this.corners?.length) this.cross(pen, view.toScreen(...this.corners[0]), this.style.ink);
    if (this.ghost) this.arrow(pen, this.ghost, .6);
    if (canvas.matches(":focus-visible") || this.corners) this.cross(pen, [width / 2, height / 2], this.style.muted);
    this.scaleBar(pen, height, step);
    if (moving || (this.pose && now - this.poseAt < this.glideMs)) this.redraw();
    else this.drawnAt = null;
  }

  grid(pen, width, height) {
    const step = [0.5, 1, 2, 5, 10, 20].find((metres) => metres * this.view.now.scale >= 48) ?? 50;
    const [top, left] = this.view.toFloor(0, 0), [bottom, right] = this.view.toFloor(width, height);
    for (const strong of [false, true]) {
      pen.beginPath();
      for (let i = Math.ceil(right / step); i <= left / step; i++) {
        if ((i === 0) !== strong) continue;
        const x = Math.round(this.view.toScreen(0, i * step)[0]) + .5;
        pen.moveTo(x, 0);
        pen.lineTo(x, height);
      }
      for (let i = Math.ceil(bottom / step); i <= top / step; i++) {
        if ((i === 0) !== strong) continue;
        const y = Math.round(this.view.toScreen(i * step, 0)[1]) + .5;
        pen.moveTo(0, y);
        pen.lineTo(width, y);
      }
      pen.lineWidth = 1;
      pen.strokeStyle = strong ? this.style.gridStrong : this.style.grid;
      pen.stroke();
    }
    return step;
  }

  points(pen) {
    pen.globalAlpha = .5;
    for (const [label, , x, y] of this.sightings) {
      pen.fillStyle = markOf(label).colour;
      pen.beginPath();
      pen.arc(...this.view.toScreen(x, y), 2, 0, 2 * Math.PI);
      pen.fill();
    }
    pen.globalAlpha = 1;
  }

  robot(pen, [x, y, yaw]) {
    const { view, info } = this, [left, top] = view.toScreen(x, y);
    const { forward_m: ahead, left_m: aside } = info.mount, [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    const lens = [x + c * ahead - s * aside, y + s * ahead + c * aside];
    pen.beginPath();
    for (const corner of this.floor.sight(lens, yaw - info.view_rad / 2, yaw + info.view_rad / 2, SIGHT_M)) pen.lineTo(...view.toScreen(...corner));
    pen.closePath();
    pen.fillStyle = this.style.sight;
    pen.fill();
    if (this.poseCovariance) this.ellipse(pen, this.poseCovariance, [left, top], this.style.ink, [2, 3]);
    this.arrow(pen, [x, y, yaw]);
  }

  things(pen, robot) {
    const placed = robot ? [around(this.view.toScreen(robot[0], robot[1]), 12)] : [];
    const items = this.shown(), missed = this.truth.missed();
    for (const { x_m, y_m } of missed) placed.push(around(this.view.toScreen(x_m, y_m), 6));
    for (const item of items) {
      const at = this.view.toScreen(item.x_m, item.y_m), colour = markOf(item.label).colour, seen = this.seen.has(item.id);
      if (seen && robot) {
        pen.beginPath();
        pen.moveTo(...this.view.toScreen(robot[0], robot[1]));
        pen.lineTo(...at);
        Object.assign(pen, { lineWidth: 1, strokeStyle: colour, globalAlpha: .45 });
        pen.stroke();
        pen.globalAlpha = 1;
      }
      const { doubtful } = item;
      if (item.id === this.chosen) {
        this.ellipse(pen, item.covariance_m2, at, colour, doubtful ? [5, 4] : []);
        this.ring(pen, at);
      }
      tracePath(pen, item.label, at, seen ? 7 : 5.5);
      Object.assign(pen, { strokeStyle: this.style.card, lineWidth: 3 });
      pen.stroke();
      Object.assign(pen, { fillStyle: doubtful ? this.style.card : colour, strokeStyle: colour, lineWidth: 2 });
      pen.fill();
      if (doubtful) pen.stroke();
      placed.push(around(at, 7));
    }
    for (const item of items.sort((a, b) => (b.id === this.chosen) - (a.id === this.chosen) || b.count - a.count)) this.name(pen, item, placed);
    for (const row of missed) this.name(pen, row, placed, this.style.bad);
    for (const room of this.rooms) this.title(pen, room, placed, this.style.muted);
    for (const zone of this.zones) this.title(pen, zone, placed, this.style.ink);
  }

  // A zone or a room, by the colour of its outline; drawn: its corners so far.
  zone(pen, corners, drawn = false, ink = this.style.ink) {
    const places = corners.map(([x, y]) => this.view.toScreen(x, y));
    pen.beginPath();
    for (const place of places) pen.lineTo(...place);
    pen.closePath();
    Object.assign(pen, { fillStyle: this.style.zone, strokeStyle: ink, lineWidth: drawn ? 2.5 : 1.5 });
    pen.fill();
    pen.stroke();
    for (const [left, top] of drawn ? places : []) pen.strokeRect(left - 4, top - 4, 8, 8);
  }

  // The name of a room or zone: inside it, as near to its middle as nothing else is written; else above it.
  title(pen, area, placed, ink) {
    const name = titleOf(area), corners = area.corners_m.map(([x, y]) => this.view.toScreen(x, y));
    const [xs, ys] = [0, 1].map((axis) => corners.map((corner) => corner[axis])), [x0, y0] = [Math.min(...xs), Math.min(...ys)];
    const [width, height] = [Math.max(...xs) - x0, Math.max(...ys) - y0], shares = Array.from({ length: TITLE_STEPS - 1 }, (_, k) => (k + 1) / TITLE_STEPS);
    pen.font = "600 12.5px system-ui, sans-serif";
    const half = pen.measureText(name).width / 2, rect = ([x, y]) => [x - half, y - 8, x + half, y + 8];
    const spots = shares.flatMap((across) => shares.map((down) => [x0 + across * width, y0 + down * height]));
    spots.sort((a, b) => Math.hypot(a[0] - x0 - width / 2, a[1] - y0 - height / 2) - Math.hypot(b[0] - x0 - width / 2, b[1] - y0 - height / 2));
    const free = (box) => [[0, 1], [2, 1], [0, 3], [2, 3]].every(([x, y]) => within(corners, [box[x], box[y]])) && placed.every((other) => apart(box, other));
    const at = spots.find((spot) => free(rect(spot))) ?? [x0 + width / 2, y0 - 12];
    placed.push(rect(at));
    Object.assign(pen, { textAlign: "center", textBaseline: "middle", lineWidth: 3.5, strokeStyle: this.style.card, fillStyle: ink });
    pen.strokeText(name, ...at);
    pen.fillText(name, ...at);
    pen.textAlign = "start";
  }

  // A gap in the walls; a line across it where it is more likely closed.
  door(pen, { from_m, to_m, open }) {
    pen.beginPath();
    for (const end of [from_m, to_m]) pen.lineTo(...this.view.toScreen(...end));
    const open_ = open >= .5, lineWidth = Math.max(open_ ? 5 : 2, (open_ ? .14 : .06) * this.view.now.scale);
    Object.assign(pen, { strokeStyle: open_ ? this.style.floor : this.style.bad, lineWidth });
    pen.stroke();
  }

  // Where the keyboard acts.
  cross(pen, [left, top], colour) {
    pen.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      pen.moveTo(left + 4 * dx, top + 4 * dy);
      pen.lineTo(left + 12 * dx, top + 12 * dy);
    }
    Object.assign(pen, { lineWidth: 1.5, strokeStyle: colour });
    pen.stroke();
  }

  // The dock: a house, with a line the way the robot faces in it.
  home(pen, [x, y, yaw]) {
    const [left, top] = this.view.toScreen(x, y);
    pen.beginPath();
    for (const [dx, dy] of [[0, -9], [8, -2], [6, -2], [6, 7], [-6, 7], [-6, -2], [-8, -2]]) pen.lineTo(left + dx, top + dy);
    pen.closePath();
    Object.assign(pen, { fillStyle: this.style.card, strokeStyle: this.style.ink, lineWidth: 1.5 });
    pen.fill();
    pen.stroke();
    pen.beginPath();
    pen.moveTo(left, top);
    pen.lineTo(left - 18 * Math.sin(yaw), top - 18 * Math.cos(yaw));
    pen.stroke();
  }

  // A pose: an arrow the way it faces.
  arrow(pen, [x, y, yaw], alpha = 1) {
    const [left, top] = this.view.toScreen(x, y);
    pen.save();
    pen.globalAlpha = alpha;
    pen.translate(left, top);
    pen.rotate(-yaw);
    pen.beginPath();
    for (const [px, py] of [[0, -12], [8, 9], [0, 5], [-8, 9]]) pen.lineTo(px, py);
    pen.closePath();
    Object.assign(pen, { fillStyle: this.style.ink, strokeStyle: this.style.card, lineWidth: 2 });
    pen.stroke();
    pen.fill();
    pen.restore();
  }

  ring(pen, at) {
    pen.beginPath();
    pen.arc(...at, 13, 0, 2 * Math.PI);
    Object.assign(pen, { lineWidth: 2.5, strokeStyle: this.style.ink });
    pen.stroke();
  }

  // 95 % ellipse of a covariance over x and y; on the canvas across is -y and down is -x.
  ellipse(pen, [[xx, xy], [, yy]], at, colour, dash) {
    const mean = (xx + yy) / 2, spread = Math.hypot((xx - yy) / 2, xy), angle = Math.atan2(2 * xy, yy - xx) / 2;
    const axes = [mean + spread, Math.max(0, mean - spread)].map((v) => Math.sqrt(this.info.chi2_95 * v) * this.view.now.scale);
    pen.beginPath();
    pen.ellipse(...at, ...axes, angle, 0, 2 * Math.PI);
    Object.assign(pen, { strokeStyle: colour, lineWidth: 1.25 });
    pen.setLineDash(dash);
    pen.stroke();
    pen.setLineDash([]);
  }

  // Beside its dot, where no other name is; left out where there is no room.
  name(pen, item, placed, colour = this.style.ink) {
    const [left, top] = this.view.toScreen(item.x_m, item.y_m), chosen = item.id === this.chosen;
    const text = nameOf(item) + (item.confirmed ? " ✓" : classDoubt(item) ? " ?" : "");
    pen.font = `${chosen ? 650 : 500} 12.5px system-ui, sans-serif`;
    const width = pen.measureText(text).width, places = [[12, 0], [-12 - width, 0], [-width / 2, -18], [-width / 2, 18]];
    const rect = ([dx, dy]) => [left + dx, top + dy - 7, left + dx + width, top + dy + 7];
    const free = places.find((place) => this.inside(rect(place)) && placed.every((other) => apart(rect(place), other))) ?? (chosen ? places[0] : null);
    if (!free) return;
    placed.push(rect(free));
    pen.textBaseline = "middle";
    Object.assign(pen, { lineWidth: 3.5, strokeStyle: this.style.card, fillStyle: colour });
    pen.strokeText(text, left + free[0], top + free[1]);
    pen.fillText(text, left + free[0], top + free[1]);
  }

  inside([left, top, right, bottom]) {
    return left >= 4 && top >= TOOLS_PX && right <= this.canvas.clientWidth - 4 && bottom <= this.canvas.clientHeight - 4;
  }

  scaleBar(pen, height, step) {
    const length = step * this.view.now.scale, left = 16.5, bottom = height - 16.5;
    pen.beginPath();
    pen.moveTo(left, bottom - 5);
    pen.lineTo(left, bottom);
    pen.lineTo(left + length, bottom);
    pen.lineTo(left + length, bottom - 5);
    Object.assign(pen, { lineWidth: 1.5, strokeStyle: this.style.muted, fillStyle: this.style.muted });
    pen.stroke();
    pen.font = "12px system-ui, sans-serif";
    pen.textBaseline = "alphabetic";
    pen.fillText(`${step} m`, left + 6, bottom - 5);
  }
}

function around([left, top], reach) { return [left - reach, top - reach, left + reach, top + reach]; }
function apart(a, b) { return a[2] < b[0] || b[2] < a[0] || a[3] < b[1] || b[3] < a[1]; }

function readStyle() {
  const style = getComputedStyle(document.documentElement), names = { grid: "--grid", gridStrong: "--grid-strong", bad: "--bad",
    pathStart: "--path-start", pathEnd: "--path-end", sure: "--sure", unsure: "--unsure",
    ink: "--ink", card: "--card", muted: "--muted", sight: "--sight", zone: "--zone", floor: "--floor", obstacle: "--obstacle" };
  return Object.fromEntries(Object.entries(names).map(([key, name]) => [key, style.getPropertyValue(name).trim()]));
}
