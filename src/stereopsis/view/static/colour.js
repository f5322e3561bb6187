/** From values to colours. The tables come from the server: there is one definition of each. */

/** A colour for each flag's bit, as the server has them. */
export const FLAG_COLOURS = {};
export const FILLED = 128;

export const packed = ([r, g, b], a = 255) => ((a << 24) | (b << 16) | (g << 8) | r) >>> 0;

export function setFlagColours(flags) {
  for (const { bit, colour } of flags) FLAG_COLOURS[bit] = colour;
}

/** A table of 256 colours as canvas words. */
export const lookup = (table) => Uint32Array.from(table, (colour) => packed(colour));

/** [[r, g, b], …], or the same bytes in base 64. */
export function tableOf(given) {
  if (typeof given !== "string") return given;
  const bytes = Uint8Array.from(atob(given), (c) => c.charCodeAt(0));
  return Array.from({ length: bytes.length / 3 }, (_, i) => [...bytes.subarray(3 * i, 3 * i + 3)]);
}

/** Fill `out` with the colours of `values` between `low` and `high`; `none` where a value is NaN. */
export function colorize(values, low, high, table, none, out) {
  const scale = 255 / (high - low);
  for (let i = 0; i < values.length; i++) {
    const v = values[i];
    if (v !== v) {
      out[i] = none;
      continue;
    }
    const index = (v - low) * scale;
    out[i] = table[index <= 0 ? 0 : index >= 255 ? 255 : (index + 0.5) | 0];
  }
}

/** The values below which the two given parts of all finite ones lie. */
export function quantiles(values, lower, upper) {
  const step = Math.max(1, Math.floor(values.length / 100000));
  const some = [];
  for (let i = 0; i < values.length; i += step) if (Number.isFinite(values[i])) some.push(values[i]);
  if (some.length === 0) return [0, 1];
  some.sort((a, b) => a - b);
  const at = (part) => some[Math.min(some.length - 1, Math.max(0, Math.round(part * (some.length - 1))))];
  return [at(lower), at(upper)];
}

/** About `count` round numbers from `low` to `high`. */
export function ticks(low, high, count = 5) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const marks = [];
  for (let i = Math.ceil(low / step - 1e-9); i * step <= high + 1e-9 * step; i++) marks.push([i * step, (i * step).toFixed(decimals).replace("-", "−")]);
  return marks;
}
