/** The settings as a form: filled from what a result used; says what the user changed. */

import { el, number } from "./dom.js";
import { GROUPS, PARTS } from "./fields.js";

const text = (value) => (value === null ? "none" : String(value));

/** Calls `change(changes, since)` with new values by name, undefined where one falls back; `preset(name, since)`. */
export class Controls {
  #parts = new Map(); // what to do when settings were used: name -> function

  constructor(form, info, { change, preset }) {
    Object.assign(this, { form, info, change });
    form.addEventListener("submit", (event) => event.preventDefault());
    const presets = select("preset", info.presets.map((name) => [name, name]));
    presets.append(el("option", { value: "", disabled: true, hidden: true }, "none"));
    presets.addEventListener("change", (event) => preset(presets.value, event.timeStamp));
    this.presets = presets;
    form.append(labelled("Preset", presets));
    for (const group of GROUPS) {
      const box = el("details", { open: Boolean(group.open) }, el("summary", {}, group.title));
      for (const field of group.fields) box.append(this.#field(field));
      form.append(box);
    }
  }

  /** Show what a result was made with. */
  show(settings, preset) {
    this.used = settings;
    this.presets.value = preset ?? "";
    for (const part of this.#parts.values()) part(settings);
  }

  set disabled(disabled) {
    for (const element of this.form.elements) element.disabled = disabled || element.dataset.off === "yes";
  }

  #field(field) {
    switch (field.kind) {
      case "cost": return this.#cost(field);
      case "window": return this.#window(field);
      case "range": return this.#range(field);
      case "optimize": return this.#optimize(field);
      case "switch": return this.#switch(field);
      default: return this.#choice(field);
    }
  }

  #cost({ name, label }) {
    const box = select(name, this.info.costs.map((cost) => [cost.name, cost.name]));
    box.addEventListener("change", (event) => {
      const fields = (cost) => this.info.costs.find((one) => one.name === cost)?.fields ?? {};
      const keeps = !("aggregation" in fields(box.value)) && !("aggregation" in fields(this.used?.cost.name));
      this.change({ cost: box.value, ...(keeps ? {} : { window: undefined, aggregation: undefined }) }, event.timeStamp);
    });
    this.#parts.set(name, ({ cost }) => {
      if (![...box.options].some((option) => option.value === cost.name)) box.append(el("option", { value: cost.name }, cost.name));
      box.value = cost.name;
    });
    return labelled(label, box);
  }

  /** Width and height; linked, they keep their proportion. */
  #window({ name, label }) {
    const sides = ["width", "height"].map((side) => el("input", { type: "range", id: `${name}-${side}`, min: 1, max: 61, step: 1, "aria-label": `${label}, ${side} in pixels` }));
    const shown = el("output", {});
    const link = el("input", { type: "checkbox", id: `${name}-link`, checked: true });
    const box = el("fieldset", { className: "sliders" }, el("legend", {}, `${label} `, shown),
      ...sides.map((side, i) => el("label", {}, el("span", {}, ["Width", "Height"][i]), side)),
      el("label", { className: "check" }, link, " Keep the proportion"));
    let proportion = 1;
    const say = () => (shown.textContent = `${sides[0].value} × ${sides[1].value}`);
    sides.forEach((side, i) => side.addEventListener("input", (event) => {
      if (link.checked) sides[1 - i].value = snap(sides[1 - i], i === 0 ? side.value / proportion : side.value * proportion);
      else proportion = sides[0].value / sides[1].value;
      say();
      this.change({ [name]: sides.map((one) => Number(one.value)) }, event.timeStamp);
    }));
    this.#parts.set(name, ({ cost }) => {
      const value = cost[name];
      box.hidden = value === undefined || value === null;
      if (box.hidden) return;
      const pixelwise = "aggregation" in cost;
      for (const side of sides) Object.assign(side, { max: pixelwise && name === "window" ? 15 : 61, step: pixelwise && name === "window" ? 2 : 1 });
      if (typeof value === "string") {
        shown.textContent = value;
        return;
      }
      const size = Array.isArray(value) ? value : [value, value];
      sides.forEach((side, i) => (side.value = size[i]));
      proportion = size[0] / size[1];
      say();
    });
    return box;
  }

  #range({ name, label }) {
    const ends = ["from", "to, excluded"].map((end, i) => el("input", { type: "number", id: `${name}-${i ? "max" : "min"}`, step: 1, "aria-label": `${label} ${end}` }));
    const estimate = el("button", { type: "button", className: "quiet" }, "Estimate");
    estimate.addEventListener("click", (event) => this.change({ [name]: undefined }, event.timeStamp));
    for (const end of ends) end.addEventListener("input", (event) => {
      const [low, high] = ends.map((one) => Number.parseInt(one.value, 10));
      if (low < high) this.change({ [name]: [low, high] }, event.timeStamp);
    });
    this.#parts.set(name, ({ disparities }) => {
      if (disparities && !ends.includes(document.activeElement)) ends.forEach((end, i) => (end.value = disparities[i]));
    });
    return el("fieldset", { className: "range" }, el("legend", {}, label), ends[0], el("span", {}, "to"), ends[1], estimate);
  }

  #optimize({ name, label }) {
    const box = select(name, [["none", "none"], ...this.info.optimizers.map((one) => [one.name, one.name])]);
    const parts = el("div", { className: "parts" });
    box.addEventListener("change", (event) => {
      const gone = Object.fromEntries(Object.keys(PARTS).map((part) => [part, undefined]));
      this.change({ ...gone, [name]: box.value === "none" ? null : box.value }, event.timeStamp);
    });
    let built = null;
    const sliders = new Map();
    this.#parts.set(name, ({ optimize }) => {
      const chosen = optimize?.name ?? "none";
      box.value = chosen;
      if (built !== chosen) {
        built = chosen;
        sliders.clear();
        parts.replaceChildren();
        const fields = this.info.optimizers.find((one) => one.name === chosen)?.fields ?? {};
        for (const part of Object.keys(PARTS)) {
          const used = valueOf(optimize, part);
          if (!(part in fields) || used === null || used === undefined) continue;
          const [title, range] = PARTS[part];
          const control = Array.isArray(range) ? choiceOf(part, title, range) : sliderOf(part, title, range);
          control.input.addEventListener(control.event, (event) => this.change({ [part]: Number(control.input.value) }, event.timeStamp));
          sliders.set(part, control);
          parts.append(control.box);
        }
      }
      for (const [part, control] of sliders) control.set(valueOf(optimize, part));
    });
    return el("div", {}, labelled(label, box), parts);
  }

  #switch(field) {
    const { name, label, on, off, value, part } = field;
    const tick = el("input", { type: "checkbox", role: "switch", id: name });
    const box = el("div", { className: "toggle" }, el("label", { className: "check" }, tick, ` ${label}`));
    let last = on;
    const control = value ? sliderOf(`${name}-value`, "", value, `${label}: how much`) : null;
    if (control) box.append(control.box);
    tick.addEventListener("change", (event) => this.change({ [name]: tick.checked ? last : off }, event.timeStamp));
    control?.input.addEventListener("input", (event) => {
      const number = Number(control.input.value);
      last = part === undefined ? number : last.with(part, number);
      this.change({ [name]: last }, event.timeStamp);
    });
    this.#parts.set(name, (settings) => {
      const used = settings[name];
      tick.checked = used !== null && used !== undefined && used !== false;
      if (control) {
        control.box.hidden = !tick.checked;
        if (tick.checked) {
          last = used;
          const shown = part === undefined ? used : used[part];
          if (typeof shown === "number") control.set(shown);
          else control.say(text(shown));
        }
      }
    });
    return box;
  }

  #choice({ name, label, options }) {
    const pairs = options.map((option) => (Array.isArray(option) ? option : [option, text(option)]));
    const box = select(name, pairs.map(([value, title]) => [JSON.stringify(value), title]));
    box.addEventListener("change", (event) => this.change({ [name]: JSON.parse(box.value) }, event.timeStamp));
    this.#parts.set(name, (settings) => {
      const value = JSON.stringify(settings[name] ?? null);
      if (![...box.options].some((option) => option.value === value)) box.append(el("option", { value }, Array.isArray(settings[name]) ? "estimated" : text(settings[name])));
      box.value = value;
    });
    return labelled(label, box);
  }
}

function valueOf(optimize, part) {
  const own = part === "smoothness" ? "norm" : part.replace(/^(optimize|smoothness)_/, "");
  return optimize?.[own];
}

/** Settings of the server as the page's own: an optimizer's parts stand for themselves, so that each can be changed. */
export function flattened({ preset = null, ...set }, info) {
  const { optimize } = set;
  if (optimize?.name) {
    const fields = info.optimizers.find((one) => one.name === optimize.name)?.fields ?? {};
    const parts = Object.keys(fields).map((part) => [part, valueOf(optimize, part)]).filter(([, value]) => value !== undefined);
    Object.assign(set, { optimize: optimize.name }, Object.fromEntries(parts));
  }
  return { preset, set };
}

function select(name, options) {
  return el("select", { id: name, name }, ...options.map(([value, title]) => el("option", { value }, title)));
}

function labelled(title, control) {
  return el("label", { className: "field" }, el("span", {}, title), control);
}

function sliderOf(name, title, { min, max, step, unit }, spoken = title) {
  const input = el("input", { type: "range", id: name, min, max, step, "aria-label": spoken });
  const shown = el("output", {});
  const decimals = step < 0.1 ? 2 : step < 1 ? (step === 0.25 ? 2 : 1) : 0;
  const say = () => (shown.textContent = `${number(Number(input.value), decimals)}${unit ? ` ${unit}` : ""}`);
  input.addEventListener("input", say);
  const set = (value) => {
    if (value === undefined || value === null || document.activeElement === input) return;
    input.max = Math.max(max, value);
    input.value = value;
    say();
  };
  const box = el("label", { className: "slider" }, title ? el("span", {}, title) : null, input, shown);
  return { input, box, set, event: "input", say: (said) => (shown.textContent = said) };
}

function choiceOf(name, title, options) {
  const input = select(name, options.map((option) => [option, option]));
  const set = (value) => {
    if (value === undefined || value === null) return;
    if (![...input.options].some((option) => option.value === String(value))) input.append(el("option", { value }, String(value)));
    input.value = String(value);
  };
  return { input, box: labelled(title, input), set, event: "change" };
}

function snap(input, value) {
  const step = Number(input.step);
  const low = Number(input.min);
  return Math.min(Math.max(low + Math.round((value - low) / step) * step, low), Number(input.max));
}
