// Loaded at the first click: an editor for each cell that is opened, and one worker with Python for the page.
import { defaultKeymap, history, historyKeymap } from "./python/codemirror-commands.js";
import { python } from "./python/codemirror-lang-python.js";
import { bracketMatching, indentUnit, syntaxHighlighting } from "./python/codemirror-language.js";
import { EditorView, keymap } from "./python/codemirror-view.js";
import { classHighlighter } from "./python/lezer-highlight.js";

const at = (name) => new URL(name, import.meta.url);
const make = (tag, properties) => Object.assign(document.createElement(tag), properties);
const cells = window.liveCells;
const stored = cells.map((cell) => cell.querySelector(".cell_input pre").textContent.replace(/\n$/, ""));
const opened = []; // cell -> editor, place of its output, status and buttons
const ids = cells.map((cell, n) => cells[n + 1]?.className.match(/tag_check-(\S+)/)?.[1]); // of the exercise answered
const text = (n) => opened[n]?.editor.state.doc.toString() ?? kept.texts[ids[n]] ?? stored[n];

export function open(cell) {
  if (!cell) return;
  const n = cells.indexOf(cell);
  opened[n] ??= build(n);
  opened[n].editor.focus();
  if (!ids[n]) run(n);
}

function button(bar, words, action) {
  const made = make("button", { type: "button", textContent: words });
  made.addEventListener("click", () => action());
  bar.append(made);
  return made;
}

function build(n) {
  const input = cells[n].querySelector(".cell_input");
  const bar = cells[n].querySelector(".live-bar");
  const status = bar.querySelector("span");
  const place = ids[n] ? cells[n + 1] : cells[n]; // a verdict stands where the check is
  const name = ids[n] ? `Your answer to exercise ${ids[n]}` : `Python code of cell ${n + 1}`;
  const go = () => (run(n), true);
  const parent = make("div", { className: "live-editor" });
  parent.addEventListener("keydown", (event) => event.stopPropagation()); // "/" is a slash here, not the page's search
  for (const child of input.children) child.hidden = true;
  input.append(parent);
  const editor = new EditorView({
    parent,
    doc: kept.texts[ids[n]] ?? stored[n],
    extensions: [
      keymap.of([{ key: "Shift-Enter", run: go }, { key: "Mod-Enter", run: go }, ...defaultKeymap, ...historyKeymap]),
      [history(), python(), bracketMatching(), indentUnit.of("    "), EditorView.lineWrapping],
      syntaxHighlighting(classHighlighter),
      EditorView.contentAttributes.of({ "aria-label": `${name}; Shift+Enter runs it` }),
      EditorView.updateListener.of((update) => update.docChanged && ids[n] && keep(n)),
    ],
  });
  const undo = () => editor.dispatch({ changes: { from: 0, to: editor.state.doc.length, insert: stored[n] } });
  bar.replaceChildren();
  const runs = button(bar, ids[n] ? "Check" : "Run", go);
  const stops = button(bar, "Stop", stop);
  stops.hidden = true;
  if (ids[n]) for (const word of ["Hint", "Solution"]) button(bar, word, () => unfold(n, word));
  button(bar, "Undo changes", undo);
  bar.append(status);
  if (ids[n]) place.querySelector(".cell_input").hidden = true;
  const alt = place.querySelector(".cell_output img")?.alt;
  if (!place.querySelector(".cell_output")) place.append(make("div", { className: "cell_output docutils container" }));
  return { editor, output: place.querySelector(".cell_output"), status, runs, stops, alt };
}

// The next hint, or the solution, which are folded below the check
function unfold(n, word) {
  let part = cells[n + 1];
  while ((part = part.nextElementSibling) && !part.matches("section, div.cell")) {
    if (!part.matches("details:not([open])") || !part.querySelector("summary").textContent.startsWith(word)) continue;
    part.open = true;
    return part.scrollIntoView({ block: "nearest" });
  }
  opened[n].status.textContent = word === "Hint" ? "That was the last hint." : "";
}

// ---------------------------------------------------------------- Python

let worker;
let asked; // the one cell that is running

async function run(n) {
  const one = opened[n];
  const start = performance.now();
  const sources = cells.map((_, i) => text(i));
  if (asked) {
    one.status.textContent = "Another cell is running; stop it first.";
    return;
  }
  const request = (asked = { one, unchanged: sources.every((source, i) => source === stored[i]), fresh: true });
  one.runs.disabled = true;
  one.stops.hidden = false;
  try {
    const result = await new Promise((resolve, reject) => {
      Object.assign(request, { resolve, reject });
      shelf().then(() => {
        if (asked !== request) return; // stopped meanwhile
        worker ??= hire();
        worker.postMessage({ sources, targets: ids[n] ? [n, n + 1] : [n] });
      });
    });
    const which = result.shown ? "Ended with an error" : "A cell that this one builds on ended with an error";
    const seconds = ((performance.now() - start) / 1000).toFixed(1);
    one.status.textContent = `${result.well ? "Done" : which} in ${seconds} s`;
    one.status.title = `Python holds ${Math.round(result.heap / 1e6)} MB`;
    if (ids[n]) passed(ids[n], result.well && one.output.lastChild?.textContent.startsWith("passed"));
  } catch (error) {
    one.status.textContent = error.message;
  }
  asked = undefined;
  one.runs.disabled = false;
  one.stops.hidden = true;
}

function hire() {
  const made = new Worker(at("worker.js"), { type: "module" });
  made.onerror = () => stop("Python could not be started here.");
  made.onmessage = ({ data }) => {
    if (made !== worker) return; // it was stopped
    if (data.type === "status") asked.one.status.textContent = data.text + "…";
    if (data.type === "output") show(data.output);
    if (data.type === "failed") stop(`Python cannot run here: ${data.text}.`);
    if (data.type !== "done") return;
    if (asked.fresh) asked.one.output.replaceChildren();
    asked.resolve(data);
  };
  return made;
}

function stop(words = "Stopped. What earlier cells made is made again at the next run.") {
  worker?.terminate();
  worker = undefined;
  asked?.reject(new Error(words));
}

function show({ type, name, text, data = { "text/plain": text } }) {
  const { one, unchanged, fresh } = asked;
  const last = fresh ? null : one.output.lastElementChild;
  if (fresh) one.output.replaceChildren();
  asked.fresh = false;
  if (type === "stream" && last?.dataset.stream === name) return last.firstChild.append(text);
  const box = make("div", { className: "output text_plain live-words" });
  one.output.append(box);
  if (data["text/html"]) {
    box.className = "output text_html";
    box.innerHTML = data["text/html"];
  } else if (data["image/png"]) {
    box.className = "output image_png";
    const alt = one.alt && unchanged ? `Drawn anew: ${one.alt}` : "The figure that this cell drew";
    const image = make("img", { src: "data:image/png;base64," + data["image/png"], alt });
    image.onload = () => (image.style.width = image.naturalWidth / 2 + "px");
    box.append(image);
  } else {
    if (type === "error") box.className = "output traceback live-error";
    if (type === "stream") Object.assign(box, { className: "output stream" }).dataset.stream = name;
    box.append(make("pre", { textContent: data["text/plain"] }));
  }
}

// ---------------------------------------------------------------- what is kept in this browser, and nowhere else

const key = "answers " + location.pathname;
const kept = { texts: {}, passed: [] };
let words = "Your answers are kept in this browser only.";
let bar;

function keep(n) {
  kept.texts[ids[n]] = text(n) === stored[n] ? undefined : text(n);
  save();
}

function passed(id, well) {
  kept.passed = kept.passed.filter((other) => other !== id).concat(well ? [id] : []);
  save();
}

function save() {
  try {
    localStorage.setItem(key, JSON.stringify(kept));
  } catch {
    words = "This browser keeps nothing: download your answers.";
  }
  progress();
}

function progress() {
  if (!bar) {
    bar = make("p", { className: "live-bar live-kept" });
    bar.append(make("span"));
    button(bar, "Download as notebook", download);
    button(bar, "Forget", forget);
    document.querySelector("article h1").after(bar);
  }
  bar.firstChild.textContent = `${kept.passed.length} of ${ids.filter(Boolean).length} passed. ${words}`;
}

async function download() {
  const link = document.querySelector('a[href$=".ipynb"][href*="_sources"]');
  const notebook = await (await fetch(link.href)).json();
  notebook.cells.filter((cell) => cell.cell_type === "code").forEach((cell, n) => (cell.source = text(n)));
  const blob = new Blob([JSON.stringify(notebook, null, 1)], { type: "application/x-ipynb+json" });
  make("a", { href: URL.createObjectURL(blob), download: link.href.split("/").at(-1) }).click();
}

function forget() {
  try {
    localStorage.removeItem(key);
  } finally {
    location.reload();
  }
}

try {
  Object.assign(kept, JSON.parse(localStorage.getItem(key)));
} catch {} // nothing that was kept can be read
for (const [n, id] of ids.entries()) if (kept.texts[id] !== undefined) opened[n] = build(n);
if (opened.length) progress();

// ---------------------------------------------------------------- the next visit needs no network

async function shelf() {
  const keeper = navigator.serviceWorker;
  if (!keeper || keeper.controller) return;
  const ready = new Promise((resolve) => keeper.addEventListener("controllerchange", resolve, { once: true }));
  try {
    await keeper.register(at("../../live-shelf.js"));
    await Promise.race([ready, new Promise((resolve) => setTimeout(resolve, 2000))]);
    const fetched = performance.getEntriesByType("resource").map((entry) => entry.name);
    keeper.controller?.postMessage([location.href.split("#")[0], ...fetched]);
  } catch {} // without it, pages are fetched each time
}
