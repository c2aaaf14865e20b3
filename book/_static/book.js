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

// Buttons for many numbers in a row become a slider; the buttons stay for print, and CSS goes on asking them.
function slide(row) {
  const knobs = [...row.querySelectorAll("input[type=radio]")], legend = row.querySelector("legend");
  const slider = document.createElement("input"), value = document.createElement("span");
  Object.assign(slider, {type: "range", min: 0, max: knobs.length - 1, step: 1});
  slider.setAttribute("aria-label", legend.textContent);
  value.className = "value";
  value.setAttribute("aria-hidden", "true");
  const show = () => {
    slider.value = knobs.findIndex(knob => knob.checked);
    value.textContent = knobs[slider.value].nextElementSibling.textContent;
    slider.setAttribute("aria-valuetext", value.textContent);
  };
  slider.addEventListener("input", () => {
    knobs[slider.value].checked = true;
    show();
  });
  row.classList.add("slides");
  legend.after(slider, value);
  show();
  window.addEventListener("pageshow", show);  // where a browser comes back to what was chosen
}
document.addEventListener("DOMContentLoaded", () => document.querySelectorAll(".explore fieldset.ordered").forEach(slide));

// From a disk a page must not read the others: the search shows where words stand, without the lines around them.
if (location.protocol == "file:") DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = false;
