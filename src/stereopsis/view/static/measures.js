/** How good a result is, and how long each of its stages took. */

import { el } from "./dom.js";

const ROWS = [
  ["within_1", "within 1 px", 100, 1, "%"], ["bad_2", "bad 2.0", 100, 1, "%"], ["d1", "D1", 100, 2, "%"], ["epe", "EPE", 1, 2, "px"], ["rmse", "RMSE", 1, 2, "px"],
];
const COLUMNS = [["own", "answered"], ["all", "all"], ["filled", "filled"]];

export function scoreTable(scores) {
  if (!scores) return el("p", { className: "hint" }, "No truth is known, so nothing is measured.");
  const cell = (measures, name, factor, decimals, unit) => {
    const value = measures?.[name];
    return el("td", {}, typeof value === "number" ? `${(factor * value).toFixed(decimals)} ${unit}` : "–");
  };
  return el("table", { className: "scores" },
    el("caption", { className: "hidden" }, "Measures against the truth"),
    el("thead", {}, el("tr", {}, el("td", {}), ...COLUMNS.map(([, title]) => el("th", { scope: "col" }, title)))),
    el("tbody", {}, ...ROWS.map(([name, title, ...how]) => el("tr", {}, el("th", { scope: "row" }, title), ...COLUMNS.map(([column]) => cell(scores[column], name, ...how))))));
}

export function stageBars(stages, seconds) {
  const times = Object.entries(stages);
  const longest = Math.max(...times.map(([, time]) => time), 1e-9);
  const milliseconds = (time) => (time >= 9.9995 ? `${time.toFixed(1)} s` : `${(1000 * time).toFixed(time < 0.00995 ? 1 : 0)} ms`);
  const rows = times.map(([name, time]) => {
    const bar = el("i", {});
    bar.style.width = `${(100 * time) / longest}%`;
    return el("tr", {}, el("th", { scope: "row" }, name), el("td", { className: "length" }, bar), el("td", {}, milliseconds(time)));
  });
  return el("table", { className: "times" }, el("caption", { className: "hidden" }, "Time of each stage"),
    el("tbody", {}, ...rows, el("tr", { className: "total" }, el("th", { scope: "row" }, "in all"), el("td", {}), el("td", {}, milliseconds(seconds)))));
}

export function summary(result) {
  const size = `${result.width} × ${result.height}`;
  return `${(100 * result.density).toFixed(1)} % of ${size} pixels answered in ${(1000 * result.seconds).toFixed(0)} ms, disparities ${result.disparities[0]} to ${result.disparities[1] - 1}.`;
}
