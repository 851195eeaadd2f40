// The robot's path, coloured by time or by how well the position is known along it.

const STEPS = 24, SURE_M = .05, UNSURE_M = 1; // radius that holds 95 % of the position: the ends of the scale

export class Path {
  constructor() { this.byTrust = false; }

  // trail: [x, y, stamp_s, bound_m] in order; end: the robot's place now, or null.
  draw(pen, view, trail, end, style) {
    if (!trail.length) return;
    const from = trail[0][2], span = Math.max(trail.at(-1)[2] - from, 1e-9);
    const level = ([, , stamp, bound]) => Math.round((STEPS - 1) * (this.byTrust ? doubt(bound) : (stamp - from) / span));
    Object.assign(pen, { lineWidth: 3, lineCap: "round" });
    for (let first = 0; first < trail.length;) { // one line for each piece of one colour
      const now = level(trail[first]);
      let last = first + 1;
      while (last < trail.length && level(trail[last]) === now) last += 1;
      pen.beginPath();
      for (const [x, y] of trail.slice(first, last + 1)) pen.lineTo(...view.toScreen(x, y));
      if (last === trail.length && end) pen.lineTo(...view.toScreen(end[0], end[1]));
      pen.strokeStyle = this.colour(style, now / (STEPS - 1));
      pen.stroke();
      first = last;
    }
    pen.lineCap = "butt";
  }

  colour(style, share) {
    const [low, high] = this.byTrust ? [style.sure, style.unsure] : [style.pathStart, style.pathEnd];
    return `color-mix(in oklab, ${high} ${(100 * share).toFixed(0)}%, ${low})`;
  }

  // The words at the ends of the scale.
  ends(trail) {
    if (this.byTrust) return [`±${SURE_M} m`, `±${UNSURE_M} m or more`];
    return ["start", trail.length ? duration(trail.at(-1)[2] - trail[0][2]) : "now"];
  }
}

// 0 where the position is known to SURE_M, 1 at UNSURE_M; between them by its logarithm.
function doubt(bound) { return Math.max(0, Math.min(1, Math.log(Math.max(bound, 1e-6) / SURE_M) / Math.log(UNSURE_M / SURE_M))); }

export function duration(seconds) {
  const whole = Math.round(seconds);
  if (seconds < 120) return `${+seconds.toFixed(1)} s`;
  return whole < 7200 ? `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")} min` : `${Math.floor(whole / 3600)}:${String(Math.floor(whole % 3600 / 60)).padStart(2, "0")} h`;
}
