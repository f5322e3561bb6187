/** Which part of the picture is seen: zoom (1: it just fits) about a centre in pixels. Shared by all panes. */

const MOST = 64;

/** Fires "change"; "hover" and "pick" with the pixel under the pointer, [x, y] or null. */
export class Viewport extends EventTarget {
  zoom = 1;
  width = 1;
  height = 1;
  centre = [0.5, 0.5];

  resize(width, height) {
    if (width === this.width && height === this.height) return;
    Object.assign(this, { width, height });
    this.fit();
  }

  fit() {
    this.set(1, [this.width / 2, this.height / 2]);
  }

  set(zoom, centre) {
    this.zoom = Math.min(Math.max(zoom, 1), MOST);
    const half = 0.5 / this.zoom;
    const clamp = (value, size) => Math.min(Math.max(value, size * half), size * (1 - half));
    this.centre = [clamp(centre[0], this.width), clamp(centre[1], this.height)];
    this.dispatchEvent(new Event("change"));
  }

  /** Screen pixels a picture's pixel has in a pane. */
  scale(pane) {
    return this.zoom * Math.min(pane.clientWidth / this.width, pane.clientHeight / this.height);
  }

  /** From a picture's point to the pane's, in its own pixels. */
  toPane(pane, [x, y]) {
    const scale = this.scale(pane);
    return [(x - this.centre[0]) * scale + pane.clientWidth / 2, (y - this.centre[1]) * scale + pane.clientHeight / 2];
  }

  fromPane(pane, [x, y]) {
    const scale = this.scale(pane);
    return [(x - pane.clientWidth / 2) / scale + this.centre[0], (y - pane.clientHeight / 2) / scale + this.centre[1]];
  }

  /** Zoom by a factor about a point of the picture, which stays where it is. */
  zoomBy(factor, about = this.centre) {
    const zoom = Math.min(Math.max(this.zoom * factor, 1), MOST);
    const real = zoom / this.zoom;
    this.set(zoom, [0, 1].map((i) => about[i] + (this.centre[i] - about[i]) / real));
  }

  /** Move so that a point of the picture is seen. */
  reveal([x, y]) {
    const room = (0.5 / this.zoom) * 0.9;
    const near = (c, p, size) => Math.min(Math.max(c, p - room * size), p + room * size);
    this.set(this.zoom, [near(this.centre[0], x, this.width), near(this.centre[1], y, this.height)]);
  }

  /** Follow wheel, drag, pinch and pointer on a pane. */
  attach(pane) {
    const at = (event) => {
      const box = pane.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const pixel = (event) => {
      const [x, y] = this.fromPane(pane, at(event)).map(Math.floor);
      return x >= 0 && y >= 0 && x < this.width && y < this.height ? [x, y] : null;
    };
    const down = new Map();
    let travelled = 0;
    pane.addEventListener("wheel", (event) => {
      if (event.ctrlKey || event.deltaY < 0 || this.zoom > 1) event.preventDefault();
      const lines = event.deltaMode === 1 ? 20 : 1;
      this.zoomBy(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.002)), this.fromPane(pane, at(event)));
    }, { passive: false });
    pane.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      pane.setPointerCapture(event.pointerId);
      if (down.size === 0) travelled = 0;
      down.set(event.pointerId, at(event));
    });
    pane.addEventListener("pointermove", (event) => {
      if (!down.has(event.pointerId)) {
        this.#tell("hover", pixel(event), pane);
        return;
      }
      const [before, now] = [down.get(event.pointerId), at(event)];
      if (down.size === 2) {
        const other = [...down.entries()].find(([id]) => id !== event.pointerId)[1];
        const reach = (p) => Math.hypot(p[0] - other[0], p[1] - other[1]);
        travelled = Infinity;
        // What lay between the fingers stays between them.
        this.zoomBy(reach(now) / Math.max(reach(before), 1), this.fromPane(pane, [(before[0] + other[0]) / 2, (before[1] + other[1]) / 2]));
        this.#pan(pane, [(now[0] - before[0]) / 2, (now[1] - before[1]) / 2]);
      } else {
        travelled += Math.hypot(now[0] - before[0], now[1] - before[1]);
        if (travelled > 4) this.#pan(pane, [now[0] - before[0], now[1] - before[1]]);
      }
      down.set(event.pointerId, now);
    });
    const up = (event) => {
      if (!down.delete(event.pointerId)) return;
      if (event.type === "pointerup" && travelled <= 4 && pixel(event)) this.#tell("pick", pixel(event), pane);
    };
    pane.addEventListener("pointerup", up);
    pane.addEventListener("pointercancel", up);
    // One finger may scroll the page; two never do.
    pane.addEventListener("touchmove", (event) => event.touches.length > 1 && event.cancelable && event.preventDefault(), { passive: false });
    pane.addEventListener("pointerleave", () => this.#tell("hover", null, pane));
    pane.addEventListener("dblclick", (event) => this.zoomBy(event.shiftKey ? 0.5 : 2, this.fromPane(pane, at(event))));
  }

  #pan(pane, [x, y]) {
    const scale = this.scale(pane);
    this.set(this.zoom, [this.centre[0] - x / scale, this.centre[1] - y / scale]);
  }

  #tell(type, pixel, pane) {
    this.dispatchEvent(new CustomEvent(type, { detail: { pixel, pane } }));
  }
}
