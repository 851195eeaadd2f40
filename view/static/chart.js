// Charts over time as SVG that stretches to any width; the words are HTML beside it and stay readable on a phone.
import { element } from "/dom.js";
import { duration } from "/path.js";

const SVG = "http://www.w3.org/2000/svg", WIDTH = 1000, HEIGHT = 100;

function shape(name, attributes, title = "") {
  const made = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (title) made.append(Object.assign(document.createElementNS(SVG, "title"), { textContent: title }));
  return made;
}

// layers: [{kind: area, line or thin, values, below: values or none, colour, title}] over times in seconds, from 0 to top in a unit.
export function chart(times, layers, top, unit, name) {
  const span = Math.max(times.at(-1) ?? 0, 1e-9), picture = shape("svg", { viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img", "aria-label": name });
  const at = (values, backwards = false) => {
    const points = values.map((value, k) => `${(times[k] / span * WIDTH).toFixed(1)},${(HEIGHT * (1 - Math.min(value / top, 1))).toFixed(1)}`);
    return (backwards ? points.reverse() : points).join(" ");
  };
  for (const share of [0, .5, 1]) picture.append(shape("line", { x1: 0, x2: WIDTH, y1: HEIGHT * (1 - share), y2: HEIGHT * (1 - share), class: "rule" }));
  for (const { kind, values, below, colour, title } of layers) {
    if (kind === "area") picture.append(shape("polygon", { points: `${at(values)} ${at(below ?? values.map(() => 0), true)}`, class: "area", fill: colour ?? "" }, title));
    else picture.append(shape("polyline", { points: at(values), class: kind }, title));
  }
  const whole = element("figure", "", "chart"), levels = element("div", "", "levels"), marks = element("div", "", "times");
  for (const share of [1, .5, 0]) levels.append(element("span", `${+(top * share).toPrecision(3)}${share === 1 ? ` ${unit}` : ""}`));
  for (const share of [0, .5, 1]) marks.append(element("span", duration(span * share)));
  whole.append(levels, picture, marks);
  return whole;
}

// The end of an axis: a round number that is at least the value.
export function niceTop(value) {
  if (!(value > 0) || !Number.isFinite(value)) return 1;
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.2, 1.6, 2, 2.4, 3, 4, 5, 6, 8, 10].find((step) => step * power >= value * (1 - 1e-9));
}
