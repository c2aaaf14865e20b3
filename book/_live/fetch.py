"""Fetch what live pages run on, each file by its hash, and pack it: make live.

The hash decides, the source does not matter. Those of Pyodide and of the editor are in package-lock.json, as npm writes
it; Pyodide's own lock, which comes with it, has those of its wheels, requirements.lock those of what comes from PyPI.
Tried in order: the folder that LIVE_FILES names, what was fetched before, then where the file comes from.
"""

import gzip
import hashlib
import io
import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import urllib.request
import zipfile
from base64 import b64encode
from functools import cache
from pathlib import Path

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
TO = ROOT / "_build" / "live"
FILES = TO / "files"  # as they came
NPM = {
    path.removeprefix("node_modules/"): entry
    for path, entry in json.loads((HERE / "package-lock.json").read_text(encoding="utf-8"))["packages"].items()
    if path and not path.endswith(("/ws", "/emscripten"))  # what Pyodide needs in Node alone
}
PIP = (sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:")
DISTRIBUTION = f"https://cdn.jsdelivr.net/pyodide/v{NPM['pyodide']['version']}/full/"
CARRIER = "open-webui==0.12.4", "open_webui/frontend/pyodide/"  # a wheel that carries Pyodide's files unchanged
CORE = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip")
PLOTS = "matplotlib contourpy cycler kiwisolver packaging pillow pyparsing python-dateutil six"
PYPI = ("gymnasium", "farama-notifications", "cloudpickle", "typing-extensions")
ARCHIVES = {  # what is fetched together, when one of its modules is first imported and not there yet
    "numpy": ("numpy",),
    "plots": PLOTS.split(),
    "scipy": ("scipy",),  # the part that most of it needs
    "scipy-more": ("scipy",),
    "gymnasium": PYPI,
}
NEEDED = re.compile(r"scipy[-.]|scipy/(sparse|linalg|special|_|constants|version|__)[^/]*|scipy/[^/]*\.(py|so)$")
LEFT_OUT = re.compile(  # tests, headers, stubs, sample data, toolkits of windows, fonts that no figure asks for
    r"(^|/)tests?/|\.(pyi|pxd|h|c|pyx)$|/include/|mpl-data/(sample_data|images|fonts/(afm|pdfcorefonts))/"
    r"|fonts/ttf/(STIX|cm|DejaVuSerif|DejaVuSans(Mono)?-BoldOblique)|dateutil/zoneinfo/.*gz|_tkagg"
    r"|backends/(backend_(gtk|qt|wx|tk|web|nbagg|cairo|macosx)|qt_|_backend_tk)"
    r"|PIL/_(webp|avif|imagingtk)|gymnasium/envs/(mujoco|box2d)/|gymnasium/.*\.(png|ttf|xml)$"
)
LICENCE = re.compile(r"(^|dist-info/(licenses/)?)[^/]*(LICEN|COPYING)[^/]*$")
TEXTS = [
    "Pyodide, MPL-2.0: https://mozilla.org/MPL/2.0/, its source: https://github.com/pyodide/pyodide\n"
    "CPython, PSF licence: https://docs.python.org/3/license.html"
]


def result(*command):
    """The bytes of the file that a command leaves in its folder."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(command, cwd=folder, capture_output=True, check=True)
        return next(Path(folder).iterdir()).read_bytes()


def download(name):
    with urllib.request.urlopen(DISTRIBUTION + name, timeout=10) as answer:
        return answer.read()


@cache
def carrier():
    return zipfile.ZipFile(io.BytesIO(result(*PIP, CARRIER[0])))


def integrity(data, kind):
    """A hash as npm and browsers write it."""
    return f"{kind}-{b64encode(hashlib.new(kind, data).digest()).decode()}"


def get(name, hashes, sources):
    """The bytes of a file that has one of the hashes: SHA-256 in hexadecimal digits, or SHA-512 as npm writes it."""
    kept = [Path(folder, name) for folder in (os.environ.get("LIVE_FILES"), FILES) if folder]
    sources = {str(path.parent): path.read_bytes for path in kept if path.is_file()} | sources
    tried = []
    for source, read in sources.items():
        try:
            data = read()
        except Exception as error:
            tried.append(f"{source}: {type(error).__name__}")
            continue
        if {hashlib.sha256(data).hexdigest(), integrity(data, "sha512")} & set(hashes):
            FILES.mkdir(parents=True, exist_ok=True)
            (FILES / name).write_bytes(data)
            return data
        tried.append(f"{source}: another file, by its hash")
    raise SystemExit(f"{name}: not to be had ({'; '.join(tried)})")


def slug(name):
    return name.removeprefix("@").replace("/", "-")


def from_npm(name):
    """The files of a package."""
    version = NPM[name]["version"]
    sources = {"npm": lambda: result("npm", "pack", "--silent", f"{name}@{version}")}
    data = get(f"{slug(name)}-{version}.tgz", [NPM[name]["integrity"]], sources)
    with tarfile.open(fileobj=io.BytesIO(data)) as tar:
        return {file.name.removeprefix("package/"): tar.extractfile(file).read() for file in tar if file.isfile()}


def pinned(name):
    """A package as requirements.lock has it: name==version, and its hashes."""
    locked = (ROOT / "requirements.lock").read_text(encoding="utf-8")
    entry = re.search(rf"^{name}==.*?(?=^\S|\Z)", locked, re.M | re.S)[0]
    return entry.split()[0], re.findall(r"sha256:(\w+)", entry)


def wheel(name, theirs):
    """The files of a package of Python."""
    if name in PYPI:
        requirement, hashes = pinned(name)
        file = requirement.replace("-", "_").replace("==", "-") + "-py3-none-any.whl"
        sources = {"PyPI": lambda: result(*PIP, requirement)}
    else:
        file, hashes = theirs["packages"][name]["file_name"], [theirs["packages"][name]["sha256"]]
        sources = {DISTRIBUTION: lambda: download(file), CARRIER[0]: lambda: carrier().read(CARRIER[1] + file)}
    data = get(file, hashes, sources)
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        return {path: archive.read(path) for path in archive.namelist() if not path.endswith("/")}


def zipped(files):
    """An archive of files, the same bytes each time."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for path, data in sorted(files.items()):
            archive.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), data, zipfile.ZIP_DEFLATED, 9)
    return out.getvalue()


def belongs(path, archive):
    scipy = not archive.startswith("scipy") or bool(NEEDED.match(path)) == (archive == "scipy")
    return scipy and not LEFT_OUT.search(path)


def editor(files):
    """The module of a package of npm, which finds the others beside it."""
    about = json.loads(files["package.json"])
    main = about["exports"]["import"] if isinstance(about.get("exports"), dict) else about["module"]
    text = files[main.removeprefix("./")].decode()
    beside = r"""(\bfrom\s*)['"](@?[a-z][^'"]*)['"]"""
    return re.sub(beside, lambda found: f'{found[1]}"./{slug(found[2])}.js"', text).encode()


def licences(name, files):
    return "\n\n".join(
        [name, *(data.decode("utf-8", "replace") for path, data in files.items() if LICENCE.search(path))]
    )


def main():
    pyodide = from_npm("pyodide")
    theirs = json.loads(pyodide["pyodide-lock.json"])
    made, late, texts = {name: pyodide[name] for name in CORE}, {}, {}
    made["pyodide.asm.wasm.gz"] = gzip.compress(made.pop("pyodide.asm.wasm"), 9, mtime=0)
    for archive, names in ARCHIVES.items():
        files = {}
        for name in names:
            files |= (new := wheel(name, theirs))
            texts[name] = licences(name, new)
        files = {path: data for path, data in files.items() if belongs(path, archive)}
        made[f"{archive}.zip"] = zipped(files)
        for module in {path.split("/")[0].removesuffix(".py") for path in files}:
            late.setdefault(module, []).append(archive)
    for name in sorted(NPM.keys() - {"pyodide"}):
        files = from_npm(name)
        made[f"{slug(name)}.js"], texts[name] = editor(files), licences(name, files)
    made["LICENCES.txt"] = ("\n\n" + "-" * 78 + "\n\n").join([*TEXTS, *texts.values()]).encode()
    folder = TO / "python"
    folder.mkdir(exist_ok=True)
    for name, data in made.items():
        (folder / name).write_bytes(data)
    hashes = {name: integrity(data, "sha256") for name, data in made.items()}
    manifest = json.dumps({"info": theirs["info"], "late": late, "hashes": hashes}, indent=0, sort_keys=True)
    (folder / "files.json").write_text(manifest, encoding="utf-8")
    print(f"live pages: {len(made)} files, {sum(map(len, made.values())) / 1e6:.1f} MB, in _build/live/python")


if __name__ == "__main__":
    main()
