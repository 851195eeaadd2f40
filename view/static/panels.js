// The status in words at the top, figures, latency by stage and the faults.
import { byId, element, prose, setText } from "/dom.js";

const TRUST = { good: "good", care: "use with care", unreliable: "not reliable" };
const SMOOTH = .15, SILENT_S = 2, UNSURE_M = .5, UNSURE_RAD = 15 * Math.PI / 180;

export class Panels {
  constructor() {
    this.figures = Object.fromEntries([["rate", "Pictures"], ["step", "Step"], ["cpu", "Processor"], ["memory", "Memory"]]
      .map(([key, name]) => [key, this.figure(name)]));
    this.camera = this.figure("Camera", "health");
    this.odometry = this.figure("Position", "health");
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
    for (const id of ["stages", "faults"]) byId(id).replaceChildren();
    byId("faults").append(element("li", "none", "muted"));
    this.faultCount = 0;
    this.remedies = new Map(); // each stands once, with the newest fault that it is for
    byId("faults-link").hidden = true;
    setText(byId("fault-count"), "");
  }

  about(info) { this.info = info; }

  update(news) {
    this.over = news.state === "finished";
    this.costless = news.status.verdict?.level === "good"; // no fault has lowered the trust in the map
    this.faults(news.faults, news.fault_count);
    this.status(news.status, news.state);
    if (news.frame === undefined) return;
    this.stages(news.stages_ms);
    this.health(news);
  }

  // What a person must know first. level: ok, degraded, fault, wait.
  status({ level, headline, problems, verdict }, state) {
    byId("status").dataset.level = level;
    told(byId("headline"), headline);
    const trust = byId("trust");
    trust.hidden = !verdict || state === "finished"; // the headline of a finished run says it
    if (verdict) {
      trust.dataset.level = verdict.level;
      const reasons = verdict.reasons.map((reason) => reason.replaceAll("`", ""));
      told(trust, `map so far: ${TRUST[verdict.level]}${reasons.length ? ` (${reasons.slice(0, 3).join("; ")})` : ""}`);
      trust.title = reasons.join("; ");
    }
    byId("why").hidden = !byId("status").querySelector("p:not([hidden]) .numbers");
    const rest = problems.slice(1).map(({ text }) => text), list = byId("problems"), key = rest.join("\n");
    list.hidden = !rest.length;
    if (list.dataset.told === key) return;
    list.dataset.told = key;
    list.replaceChildren(...rest.map((text) => element("li", text)));
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
      setText(row.text, `${row.ms.toFixed(row.ms < 10 ? 2 : 1)} ms`);
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
    const unsure = pose_sigma[0] > UNSURE_M || pose_sigma[1] > UNSURE_RAD;
    const heading = pose_sigma[1] > Math.PI / 2 ? "heading unknown" : `± ${(pose_sigma[1] * 180 / Math.PI).toFixed(1)}°`;
    const sure = `± ${pose_sigma[0].toFixed(2)} m, ${heading}`;
    mark(this.odometry, motion_fault || unsure ? "bad" : still ? "still" : "", motion_fault || at, `${sure}, ${this.info.odometry} odometry`);
  }

  // count: of all since the start, where not all are told.
  faults(faults, count = this.faultCount + faults.length) {
    const list = byId("faults"), link = byId("faults-link");
    if (faults.length) {
      if (!this.faultCount) list.replaceChildren();
      this.faultCount = count;
    }
    if (!this.faultCount) return;
    for (const { frame, text, remedy } of faults) {
      const item = element("li");
      if (frame !== undefined) item.append(element("b", `frame ${frame + 1}`));
      item.append(text);
      if (remedy && !this.remedies.has(remedy)) this.remedies.set(remedy, prose(remedy, element("small")));
      if (remedy) item.append(this.remedies.get(remedy));
      list.prepend(item);
    }
    while (list.children.length > 100) list.lastChild.remove();
    link.hidden = false;
    const word = this.costless ? "note" : "fault";
    setText(byId("fault-count"), `${this.faultCount} ${word}${this.faultCount === 1 ? "" : "s"}`);
    setText(byId("faults-title"), this.costless ? "Notes" : "Faults");
    byId("faults-costless").hidden = !this.costless;
    setText(link, `${byId("fault-count").textContent}${this.over ? "" : " so far"}`);
  }
}

// A line whose numbers, in brackets at its end, are folded on a phone.
function told(place, text) {
  if (place.textContent === text) return;
  const [, words, numbers, end] = text.match(/^(.*?)( \(.*\))?(\.?)$/s);
  place.replaceChildren(words, ...(numbers ? [element("span", numbers, "numbers")] : []), end);
}

function put({ value, more }, text, unit, detail) {
  value.replaceChildren(text, element("span", ` ${unit}`, "unit"));
  setText(more, detail);
}

function mark({ value, more }, kind, text, detail) {
  value.replaceChildren(element("span", "", `lamp ${kind}`), text);
  setText(more, detail);
}
