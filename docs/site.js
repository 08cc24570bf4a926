// Each list of the contents and each bar of code is a landmark with a name of its own; the search is named, and
// wide tables can be scrolled by keys.
window.addEventListener("load", () => {
  document.querySelectorAll("nav nav, nav.md-code__nav").forEach((list, k) => {
    const named = document.getElementById(list.getAttribute("aria-labelledby"));
    list.removeAttribute("aria-labelledby");
    list.setAttribute("aria-label", `${named ? named.textContent.trim() : "code"} (${k + 1})`);
  });
  document.querySelector(".md-search")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(".md-typeset__scrollwrap").forEach((table) => (table.tabIndex = 0));
});
