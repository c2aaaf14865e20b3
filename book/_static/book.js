// Formulas that are wider than their column break after relations, operators and commas, as TeX breaks them; first outside
// of brackets, inside where a part is still too wide.
const OPEN = ".mjx-c28, .mjx-c5B, .mjx-c7B, .mjx-c27E8";
const CLOSE = ".mjx-c29, .mjx-c5D, .mjx-c7D, .mjx-c27E9";

function cut(math, anywhere) {
  let row = math;
  while (row.children.length == 1 && /^MJX-(MROW|TEXATOM|MSTYLE)$/.test(row.firstElementChild.tagName)) row = row.firstElementChild;
  const parts = [];
  let depth = 0, part;
  [...row.children].forEach((item, i, all) => {
    const before = all[i - 1];
    const after = before?.tagName == "MJX-MO" && item.hasAttribute("space");
    if (!part || (after && (anywhere || depth == 0))) parts.push((part = math.cloneNode(false)));
    if (item.tagName == "MJX-MO") depth += !!item.querySelector(OPEN) - !!item.querySelector(CLOSE);
    part.append(item);
  });
  math.replaceWith(...parts);
}

function fit() {
  for (const formula of document.querySelectorAll("div.math mjx-container, span.math mjx-container")) {
    const display = formula.closest("div.math");
    const block = display ?? formula.closest("p, li, dd, td, th, h1, h2, h3, h4, figcaption, summary, div");
    const style = getComputedStyle(block);
    const number = display?.querySelector(".eqno")?.offsetWidth ?? 0;
    const room = block.clientWidth - parseFloat(style.paddingLeft) - parseFloat(style.paddingRight) - number;
    const wide = (part, share = 1) => part.getBoundingClientRect().width > share * room;
    const parts = () => [...formula.querySelectorAll(":scope > mjx-math")];
    if (parts().length == 1 && wide(parts()[0], display ? 1 : 0.6)) cut(parts()[0], false);
    for (const part of parts().filter((part) => wide(part))) cut(part, true);
    formula.classList.toggle("parts", parts().length > 1);
    formula.classList.toggle("wide", parts().some((part) => wide(part)));
  }
  reachable();
}

// What scrolls, the keyboard must be able to reach.
function reachable() {
  for (const block of document.querySelectorAll("div.math, div.math mjx-container, mjx-container.wide, div.proof > section")) {
    if (block.scrollWidth > block.clientWidth) {
      block.tabIndex = 0;
      block.setAttribute("role", "group");
      block.setAttribute("aria-label", block.matches("section") ? "box, scrolls sideways" : "equation, scrolls sideways");
    }
  }
}
window.addEventListener("load", () => (window.MathJax?.startup?.promise ?? Promise.resolve()).then(fit));
window.addEventListener("resize", fit);
