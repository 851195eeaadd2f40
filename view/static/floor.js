// The floor as the robot has seen it: free, obstacles and walls, below everything else; and how far it can be seen over.
const FREE = 0, OBSTACLE = 100, STEP_RAD = .02;

export class SeenFloor {
  constructor() { this.clear(); }

  clear() { this.floor = this.picture = null; }

  // floor: {x_m, y_m, cell_m, rows, columns, runs: [value, count, …] row by row, walls: [{from_m, to_m}, …]}.
  take(floor) {
    const cells = new Int8Array(floor.rows * floor.columns);
    for (let at = 0, k = 0; k < floor.runs.length; at += floor.runs[k + 1], k += 2) cells.fill(floor.runs[k], at, at + floor.runs[k + 1]);
    const { x_m, y_m, cell_m, rows, columns } = floor;
    let [left, right, low, high] = [columns, 0, rows, 0];
    for (let k = 0; k < cells.length; k++) {
      if (cells[k] !== FREE && cells[k] !== OBSTACLE) continue;
      const column = k % columns, row = (k - column) / columns;
      [left, right, low, high] = [Math.min(left, column), Math.max(right, column + 1), Math.min(low, row), Math.max(high, row + 1)];
    }
    this.known = left < right ? [[x_m + left * cell_m, y_m + low * cell_m], [x_m + right * cell_m, y_m + high * cell_m]] : [];
    this.floor = { ...floor, cells };
    this.picture = null;
  }

  // Opposite corners of what is known, [x, y].
  corners() { return this.floor ? this.known : []; }

  draw(pen, view, style) {
    if (!this.floor) return;
    const { x_m, y_m, cell_m, rows, columns, walls } = this.floor, far = [x_m + columns * cell_m, y_m + rows * cell_m];
    if (this.style !== style) this.picture = null; // light or dark
    this.style = style;
    this.picture ??= this.paint();
    const [left, top] = view.toScreen(...far), scale = cell_m * view.now.scale;
    pen.imageSmoothingEnabled = false;
    pen.drawImage(this.picture, left, top, rows * scale, columns * scale);
    pen.beginPath();
    for (const { from_m, to_m } of walls) {
      pen.moveTo(...view.toScreen(...from_m));
      pen.lineTo(...view.toScreen(...to_m));
    }
    Object.assign(pen, { strokeStyle: style.ink, lineWidth: Math.max(1.5, .06 * view.now.scale), lineCap: "round" });
    pen.stroke();
    pen.lineCap = "butt";
  }

  // A pixel a cell, as the map shows it: x up, y to the left.
  paint() {
    const { rows, columns, cells } = this.floor, canvas = document.createElement("canvas");
    Object.assign(canvas, { width: rows, height: columns });
    const pen = canvas.getContext("2d");
    for (const [value, colour] of [[FREE, this.style.floor], [OBSTACLE, this.style.obstacle]]) {
      pen.fillStyle = colour;
      for (let row = 0; row < rows; row++) {
        for (let column = 0; column < columns; column++) {
          if (cells[row * columns + column] === value) pen.fillRect(rows - 1 - row, columns - 1 - column, 1, 1);
        }
      }
    }
    return canvas;
  }

  // The part of the floor that is seen from [x, y] between two angles, to a distance or to the first obstacle: corners.
  sight([x, y], from, to, far) {
    const step = this.floor?.cell_m ?? far, corners = [[x, y]];
    for (let angle = from; angle < to + STEP_RAD; angle += STEP_RAD) {
      const c = Math.cos(Math.min(angle, to)), s = Math.sin(Math.min(angle, to));
      let reach = step;
      while (reach < far && !this.stops(x + reach * c, y + reach * s)) reach += step;
      corners.push([x + Math.min(reach, far) * c, y + Math.min(reach, far) * s]);
    }
    return corners;
  }

  stops(x, y) {
    const { x_m, y_m, cell_m, rows, columns, cells } = this.floor ?? {};
    const column = Math.floor((x - x_m) / cell_m), row = Math.floor((y - y_m) / cell_m);
    return column >= 0 && row >= 0 && column < columns && row < rows && cells[row * columns + column] === OBSTACLE;
  }
}
