// The drive of a finished run, picture by picture: a slider moves the robot along its path and shows what it saw there.
import { byId, setText } from "/dom.js";

export class Replay {
  // stills: {frame, time_s, pose, boxes, jpeg} in order. shown(still): its picture is drawn.
  constructor(stills, picture, map, shown) {
    Object.assign(this, { stills, picture, map, shown });
    const slider = byId("replay-at"), last = stills.length - 1;
    byId("replay").closest(".card").hidden = last < 1;
    if (last < 1) return;
    document.body.dataset.replay = "on";
    Object.assign(slider, { max: last, value: last });
    slider.oninput = () => this.show(Number(slider.value));
    this.show(last);
  }

  async show(place) {
    const still = this.stills[place], image = new Image();
    setText(byId("replay-time"), `${still.time_s.toFixed(1)} s`);
    byId("replay-at").setAttribute("aria-valuetext", `${still.time_s.toFixed(1)} seconds`);
    this.map.replay(still);
    this.asked = place;
    image.src = still.jpeg;
    await image.decode();
    if (this.asked !== place) return;
    this.picture.draw(image, still.boxes);
    this.shown(still);
  }
}
