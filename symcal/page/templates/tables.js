"use strict";
// Tables: sorted by a click on a head, rows found by what they hold. Without script they stand as they are.
(() => {
  for (const each of document.querySelectorAll(".js")) each.hidden = false;

  const value = (row, column) => {
    const cell = row.cells[column];
    const text = cell.dataset.v ?? cell.textContent.trim();
    const number = text === "" || text === "–" ? NaN : Number(text.replace("\u2212", "-").replace(/\s*(%|mm|deg|px)$/, ""));
    return [number, text];
  };
  const compare = (a, b) => {
    const x = Number.isNaN(a[0]), y = Number.isNaN(b[0]);
    if (!x && !y) return a[0] - b[0];
    if (x !== y) return x ? 1 : -1; // what is no number stands last
    return a[1].localeCompare(b[1], "en", { numeric: true });
  };
  for (const table of document.querySelectorAll("table.sortable")) {
    const heads = [...table.tHead.rows[0].cells];
    heads.forEach((head, column) => {
      if (!head.textContent.trim() || "plain" in head.dataset) return;
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = head.textContent;
      head.replaceChildren(button);
      button.addEventListener("click", () => {
        const down = head.getAttribute("aria-sort") === "ascending";
        for (const other of heads) other.removeAttribute("aria-sort");
        head.setAttribute("aria-sort", down ? "descending" : "ascending");
        const body = table.tBodies[0];
        const rows = [...body.rows].map((row) => [value(row, column), row]);
        rows.sort((a, b) => {
          const missing = Number.isNaN(a[0][0]) !== Number.isNaN(b[0][0]);
          return missing || !down ? compare(a[0], b[0]) : compare(b[0], a[0]);
        });
        body.append(...rows.map((each) => each[1]));
      });
    });
  }

  // Words must all be in a row; `> 2` and `< 0.5` are about its last error, measured or foretold.
  const points = document.getElementById("points"), search = document.getElementById("search");
  if (!points || !search) return;
  const heads = [...points.tHead.rows[0].cells].map((head) => head.textContent);
  const error = Math.max(...["held out", "after", "foretold"].map((words) => heads.findIndex((h) => h.startsWith(words))));
  const count = document.getElementById("count");
  const find = () => {
    const bounds = [], words = search.value.toLowerCase().replace(/([<>])\s*([\d.]+)/g, (_, sign, number) => {
      bounds.push([sign, Number(number)]);
      return " ";
    }).split(/\s+/).filter(Boolean);
    let shown = 0;
    for (const row of points.tBodies[0].rows) {
      const text = row.textContent.toLowerCase(), size = value(row, error)[0];
      const fits = words.every((word) => text.includes(word)) && bounds.every(([sign, number]) => (sign === ">" ? size > number : size < number));
      row.hidden = !fits;
      shown += fits;
    }
    count.textContent = search.value ? `${shown} of ${points.tBodies[0].rows.length} rows` : "";
  };
  search.addEventListener("input", find);
  search.addEventListener("keydown", (event) => {
    if (event.key !== "Enter") return;
    const first = [...points.tBodies[0].rows].find((row) => !row.hidden);
    if (first) window.choose?.(Number(first.dataset.i));
  });
  for (const row of points.tBodies[0].rows) {
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = row.cells[0].textContent;
    row.cells[0].replaceChildren(button);
    row.addEventListener("click", () => window.choose?.(Number(row.dataset.i)));
  }
})();
