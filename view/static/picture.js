// The camera's picture, and the boxes over it, drawn from data at the screen's own sharpness.

import { markOf, tracePath } from "/marks.js";

const OTHER = "#b4bcc6", PLATE = "rgba(16, 19, 23, .84)";

export class Picture {
  constructor(stack) {
    this.stack = stack;
    [this.image, this.boxes] = stack.querySelectorAll("canvas");
    this.waiting = stack.querySelector(".waiting");
    this.last = [];
    this.size = [4, 3];
    this.grid = null; // a floor grid that is being laid: the picture stands still under it
    new ResizeObserver(() => this.drawBoxes()).observe(stack);
  }

  about({ picture_px }) {
    this.size = picture_px;
    this.stack.style.aspectRatio = `${picture_px[0]} / ${picture_px[1]}`;
  }

  clear() {
    this.last = [];
    this.image.width = this.image.width;
    this.drawBoxes();
    this.waiting.hidden = false;
  }

  draw(bitmap, boxes) {
    if (this.grid) return;
    if (this.image.width !== bitmap.width || this.image.height !== bitmap.height) {
      [this.image.width, this.image.height] = [bitmap.width, bitmap.height];
    }
    this.image.getContext("2d").drawImage(bitmap, 0, 0);
    this.waiting.hidden = true;
    this.last = boxes;
    this.drawBoxes();
  }

  drawBoxes() {
    const { clientWidth: width, clientHeight: height } = this.stack, ratio = devicePixelRatio || 1;
    const [columns, rows] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.boxes.width !== columns || this.boxes.height !== rows) [this.boxes.width, this.boxes.height] = [columns, rows];
    const pen = this.boxes.getContext("2d"), scale = Math.min(width / this.size[0], height / this.size[1]);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, columns, rows);
    pen.setTransform(ratio, 0, 0, ratio, (columns - ratio * scale * this.size[0]) / 2, (rows - ratio * scale * this.size[1]) / 2);
    if (this.grid) return this.grid.draw(pen, scale);
    const ordered = [...this.last].sort((a, b) => (a.distance_m !== null) - (b.distance_m !== null) || b.distance_m - a.distance_m);
    for (const found of ordered) this.frame(pen, found, scale);
    const taken = [];
    for (const found of ordered.reverse()) this.plate(pen, found, scale, taken);
  }

  frame(pen, { box, label, distance_m }, scale) {
    const [x0, y0, x1, y1] = box.map((v) => v * scale);
    pen.setLineDash(distance_m === null ? [4, 4] : []);
    pen.lineWidth = distance_m === null ? 3 : 4;
    pen.strokeStyle = "rgba(16, 19, 23, .45)";
    pen.strokeRect(x0, y0, x1 - x0, y1 - y0);
    pen.lineWidth = distance_m === null ? 1 : 2;
    pen.strokeStyle = distance_m === null ? OTHER : markOf(label).colour;
    pen.strokeRect(x0, y0, x1 - x0, y1 - y0);
  }

  // Above its box, or further down where another plate is already.
  plate(pen, { box, label, distance_m }, scale, taken) {
    const onFloor = distance_m !== null, text = onFloor ? `${label}  ${distance_m.toFixed(1)} m` : label;
    pen.font = `${onFloor ? 600 : 400} 12px system-ui, sans-serif`;
    const width = pen.measureText(text).width + (onFloor ? 28 : 10), height = 20;
    const x = Math.max(0, Math.min(box[0] * scale, this.size[0] * scale - width));
    let y = Math.max(0, box[1] * scale - height);
    while (taken.some(([left, top, right]) => x < right && left < x + width && Math.abs(y - top) < height)) y += 2;
    taken.push([x, y, x + width]);
    pen.fillStyle = PLATE;
    pen.fillRect(x, y, width, height);
    if (onFloor) {
      tracePath(pen, label, [x + 11.5, y + height / 2], 5);
      Object.assign(pen, { fillStyle: markOf(label).colour, strokeStyle: "#fff", lineWidth: 2.5 });
      pen.stroke();
      pen.fill();
    }
    pen.fillStyle = onFloor ? "#fff" : "#d3d9e0";
    pen.textBaseline = "middle";
    pen.fillText(text, x + (onFloor ? 22 : 5), y + height / 2 + .5);
  }
}
