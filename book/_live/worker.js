// One Python for the page. In: {sources, targets}. Out: status, output, done, failed.
const say = (type, message) => self.postMessage({ type, ...message });
const at = (name) => new URL(name, import.meta.url);
const real = self.fetch.bind(self);
const ahead = {}; // name -> bytes of archives that are fetched before they are asked for
let shell;
let shown; // whether the cell that runs is one that was asked for

async function get(name, integrity) {
  const answer = await real(at(name), { integrity }).catch(() => ({ ok: false })); // also where its hash is another
  if (answer.ok) return new Uint8Array(await answer.arrayBuffer());
  throw new Error(`the file ${name} could not be fetched, or is not the one that this book names`);
}

// Python waits for an import, so this waits, too
function getNow(name) {
  if (ahead[name]) return ahead[name];
  const request = new XMLHttpRequest();
  request.open("GET", at(`python/${name}`), false);
  request.responseType = "arraybuffer";
  try {
    request.send();
  } catch {} // status says it
  if (request.status === 200) return new Uint8Array(request.response);
  throw new Error(`the file ${name} could not be fetched`);
}

async function start(sources) {
  say("status", { text: "Fetching Python" });
  const files = JSON.parse(new TextDecoder().decode(await get("python/files.json")));
  const names = ["pyodide.asm.wasm.gz", "python_stdlib.zip", "pyodide.asm.mjs", "pyodide.mjs", "numpy.zip"];
  if (/\bplots\b|matplotlib|explore/.test(sources.join())) names.push("plots.zip");
  const fetched = names.map(async (name) => (ahead[name] = await get(`python/${name}`, files.hashes[name])));
  const [own] = await Promise.all([get("rlcore.zip"), ...fetched]);
  const unpacked = new Blob([ahead["pyodide.asm.wasm.gz"]]).stream().pipeThrough(new DecompressionStream("gzip"));
  self.fetch = async (resource, options) => {
    const url = String(resource.url ?? resource);
    if (url.endsWith("python_stdlib.zip")) return new Response(ahead["python_stdlib.zip"]);
    if (!url.endsWith("pyodide.asm.wasm")) return real(resource, options);
    return new Response(unpacked, { headers: { "Content-Type": "application/wasm" } });
  };
  say("status", { text: "Starting Python" });
  const { loadPyodide } = await import("./python/pyodide.mjs");
  const lockFileContents = JSON.stringify({ info: files.info, packages: {} }); // we unpack them ourselves
  const py = await loadPyodide({ indexURL: at("python/").href, lockFileContents });
  py.unpackArchive(own, "zip", { extractDir: "/book" });
  py.runPython("import os, sys; sys.path.insert(0, '/book'); os.chdir('/book')");
  const { Late, Shell } = py.pyimport("shell");
  const late = Late(py.toPy(files.late), py.toPy(files.hashes), (name) => py.toPy(getNow(name)));
  py.pyimport("sys").meta_path.append(late);
  const made = Shell((text) => {
    const output = JSON.parse(text);
    if (shown || output.type === "error") say("output", { output });
  });
  const heap = () => py._module.HEAPU8.length;
  return { plan: (all, n) => made.plan(py.toPy(all), n).toJs(), run: (all, n) => made.run(py.toPy(all), n), heap };
}

async function run({ sources, targets }) {
  shell ??= await start(sources);
  for (const target of targets) {
    const plan = shell.plan(sources, target);
    for (const [i, cell] of plan.entries()) {
      shown = targets.includes(cell);
      say("status", { text: shown ? "Running" : `Running what it builds on, ${i + 1} of ${plan.length - 1}` });
      if (!shell.run(sources, cell)) return { well: false, shown, heap: shell.heap() };
    }
  }
  return { well: true, heap: shell.heap() };
}

self.onmessage = ({ data }) =>
  run(data).then(
    (result) => say("done", result),
    ({ message }) => say("failed", { text: message.trim().split("\n").at(-1) }),
  );
