// Furniture from above, in its true size: outlines by class, turned the way it faces; a circle where that is unknown.
import { markOf } from "/marks.js";

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

// view: a Viewport. style: of the page. Draws what an object takes of the floor.
export function drawFootprint(pen, item, view, style, strong) {
  const colour = markOf(item.label).colour, [width, depth] = item.footprint_m, round = ROUND.has(item.label);
  const yaw = round ? 0 : item.yaw_rad ?? null, at = view.toScreen(item.x_m, item.y_m), path = new Path2D();
  if (round) path.ellipse(0, 0, depth / 2, width / 2, 0, 0, 2 * Math.PI);
  else if (yaw !== null) (SHAPES[item.label] ?? SHAPES.table)(path, depth, width);
  else path.arc(0, 0, item.radius_m, 0, 2 * Math.PI);
  const { scale } = view.now, [c, s] = [scale * Math.cos(yaw ?? 0), scale * Math.sin(yaw ?? 0)];
  const placed = new Path2D();
  placed.addPath(path, new DOMMatrix([-s, -c, -c, s, ...at]));
  Object.assign(pen, { fillStyle: colour, globalAlpha: strong ? .34 : .2 });
  pen.fill(placed);
  Object.assign(pen, { globalAlpha: yaw === null ? .3 : .75, strokeStyle: colour, lineWidth: strong ? 2 : 1.2 });
  pen.stroke(placed);
  pen.globalAlpha = 1;
}
