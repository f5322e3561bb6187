/** What the colours mean: a colour bar with numbers, or the flags. */

import { FILLED, FLAG_COLOURS, ticks } from "./colour.js";
import { el, number } from "./dom.js";

/** A horizontal bar of a table's 256 colours with round numbers below. */
export function colourBar(table, low, high, unit, label) {
  const strip = el("canvas", { width: 256, height: 1, className: "strip", role: "img", "aria-label": `${label}: colours from ${number(low, 1)} to ${number(high, 1)} ${unit}` });
  const context = strip.getContext("2d");
  const picture = context.createImageData(256, 1);
  new Uint32Array(picture.data.buffer).set(table);
  context.putImageData(picture, 0, 0);
  const marks = el("div", { className: "marks", "aria-hidden": "true" });
  const inner = ticks(low, high);
  const free = (end) => inner.every(([value]) => Math.abs(value - end) > 0.08 * (high - low));
  const ends = [low, high].filter(free).map((end) => [end, number(end, Number.isInteger(end) ? 0 : 1)]);
  for (const [value, text] of [...inner, ...ends]) {
    const mark = el("span", { className: value - low < 0.01 * (high - low) ? "start" : high - value < 0.01 * (high - low) ? "end" : "" }, text);
    mark.style.left = `${(100 * (value - low)) / (high - low)}%`;
    marks.append(mark);
  }
  return el("div", { className: "colourbar" }, strip, marks);
}

/** Each flag's colour, name and share of the pixels. */
export function flagLegend(flags, names) {
  const counts = new Array(256).fill(0);
  for (const bits of flags) counts[bits]++;
  const share = (bit) => counts.reduce((sum, count, bits) => sum + (bits & bit ? count : 0), 0) / flags.length;
  const items = names.filter(({ bit }) => bit !== FILLED).map(({ bit, name }) => {
    const swatch = el("i", { className: "swatch" });
    swatch.style.background = `rgb(${FLAG_COLOURS[bit].join(" ")})`;
    return el("li", {}, swatch, `${name} `, el("span", { className: "soft" }, `${(100 * share(bit)).toFixed(1)} %`));
  });
  const filled = share(FILLED);
  if (filled > 0) items.push(el("li", {}, `paler: filled `, el("span", { className: "soft" }, `${(100 * filled).toFixed(1)} %`)));
  return el("ul", { className: "flags" }, ...items);
}
