// The marks of the labels: a shape in a colour, drawn on a canvas or as a small picture in a list.

const SVG = "http://www.w3.org/2000/svg";
let marks = {}, shapes = {};

export function learnMarks(info) { ({ marks, shapes } = info); }
export function markOf(label) { return marks[label] ?? { shape: "circle", colour: "#6f7782" }; }

// A path of a label's shape about a point; radius in px.
export function tracePath(pen, label, [left, top], radius) {
  const corners = shapes[markOf(label).shape] ?? [];
  pen.beginPath();
  if (!corners.length) pen.arc(left, top, radius, 0, 2 * Math.PI);
  for (const [x, y] of corners) pen.lineTo(left + radius * x, top + radius * y);
  pen.closePath();
}

// hollow: of an object that may not be there.
export function markPicture(label, hollow = false) {
  const { shape, colour } = markOf(label), corners = shapes[shape] ?? [], svg = document.createElementNS(SVG, "svg");
  const drawn = document.createElementNS(SVG, corners.length ? "polygon" : "circle");
  if (corners.length) drawn.setAttribute("points", corners.map((corner) => corner.join()).join(" "));
  else drawn.setAttribute("r", 1);
  drawn.setAttribute("fill", hollow ? "none" : colour);
  drawn.setAttribute("stroke", colour);
  drawn.setAttribute("stroke-width", .3);
  svg.setAttribute("viewBox", "-1.6 -1.6 3.2 3.2");
  svg.setAttribute("class", "mark-picture");
  svg.setAttribute("aria-hidden", "true");
  svg.append(drawn);
  return svg;
}
