/** The samples of a data set or the rows of a results folder. */

import "./table.js";
import { el } from "./dom.js";

const PERCENT = /density|within|bad|d1|coverage/i;

export class Samples {
  constructor(box, { samples, columns }, open) {
    this.names = samples.map(({ name }) => name);
    this.box = box;
    const cell = (value, column) => {
      if (typeof value !== "number") return el("td", {}, value ?? "–");
      const shown = el("td", {}, PERCENT.test(column) && Math.abs(value) <= 1 ? `${(100 * value).toFixed(1)} %` : Number.isInteger(value) ? String(value) : value.toFixed(3));
      shown.dataset.value = value;
      return shown;
    };
    const rows = samples.map(({ name, has_truth, values }) => {
      const button = el("button", { type: "button", className: "link", onclick: () => open(name) }, name);
      const row = el("tr", { onclick: (event) => event.target === button || open(name) }, el("th", { scope: "row" }, button),
        ...columns.map((column) => cell(values?.[column], column)), ...(columns.length ? [] : [el("td", {}, has_truth ? "yes" : "no")]));
      row.dataset.name = name;
      return row;
    });
    const head = ["Sample", ...(columns.length ? columns : ["Truth"])];
    const table = el("table", {}, el("caption", { className: "hidden" }, "Samples"), el("thead", {}, el("tr", {}, ...head.map((title) => el("th", { scope: "col" }, title.replaceAll("_", " "))))), el("tbody", {}, ...rows));
    box.replaceChildren(el("sortable-table", { className: "scroll", tabIndex: 0, role: "region", "aria-label": "Samples" }, table));
  }

  /** The name so many rows further, in the order that the table has now. */
  beside(name, step) {
    const order = [...this.box.querySelectorAll("tbody tr")].map((row) => row.dataset.name);
    return order[(order.indexOf(name) + step + order.length) % order.length];
  }

  mark(name) {
    for (const row of this.box.querySelectorAll("tbody tr")) row.dataset.name === name ? row.setAttribute("aria-current", "true") : row.removeAttribute("aria-current");
  }
}
