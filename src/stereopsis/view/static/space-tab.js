/** The 3-D tab: its controls, and what it shows. Loads three.js when it is first opened. */

import { el, number } from "./dom.js";
import { grown } from "./layers.js";
import { isDark } from "./theme.js";

export class SpaceTab {
  #shown = null;

  constructor(session, painter, look, { bar, box, note, home }, refuse) {
    Object.assign(this, { session, painter, look, box, note, refuse });
    const option = (value, title) => el("option", { value }, title);
    const input = (id, title, range) => {
      const slider = el("input", { type: "range", id, ...range });
      const shown = el("output", {});
      return { slider, shown, label: el("label", { className: "slider" }, el("span", {}, title), slider, shown) };
    };
    this.shape = el("select", { id: "shape" }, option("points", "Points"), option("surface", "Surface"));
    this.tint = el("select", { id: "tint" }, option("left", "Left image"), option("disparity", "Disparity"), option("error", "Error"));
    this.source = el("select", { id: "source" }, option("disparity", "Result"), option("truth", "Truth"));
    this.way = el("select", { id: "way" }, option("orbit", "Orbit"), option("fly", "Fly"));
    this.size = input("point-size", "Point size", { min: 0.5, max: 6, step: 0.1, value: 2 });
    this.near = input("near", "From", { min: 0, max: 1, step: 0.005, value: 0 });
    this.far = input("far", "To", { min: 0, max: 1, step: 0.005, value: 1 });
    const label = (title, control) => el("label", {}, `${title} `, control);
    bar.append(label("Show", this.shape), label("Of", this.source), label("Colour", this.tint), label("Move", this.way), this.size.label, this.near.label, this.far.label);
    home.addEventListener("click", () => this.space?.home());
    this.shape.addEventListener("change", () => this.space && (this.space.shape = this.shape.value));
    this.way.addEventListener("change", () => this.space && (this.space.flying = this.way.value === "fly"));
    for (const box of [this.tint, this.source]) box.addEventListener("change", () => this.#load());
    this.size.slider.addEventListener("input", () => this.#sizes());
    for (const end of [this.near, this.far]) end.slider.addEventListener("input", () => this.#clip());
  }

  /** Show the newest result, where that has changed. */
  async open() {
    this.active = true;
    if (!this.space) {
      try {
        const { Space } = await import("./space.js");
        this.space ??= new Space(this.box);
      } catch (error) {
        this.note.textContent = "";
        this.refuse(`The 3-D view cannot be shown: ${/webgl/i.test(error.message) ? "this browser offers no WebGL" : error.message}.`);
        return;
      }
      this.#sizes();
    }
    this.look_();
    if (this.#shown?.disparity !== this.#map()) this.#load();
  }

  close() {
    this.active = false;
  }

  changed() {
    if (this.active && this.space) this.#load();
  }

  look_() {
    if (this.space) this.space.paper = isDark() ? 0x0c0d10 : 0xe9ebee;
  }

  #map() {
    return this.source.value === "truth" ? this.session.truth : this.session.disparity;
  }

  #load() {
    const { scene, result } = this.session;
    this.source.options[1].disabled = !this.session.truth;
    this.tint.options[2].disabled = !this.session.truth;
    if (!this.session.truth && this.source.value === "truth") this.source.value = "disparity";
    if (!this.session.truth && this.tint.value === "error") this.tint.value = "left";
    const disparity = this.#map();
    if (!scene || !disparity || !this.space) return;
    const fresh = this.#shown?.scene !== scene;
    const canvas = this.painter.canvas(this.tint.value, this.look()) ?? this.painter.canvas("disparity", this.look());
    const rgba = canvas.getContext("2d").getImageData(0, 0, scene.width, scene.height).data;
    const tints = new Uint8Array(3 * scene.width * scene.height);
    for (let i = 0, j = 0; j < tints.length; i += 4) {
      tints[j++] = rgba[i];
      tints[j++] = rgba[i + 1];
      tints[j++] = rgba[i + 2];
    }
    this.space.load({ width: scene.width, height: scene.height, disparity: this.source.value === "truth" ? grown(disparity, scene.width) : disparity, tints, calibration: scene.calibration });
    this.#shown = { scene, result, disparity };
    if (fresh) this.space.home();
    this.#clip();
    const c = scene.calibration;
    const camera = `focal length ${number(c.focal_length, 1)} px, baseline ${number(c.baseline, 3)} m`;
    this.note.textContent = `${this.space.count.toLocaleString("en")} points; ${c.stated ? camera : `no calibration was given, so these are assumed: ${camera}`}. Drag to turn, wheel to come nearer; with keys: arrows, W A S D Q E, + −, 0.`;
    this.box.dataset.points = this.space.count;
  }

  #sizes() {
    this.size.shown.textContent = `${number(Number(this.size.slider.value), 1)}×`;
    this.space.pointSize = Number(this.size.slider.value);
  }

  /** The sliders go over the depths that there are, evenly in their logarithm. */
  #clip() {
    const depths = this.space?.depths;
    if (!depths) return;
    const metres = (part) => depths.least * (Math.max(depths.most, depths.least * 1.01) / depths.least) ** part;
    const ends = [this.near, this.far].map(({ slider }) => Number(slider.value));
    [this.near, this.far].forEach(({ shown }, i) => (shown.textContent = `${number(metres(ends[i]), metres(ends[i]) < 10 ? 1 : 0)} m`));
    if (ends[0] === 0) this.near.shown.textContent = "nearest";
    if (ends[1] === 1) this.far.shown.textContent = "farthest";
    this.space.clip(ends[0] === 0 ? 0 : metres(ends[0]), ends[1] === 1 ? 1e9 : metres(ends[1]));
  }
}
