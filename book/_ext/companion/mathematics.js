// MathJax as it runs under Node.js, without Node.js: FILES has its sources, CONFIG its configuration.
let state = "starting";
const module = { exports: {} };
const exports = module.exports;
const __dirname = "mathjax";
var global = globalThis;
const quiet = () => {};
var console = { log: quiet, warn: quiet, error: quiet };
const path = { basename: (name) => name, dirname: (name) => name, resolve: (...names) => names.join("/") };
const require = (name) => (name == "path" ? path : (0, eval)(FILES[name]));

Object.assign(globalThis, { module, exports, __dirname, require });
(0, eval)(FILES.main);
module.exports
  .init({
    loader: { load: ["adaptors/liteDOM", "input/tex-full", "output/chtml", "a11y/assistive-mml"] },
    startup: { typeset: false },
    tex: { ...CONFIG.tex, packages: { "[-]": ["noundefined"] } },
    chtml: { ...CONFIG.chtml, fontURL: "mathjax", adaptiveCSS: false },
  })
  .then(() => (state = "ready"), (error) => (state = String(error)));

// A formula that is wide is cut into parts, between which a line may break: after relations, operators and commas, as TeX
// breaks it; first outside of brackets, inside where a part is still too wide.
const OPEN = /^mjx-c(28|5B|7B|27E8)$/;
const CLOSE = /^mjx-c(29|5D|7D|27E9)$/;
const LONG = 10; // letters and signs of a formula that may break
const WIDE = { inline: 14, display: 26 }; // of a part that may have to break again

const dom = () => MathJax.startup.adaptor;
const all = (node) => dom().outerHTML(node).match(/\bmjx-c[0-9A-F]+\b/g) ?? [];
const signs = (node) => all(node).join(" ");
const size = (node) => all(node).length;

function cut(math, anywhere) {
  let row = math;
  while (dom().childNodes(row).length == 1 && /^mjx-(mrow|inferredMrow|TeXAtom|mstyle)$/.test(dom().kind(dom().firstChild(row))))
    row = dom().firstChild(row);
  const parts = [];
  let depth = 0, before;
  for (const item of [...dom().childNodes(row)]) {
    const after = before && dom().kind(before) == "mjx-mo" && dom().getAttribute(item, "space") &&
      (dom().getAttribute(before, "space") || signs(before) == "mjx-c2C");
    if (!parts.length || (after && (anywhere || depth == 0))) {
      const part = dom().clone(math);
      [...dom().childNodes(part)].forEach((child) => dom().remove(child));
      parts.push(part);
    }
    if (dom().kind(item) == "mjx-mo") depth += OPEN.test(signs(item)) - CLOSE.test(signs(item));
    before = item;
    dom().append(parts[parts.length - 1], item);
  }
  for (const part of parts) dom().insert(part, math);
  dom().remove(math);
  return parts;
}

function typeset(tex, display) {
  const formula = MathJax.tex2chtml(tex, { display });
  const math = dom().firstChild(formula);
  const wide = (part) => size(part) >= (display ? WIDE.display : WIDE.inline);
  if (size(math) >= LONG) {
    const parts = cut(math, false).flatMap((part) => (wide(part) ? cut(part, true) : [part]));
    if (parts.length > 1) dom().addClass(formula, "parts");
    if (parts.some(wide)) dom().addClass(formula, "wide");
  }
  return dom().outerHTML(formula);
}

const stylesheet = () => dom().textContent(MathJax.chtmlStylesheet());
