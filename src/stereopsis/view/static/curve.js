/** What each disparity costs at a pixel, as a drawing. */

import { ticks } from "./colour.js";
import { number, svg } from "./dom.js";

const SIZE = { width: 320, height: 190, left: 44, right: 10, top: 12, bottom: 34 };

/** How many disparities the close-up shows at either side of the winner. */
const NEAR = 4;

/** The cost curve over the whole range and, where there is a winner, close up; empty where nothing can be matched. */
export function costCurves(curve, truth, at) {
  if (curve.costs.every((cost) => cost === null)) return [];
  const whole = costCurve(curve, truth, at);
  const index = curve.disparities.indexOf(curve.winner);
  if (index < 0) return [whole];
  const [from, to] = [Math.max(index - NEAR, 0), index + NEAR + 1];
  const near = { ...curve, disparities: curve.disparities.slice(from, to), costs: curve.costs.slice(from, to) };
  const close = costCurve(near, truth, at, "disparity near the winner (px)", 130);
  close.classList.add("near");
  return [whole, close];
}

/** An SVG of the cost curve, its winner, the sub-pixel fit and, where it is known, the truth. */
function costCurve({ disparities, costs, winner, subpixel, fit }, truth, at, title = "disparity (px)", height = SIZE.height) {
  const known = costs.filter((cost) => cost !== null);
  const { width, left, right, top, bottom } = SIZE;
  const drawing = svg("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", class: "costcurve" });
  const [low, high] = [disparities[0], Math.max(disparities.at(-1), disparities[0] + 1)];
  let [least, most] = [Math.min(...known), Math.max(...known)];
  if (most - least < 1e-9) [least, most] = [least - 0.5, most + 0.5];
  const room = 0.06 * (most - least);
  const px = (d) => left + ((d - low) / (high - low)) * (width - left - right);
  const py = (c) => top + ((most + room - c) / (most - least + 2 * room)) * (height - top - bottom);

  for (const [value, text] of ticks(least, most, height < SIZE.height ? 2 : 3)) {
    drawing.append(svg("line", { class: "grid", x1: left, x2: width - right, y1: py(value), y2: py(value) }));
    drawing.append(svg("text", { x: left - 6, y: py(value) + 3.5, "text-anchor": "end" }, text));
  }
  for (const [value, text] of ticks(low, high, 6)) drawing.append(svg("text", { x: px(value), y: height - bottom + 15, "text-anchor": "middle" }, text));
  drawing.append(svg("line", { class: "axis", x1: left, x2: width - right, y1: height - bottom, y2: height - bottom }));
  drawing.append(svg("text", { class: "title", x: (left + width - right) / 2, y: height - 4, "text-anchor": "middle" }, title));

  if (Number.isFinite(subpixel) && title.includes("near")) drawing.append(svg("line", { class: "refined", x1: px(subpixel), x2: px(subpixel), y1: top, y2: height - bottom }));
  if (Number.isFinite(truth) && truth >= low && truth <= high) drawing.append(svg("line", { class: "truth", x1: px(truth), x2: px(truth), y1: top, y2: height - bottom }));
  if (winner !== null && winner !== undefined) drawing.append(svg("line", { class: "winner", x1: px(winner), x2: px(winner), y1: top, y2: height - bottom }));
  drawing.append(svg("path", { class: "costs", d: path(disparities.map((d, i) => (costs[i] === null ? null : [px(d), py(costs[i])]))) }));
  if (disparities.length <= 2 * NEAR + 1) disparities.forEach((d, i) => costs[i] === null || drawing.append(svg("circle", { class: "cost", cx: px(d), cy: py(costs[i]), r: 2.2 })));
  if (fit?.points?.length) drawing.append(svg("path", { class: "fit", d: path(fit.points.map(([d, c]) => [px(d), py(Math.min(Math.max(c, least - room), most + room))])) }));
  const index = disparities.indexOf(winner);
  if (index >= 0 && costs[index] !== null) drawing.append(svg("circle", { class: "best", cx: px(winner), cy: py(costs[index]), r: 4 }));
  drawing.setAttribute("aria-label", [
    `Cost over disparity at ${at.join(", ")}: the least is at ${winner} px`,
    Number.isFinite(subpixel) ? `, refined ${number(subpixel, 3)} px` : "",
    Number.isFinite(truth) ? `, truth ${number(truth, 3)} px` : "", ".",
  ].join(""));
  return drawing;
}

/** Lines between neighbours that are both there. */
function path(points) {
  let text = "";
  let pen = false;
  for (const point of points) {
    if (point) text += `${pen ? "L" : "M"}${point[0].toFixed(2)} ${point[1].toFixed(2)}`;
    pen = Boolean(point);
  }
  return text;
}
