// An equation or box that is wider than its column scrolls; then the keyboard must be able to reach it.
function reachable() {
  for (const block of document.querySelectorAll("div.math, div.math mjx-container, div.proof > section")) {
    if (block.scrollWidth > block.clientWidth) {
      block.tabIndex = 0;
      block.setAttribute("role", "group");
      block.setAttribute("aria-label", block.matches("section") ? "box, scrolls sideways" : "equation, scrolls sideways");
    }
  }
}
window.addEventListener("load", () => (window.MathJax?.startup?.promise ?? Promise.resolve()).then(reachable));
window.addEventListener("resize", reachable);
