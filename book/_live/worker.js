// One Python for the page. In: {id, sources, targets}. Out: status, output, done, failed.
const say = (message) => self.postMessage(message);
const at = (name) => new URL(name, import.meta.url);
const real = self.fetch.bind(self);
let shell, busy; // the request that is being answered

async function get(name, sha256) {
  const answer = await real(at(name)).catch(() => ({ ok: false }));
  if (!answer.ok) throw new Error(`the file ${name} could not be fetched`);
  const data = await answer.arrayBuffer();
  if (sha256 && self.crypto.subtle) { // there is none on a plain http address that is not this machine
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", data));
    if (Array.from(hash, (b) => b.toString(16).padStart(2, "0")).join("") !== sha256)
      throw new Error(`the file ${name} is not the one that this book names`);
  }
  return data;
}

function fetchNow(name) {
  const request = new XMLHttpRequest(); // Python waits for an import, so this waits too
  request.open("GET", at(`python/${name}`), false);
  request.responseType = "arraybuffer";
  try { request.send(); } catch { /* status says it */ }
  if (request.status !== 200) throw new Error(`the file ${name} could not be fetched`);
  return new Uint8Array(request.response);
}

async function start(sources) {
  say({ type: "status", text: "Fetching Python" });
  const files = JSON.parse(new TextDecoder().decode(await get("python/files.json")));
  const part = (name) => get(`python/${name}`, files.sha256[name]);
  const plots = /\bplots\b|matplotlib|explore/.test(sources.join());
  const [wasm, library, own, ...archives] = await Promise.all([
    part("pyodide.asm.wasm.gz"), part("python_stdlib.zip"), get("rlcore.zip"), part("numpy.zip"),
    ...(plots ? [part("plots.zip")] : []), part("pyodide.asm.mjs"), part("pyodide.mjs"),
  ]);
  self.fetch = (url, options) => {
    const type = { headers: { "Content-Type": "application/wasm" } };
    if (String(url.url ?? url).endsWith("pyodide.asm.wasm"))
      return Promise.resolve(new Response(new Blob([wasm]).stream().pipeThrough(new DecompressionStream("gzip")), type));
    return String(url.url ?? url).endsWith("python_stdlib.zip") ? Promise.resolve(new Response(library)) : real(url, options);
  };
  say({ type: "status", text: "Starting Python" });
  const { loadPyodide } = await import("./python/pyodide.mjs");
  const lock = JSON.stringify({ info: files.info, packages: {} }); // we unpack them ourselves
  const py = await loadPyodide({ indexURL: at("python/").href, lockFileContents: lock });
  py.unpackArchive(own, "zip", { extractDir: "/book" });
  py.runPython("import os, sys; sys.path.insert(0, '/book'); os.chdir('/book'); from shell import Late, Shell");
  const late = py.globals.get("Late")(py.toPy(files.late), py.toPy(files.sha256), (name) => py.toPy(fetchNow(name)));
  late.unpack("numpy", py.toPy(new Uint8Array(archives[0])));
  if (plots) late.unpack("plots", py.toPy(new Uint8Array(archives[1])));
  py.globals.set("late", late);
  py.runPython("sys.meta_path.insert(0, late)");
  const made = py.globals.get("Shell")((output) => say({ type: "output", id: busy, shown, output: JSON.parse(output) }));
  return { plan: (s, n) => made.plan(py.toPy(s), n).toJs(), run: (s, n) => made.run(py.toPy(s), n), py };
}

let shown; // whether the cell that runs is one that was asked for

self.onmessage = async ({ data: { id, sources, targets } }) => {
  try {
    shell ??= await start(sources);
    busy = id;
    const heap = () => shell.py._module.HEAPU8.length;
    for (const target of targets) {
      const plan = shell.plan(sources, target);
      for (const [index, cell] of plan.entries()) {
        shown = targets.includes(cell);
        say({ type: "status", id, text: shown ? "Running" : `Running what it builds on, ${index + 1} of ${plan.length - 1}` });
        if (!shell.run(sources, cell)) return say({ type: "done", id, well: false, shown, heap: heap() });
      }
    }
    say({ type: "done", id, well: true, heap: heap() });
  } catch (error) {
    say({ type: "failed", id, text: String(error.message ?? error).trim().split("\n").at(-1) });
  }
};
