// What scrolls sideways, the keyboard must be able to reach.
function reachable() {
  for (const block of document.querySelectorAll("div.math, mjx-container, div.proof > section")) {
    if (block.scrollWidth > block.clientWidth && getComputedStyle(block).overflowX == "auto") {
      block.tabIndex = 0;
      block.setAttribute("role", "group");
      block.setAttribute("aria-label", block.matches("section") ? "box, scrolls sideways" : "equation, scrolls sideways");
    }
  }
}
window.addEventListener("load", reachable);
window.addEventListener("resize", reachable);
