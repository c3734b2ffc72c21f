// Formulas and tables that scroll sideways are reached by the keyboard.
const boxes = new ResizeObserver((found) => found.forEach(({ target }) => {
  if (target.scrollWidth > target.clientWidth) target.tabIndex = 0; else target.removeAttribute("tabindex");
}));
addEventListener("DOMContentLoaded", () => document.querySelectorAll(".formula, .bd-article table").forEach((box) => boxes.observe(box)));
