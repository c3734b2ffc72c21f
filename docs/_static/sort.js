// Sort the table of problems by the column whose heading is clicked.
document.addEventListener("DOMContentLoaded", () => {
  const mark = document.querySelector(".sortable");
  const table = mark && mark.parentElement.querySelector("table");
  if (!table) return;
  table.querySelectorAll("th").forEach((heading, column) => {
    heading.style.cursor = "pointer";
    let ascending = false;
    heading.addEventListener("click", () => {
      ascending = !ascending;
      const body = table.tBodies[0];
      const value = (row) => row.cells[column].textContent.trim();
      const rows = [...body.rows].sort((a, b) =>
        value(a).localeCompare(value(b), "en", { numeric: true }) * (ascending ? 1 : -1));
      rows.forEach((row) => body.appendChild(row));
    });
  });
});
