// What a report shows beside map and objects: why the map can be trusted or not, the truth, times, mount and settings.
import { chart, niceTop } from "/chart.js";
import { byId, element, prose } from "/dom.js";
import { duration } from "/path.js";

// Stages in the order of the step, apart from the labels' colours.
const STAGES = ["#7f93ad", "#3f5f86", "#a9bcd3", "#6b8f8a", "#c98f57", "#8d6a97", "#d9bf94", "#9aa67a"];

export class Run {
  // run: of the report's data; trail: [x, y, stamp_s, bound_m].
  constructor(run, trail, shown) {
    this.shown = shown; // objects: at most a thousand, those observed most often
    byId("run").append(...[this.verdict(run), this.figures(run), this.truth(run, trail), this.trust(run, trail), this.times(run), this.detected(run)].filter(Boolean));
    byId("run-end").append(...[this.mount(run), this.settings(run)].filter(Boolean));
  }

  part(title, ...children) {
    const whole = element("section", "", "part");
    whole.append(element("h3", title), ...children);
    return whole;
  }

  verdict({ verdict }) {
    if (!verdict?.reasons.length) return null;
    const list = element("ul", "", "reasons");
    for (const remedy of new Set(verdict.reasons.map((reason) => reason.remedy))) { // each once, after all that it is for
      const line = element("li", `${verdict.reasons.filter((reason) => reason.remedy === remedy).map(({ text }) => text).join("; ")}.`);
      line.append(prose(remedy, element("small")));
      list.append(line);
    }
    return this.part(`Map: ${verdict.title}`, list);
  }

  figures(run) {
    const list = element("dl", "", "facts"), told = {
      Objects: this.shown < run.objects ? `${run.objects}, ${this.shown} shown` : run.objects, Path: `${run.path_m.toFixed(1)} m`, Drive: duration(run.span_s), Frames: run.frames,
      "Frames a second": run.rate_hz ? run.rate_hz.toFixed(0) : "–", "Step, p95": run.step_ms.p95 ? `${run.step_ms.p95.toFixed(1)} ms` : "–",
    };
    for (const [name, value] of Object.entries(told)) {
      const pair = element("div");
      pair.append(element("dt", name), element("dd", value));
      list.append(pair);
    }
    return this.part("Run", list, element("p", [run.started, run.clustering && `${run.clustering} clustering`, ...run.source].filter(Boolean).join(" · "), "muted small"));
  }

  truth({ truth }, trail) {
    if (!truth) return null;
    const words = [];
    if (truth.tally) words.push(`${truth.tally}${truth.median_error_m === null ? "" : `; median error of those found ${truth.median_error_m.toFixed(2)} m`}. Found: same class within 0.5 m; misplaced: within 1.5 m.`);
    const { errors_m: errors } = truth;
    if (errors.length) {
      const rms = Math.sqrt(errors.reduce((sum, error) => sum + error * error, 0) / errors.length), most = errors.reduce((a, b) => Math.max(a, b));
      words.push(`Position: ${rms.toFixed(3)} m RMS, ${most.toFixed(3)} m at most, ${errors.at(-1).toFixed(3)} m at the end.`);
    }
    return this.part("Against the truth", ...words.map((line) => element("p", line)));
  }

  trust({ truth, start_s }, trail) {
    const bounds = trail.map(([, , , bound]) => bound), errors = truth?.errors_m ?? [];
    if (trail.length < 2 || !(errors.length || bounds.some((bound) => bound > 0))) return null;
    const highest = bounds.concat(errors).reduce((a, b) => Math.max(a, b)), worst = errors.reduce((a, b) => Math.max(a, b), 0);
    const top = niceTop(worst > 0 ? Math.min(highest, 4 * worst) : highest); // a bound far above the error would flatten it
    const layers = [{ kind: "area", values: bounds, title: "95 % bound by the run's own covariance" }];
    if (errors.length) layers.push({ kind: "line", values: errors, title: "position error" });
    const words = errors.length ? "Line: position error. Shade: the run's own 95 % bound." : `The run's own 95 % bound, ${bounds.at(-1).toFixed(2)} m at the end.`;
    return this.part("Position along the path", chart(trail.map(([, , stamp]) => stamp - start_s), layers, top, "m", "position error over time"), element("p", words, "muted small"));
  }

  times({ stages, step_ms, windows }) {
    const names = Object.keys(stages);
    if (!names.length) return null;
    const table = element("table", "", "stages"), head = element("tr");
    head.append(...["stage", "p50", "p95", "p99 ms"].map((name) => element("th", name)));
    const rows = [...names.map((name) => [name, stages[name]]), ...(step_ms.p50 === undefined ? [] : [["complete step", step_ms]])];
    table.append(head, ...rows.map(([name, figures], k) => {
      const line = element("tr"), first = element("th"), key = element("i", "", "key");
      key.style.background = k < names.length ? STAGES[k % STAGES.length] : "none";
      first.append(key, name);
      line.append(first, ...["p50", "p95", "p99"].map((part) => element("td", figures[part]?.toFixed(2) ?? "–")));
      return line;
    }));
    return this.part("Time of one step", ...(windows.length > 1 ? [this.latency(names, windows), element("p", "Mean of each stage, stacked; thin line: the slowest step.", "muted small")] : []), table);
  }

  latency(names, windows) {
    const sums = windows.map(() => 0), worst = windows.map(([, slowest]) => slowest);
    const layers = names.map((name, k) => {
      const below = [...sums];
      windows.forEach((row, n) => { sums[n] += row[k + 2]; });
      return { kind: "area", values: [...sums], below, colour: STAGES[k % STAGES.length], title: name };
    });
    const usual = [...sums].sort((a, b) => a - b)[Math.floor(.95 * (sums.length - 1))];
    const top = niceTop(Math.min(worst.reduce((a, b) => Math.max(a, b)), 2.5 * usual));
    return chart(windows.map(([end]) => end), [...layers, { kind: "thin", values: worst, title: "slowest step" }], top, "ms", "latency over time");
  }

  detected({ detected }) {
    if (!detected.length) return null;
    const list = element("p", detected.slice(0, 20).map(([label, count, mapped]) => `${label} ${count}${mapped ? "" : " (not mapped)"}`).join(", "));
    return this.part("Boxes in all pictures", list);
  }

  mount({ mount }) {
    if (!mount) return null;
    const picture = new Image(), words = "The first picture with horizon and metre grid. Where the mount is right, the grid lies flat on the floor.";
    Object.assign(picture, { src: mount, alt: words, className: "mount" });
    return this.part("Mount", picture, element("p", words, "muted small"));
  }

  settings({ settings }) {
    const fold = element("details", "", "settings"), table = element("table");
    table.append(...flat(settings).map(([key, value]) => {
      const line = element("tr");
      line.append(element("th", key), element("td", value));
      return line;
    }));
    const scroll = element("div", "", "scroll");
    scroll.append(table);
    scroll.tabIndex = 0;
    scroll.setAttribute("role", "region");
    scroll.setAttribute("aria-label", "Settings");
    fold.append(element("summary", "Settings"), scroll);
    return fold;
  }
}

// Nested keys joined by dots.
function flat(value, before = "") {
  return Object.entries(value).flatMap(([key, item]) => {
    if (item && typeof item === "object" && !Array.isArray(item) && Object.keys(item).length) return flat(item, `${before}${key}.`);
    const text = Array.isArray(item) ? item.map((one) => (typeof one === "object" ? JSON.stringify(one) : String(one))).join(", ") : item && typeof item === "object" ? "" : String(item);
    return [[before + key, text || "none"]];
  });
}
