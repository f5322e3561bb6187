/** The numbers at one pixel. */

import { el, number } from "./dom.js";

/** Everything that is known at a pixel of the left image. */
export function probe(session, x, y) {
  const { width, channels } = session.scene;
  const i = y * width + x;
  const d = session.disparity?.[i] ?? NaN;
  const truth = session.truth?.[i] ?? NaN;
  const match = x - d;
  return {
    x, y, d, truth, match,
    grey: values(session.leftValues, i, channels),
    right: Number.isFinite(match) && Math.round(match) >= 0 && Math.round(match) < width ? values(session.rightValues, y * width + Math.round(match), channels) : null,
    depth: session.depth(d),
    error: d - truth,
    confidence: session.confidence?.[i] ?? NaN,
    flags: session.flags ? session.info.flags.filter(({ bit }) => session.flags[i] & bit).map(({ name }) => name) : [],
  };
}

function values(array, i, channels) {
  return array ? Array.from(array.subarray(i * channels, (i + 1) * channels)) : null;
}

const shown = (list) => (list ? list.map((v) => (Number.isInteger(v) ? v : v.toPrecision(4))).join(" ") : "–");

/** Write a pixel's numbers into a list, and what they assume into a note; null: dashes. */
export function showReadout(list, note, session, at) {
  const p = at && session.scene ? probe(session, ...at) : null;
  const stated = session.scene?.calibration.stated;
  const rows = [
    ["x, y", p ? `${p.x}, ${p.y}` : "–", "xy"],
    ["Disparity", p ? `${number(p.d, 3)} px` : "–", "d"],
    ["Depth", p ? `${number(p.depth, 2)} m${stated ? "" : " *"}` : "–", "depth"],
    ...(session.truth ? [["Truth", p ? `${number(p.truth, 3)} px` : "–", "truth"], ["Error", p ? `${number(p.error, 3)} px` : "–", "error"]] : []),
    ["Confidence", p ? number(p.confidence, 2) : "–", "confidence"],
    [session.scene?.channels > 1 ? "Colour" : "Grey", p ? shown(p.grey) : "–", "grey"],
    ["Its match", p ? shown(p.right) : "–", "right"],
    ["Flags", p ? p.flags.join(", ") || "none" : "–", "flags"],
  ];
  list.replaceChildren(...rows.map(([term, text, name]) => {
    const value = el("dd", {}, text);
    value.dataset.name = name;
    return el("div", {}, el("dt", {}, term), value);
  }));
  note.hidden = stated !== false;
  note.textContent = stated === false ? `* No calibration was given: a focal length of ${number(session.scene.calibration.focal_length, 0)} px and a baseline of ${number(session.scene.calibration.baseline, 2)} m are assumed.` : "";
  return p;
}
