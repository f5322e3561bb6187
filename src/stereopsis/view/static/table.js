/**
 * <sortable-table>: the table inside it is sorted by a column when its heading is pressed, up and then down; cells that
 * hold no number come last. A cell counts as its data-value, else as its text. Needs pieces.css; stands alone otherwise.
 */
export class SortableTable extends HTMLElement {
  connectedCallback() {
    const table = this.querySelector("table");
    if (!table || table.dataset.sortable) return;
    table.dataset.sortable = "yes";
    for (const heading of table.tHead?.rows[0]?.cells ?? []) {
      const text = heading.textContent.trim();
      if (!text || heading.tagName !== "TH") continue;
      const button = document.createElement("button");
      button.type = "button";
      button.className = "sort";
      button.append(...heading.childNodes);
      button.addEventListener("click", () => this.sort(heading.cellIndex));
      heading.append(button);
    }
  }

  /** Sort by a column; pressed again, the other way round. */
  sort(column, descending) {
    const table = this.querySelector("table");
    const heading = table.tHead.rows[0].cells[column];
    const down = descending ?? heading.getAttribute("aria-sort") === "ascending";
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    heading.setAttribute("aria-sort", down ? "descending" : "ascending");
    const rows = [...table.tBodies[0].rows].map((row) => [worth(row.cells[column]), row]);
    rows.sort(([a], [b]) => compare(a, b, down));
    table.tBodies[0].append(...rows.map(([, row]) => row));
  }
}

function worth(cell) {
  const text = (cell?.dataset.value ?? cell?.firstChild?.textContent ?? "").trim();
  const number = Number.parseFloat(text.replace("−", "-"));
  return /^[-−+]?[\d.]/.test(text) && Number.isFinite(number) ? number : text;
}

function compare(a, b, down) {
  if (typeof a !== typeof b) return typeof a === "number" ? -1 : 1;
  const order = typeof a === "number" ? a - b : a.localeCompare(b, undefined, { numeric: true });
  return down ? -order : order;
}

customElements.define("sortable-table", SortableTable);
