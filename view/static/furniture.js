// Furniture from above, in its true size: outlines by class, turned the way it faces where that is known or can be assumed.
import { markOf } from "/marks.js";

const WALL_REACH_M = .6; // of a back to the wall that it stands at
const ROUND = new Set(["potted plant", "vase", "bowl", "cup", "bottle", "sports ball", "clock"]);

// Each draws into a box of depth d (x, forward to the front) and width w (y, to the left) about the centre.
const SHAPES = {
  chair(path, d, w) {
    box(path, -d / 2, -w / 2, d, w, .18 * d);
    box(path, -d / 2, -w / 2, .18 * d, w, .06 * d);
  },
  couch(path, d, w) {
    box(path, -d / 2, -w / 2, d, w, .1 * d);
    box(path, -d / 2, -w / 2, .28 * d, w, .08 * d);
    for (const side of [-w / 2, w / 2 - .12 * w]) box(path, -d / 2, side, d, .12 * w, .06 * d);
  },
  bed(path, d, w) {
    box(path, -d / 2, -w / 2, d, w, .04 * d);
    for (const side of [-.44 * w, .04 * w]) box(path, -.46 * d, side, .18 * d, .4 * w, .03 * d);
  },
  toilet(path, d, w) {
    box(path, -d / 2, -w / 2, .3 * d, w, .04 * d);
    path.moveTo(.5 * d, 0);
    path.ellipse(.14 * d, 0, .36 * d, .4 * w, 0, 0, 2 * Math.PI);
  },
  sink(path, d, w) {
    box(path, -d / 2, -w / 2, d, w, .06 * d);
    path.moveTo(.34 * d, 0);
    path.ellipse(0, 0, .34 * d, .36 * w, 0, 0, 2 * Math.PI);
  },
  bench(path, d, w) {
    box(path, -d / 2, -w / 2, d, w, .05 * d);
    for (const at of [-1 / 6, 1 / 6]) { path.moveTo(at * d, -w / 2); path.lineTo(at * d, w / 2); }
  },
  cabinet(path, d, w) {
    box(path, -d / 2, -w / 2, d, w, .04 * d);
    path.moveTo(.38 * d, -w / 2);
    path.lineTo(.38 * d, w / 2);
  },
  table(path, d, w) { box(path, -d / 2, -w / 2, d, w, .06 * Math.min(d, w)); },
};
for (const name of ["refrigerator", "oven", "microwave", "tv"]) SHAPES[name] = SHAPES.cabinet;

function box(path, x, y, width, height, radius) { path.roundRect(x, y, width, height, radius); }

// The yaw to draw an object at, and whether a person has set it; null where nobody can say.
export function facing({ x_m, y_m, yaw_rad, footprint_m: [, depth] }, walls) {
  if (yaw_rad !== undefined && yaw_rad !== null) return { yaw: yaw_rad, set: true };
  if (!walls.length) return null;
  let nearest = null, four = [0, 0];
  for (const { from_m: [ax, ay], to_m: [bx, by] } of walls) {
    const [dx, dy] = [bx - ax, by - ay], length = Math.hypot(dx, dy) || 1e-9;
    const along = Math.max(0, Math.min(1, ((x_m - ax) * dx + (y_m - ay) * dy) / length ** 2));
    const [ox, oy] = [x_m - ax - along * dx, y_m - ay - along * dy], away = Math.hypot(ox, oy);
    if (!nearest || away < nearest.away) nearest = { away, dx, dy, side: Math.sign(dx * (y_m - ay) - dy * (x_m - ax)) || 1 };
    const angle = 4 * Math.atan2(dy, dx);
    four = [four[0] + length * Math.cos(angle), four[1] + length * Math.sin(angle)];
  }
  if (nearest.away <= depth / 2 + WALL_REACH_M) return { yaw: Math.atan2(nearest.side * nearest.dx, -nearest.side * nearest.dy), set: false };
  return { yaw: Math.atan2(four[1], four[0]) / 4, set: false };
}

// view: a Viewport. style: of the page. Draws what an object takes of the floor.
export function drawFootprint(pen, item, view, walls, style, strong) {
  const colour = markOf(item.label).colour, [width, depth] = item.footprint_m, round = ROUND.has(item.label);
  const turned = round ? { yaw: 0, set: true } : facing(item, walls), at = view.toScreen(item.x_m, item.y_m), path = new Path2D();
  if (round) path.ellipse(0, 0, depth / 2, width / 2, 0, 0, 2 * Math.PI);
  else if (turned) (SHAPES[item.label] ?? SHAPES.table)(path, depth, width);
  else path.arc(0, 0, item.radius_m, 0, 2 * Math.PI);
  const { scale } = view.now, yaw = turned?.yaw ?? 0, [c, s] = [scale * Math.cos(yaw), scale * Math.sin(yaw)];
  const placed = new Path2D();
  placed.addPath(path, new DOMMatrix([-s, -c, -c, s, ...at]));
  Object.assign(pen, { fillStyle: colour, globalAlpha: strong ? .34 : .2 });
  pen.fill(placed);
  Object.assign(pen, { globalAlpha: turned ? .75 : .3, strokeStyle: colour, lineWidth: strong ? 2 : 1.2 });
  pen.setLineDash(turned && !turned.set ? [4, 3] : []);
  pen.stroke(placed);
  pen.setLineDash([]);
  pen.globalAlpha = 1;
}
