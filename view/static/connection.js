// The socket to the robot: opens it, opens it again when it is lost, and asks for updates only while somebody looks.

const FIRST_WAIT_MS = 400, LONGEST_WAIT_MS = 5000;

// A request to the API: the answer's JSON. Throws an Error with the robot's own line.
export async function api(method, path, body) {
  const request = { method };
  if (body !== undefined) Object.assign(request, { headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) });
  const answer = await fetch(`/api/${path}`, request), told = await answer.json().catch(() => ({}));
  if (!answer.ok) throw new Error(told.error ?? `the robot answered ${answer.status}`);
  return told;
}

export class Connection {
  // on: {hello(document), update(document, jpeg), lost(reason)}. An update is answered with shown().
  constructor(on) {
    this.on = on;
    this.held = false;
    this.sightings = false;
    this.waitMs = FIRST_WAIT_MS;
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden && this.timer) this.open();
      else this.tellStream();
    });
  }

  // The address of an object's picture; none that would be asked for a whole list.
  picture({ id, count }) { return `/api/objects/${encodeURIComponent(id)}/picture?at=${count}`; }
  thumbnail() { return ""; }

  open() {
    clearTimeout(this.timer);
    this.timer = null;
    const socket = this.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/api/stream`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => {
      this.waitMs = FIRST_WAIT_MS;
      this.tellStream();
      if (this.sightings) this.say("sightings", true);
    };
    socket.onmessage = ({ data }) => this.receive(data);
    socket.onclose = ({ reason }) => {
      if (socket !== this.socket) return;
      this.on.lost(reason);
      this.timer = setTimeout(() => this.open(), this.waitMs);
      this.waitMs = Math.min(1.6 * this.waitMs, LONGEST_WAIT_MS);
    };
  }

  receive(data) {
    if (typeof data === "string") {
      this.on.hello(JSON.parse(data));
      return;
    }
    const length = new DataView(data).getUint32(0, true);
    const head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length)));
    this.on.update(head, new Uint8Array(data, 4 + length));
  }

  say(what, on = true) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify({ do: what, on }));
  }

  shown() { this.say("shown"); }
  tellStream() { this.say("stream", !document.hidden && !this.held); }
  hold(held) { this.held = held; this.tellStream(); }
  askSightings(on) { this.sightings = on; this.say("sightings", on); }
}
