// The sheet at the bottom of a phone: three heights, by its handle, by dragging it, or by the keyboard.
import { byId, setText } from "/dom.js";

const SIZES = ["peek", "half", "full"], DRAG_PX = 24;

export class Sheet {
  constructor() {
    this.sheet = byId("sheet");
    this.handle = byId("sheet-handle");
    let from = null, moved = 0;
    this.handle.onclick = () => {
      if (Math.abs(moved) < DRAG_PX) this.show(SIZES[(SIZES.indexOf(this.size) + 1) % SIZES.length]);
      moved = 0;
    };
    this.handle.addEventListener("pointerdown", (event) => { from = event.clientY; moved = 0; this.handle.setPointerCapture(event.pointerId); });
    this.handle.addEventListener("pointermove", (event) => { if (from !== null) moved = from - event.clientY; });
    this.handle.addEventListener("pointerup", () => {
      from = null;
      if (Math.abs(moved) >= DRAG_PX) this.show(SIZES[Math.max(0, Math.min(2, SIZES.indexOf(this.size) + Math.sign(moved)))]);
    });
    this.handle.addEventListener("keydown", ({ key }) => {
      const by = { ArrowUp: 1, ArrowDown: -1 }[key];
      if (by) this.show(SIZES[Math.max(0, Math.min(2, SIZES.indexOf(this.size) + by))]);
    });
  }

  get size() { return this.sheet.dataset.size; }

  show(size) {
    this.sheet.dataset.size = size;
    this.handle.setAttribute("aria-expanded", size !== "peek");
  }

  // Somebody picked an object: its card is to be seen.
  reveal() {
    if (this.size === "peek") this.show("half");
    byId("sheet-body").scrollTop = 0;
  }

  tell(text) { setText(byId("sheet-words"), text); }
}
