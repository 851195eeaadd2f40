// The data of a finished run that lies in the page itself: report.html. It answers as a connection does that never changes.

export class Saved {
  // on: {hello(document), update(document, jpeg)}. run: what only a report shows.
  constructor(on, { about, update, pictures, run }) { Object.assign(this, { on, about, update, pictures, run }); }

  static find() {
    const data = document.getElementById("run-data");
    return data && JSON.parse(data.textContent);
  }

  open() {
    this.on.hello(this.about);
    this.on.update(this.update, []);
  }

  picture({ id }) { return this.pictures[id] ?? ""; }
  thumbnail({ id }) { return this.pictures[id] ?? ""; }
  shown() {}
}
