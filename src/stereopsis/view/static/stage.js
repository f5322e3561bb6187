/** The two views: under a swipe, side by side, or in turns; the marks of the pixel that is read upon them. */

import { el } from "./dom.js";
import { LAYERS } from "./layers.js";

const TURN = 600; // milliseconds a view stays when they flicker: below three changes a second

export class Stage {
  #panes = [];
  #drawing = 0;
  #turn = 0;
  #timer = 0;

  constructor(root, swipe, viewport, painter) {
    Object.assign(this, { root, swipe, viewport, painter });
    this.layers = ["left", "disparity"];
    this.look = null;
    this.pixel = null;
    for (const side of ["first", "second"]) {
      const pane = el("div", { className: `pane ${side}` });
      pane.picture = el("canvas", { className: "picture", role: "img" });
      pane.marks = el("canvas", { className: "marks", "aria-hidden": "true" });
      pane.name = el("span", { className: "name", "aria-hidden": "true" });
      pane.append(pane.picture, pane.marks, pane.name);
      viewport.attach(pane);
      this.#panes.push(pane);
    }
    swipe.prepend(...this.#panes);
    viewport.addEventListener("change", () => this.draw());
    new ResizeObserver(() => this.draw()).observe(root);
  }

  get mode() {
    return this.swipe.dataset.mode ?? "swipe";
  }

  set mode(mode) {
    this.swipe.dataset.mode = mode;
    this.root.dataset.mode = mode;
    clearInterval(this.#timer);
    this.#show(0);
    if (mode === "flicker" && !matchMedia("(prefers-reduced-motion: reduce)").matches) this.#timer = setInterval(() => this.flip(), TURN);
    this.draw();
  }

  /** Show the other view, where they flicker. */
  flip() {
    this.#show(1 - this.#turn);
  }

  #show(turn) {
    this.#turn = turn;
    this.#panes.forEach((pane, i) => pane.classList.toggle("away", this.mode === "flicker" && i !== turn));
  }

  /** Draw before the next frame. */
  draw() {
    this.#drawing ||= requestAnimationFrame(() => this.drawNow());
  }

  drawNow() {
    cancelAnimationFrame(this.#drawing);
    this.#drawing = 0;
    if (!this.look) return;
    this.root.style.setProperty("--ratio", String(this.viewport.width / this.viewport.height));
    this.swipe.classList.toggle("stacked", this.#stacks());
    this.root.classList.toggle("zoomed", this.viewport.zoom > 1);
    this.swipe.setAttribute("first", LAYERS[this.layers[0]].label);
    this.swipe.setAttribute("second", LAYERS[this.layers[1]].label);
    this.#panes.forEach((pane, i) => this.#drawPane(pane, this.layers[i]));
  }

  /** Whether the two are seen much larger one above the other. */
  #stacks() {
    const { width, height } = this.viewport;
    const [room, tall] = [this.root.clientWidth, 0.8 * innerHeight];
    const beside = Math.min(room / 2 / width, tall / height);
    return Math.min(room / width, tall / 2 / height) > 1.25 * beside;
  }

  #drawPane(pane, name) {
    const density = devicePixelRatio;
    const size = { width: Math.round(pane.clientWidth * density), height: Math.round(pane.clientHeight * density) };
    for (const canvas of [pane.picture, pane.marks]) if (canvas.width !== size.width || canvas.height !== size.height) Object.assign(canvas, size);
    const label = LAYERS[name].label;
    const layer = this.painter.canvas(name, this.look);
    if (pane.name.textContent !== label) pane.name.textContent = label;
    pane.picture.setAttribute("aria-label", layer ? label : `${label}: nothing to show yet`);
    const context = pane.picture.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, size.width, size.height);
    if (layer) {
      const scale = this.viewport.scale(pane) * density;
      const [x, y] = this.viewport.toPane(pane, [0, 0]).map((v) => v * density);
      context.imageSmoothingEnabled = scale < 1.5;
      context.drawImage(layer, x, y, layer.width * scale, layer.height * scale);
    }
    this.#mark(pane, name, density);
  }

  /** The pixel in the left image's frame; in the right image its row and its match. */
  #mark(pane, name, density) {
    const context = pane.marks.getContext("2d");
    context.setTransform(density, 0, 0, density, 0, 0);
    context.clearRect(0, 0, pane.clientWidth, pane.clientHeight);
    if (!this.pixel) return;
    const { x, y, match, range } = this.pixel;
    if (name !== "right") {
      cross(context, this.viewport.toPane(pane, [x + 0.5, y + 0.5]));
      return;
    }
    const row = this.viewport.toPane(pane, [0, y + 0.5])[1];
    line(context, [0, row], [pane.clientWidth, row], 1, [5, 4]);
    if (range) {
      const [far, near] = [x - range[0], x - range[1] + 1].map((u) => this.viewport.toPane(pane, [u + 0.5, 0])[0]);
      line(context, [near, row], [far, row], 2.5, []);
    }
    if (Number.isFinite(match)) cross(context, this.viewport.toPane(pane, [match + 0.5, y + 0.5]));
  }

  /** What is seen, as one picture. */
  snapshot() {
    const [a, b] = this.#panes.map((pane) => pane.picture);
    const side = this.mode === "side";
    const stacked = side && this.swipe.classList.contains("stacked");
    const canvas = el("canvas", { width: side && !stacked ? a.width + b.width : a.width, height: stacked ? a.height + b.height : a.height });
    const context = canvas.getContext("2d");
    if (side) {
      context.drawImage(a, 0, 0);
      context.drawImage(b, stacked ? 0 : a.width, stacked ? a.height : 0);
    } else if (this.mode === "flicker") context.drawImage(this.#turn ? b : a, 0, 0);
    else {
      const cut = Math.round(a.width * this.swipe.value);
      if (cut > 0) context.drawImage(a, 0, 0, cut, a.height, 0, 0, cut, a.height);
      if (cut < a.width) context.drawImage(b, cut, 0, b.width - cut, b.height, cut, 0, b.width - cut, b.height);
    }
    return canvas;
  }
}

function cross(context, [x, y]) {
  for (const [width, colour] of [[4, "rgb(0 0 0 / .75)"], [2, "#fff"]]) {
    context.lineWidth = width;
    context.strokeStyle = colour;
    context.setLineDash([]);
    context.beginPath();
    for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
      context.moveTo(x + 4 * dx, y + 4 * dy);
      context.lineTo(x + 12 * dx, y + 12 * dy);
    }
    context.stroke();
  }
}

function line(context, from, to, width, dash) {
  for (const [extra, colour] of [[2, "rgb(0 0 0 / .7)"], [0, "#fff"]]) {
    context.lineWidth = width + extra;
    context.strokeStyle = colour;
    context.setLineDash(extra ? [] : dash);
    context.beginPath();
    context.moveTo(...from);
    context.lineTo(...to);
    context.stroke();
  }
}
