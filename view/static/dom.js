// Small helpers. What comes from the robot or a person is only ever set as text.

export const byId = (id) => document.getElementById(id);

export function element(name, text = "", className = "") {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = className;
  return made;
}

export function button(text, act, className = "") {
  const made = element("button", text, className);
  made.type = "button";
  made.onclick = act;
  return made;
}

// A sentence whose words in backticks are code, into an element.
export function prose(text, place) {
  place.append(...text.split("`").map((part, k) => (k % 2 ? element("code", part) : part)));
  return place;
}

export function setText(place, text) { if (place.textContent !== text) place.textContent = text; }
export function metres(value) { return `${value.toFixed(value < 10 ? 1 : 0)} m`; }

export function ago(seconds) {
  if (seconds < 1.5) return "now";
  if (seconds < 90) return `${seconds.toFixed(0)} s ago`;
  return seconds < 5400 ? `${(seconds / 60).toFixed(0)} min ago` : `${(seconds / 3600).toFixed(1)} h ago`;
}
