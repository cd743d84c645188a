// Tables that sort when a head is clicked and that can be copied; figures that can be saved.
"use strict";
(function () {
  function sortKey(cell, numeric) {
    if (!numeric) return cell.dataset.text || cell.textContent.trim();
    const text = cell.dataset.sort;
    return text === "" ? NaN : Number(text.replace(/^(-?)inf$/, "$1Infinity"));
  }

  const words = new Intl.Collator("en", { numeric: true });

  function compare(a, b, numeric, direction) {
    if (!numeric) return direction * words.compare(a, b);
    // What is missing stays at the end, whatever the direction.
    if (Number.isNaN(a) || Number.isNaN(b)) return Number(Number.isNaN(a)) - Number(Number.isNaN(b));
    return direction * (a - b || (a === b ? 0 : 1));
  }

  function sort(table, column) {
    const head = table.tHead.rows[0].cells[column];
    const direction = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    const numeric = head.classList.contains("number");
    for (const other of table.tHead.rows[0].cells) other.removeAttribute("aria-sort");
    head.setAttribute("aria-sort", direction > 0 ? "ascending" : "descending");
    const body = table.tBodies[0];
    const rows = Array.from(body.rows, (row) => [sortKey(row.cells[column], numeric), row]);
    rows.sort((a, b) => compare(a[0], b[0], numeric, direction));
    for (const [, row] of rows) body.append(row);
  }

  function asText(table) {
    // Tabs between cells: spreadsheets take them; numbers with all their digits.
    const lines = [Array.from(table.tHead.rows[0].cells, (cell) => cell.dataset.text)];
    for (const row of table.tBodies[0].rows) {
      lines.push(Array.from(row.cells, (cell) =>
        cell.dataset.sort ?? cell.dataset.text ?? cell.textContent.trim()));
    }
    return lines.map((line) => line.join("\t")).join("\n") + "\n";
  }

  function copyByHand(text) {
    const area = document.createElement("textarea");
    area.value = text;
    document.body.append(area);
    area.select();
    const copied = document.execCommand("copy");
    area.remove();
    return copied;
  }

  async function copy(button, table) {
    const text = asText(table);
    let copied = true;
    try {
      await navigator.clipboard.writeText(text);
    } catch {
      copied = copyByHand(text);
    }
    button.textContent = copied ? "Copied" : "Not copied";
    setTimeout(() => { button.textContent = "Copy"; }, 1500);
  }

  for (const table of document.querySelectorAll("table.data")) {
    Array.from(table.tHead.rows[0].cells).forEach((head, column) => {
      head.classList.add("sortable");
      head.tabIndex = 0;
      head.addEventListener("click", () => sort(table, column));
      head.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== " ") return;
        event.preventDefault();
        sort(table, column);
      });
    });
    const button = table.closest(".table").querySelector("button.copy");
    button.hidden = false;
    button.addEventListener("click", () => copy(button, table));
  }

  for (const button of document.querySelectorAll("button.save")) {
    const image = button.closest("figure").querySelector("img");
    button.hidden = false;
    button.addEventListener("click", () => {
      const link = document.createElement("a");
      link.href = image.src;
      link.download = image.dataset.name;
      link.click();
    });
  }
})();
