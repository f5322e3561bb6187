/** What can be looked at, and how each is drawn at its own size. */

import { colorize, FILLED, FLAG_COLOURS, packed } from "./colour.js";

export const LAYERS = {
  left: { label: "Left", has: (s) => s.left },
  right: { label: "Right", has: (s) => s.right },
  disparity: { label: "Disparity", has: (s) => s.disparity },
  confidence: { label: "Confidence", has: (s) => s.result && s.result.arrays?.includes("confidence") !== false },
  flags: { label: "Flags", has: (s) => s.flags },
  truth: { label: "Truth", has: (s) => s.truth },
  error: { label: "Error", has: (s) => s.truth && s.disparity },
};

/** Draws layers on canvases of the scene's size, each once for what it depends on. */
export class Painter {
  #kept = new Map();

  constructor(session) {
    this.session = session;
  }

  /** The layer's picture, or null where there is nothing to draw yet. */
  canvas(name, look) {
    const s = this.session;
    if (!s.scene || !LAYERS[name].has(s)) return null;
    const key = [s.scene, depends(name, s), JSON.stringify(limits(name, look)), look.none];
    const kept = this.#kept.get(name);
    if (kept && kept.key.every((part, i) => part === key[i])) return kept.canvas;
    const { width, height } = s.scene;
    const canvas = kept?.canvas ?? document.createElement("canvas");
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.#draw(name, look, canvas);
    this.#kept.set(name, { key, canvas });
    return canvas;
  }

  #draw(name, look, canvas) {
    const s = this.session;
    const context = canvas.getContext("2d", { willReadFrequently: true });
    if (name === "left" || name === "right") {
      context.drawImage(s[name], 0, 0, canvas.width, canvas.height);
      return;
    }
    const picture = context.createImageData(canvas.width, canvas.height);
    const out = new Uint32Array(picture.data.buffer);
    const none = packed(look.none);
    if (name === "disparity") colorize(s.disparity, ...look.range, look.map, none, out);
    if (name === "truth") colorize(grown(s.truth, canvas.width), ...look.range, look.map, none, out);
    if (name === "confidence") s.confidence ? colorize(s.confidence, 0, 1, look.confidenceMap, none, out) : out.fill(none);
    if (name === "error") paintError(s, look, canvas.width, out);
    if (name === "flags") paintFlags(s, out);
    context.putImageData(picture, 0, 0);
  }
}

const depends = (name, s) => (name === "truth" ? s.truth : name === "confidence" ? s.confidence : name === "left" || name === "right" ? null : s.result);
const limits = (name, look) => (name === "error" ? look.error : name === "disparity" || name === "truth" ? [look.range, look.mapName] : null);

/** Where the truth is sparse, unknown pixels beside a known one take its value, so that it can be seen. */
export function grown(truth, width) {
  let known = 0;
  for (let i = 0; i < truth.length; i++) if (truth[i] === truth[i]) known++;
  if (known > truth.length / 2) return truth;
  const wide = truth.slice();
  for (let i = 1; i < truth.length - 1; i++) if (wide[i] !== wide[i]) wide[i] = truth[i - 1] === truth[i - 1] ? truth[i - 1] : truth[i + 1];
  const full = wide.slice();
  for (let i = width; i < full.length - width; i++) if (full[i] !== full[i]) full[i] = wide[i - width] === wide[i - width] ? wide[i - width] : wide[i + width];
  return full;
}

function paintError(s, look, width, out) {
  const error = new Float32Array(out.length);
  for (let i = 0; i < error.length; i++) error[i] = s.disparity[i] - s.truth[i];
  colorize(grown(error, width), -look.error, look.error, look.errorMap, packed(look.none), out);
}

/** The left picture, dimmed, under the colour of the first reason; paler where the pixel was filled. */
function paintFlags(s, out) {
  const { channels } = s.scene;
  const values = s.leftValues;
  const full = !values || values instanceof Uint8Array ? 255 : largest(values);
  for (let i = 0; i < out.length; i++) {
    const bits = s.flags[i];
    const grey = values ? 40 + (150 * values[i * channels + (channels > 1 ? 1 : 0)]) / full : 128;
    const reason = bits & 127;
    if (reason) {
      const [r, g, b] = FLAG_COLOURS[reason & -reason];
      const own = bits & FILLED ? 0.5 : 1;
      const rest = (1 - own) * 255;
      out[i] = packed([r * own + rest, g * own + rest, b * own + rest]);
    } else out[i] = packed([grey, grey, grey]);
  }
}

function largest(values) {
  let most = 1e-9;
  for (const value of values) if (value > most) most = value;
  return most;
}
