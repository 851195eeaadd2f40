// What to do while the map is empty.
import { byId, element } from "/dom.js";

export class Guide {
  constructor() { this.told = null; }

  // count: objects on the map.
  update({ state, frame, status }, count) {
    const steps = count ? null : state === "finished" ? ["No object on the map", "Nothing of the classes that this run maps stood on visible floor. The command edgemap why names the likely cause."]
      : frame === undefined ? ["Waiting for the camera", "The first picture takes a few seconds. If none comes, check its cable, and what edgemap cameras lists."]
      : status.level === "fault" ? ["Nothing can be mapped right now", "Solve what the line at the top says first."]
      : ["No object on the map yet", "Drive slowly past the furniture. An object appears once it was seen a few times, from half a metre apart, with its feet on visible floor."];
    const key = steps?.join();
    if (key === this.told) return;
    this.told = key;
    const place = byId("guide");
    place.hidden = !steps;
    if (steps) place.replaceChildren(element("h2", steps[0]), element("p", steps[1]));
  }
}
