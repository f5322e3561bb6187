/** Shortcuts, and the list of them. */

import { el } from "./dom.js";

/** `keys`: [key, what it does, function]. Letters can be switched off, and rest while something is typed. */
export function shortcuts(keys, letters, list) {
  list.replaceChildren(...keys.concat([
    ["← → ↑ ↓", "on the picture: move the pixel that is read; with Shift by ten; with Alt move the picture"],
    ["Enter", "on the picture: the cost curve of that pixel"], ["+ − 0", "on the picture: zoom in, out, fit"],
  ]).map(([key, does]) => el("div", {}, el("dt", {}, el("kbd", {}, key)), el("dd", {}, does))));
  addEventListener("keydown", (event) => {
    if (!letters.checked || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target.closest?.("input:not([type=range],[type=checkbox],[type=radio]), select, textarea, dialog[open]")) return;
    const found = keys.find(([key]) => key === event.key);
    if (!found) return;
    event.preventDefault();
    found[2]();
  });
}
