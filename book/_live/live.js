// Loaded at the first click: an editor for each cell that is opened, and one worker with Python for the page.
import { defaultKeymap, history, historyKeymap, indentWithTab } from "./python/codemirror-commands.js";
import { python } from "./python/codemirror-lang-python.js";
import { HighlightStyle, bracketMatching, indentUnit, syntaxHighlighting } from "./python/codemirror-language.js";
import { EditorState } from "./python/codemirror-state.js";
import { EditorView, keymap } from "./python/codemirror-view.js";
import { tags } from "./python/lezer-highlight.js";

const at = (name) => new URL(name, import.meta.url);
const cells = window.liveCells;
const stored = cells.map((cell) => cell.querySelector(".cell_input pre").textContent.replace(/\n$/, ""));
const opened = cells.map(() => null); // editor, output, status and buttons of each cell, once opened
const ids = cells.map((cell, n) => cells[n + 1]?.className.match(/tag_check-(\S+)/)?.[1]); // of the exercise answered
const key = "answers " + location.pathname;
const kept = { texts: {}, passed: [] };
try { Object.assign(kept, JSON.parse(localStorage.getItem(key))); } catch { /* nothing that was kept can be read */ }
let worker, asked, next = 0;

const colours = HighlightStyle.define([
  { tag: tags.keyword, color: "var(--live-keyword)" },
  { tag: tags.comment, color: "var(--live-comment)" },
  { tag: [tags.string, tags.special(tags.string)], color: "var(--live-string)" },
  { tag: tags.number, color: "var(--live-number)" },
]);

export function open(cell) {
  if (!cell) return;
  const n = cells.indexOf(cell);
  opened[n] ??= build(n);
  opened[n].editor.focus();
  if (!ids[n]) run(n);
}

function button(bar, text, action) {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text });
  made.addEventListener("click", action);
  bar.append(made);
  return made;
}

function build(n) {
  const cell = cells[n], input = cell.querySelector(".cell_input"), bar = cell.querySelector(".live-bar");
  const holder = Object.assign(document.createElement("div"), { className: "live-editor" });
  holder.addEventListener("keydown", (event) => event.stopPropagation()); // "/" is a slash here, not the page's search
  [...input.children].forEach((child) => { child.hidden = true; });
  input.append(holder);
  const go = () => (run(n), true);
  const name = ids[n] ? `Your answer to exercise ${ids[n]}` : `Python code of cell ${n + 1}`;
  const editor = new EditorView({
    parent: holder,
    state: EditorState.create({
      doc: kept.texts[ids[n]] ?? stored[n],
      extensions: [
        keymap.of([{ key: "Shift-Enter", run: go }, { key: "Mod-Enter", run: go }, ...defaultKeymap, ...historyKeymap]),
        history(), python(), bracketMatching(), indentUnit.of("    "), syntaxHighlighting(colours), EditorView.lineWrapping,
        EditorView.contentAttributes.of({ "aria-label": `${name}; Shift+Enter runs it` }),
        EditorView.updateListener.of((update) => update.docChanged && ids[n] && keep(n)),
      ],
    }),
  });
  const status = bar.querySelector("span");
  bar.replaceChildren();
  const runs = button(bar, ids[n] ? "Check" : "Run", go);
  const stops = button(bar, "Stop", () => stop());
  stops.hidden = true;
  if (ids[n]) for (const word of ["Hint", "Solution"]) button(bar, word, () => unfold(n, word));
  button(bar, "Undo changes", () => editor.dispatch({ changes: { from: 0, to: editor.state.doc.length, insert: stored[n] } }));
  bar.append(status);
  const place = ids[n] ? cells[n + 1] : cell; // a verdict stands where the check is
  if (ids[n]) place.querySelector(".cell_input").hidden = true;
  let output = place.querySelector(".cell_output");
  const alt = output?.querySelector("img")?.alt;
  if (!output) place.append(output = Object.assign(document.createElement("div"), { className: "cell_output docutils container" }));
  return { editor, output, status, runs, stops, alt };
}

function unfold(n, word) { // the next hint, or the solution, which are folded below the check
  let part = cells[n + 1];
  while ((part = part.nextElementSibling) && !part.matches("section, div.cell")) {
    if (!part.matches("details") || part.open || !part.querySelector("summary").textContent.startsWith(word)) continue;
    part.open = true;
    return part.scrollIntoView({ block: "nearest" });
  }
  opened[n].status.textContent = word === "Hint" ? "That was the last hint." : "";
}

const text = (n) => opened[n]?.editor.state.doc.toString() ?? kept.texts[ids[n]] ?? stored[n];

async function run(n) {
  const one = opened[n], start = performance.now();
  if (asked) return void (one.status.textContent = "Another cell is running; stop it first.");
  one.runs.disabled = true;
  one.stops.hidden = false;
  try {
    const result = await ask(one, cells.map((_, i) => text(i)), ids[n] ? [n, n + 1] : [n]);
    const seconds = ((performance.now() - start) / 1000).toFixed(1);
    one.status.textContent = `${result.well ? "Done" : result.shown ? "Ended with an error" : "A cell that this one builds on ended with an error"} in ${seconds} s`;
    one.status.title = `Python holds ${Math.round(result.heap / 1e6)} MB`;
    if (ids[n]) passed(n, result.well && one.output.lastChild?.textContent.startsWith("passed"));
  } catch (error) {
    one.status.textContent = error.message;
  }
  one.runs.disabled = false;
  one.stops.hidden = true;
}

function ask(one, sources, targets) {
  const id = next++, unchanged = sources.every((source, i) => source === stored[i]);
  return new Promise((resolve, reject) => {
    asked = { id, one, unchanged, fresh: true, resolve, reject };
    shelf().then(() => {
      if (asked?.id !== id) return; // stopped meanwhile
      worker ??= hire();
      worker.postMessage({ id, sources, targets });
    });
  }).finally(() => { asked = undefined; });
}

function hire() {
  const made = new Worker(at("worker.js"), { type: "module" });
  made.onmessage = ({ data }) => {
    if (!asked || (data.id ?? asked.id) !== asked.id) return;
    if (data.type === "status") asked.one.status.textContent = data.text + "…";
    else if (data.type === "output") show(asked, data);
    else if (data.type === "failed") stop(`Python cannot run here: ${data.text}.`);
    else if (asked.fresh) asked.one.output.replaceChildren(), asked.resolve(data);
    else asked.resolve(data);
  };
  made.onerror = () => stop("Python could not be started here.");
  return made;
}

function stop(words = "Stopped. What earlier cells made is made again at the next run.") {
  worker?.terminate();
  worker = undefined;
  asked?.reject(new Error(words));
}

function show(request, { shown, output }) {
  if (!shown && output.type !== "error") return; // of a cell that this one builds on
  const place = request.one.output, last = place.lastElementChild;
  if (request.fresh) place.replaceChildren();
  request.fresh = false;
  if (output.type === "stream" && last?.isConnected && last.dataset.stream === output.name) return void last.firstChild.append(output.text);
  const data = output.data ?? {}, box = document.createElement("div");
  const picture = data["image/svg+xml"] ? "data:image/svg+xml;utf8," + encodeURIComponent(data["image/svg+xml"]) : data["image/png"] && "data:image/png;base64," + data["image/png"];
  if (data["text/html"]) {
    box.className = "output text_html";
    box.innerHTML = data["text/html"];
  } else if (picture) {
    const img = Object.assign(new Image(), { src: picture, alt: request.one.alt && request.unchanged ? `Drawn anew: ${request.one.alt}` : "The figure that this cell drew" });
    img.onload = () => { img.style.width = img.naturalWidth / 2 + "px"; };
    box.className = "output image_png";
    box.append(img);
  } else {
    box.className = { error: "output traceback live-error", stream: "output stream" }[output.type] ?? "output text_plain live-words";
    if (output.type === "stream") box.dataset.stream = output.name;
    box.append(Object.assign(document.createElement("pre"), { textContent: output.text ?? data["text/plain"] }));
  }
  place.append(box);
}

// ---------------------------------------------------------------- what is kept in this browser, and nowhere else

let words = "Your answers are kept in this browser only.";

function save() {
  try { localStorage.setItem(key, JSON.stringify(kept)); } catch { words = "This browser keeps nothing: download your answers."; }
  progress();
}

function keep(n) {
  if (text(n) === stored[n]) delete kept.texts[ids[n]];
  else kept.texts[ids[n]] = text(n);
  save();
}

function passed(n, well) {
  kept.passed = kept.passed.filter((id) => id !== ids[n]).concat(well ? [ids[n]] : []);
  save();
}

function progress() {
  const all = ids.filter(Boolean), there = document.querySelector(".live-kept");
  if (!all.length) return;
  const bar = there ?? Object.assign(document.createElement("p"), { className: "live-bar live-kept" });
  if (!there) {
    bar.append(document.createElement("span"));
    button(bar, "Download as notebook", download);
    button(bar, "Forget", () => { try { localStorage.removeItem(key); } finally { location.reload(); } });
    document.querySelector("article h1").after(bar);
  }
  bar.firstChild.textContent = `${kept.passed.length} of ${all.length} passed. ${words}`;
}

async function download() {
  const link = document.querySelector('a[href$=".ipynb"][href*="_sources"]'), answer = await fetch(link.href);
  const notebook = await answer.json();
  notebook.cells.filter((cell) => cell.cell_type === "code").forEach((cell, n) => { cell.source = text(n); });
  const blob = new Blob([JSON.stringify(notebook, null, 1)], { type: "application/x-ipynb+json" });
  Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: link.href.split("/").at(-1) }).click();
}

// ---------------------------------------------------------------- the next visit needs no network

async function shelf() {
  const keeper = navigator.serviceWorker;
  if (!keeper || keeper.controller) return;
  try {
    await keeper.register(at("../../live-shelf.js"));
    const ready = new Promise((resolve) => keeper.addEventListener("controllerchange", resolve, { once: true }));
    await Promise.race([ready, new Promise((resolve) => setTimeout(resolve, 2000))]);
    keeper.controller?.postMessage([location.href.split("#")[0], ...performance.getEntriesByType("resource").map((entry) => entry.name)]);
  } catch { /* without it, pages are fetched each time */ }
}

if (Object.keys(kept.texts).length) {
  cells.forEach((_, n) => { if (kept.texts[ids[n]] !== undefined) opened[n] = build(n); });
  progress();
}
