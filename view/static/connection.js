// The socket to the robot: opens it, opens it again when it is lost, and asks for updates only while somebody looks.

const FIRST_WAIT_MS = 400, LONGEST_WAIT_MS = 5000;

export class Connection {
  // on: {hello(document), update(document, jpeg), notice(text), lost(reason)}. An update is answered with shown().
  constructor(on) {
    this.on = on;
    this.held = false;
    this.sightings = false;
    this.waitMs = FIRST_WAIT_MS;
    document.addEventListener("visibilitychange", () => {
      if (!document.hidden && this.timer) this.open();
      else this.tellStream();
    });
    this.open();
  }

  open() {
    clearTimeout(this.timer);
    this.timer = null;
    const socket = this.socket = new WebSocket(`${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/socket`);
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
      const document = JSON.parse(data);
      if (document.type === "hello") this.on.hello(document);
      else this.on.notice(document.text);
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
