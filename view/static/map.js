// The map from above: grid, way, robot, objects with their 95 % ellipses, and every sighting when asked for.
import { markOf, tracePath } from "/marks.js";
import { classDoubt, DOUBT, nameOf } from "/objects.js";
import { Viewport } from "/viewport.js";

const PICK_PX = 22, TOOLS_PX = 50, LONGEST_AXIS_M = 10;

export class FloorMap {
  // chosen(id or null): somebody picks an object.
  constructor(canvas, modeChanged, chosen) {
    this.canvas = canvas;
    this.pickedBy = chosen;
    this.view = new Viewport(canvas, () => this.redraw(), modeChanged, (left, top) => this.tap(left, top));
    this.clear();
    new ResizeObserver(() => this.redraw()).observe(canvas);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { this.style = null; this.redraw(); });
  }

  clear() {
    this.chosen = null;
    this.corners = null; // of the zone that is being drawn
    this.forget();
  }

  forget() {
    this.objects = new Map();
    this.trail = [];
    this.zones = [];
    this.sightings = [];
    this.seen = new Set();
    this.pose = this.from = this.poseCovariance = null;
    this.info = this.info ?? { chi2_95: 0, view_rad: 1, lens_m: [0, 0] };
    this.redraw();
  }

  about(info) { this.info = info; }

  update(news) {
    if (news.moved) this.forget(); // all of it comes anew, in another frame
    for (const item of news.changed ?? []) this.objects.set(item.id, item);
    for (const id of news.gone ?? []) this.objects.delete(id);
    this.zones = news.zones ?? this.zones;
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

  // The robot between its last two poses, so that it glides and does not jump.
  shownPose() {
    if (!this.pose) return null;
    const share = Math.min(1, (performance.now() - this.poseAt) / this.glideMs), [a, b] = [this.from, this.pose];
    const turn = Math.atan2(Math.sin(b[2] - a[2]), Math.cos(b[2] - a[2]));
    return [a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]), a[2] + share * turn];
  }

  choose(id) {
    this.chosen = id;
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
    const nearest = [...this.objects.values()].sort((a, b) => far(a) - far(b))[0];
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
    for (const { x_m, y_m, radius_m, covariance_m2: [[xx], [, yy]] } of this.objects.values()) {
      const [ahead, aside] = [Math.max(radius_m, limit(xx)), Math.max(radius_m, limit(yy))];
      xs.push(x_m - ahead, x_m + ahead);
      ys.push(y_m - aside, y_m + aside);
    }
    for (const [x, y] of this.zones.flatMap(({ corners_m }) => corners_m)) { xs.push(x); ys.push(y); }
    for (const place of this.trail) { xs.push(place[0]); ys.push(place[1]); }
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
    if (view.mode === "fit") view.fit(this.extent());
    if (view.mode === "follow" && robot) view.look(robot[0], robot[1]);
    const moving = view.ease(Math.min(100, now - (this.drawnAt ?? now - 16)));
    this.drawnAt = now;
    this.style ??= readStyle();
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineJoin = "round";
    const step = this.grid(pen, width, height);
    for (const zone of this.zones) this.zone(pen, zone.corners_m, zone.name);
    this.way(pen, robot);
    this.points(pen);
    for (const item of this.objects.values()) this.footprint(pen, item);
    if (robot) this.robot(pen, robot);
    this.things(pen, robot);
    if (this.corners) this.zone(pen, this.corners, "", true);
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

  way(pen, robot) {
    if (!this.trail.length) return;
    pen.beginPath();
    for (const [x, y] of this.trail) pen.lineTo(...this.view.toScreen(x, y));
    if (robot) pen.lineTo(...this.view.toScreen(robot[0], robot[1]));
    pen.lineWidth = 2;
    pen.strokeStyle = this.style.trail;
    pen.stroke();
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
    const [ahead, aside] = info.lens_m, [c, s] = [Math.cos(yaw), Math.sin(yaw)];
    const lens = view.toScreen(x + c * ahead - s * aside, y + s * ahead + c * aside);
    const reach = 3 * view.now.scale, middle = -Math.PI / 2 - yaw; // of the canvas: 0 right, clockwise
    pen.beginPath();
    pen.moveTo(...lens);
    pen.arc(...lens, reach, middle - info.view_rad / 2, middle + info.view_rad / 2);
    pen.closePath();
    pen.fillStyle = this.style.sight;
    pen.fill();
    if (this.poseCovariance) this.ellipse(pen, this.poseCovariance, [left, top], this.style.ink, [2, 3]);
    pen.save();
    pen.translate(left, top);
    pen.rotate(-yaw);
    pen.beginPath();
    for (const [px, py] of [[0, -12], [8, 9], [0, 5], [-8, 9]]) pen.lineTo(px, py);
    pen.closePath();
    pen.fillStyle = this.style.ink;
    pen.strokeStyle = this.style.card;
    pen.lineWidth = 2;
    pen.stroke();
    pen.fill();
    pen.restore();
  }

  things(pen, robot) {
    const placed = robot ? [around(this.view.toScreen(robot[0], robot[1]), 12)] : [];
    const items = [...this.objects.values()];
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
      const doubtful = item.confidence < DOUBT;
      this.ellipse(pen, item.covariance_m2, at, colour, doubtful ? [5, 4] : []);
      if (item.id === this.chosen) this.ring(pen, at);
      tracePath(pen, item.label, at, seen ? 7 : 5.5);
      Object.assign(pen, { strokeStyle: this.style.card, lineWidth: 3 });
      pen.stroke();
      Object.assign(pen, { fillStyle: doubtful ? this.style.card : colour, strokeStyle: colour, lineWidth: 2 });
      pen.fill();
      if (doubtful) pen.stroke();
      placed.push(around(at, 7));
    }
    for (const item of items.sort((a, b) => (b.id === this.chosen) - (a.id === this.chosen) || b.count - a.count)) this.name(pen, item, placed);
  }

  // A named part of the floor; drawn: its corners so far.
  zone(pen, corners, name, drawn = false) {
    const places = corners.map(([x, y]) => this.view.toScreen(x, y));
    pen.beginPath();
    for (const place of places) pen.lineTo(...place);
    pen.closePath();
    Object.assign(pen, { fillStyle: this.style.zone, strokeStyle: this.style.ink, lineWidth: drawn ? 2.5 : 1.5 });
    pen.fill();
    pen.stroke();
    for (const [left, top] of drawn ? places : []) pen.strokeRect(left - 4, top - 4, 8, 8);
    if (!name) return;
    const xs = places.map(([left]) => left), middle = (Math.min(...xs) + Math.max(...xs)) / 2;
    const top = Math.min(...places.map(([, y]) => y)) - 4;
    pen.font = "600 12.5px system-ui, sans-serif";
    Object.assign(pen, { textAlign: "center", textBaseline: "bottom", lineWidth: 3.5, strokeStyle: this.style.card, fillStyle: this.style.ink });
    pen.strokeText(name, middle, top);
    pen.fillText(name, middle, top);
    pen.textAlign = "start";
  }

  // How much floor it takes: a disc, as nobody knows which way it faces.
  footprint(pen, { x_m, y_m, radius_m, label }) {
    pen.beginPath();
    pen.arc(...this.view.toScreen(x_m, y_m), radius_m * this.view.now.scale, 0, 2 * Math.PI);
    Object.assign(pen, { fillStyle: markOf(label).colour, globalAlpha: .17 });
    pen.fill();
    pen.globalAlpha = 1;
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
  name(pen, item, placed) {
    const [left, top] = this.view.toScreen(item.x_m, item.y_m), chosen = item.id === this.chosen;
    const text = nameOf(item) + (item.confirmed ? " ✓" : classDoubt(item) ? " ?" : "");
    pen.font = `${chosen ? 650 : 500} 12.5px system-ui, sans-serif`;
    const width = pen.measureText(text).width, places = [[12, 0], [-12 - width, 0], [-width / 2, -18], [-width / 2, 18]];
    const rect = ([dx, dy]) => [left + dx, top + dy - 7, left + dx + width, top + dy + 7];
    const free = places.find((place) => this.inside(rect(place)) && placed.every((other) => apart(rect(place), other))) ?? (chosen ? places[0] : null);
    if (!free) return;
    placed.push(rect(free));
    pen.textBaseline = "middle";
    Object.assign(pen, { lineWidth: 3.5, strokeStyle: this.style.card, fillStyle: this.style.ink });
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
  const style = getComputedStyle(document.documentElement), names = { grid: "--grid", gridStrong: "--grid-strong", trail: "--trail",
    ink: "--ink", card: "--card", muted: "--muted", sight: "--sight", zone: "--zone" };
  return Object.fromEntries(Object.entries(names).map(([key, name]) => [key, style.getPropertyValue(name).trim()]));
}
