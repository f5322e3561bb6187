/** What is seen, as the address after the #: a link that shows the same. */

const NUMBERS = ["zoom", "swipe"];
const LISTS = ["centre", "pixel", "range"];

export function readLink(hash = location.hash) {
  const given = new URLSearchParams(hash.slice(1));
  const state = {};
  for (const [name, value] of given) {
    if (NUMBERS.includes(name)) {
      if (Number.isFinite(Number(value))) state[name] = Number(value);
    } else if (LISTS.includes(name)) {
      const list = value.split(",").map(Number);
      if (list.length === 2 && list.every(Number.isFinite)) state[name] = list;
    } else if (name === "set") {
      try {
        const set = JSON.parse(value);
        if (set && typeof set === "object" && !Array.isArray(set)) state.set = set;
      } catch {
        // Somebody cut the link short: the rest still counts.
      }
    } else state[name] = value;
  }
  return state;
}

export function writeLink(state) {
  const out = new URLSearchParams();
  for (const [name, value] of Object.entries(state)) {
    if (value === null || value === undefined || value === "") continue;
    if (name === "set") {
      if (Object.keys(value).length) out.set(name, JSON.stringify(value));
    } else out.set(name, Array.isArray(value) ? value.map((v) => Math.round(v * 100) / 100).join(",") : NUMBERS.includes(name) ? String(Math.round(value * 1000) / 1000) : value);
  }
  const hash = `#${out.toString().replaceAll("%2C", ",").replaceAll("%22", '"').replaceAll("%3A", ":").replaceAll("%5B", "[").replaceAll("%5D", "]").replaceAll("%7B", "{").replaceAll("%7D", "}")}`;
  if (hash !== location.hash) history.replaceState(null, "", hash);
}
