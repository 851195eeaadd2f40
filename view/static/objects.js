// The list of objects, nearest first, and the card of the one that is picked, where it is named, confirmed, merged or deleted.
import { Corrections } from "/corrections.js";
import { ago, button, byId, element, metres, setText } from "/dom.js";
import { markPicture } from "/marks.js";
import { duration } from "/path.js";

const CLASS_DOUBT = .8, REDRAW_MS = 250;

// What an object is called, and whether its class is in doubt.
export function nameOf(item) { return item.name || item.id; }
export function classDoubt(item) { return Math.max(0, ...Object.values(item.labels)) < CLASS_DOUBT; }

export class Objects {
  // choose(id or null): somebody picks an object. ask(method, path, body): a request to the robot, null where it refuses;
  // null where nothing can be edited. undoable(text, act): tell what was done, and how to take it back.
  constructor(map, placing, choose, ask, undoable) {
    Object.assign(this, { map, choose, ask, undoable, rowOf: new Map() });
    this.corrections = new Corrections(map, placing, choose, ask, undoable);
    this.rows = new Map();
    this.clear();
  }

  about(info) {
    this.drives = info.drives;
    this.corrections.about(info);
  }

  // The list in one line, for a sheet that is down.
  summary() {
    const items = this.map.shown();
    if (!this.pose || !items.length) return "No objects yet";
    const nearest = items.reduce((a, b) => (this.away(a) < this.away(b) ? a : b));
    return `${items.length} object${items.length > 1 ? "s" : ""} · nearest ${nameOf(nearest)}, ${metres(this.away(nearest))}`;
  }

  clear() {
    this.items = new Map();
    this.seen = new Set();
    this.pose = null;
    this.chosen = null;
    this.drawnAt = -Infinity;
    for (const { item } of this.rows.values()) item.remove();
    this.rows.clear();
    setText(byId("count"), "");
    this.showDetail();
  }

  update({ pose, stamp_s, state }, items, seen) {
    if (!pose) return;
    Object.assign(this, { pose, stamp_s, items, seen, over: state === "finished" });
    this.start_s = this.map.trail[0]?.[2] ?? stamp_s;
    if (performance.now() - this.drawnAt < REDRAW_MS) {
      this.late ??= setTimeout(() => this.redraw(), REDRAW_MS);
    } else this.redraw();
  }

  pick(id) {
    this.chosen = this.items.has(id) ? id : null;
    for (const [key, { press }] of this.rows) press.setAttribute("aria-pressed", key === this.chosen);
    this.showDetail();
    const row = this.rows.get(this.chosen)?.item, list = byId("objects"), place = byId("detail");
    if (!row) return;
    list.scrollTop = Math.min(Math.max(list.scrollTop, row.offsetTop + row.offsetHeight - list.clientHeight), row.offsetTop);
    place.parentElement.scrollTop = 0;
    place.scrollIntoView({ block: "start" });
  }

  away({ x_m, y_m }) { return Math.hypot(x_m - this.pose[0], y_m - this.pose[1]); }

  redraw() {
    clearTimeout(this.late);
    this.late = null;
    this.drawnAt = performance.now();
    if (!this.pose) return;
    const all = [...this.items.values()], doubtful = all.filter((item) => item.doubtful).length, press = byId("doubtful");
    const sorted = this.map.shown().sort((a, b) => this.away(a) - this.away(b)), list = byId("objects"), kept = new Set(sorted.map(({ id }) => id));
    setText(byId("count"), all.length ? `${all.length - doubtful}` : "none yet");
    press.hidden = !doubtful;
    setText(press, `Show ${doubtful} doubtful`);
    for (const [id, { item }] of this.rows) if (!kept.has(id)) { item.remove(); this.rows.delete(id); }
    sorted.forEach((item, place) => {
      const row = this.rows.get(item.id) ?? this.row(item);
      if (list.children[place] !== row.item) list.insertBefore(row.item, list.children[place] ?? null);
      this.fill(row, item);
    });
    this.legend(all);
    if (this.chosen && !this.items.has(this.chosen)) this.choose(null);
    else this.fillDetail();
  }

  row({ id }) {
    const item = element("li"), press = element("button"), mark = element("span", "", "mark"), name = element("span", "", "who");
    const far = element("span", "", "far"), more = element("span", "", "more");
    press.type = "button";
    press.onclick = () => this.choose(this.chosen === id ? null : id);
    press.setAttribute("aria-pressed", id === this.chosen);
    press.append(mark, name, far, more);
    const small = this.pictures.thumbnail({ id });
    if (small) press.append(Object.assign(new Image(), { src: small, alt: "", className: "small", loading: "lazy" }));
    item.append(press);
    item.dataset.id = id;
    const row = { item, press, mark, name, far, more };
    this.rows.set(id, row);
    return row;
  }

  fill({ press, mark, name, far, more }, item) {
    const hollow = item.doubtful, drawn = `${item.label}${hollow}`, shares = Object.entries(item.labels);
    if (mark.dataset.drawn !== drawn) {
      mark.replaceChildren(markPicture(item.label, hollow));
      mark.dataset.drawn = drawn;
    }
    setText(name, nameOf(item));
    setText(far, metres(this.away(item)));
    const found = this.judged(item.id), seen = this.seen.has(item.id) ? "in view" : this.lastSeen(item);
    const doubt = classDoubt(item) ? shares.slice(0, 2).map(([label, share]) => `${label} ${percent(share)}`).join(" or ") : "";
    setText(more, [item.name ? item.id : "", item.confirmed ? "confirmed" : "", doubt, hollow ? `confidence ${percent(item.confidence)}` : "", found, seen].filter(Boolean).join(", "));
    press.dataset.seen = this.seen.has(item.id);
  }

  // While the run goes on, how long ago; of a finished one, when.
  lastSeen({ earlier, last_seen, last_seen_s }) {
    if (earlier) return last_seen ? new Date(last_seen).toLocaleString([], { dateStyle: "medium", timeStyle: "short" }) : "in an earlier run";
    return !this.over ? ago(Math.max(0, this.stamp_s - last_seen_s)) : `at ${duration(Math.round(Math.max(0, last_seen_s - this.start_s)))}`;
  }

  // What the truth says of an object: found, misplaced, extra or unscored, with the error.
  judged(id) {
    const row = this.rowOf.get(id);
    return row ? `${row.state}${row.error_m === null ? "" : `, ${row.error_m.toFixed(2)} m off`}` : "";
  }

  // Of a finished run: its first stamp, and the rows of its evaluation; those without an object were missed.
  judge({ start_s, truth }) {
    const rows = truth?.rows ?? [];
    this.start_s = start_s;
    this.rowOf = new Map(rows.filter(({ object_id }) => object_id).map((row) => [row.object_id, row]));
    const missed = rows.filter(({ state }) => state === "missed"), place = byId("missed");
    place.hidden = !missed.length;
    place.replaceChildren(element("h2", `Missed: ${missed.length}`), element("p", "true objects that the map lacks", "muted small"));
    const list = element("ul");
    list.append(...missed.map(({ label, true_m: [x, y] }) => {
      const line = element("li");
      line.append(markPicture(label, true), `${label} at x ${x.toFixed(2)}, y ${y.toFixed(2)} m`.replaceAll("-", "−"));
      return line;
    }));
    place.append(list);
    this.redraw();
  }

  // What the map draws, and no more.
  legend(all) {
    const labels = [...new Set(all.map(({ label }) => label))].sort(), list = byId("legend-labels"), drawn = labels.join("\n");
    const { zones, rooms, dock, truth } = this.map, drawnToo = {
      doubtful: all.some(({ doubtful }) => doubtful), unsure: all.some(classDoubt), confirmed: all.some(({ confirmed }) => confirmed),
      turned: all.some(({ yaw_rad }) => yaw_rad !== null), circle: all.some(({ yaw_rad }) => yaw_rad === null),
      zone: zones.length, room: rooms.length, dock, truth: truth.rows.length, missed: truth.missed().length,
    };
    for (const row of document.querySelectorAll("[data-when]")) row.hidden = !drawnToo[row.dataset.when];
    if (list.dataset.drawn === drawn) return;
    list.dataset.drawn = drawn;
    list.replaceChildren(...labels.map((label) => {
      const line = element("li");
      line.append(markPicture(label), label);
      return line;
    }));
  }

  showDetail() {
    const place = byId("detail"), item = this.items.get(this.chosen);
    place.hidden = !item;
    if (!item) {
      place.replaceChildren();
      return;
    }
    const picture = new Image(), head = element("div", "", "head"), words = element("div", "", "words"), close = element("button", "×", "close");
    const name = element("h2"), kind = element("p", "", "muted"), facts = element("dl", "", "facts"), labels = element("div", "", "labels");
    picture.alt = `${item.id} in the camera's picture`;
    picture.onerror = () => { picture.hidden = true; };
    picture.src = this.pictures.picture(item);
    picture.hidden = !picture.src;
    close.type = "button";
    close.setAttribute("aria-label", "Close");
    close.onclick = () => this.choose(null);
    words.append(name, kind);
    head.append(picture, words, close);
    place.replaceChildren(head, facts, labels, ...(this.ask ? this.editing(item) : []));
    this.detail = { ...this.detail, name, kind, facts, labels };
    this.fillDetail();
  }

  // What a person may change of an object.
  editing(item) {
    const called = element("div", "", "name"), input = element("input"), confirm = button("Confirm", () => this.confirm());
    Object.assign(input, { value: item.name ?? "", placeholder: "Name", maxLength: 80 });
    input.setAttribute("aria-label", `Name of ${item.id}`);
    input.onkeydown = ({ key }) => { if (key === "Enter") this.rename(input.value); };
    called.append(input, button("Rename", () => this.rename(input.value)));
    const acts = element("div", "", "acts"), merge = element("div", "", "merge"), into = element("select");
    const preview = element("p", "", "preview"), same = button("Merge", () => this.merge(into.value));
    into.setAttribute("aria-label", `Another object that is the same as ${item.id}`);
    into.onfocus = () => this.offerMerges(into);
    into.onchange = () => this.previewMerge(into.value, preview, same);
    preview.setAttribute("role", "status");
    preview.hidden = same.hidden = true;
    merge.append(into, same, preview);
    acts.append(confirm, button("Approach", () => this.approach()), button("Delete", () => this.delete()));
    this.detail = { confirm };
    this.offerMerges(into);
    return [called, acts, merge, this.corrections.form(item)];
  }

  rename(name) { return this.ask("PATCH", this.path(), { name: name.trim() }); }
  confirm() { return this.ask("PATCH", this.path(), { confirmed: !this.items.get(this.chosen).confirmed }); }
  path(id = this.chosen) { return `objects/${encodeURIComponent(id)}`; }

  // Where the robot would go; and off it goes, where somebody drives.
  async approach() {
    const id = this.chosen, found = await this.ask("GET", `${this.path(id)}/approach`);
    if (!found) return;
    this.corrections.map.ghost = [found.x_m, found.y_m, found.yaw_rad];
    this.corrections.map.redraw();
    const words = `${nameOf(this.items.get(id))}: from x ${found.x_m.toFixed(2)}, y ${found.y_m.toFixed(2)} m${found.floor === "free" ? "" : " (floor unknown)"}`;
    this.undoable(words, this.drives && !this.over ? () => this.ask("POST", `${this.path(id)}/go`, {}) : null, "Go there");
  }

  async delete() {
    const id = this.chosen, name = nameOf(this.items.get(id));
    if (await this.ask("DELETE", this.path())) this.undoable(`${name} is off the map`, () => this.ask("POST", `${this.path(id)}/restore`, {}));
  }

  // What both would be as one, before it is done: several can be looked at with the arrow keys.
  async previewMerge(into, place, act) {
    place.hidden = act.hidden = true;
    const found = into && await this.ask("GET", `${this.path()}/merge?into=${encodeURIComponent(into)}`);
    if (!found) return;
    const { x_m, y_m, label, labels, count } = found, share = labels[label];
    place.textContent = `Together: ${into}, ${label}${share === undefined ? "" : ` ${percent(share)}`}, at x ${x_m.toFixed(2)}, y ${y_m.toFixed(2)} m, seen ${count} times`;
    place.hidden = act.hidden = false;
  }

  async merge(into) {
    const id = this.chosen, name = nameOf(this.items.get(id));
    if (!into || !await this.ask("POST", `${this.path()}/merge`, { into })) return;
    this.undoable(`${name} is now part of ${into}`, () => this.ask("POST", `${this.path(id)}/restore`, {}));
    this.choose(into);
  }

  // The others, the nearest to this one first.
  offerMerges(list) {
    const item = this.items.get(this.chosen), apart = ({ x_m, y_m }) => Math.hypot(x_m - item.x_m, y_m - item.y_m);
    const others = [...this.items.values()].filter(({ id }) => id !== item.id).sort((a, b) => apart(a) - apart(b));
    list.replaceChildren(new Option("Same as…", ""), ...others.map((other) => new Option(`${nameOf(other)}, ${metres(apart(other))} from it`, other.id)));
    list.disabled = !others.length;
  }

  fillDetail() {
    const item = this.items.get(this.chosen);
    if (!item || !this.detail) return;
    const { name, kind, facts, labels, confirm } = this.detail, [[xx], [, yy]] = item.covariance_m2;
    setText(name, nameOf(item));
    if (confirm) {
      setText(confirm, item.confirmed ? "Confirmed" : "Confirm");
      confirm.title = item.confirmed ? "Take it back" : "It is there: it will not be forgotten";
      confirm.setAttribute("aria-pressed", Boolean(item.confirmed));
    }
    setText(kind, [item.name ? item.id : "", item.label, item.corrected ? `corrected: ${item.corrected.join(", ")}` : ""].filter(Boolean).join(", "));
    const values = {
      "From the robot": `${this.away(item).toFixed(2)} m`,
      "Position": `x ${item.x_m.toFixed(2)}, y ${item.y_m.toFixed(2)} m`.replaceAll("-", "−"),
      "Uncertainty": `± ${Math.sqrt((xx + yy) / 2).toFixed(2)} m`,
      "Size": `${item.footprint_m.map((side) => side.toFixed(2)).join(" × ")} m, ${item.height_m.toFixed(2)} m high`,
      "Facing": facingOf(item),
      "Confidence": percent(item.confidence),
      "Seen": `${item.count} times, ${this.seen.has(item.id) ? "in view" : `last ${this.lastSeen(item)}`}`,
    };
    const row = this.rowOf.get(item.id);
    if (row) values["Against the truth"] = `${this.judged(item.id)}${row.covered === null ? "" : row.covered ? ", in its 95 % ellipse" : ", outside its 95 % ellipse"}`;
    if (facts.children.length !== Object.keys(values).length) {
      facts.replaceChildren(...Object.keys(values).map((key) => {
        const pair = element("div");
        pair.append(element("dt", key), element("dd"));
        return pair;
      }));
    }
    Object.values(values).forEach((text, place) => setText(facts.children[place].lastChild, text.replace(/(\d) (m|s|%)(?=\W|$)/g, "$1\u00a0$2")));
    const shares = Object.entries(item.labels).filter(([, share]) => share >= .005).slice(0, 4), drawn = JSON.stringify(shares);
    if (labels.dataset.drawn === drawn) return;
    labels.dataset.drawn = drawn;
    labels.replaceChildren(element("h3", classDoubt(item) ? "Its class is in doubt" : "Class"), ...shares.map(([label, share]) => {
      const line = element("p", "", "share"), bar = element("span", "", "bar");
      bar.style.width = `${100 * share}%`;
      line.append(element("span", label), bar, element("span", percent(share)));
      return line;
    }));
  }
}

function facingOf({ yaw_rad, yaw_sigma_rad }) {
  const degrees = (angle) => `${(angle * 180 / Math.PI).toFixed(0)}°`.replace("-", "−");
  return yaw_rad === null ? "unknown: a circle of its area" : degrees(yaw_rad) + (yaw_sigma_rad === null ? "" : ` ± ${degrees(yaw_sigma_rad)}`);
}

function percent(share) { return `${(100 * share).toFixed(0)} %`; }
