// Figures, latency by stage, objects and faults: text and small bars.

const SMOOTH = .15, SILENT_S = 2;
const byName = new Intl.Collator("en", { numeric: true });
const byId = (id) => document.getElementById(id);

function element(name, text = "", className = "") {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = className;
  return made;
}

export class Panels {
  constructor(choose) {
    this.choose = choose;
    this.figures = Object.fromEntries([["rate", "Frames"], ["step", "Step"], ["cpu", "Processor"], ["memory", "Memory"]]
      .map(([key, name]) => [key, this.figure(name)]));
    this.camera = this.figure("Camera", "health");
    this.odometry = this.figure("Odometry", "health");
    this.clear();
  }

  figure(name, className = "") {
    const box = element("div", "", className), value = element("dd", "–", "big"), more = element("dd", "", "more");
    box.append(element("dt", name), value, more);
    byId("figures").append(box);
    return { value, more };
  }

  clear() {
    this.laps = new Map();
    this.chips = new Map();
    for (const id of ["stages", "objects", "faults"]) byId(id).replaceChildren();
    byId("faults").append(element("li", "none", "muted"));
    byId("count").textContent = "";
    this.faultless = true;
  }

  about(info) { this.info = info; }

  update(news, objects, seen) {
    this.faults(news.faults);
    if (news.frame === undefined) return;
    this.stages(news.stages_ms);
    this.health(news);
    this.things(objects, seen, news.pose);
  }

  stages(stages_ms) {
    for (const [stage, ms] of Object.entries(stages_ms)) {
      let row = this.laps.get(stage);
      if (!row) {
        row = { ms, bar: element("div", "", "bar"), text: element("td") };
        const line = element("tr"), cell = element("td");
        cell.append(row.bar);
        line.append(element("th", stage), cell, row.text);
        byId("stages").append(line);
        this.laps.set(stage, row);
      }
      row.ms += SMOOTH * (ms - row.ms);
    }
    const longest = Math.max(...[...this.laps.values()].map((row) => row.ms));
    for (const row of this.laps.values()) {
      row.bar.style.width = `${(100 * row.ms / longest).toFixed(1)}%`;
      row.text.textContent = `${row.ms.toFixed(row.ms < 10 ? 2 : 1)} ms`;
    }
  }

  health({ rate_hz, age_s, state, camera_state, vitals, pose, pose_sigma, motion_fault }) {
    const total = [...this.laps.values()].reduce((sum, row) => sum + row.ms, 0), wanted = this.info.rate_hz;
    put(this.figures.rate, rate_hz ? rate_hz.toFixed(1) : "–", "/s", wanted ? `camera ${wanted.toFixed(0)} /s` : "");
    put(this.figures.step, total.toFixed(1), "ms", `of ${wanted ? (1000 / wanted).toFixed(0) + " ms" : "a frame"}`);
    put(this.figures.cpu, vitals.cpu_percent === null ? "–" : vitals.cpu_percent.toFixed(0), "%", "of all cores");
    put(this.figures.memory, vitals.memory_mb === null ? "–" : vitals.memory_mb.toFixed(0), "MB", "resident");
    const away = camera_state !== "running", silent = state === "running" && (away || age_s > SILENT_S);
    const still = state !== "running";
    mark(this.camera, silent ? "bad" : still ? "still" : "", silent ? `${away ? `${camera_state}, ` : ""}silent for ${age_s.toFixed(0)} s` : still ? state : "delivering", this.info.camera);
    const at = `x ${pose[0].toFixed(2)} m, y ${pose[1].toFixed(2)} m, ${(pose[2] * 180 / Math.PI).toFixed(0)}°`.replaceAll("-", "−");
    const sure = `± ${pose_sigma[0].toFixed(2)} m, ± ${(pose_sigma[1] * 180 / Math.PI).toFixed(1)}°`;
    mark(this.odometry, motion_fault ? "bad" : still ? "still" : "", motion_fault || at, `${this.info.odometry}, ${sure}`);
  }

  things(objects, seen, pose) {
    byId("count").textContent = objects.size ? `${objects.size}` : "none yet";
    for (const [id, chip] of this.chips) if (!objects.has(id)) { chip.item.remove(); this.chips.delete(id); }
    for (const [id, thing] of objects) {
      const chip = this.chips.get(id) ?? this.chip(id, thing);
      const away_m = Math.hypot(thing.x_m - pose[0], thing.y_m - pose[1]).toFixed(1);
      const text = `${id}  ${away_m} m`;
      if (chip.name.textContent !== text) chip.name.textContent = text;
      chip.button.dataset.seen = seen.has(id);
      chip.button.title = `x ${thing.x_m.toFixed(2)} m, y ${thing.y_m.toFixed(2)} m, seen ${thing.count} times, confidence ${thing.confidence.toFixed(2)}`;
    }
  }

  chip(id, thing) {
    const item = element("li"), button = element("button"), dot = element("span", "", "dot"), name = element("span");
    dot.style.background = this.info.colours[thing.label];
    button.type = "button";
    button.append(dot, name);
    button.onclick = () => this.choose(id);
    item.append(button);
    item.dataset.id = id;
    const after = [...byId("objects").children].find((other) => byName.compare(other.dataset.id, id) > 0);
    byId("objects").insertBefore(item, after ?? null);
    const chip = { item, button, name };
    this.chips.set(id, chip);
    return chip;
  }

  faults(faults) {
    if (!faults.length) return;
    const list = byId("faults");
    if (this.faultless) list.replaceChildren();
    this.faultless = false;
    for (const { frame, text } of faults) {
      const item = element("li");
      item.append(element("b", `frame ${frame}`), text);
      list.prepend(item);
    }
    while (list.children.length > 100) list.lastChild.remove();
  }
}

function put({ value, more }, text, unit, detail) {
  value.replaceChildren(text, element("span", ` ${unit}`, "unit"));
  more.textContent = detail;
}

function mark({ value, more }, kind, text, detail) {
  value.replaceChildren(element("span", "", `mark ${kind}`), text);
  more.textContent = detail;
}
