// Puts the page together: what comes from the robot goes to picture, map and panels; buttons go to the robot.
import { api, Connection } from "/connection.js";
import { Saved } from "/saved.js";
import { FloorMap } from "/map.js";
import { button, byId, element, setText } from "/dom.js";
import { learnMarks } from "/marks.js";
import { nameOf, Objects } from "/objects.js";
import { Panels } from "/panels.js";
import { Picture } from "/picture.js";
import { FloorGrid } from "/floor_grid.js";
import { Guide } from "/guide.js";
import { Placing } from "/placing.js";
import { Replay } from "/replay.js";
import { Robot } from "/robot.js";
import { Run } from "/run.js";
import { Sheet } from "/sheet.js";
import { Zones } from "/zones.js";

const press = (id, on) => byId(id).setAttribute("aria-pressed", on);

const picture = new Picture(byId("picture"));
const map = new FloorMap(byId("map"), (mode) => { press("fit", mode === "fit"); press("follow", mode === "follow"); }, choose);
const placing = new Placing(map), sheet = new Sheet(), guide = new Guide();
const saved = Saved.find(); // the data of a finished run, where the page holds it: then nothing is edited
const objects = new Objects(map, placing, choose, saved ? null : ask, notice);
const zones = new Zones(map, placing, saved ? null : ask, notice);
const robot = new Robot(map, placing, ask, notice);
const panels = new Panels(), grid = new FloorGrid(picture, ask, notice);
// For the console and the tests: pictures drawn, updates received, the last state told.
const page = window.edgemap = { drawn: 0, updates: 0, state: "connecting", frame: -1, map };
let info = null, lastDrawn = -1;

const source = {
  hello(about) {
    info = about;
    lastDrawn = -1;
    learnMarks(about);
    for (const part of [picture, map, panels, objects, grid]) part.about(about);
    placing.stop();
    for (const part of [picture, map, panels, objects, zones]) part.clear();
    byId("about").textContent = [about.camera, about.bundle, `${about.odometry} odometry`].join("  ·  ");
    byId("pause").title = about.live ? "Hold this page; the robot goes on" : "Hold the run";
    document.title = `${about.camera} – edgemap`;
  },
  update(news, jpeg) {
    page.updates += 1;
    map.update(news);
    panels.update(news);
    objects.update(news, map.objects, map.seen);
    zones.update(map.zones, map.rooms, map.objects);
    for (const { event_type, id, zone_name } of news.events) notice(`${nameOf(map.objects.get(id) ?? { id })} ${event_type} ${zone_name}`);
    guide.update(news, map.objects.size);
    sheet.tell(objects.summary());
    tellState(connection.held ? "held" : news.state);
    if (news.frame !== undefined) caption(news);
    show(news, jpeg);
  },
  lost(reason) {
    tellState("lost", "not connected");
    panels.status({ level: "wait", headline: reason || "The connection to the robot is lost. Trying again.", problems: [] });
  },
};
const connection = saved ? new Saved(source, saved) : new Connection(source);
objects.pictures = connection;

// A picture appears together with its own boxes; the robot hears of it only then, and sends the next.
async function show(news, jpeg) {
  const bitmap = jpeg.length ? await createImageBitmap(new Blob([jpeg], { type: "image/jpeg" })) : null;
  requestAnimationFrame(() => {
    if (bitmap && news.number > lastDrawn) {
      lastDrawn = news.number;
      page.frame = news.frame;
      page.drawn += 1;
      picture.draw(bitmap, news.boxes);
      bitmap.close();
    }
    connection.shown();
  });
}

function tellState(state, text = { held: "page held" }[state] ?? state) {
  page.state = state;
  byId("state").dataset.state = state;
  setText(byId("state"), text);
  const held = state === "paused" || state === "held";
  press("pause", held);
  byId("pause").textContent = held ? "Resume" : "Pause";
  byId("pause").disabled = state === "finished" || state === "lost" || state === "connecting";
  byId("save").disabled = state === "lost" || state === "connecting";
}

function caption({ frame, stamp_s, boxes }) {
  const of = info.frames ? ` of ${info.frames}` : "", onFloor = boxes.filter((box) => box.distance_m !== null).length;
  byId("caption").replaceChildren(text(`frame ${frame + 1}${of}, ${stamp_s.toFixed(1)} s`), text(`${boxes.length} in view, ${onFloor} on the floor; metres from the robot`));
}

function text(content) {
  const span = document.createElement("span");
  span.textContent = content;
  return span;
}

// Somebody picks an object on the map or in the list, or lets go of it. The map moves only to show one that is out of sight.
function choose(id) {
  map.choose(id);
  objects.pick(id);
  if (id) sheet.reveal();
}

// A line that goes by itself, later where something can be taken back.
function notice(message, undo = null, act = "Undo") {
  const place = byId("notice"), hide = () => { place.hidden = true; };
  place.replaceChildren(element("span", message), ...(undo ? [button(act, () => { hide(); undo(); })] : []));
  place.hidden = false;
  clearTimeout(notice.timer);
  notice.timer = setTimeout(hide, undo ? 12000 : 5000);
}

// What the robot refuses is told in its own words.
async function ask(method, path, body) {
  try {
    return await api(method, path, body);
  } catch (error) {
    notice(error.message);
    return null;
  }
}

Object.assign(page, { connection, sheet, robot, grid });

byId("pause").onclick = () => {
  const on = byId("pause").getAttribute("aria-pressed") !== "true";
  if (!info.live) return ask("POST", "pause", { paused: on });
  connection.hold(on);
  tellState(on ? "held" : "running");
};
byId("save").onclick = async () => {
  const saved = await ask("POST", "save", {});
  if (saved) notice(`saved ${saved.path}`);
};
byId("fit").onclick = () => map.view.setMode("fit");
byId("follow").onclick = () => map.view.setMode(map.view.mode === "follow" ? "free" : "follow");
byId("closer").onclick = () => map.view.zoom(1.25);
byId("farther").onclick = () => map.view.zoom(.8);
// A menu closes when something in it was chosen, and when the focus or a click goes elsewhere.
const menu = byId("edit");
menu.addEventListener("click", ({ target }) => { if (target.tagName === "BUTTON") menu.open = false; });
menu.addEventListener("keydown", ({ key }) => { if (key === "Escape") { menu.open = false; menu.firstElementChild.focus(); } });
document.addEventListener("pointerdown", ({ target }) => { if (!menu.contains(target)) menu.open = false; });
menu.addEventListener("focusout", ({ relatedTarget }) => { if (relatedTarget && !menu.contains(relatedTarget)) menu.open = false; });
placing.started = () => sheet.show("peek"); // on a phone the map is worth more then
byId("faults-link").onclick = () => { byId("diagnostics").open = true; if (sheet.size === "peek") sheet.show("full"); };
byId("why").onclick = () => byId("why").setAttribute("aria-expanded", byId("why").getAttribute("aria-expanded") !== "true");
byId("legend").open = matchMedia("(min-width: 1101px) and (min-height: 561px)").matches; // beside the map
byId("doubtful").onclick = () => {
  map.showDoubtful = !map.showDoubtful;
  press("doubtful", map.showDoubtful);
  map.redraw();
  objects.redraw();
  zones.update(map.zones, map.rooms, map.objects);
};
byId("by-trust").onclick = () => {
  map.path.byTrust = !map.path.byTrust;
  press("by-trust", map.path.byTrust);
  byId("ramp").dataset.shows = map.path.byTrust ? "trust" : "time";
  map.redraw();
};
byId("sightings").onclick = () => {
  const on = byId("sightings").getAttribute("aria-pressed") !== "true";
  press("sightings", on);
  map.sightings = [];
  map.redraw();
  connection.askSightings(on);
};
connection.open();
if (saved) {
  new Replay(saved.run.replay, picture, map, ({ frame, time_s, boxes }) => caption({ frame, stamp_s: time_s, boxes }));
  new Run(saved.run, saved.update.trail, saved.update.changed.length);
  map.truth.set(saved.run.truth);
  objects.judge(saved.run);
  byId("diagnostics").open = true;
  document.title = `${saved.run.objects} objects – ${saved.about.camera} – edgemap`;
}
