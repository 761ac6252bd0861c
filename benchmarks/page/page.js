"use strict";
// The number with which a cell begins (1.2e-05, -0.3 ± 0.1), or NaN.
const numeric = (cell) => parseFloat(cell.textContent.trim().replace("−", "-"));

function sortBy(table, column) {
  const head = table.tHead.rows[0].cells[column];
  const falls = head.getAttribute("aria-sort") === "ascending";
  const rows = [...table.tBodies[0].rows];
  const empty = (row) => row.cells[column].textContent.trim() === "";
  const numbers = rows.every((row) => empty(row) || !Number.isNaN(numeric(row.cells[column])));
  const compare = (a, b) =>
    numbers
      ? numeric(a.cells[column]) - numeric(b.cells[column])
      : a.cells[column].textContent.localeCompare(b.cells[column].textContent);
  rows.sort((a, b) => empty(a) - empty(b) || (falls ? -compare(a, b) : compare(a, b)));
  table.tBodies[0].append(...rows);
  for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
  head.setAttribute("aria-sort", falls ? "descending" : "ascending");
}

function filterBy(table, text) {
  const words = text.toLowerCase().split(/\s+/);
  for (const row of table.tBodies[0].rows) {
    const content = [...row.cells].map((cell) => cell.textContent).join(" ").toLowerCase();
    row.hidden = !words.every((word) => content.includes(word));
  }
}

for (const table of document.querySelectorAll("table")) {
  if (!table.tHead || !table.tBodies.length) continue;
  [...table.tHead.rows[0].cells].forEach((head, column) => {
    head.tabIndex = 0;
    head.addEventListener("click", () => sortBy(table, column));
    head.addEventListener("keydown", (event) => event.key === "Enter" && sortBy(table, column));
  });
  if (table.tBodies[0].rows.length > 5) {
    const field = document.createElement("input");
    field.className = "filter";
    field.placeholder = "Filter rows";
    field.setAttribute("aria-label", "Filter rows by text");
    field.addEventListener("input", () => filterBy(table, field.value));
    table.parentElement.before(field);
  }
}
addEventListener("beforeprint", () => document.querySelectorAll("details").forEach((fold) => (fold.open = fold.querySelectorAll("tr").length < 60)));
