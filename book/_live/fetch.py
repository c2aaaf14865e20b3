"""Fetch what live pages run on, each file by its hash, and pack it: make live.

The hash in lock.json decides, the source does not matter. Tried in order: the folder that LIVE_FILES names, what was
fetched before, then Pyodide's own distribution and a wheel on PyPI that carries the same files; other packages come
from PyPI and npm. `python book/_live/fetch.py lock 314.0.3` writes lock.json anew.
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
from functools import cache
from pathlib import Path

HERE, ROOT = Path(__file__).parent, Path(__file__).parents[2]
TO = ROOT / "_build" / "live"
FILES = TO / "files"  # as they came
PYODIDE = "https://cdn.jsdelivr.net/pyodide/v{}/full/{}"
CARRIER = "open-webui==0.12.4", "open_webui/frontend/pyodide/"  # a wheel that carries Pyodide's files unchanged
CORE = ("pyodide.mjs", "pyodide.asm.mjs", "pyodide.asm.wasm", "python_stdlib.zip")
PLOTS = (
    "matplotlib",
    "contourpy",
    "cycler",
    "kiwisolver",
    "packaging",
    "pillow",
    "pyparsing",
    "python-dateutil",
    "six",
)
ARCHIVES = {  # what is loaded together, when one of its modules is first imported
    "numpy": ("numpy",),
    "plots": PLOTS,
    "scipy": ("scipy",),
    "scipy-more": ("scipy",),
    "gymnasium": ("gymnasium", "farama-notifications", "cloudpickle", "typing-extensions"),
}
NEEDED = re.compile(r"scipy[-.]|scipy/(sparse|linalg|special|_|constants|version|__)[^/]*|scipy/[^/]*\.(py|so)$")
PYPI = ("gymnasium", "farama-notifications", "cloudpickle", "typing-extensions")
NPM = (
    *(f"@codemirror/{name}" for name in ("state", "view", "commands", "language", "streamparser", "lang-python")),
    *("@codemirror/autocomplete", "@lezer/common", "@lezer/highlight", "@lezer/lr", "@lezer/python"),
    *("@marijn/find-cluster-break", "crelt", "style-mod", "w3c-keyname"),
)
LEFT_OUT = re.compile(  # tests, headers, stubs, sample data, toolkits of windows, fonts that no figure asks for
    r"(^|/)tests?/|\.(pyi|pxd|h|c|pyx)$|/include/|mpl-data/(sample_data|images|fonts/(afm|pdfcorefonts))/"
    r"|fonts/ttf/(STIX|cm|DejaVuSerif|DejaVuSans(Mono)?-BoldOblique)|dateutil/zoneinfo/.*gz|_tkagg|backends/(backend_(gtk|qt|wx|tk|web|nbagg|cairo|macosx)|qt_|_backend_tk)"
    r"|PIL/_(webp|avif|imagingtk)|gymnasium/envs/(mujoco|box2d)/|gymnasium/.*\.(png|ttf|xml)$"
)


def digest(data):
    return hashlib.sha256(data).hexdigest()


def run(*command, folder):
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout


def slug(name):
    return name.removeprefix("@").replace("/", "-")


@cache
def carrier():
    with tempfile.TemporaryDirectory() as folder:
        pip = (sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--only-binary", ":all:")
        run(*pip, CARRIER[0], folder=folder)
        (wheel,) = Path(folder).glob("*.whl")
        return zipfile.ZipFile(io.BytesIO(wheel.read_bytes()))


def from_pyodide(version, name):
    with urllib.request.urlopen(PYODIDE.format(version, name), timeout=10) as answer:
        return answer.read()


def from_carrier(version, name):
    return carrier().read(CARRIER[1] + name)


def from_pypi(requirement, name):
    with tempfile.TemporaryDirectory() as folder:
        run(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", requirement, folder=folder)
        return (Path(folder) / name).read_bytes()


@cache
def package(requirement):
    with tempfile.TemporaryDirectory() as folder:
        name = run("npm", "pack", "--silent", requirement, folder=folder).strip()
        return tarfile.open(fileobj=io.BytesIO((Path(folder) / name).read_bytes()))


def from_npm(requirement, name):
    tar = package(requirement)
    about = json.load(tar.extractfile("package/package.json"))
    main = about["exports"]["import"] if isinstance(about.get("exports"), dict) else about["module"]
    licence = next(part for part in tar.getnames() if re.fullmatch(r"package/LICEN[CS]E(\.\w+)?", part))
    return tar.extractfile(
        "package/" + (main if name.endswith(".js") else licence.split("/")[1]).removeprefix("./")
    ).read()


SOURCES = {"pyodide": (from_pyodide, from_carrier), "pypi": (from_pypi,), "npm": (from_npm,)}


def get(name, entry):
    """The bytes of one file of the lock, whose hash is right."""
    folders = [Path(os.environ["LIVE_FILES"])] if os.environ.get("LIVE_FILES") else []
    tried, (kind, _, what) = [], entry["from"].partition(" ")
    ways = [(str(folder), (folder / name).read_bytes) for folder in (*folders, FILES) if (folder / name).is_file()]
    ways += [(way.__name__.replace("_", " "), lambda way=way: way(what, name)) for way in SOURCES[kind]]
    for source, read in ways:
        try:
            data = read()
        except Exception as error:
            tried.append(f"{source}: {type(error).__name__}")
        else:
            if digest(data) == entry["sha256"]:
                return data
            tried.append(f"{source}: another file, by its hash")
    raise SystemExit(f"{name}: not to be had ({'; '.join(tried)}); lock.json names {entry['from']}")


def wheels(lock, *packages):
    for name in packages:
        for file in lock["files"]:
            if file.endswith(".whl") and file.lower().startswith(name.replace("-", "_") + "-"):
                yield file


def belongs(archive, path):
    if LEFT_OUT.search(path) or path.endswith("/"):
        return False
    return not archive.startswith("scipy") or bool(NEEDED.match(path)) == (archive == "scipy")


def pack(archive, files):
    """One archive of some wheels, the same bytes each time; and the names of the modules in it."""
    out, names = io.BytesIO(), set()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as new:
        for file in files:
            old = zipfile.ZipFile(FILES / file)
            for path in sorted(filter(lambda p: belongs(archive, p), old.namelist())):
                new.writestr(zipfile.ZipInfo(path, (1980, 1, 1, 0, 0, 0)), old.read(path), zipfile.ZIP_DEFLATED, 9)
                parts = path.removesuffix(".py").split("/")[: 2 if archive == "scipy-more" else 1]
                if not re.search(r"\.(dist-info|libs|so|pth)$", parts[0]) and len(parts) == 1 + (
                    archive == "scipy-more"
                ):
                    names.add(".".join(parts))
    return out.getvalue(), sorted(names)


def licences(lock):
    """The licence of everything that goes to the reader, in one text."""
    parts = [
        "Pyodide, MPL-2.0: https://mozilla.org/MPL/2.0/, its source: https://github.com/pyodide/pyodide\n"
        "CPython, PSF licence: https://docs.python.org/3/license.html"
    ]
    for file in lock["files"]:
        if file.endswith(".whl"):
            wheel = zipfile.ZipFile(FILES / file)
            found = [n for n in wheel.namelist() if re.search(r"dist-info/(licenses/)?[^/]*(LICEN|COPYING)[^/]*$", n)]
            parts += [f"{file}\n\n" + "\n\n".join(wheel.read(n).decode("utf-8", "replace") for n in found)]
        elif file.endswith(".licence"):
            parts += [f"{file.removesuffix('.licence')}\n\n" + (FILES / file).read_text(encoding="utf-8")]
    return ("\n\n" + "-" * 78 + "\n\n").join(parts)


def main():
    lock = json.loads((HERE / "lock.json").read_text(encoding="utf-8"))
    for name, entry in lock["files"].items():
        data = get(name, entry)
        FILES.mkdir(parents=True, exist_ok=True)
        (FILES / name).write_bytes(data)
    made, late = {}, {}
    for archive, packages in ARCHIVES.items():
        made[f"{archive}.zip"], names = pack(archive, wheels(lock, *packages))
        late |= dict.fromkeys(names, archive)
    for name in CORE:
        data = (FILES / name).read_bytes()
        made[name + ".gz" * name.endswith(".wasm")] = (
            gzip.compress(data, 9, mtime=0) if name.endswith(".wasm") else data
        )
    for name in NPM:
        text = (FILES / f"{slug(name)}.js").read_text(encoding="utf-8")
        made[f"{slug(name)}.js"] = re.sub(
            r"""(\bfrom\s*)['"](@?[a-z][^'"]*)['"]""", lambda m: f'{m[1]}"./{slug(m[2])}.js"', text
        ).encode()
    made["LICENCES.txt"] = licences(lock).encode()
    folder = TO / "python"
    folder.mkdir(exist_ok=True)
    for name, data in made.items():
        (folder / name).write_bytes(data)
    manifest = {"info": lock["info"], "late": late, "sha256": {name: digest(data) for name, data in made.items()}}
    (folder / "files.json").write_text(json.dumps(manifest, indent=0, sort_keys=True), encoding="utf-8")
    print(f"live pages: {len(made)} files, {sum(map(len, made.values())) / 1e6:.1f} MB, in _build/live/python")


def lock(version):
    """Write lock.json for a version of Pyodide and the newest of everything else."""
    theirs = json.load(package(f"pyodide@{version}").extractfile("package/pyodide-lock.json"))
    files = {}
    for name in CORE:
        data = package(f"pyodide@{version}").extractfile(f"package/{name}").read()
        files[name] = {"from": f"pyodide {version}", "sha256": digest(data)}
    for name in sorted({name for names in ARCHIVES.values() for name in names} - set(PYPI)):
        files[theirs["packages"][name]["file_name"]] = {
            "from": f"pyodide {version}",
            "sha256": theirs["packages"][name]["sha256"],
        }
    for requirement in (line.split(" ")[0] for line in (ROOT / "requirements.lock").read_text().splitlines()):
        if requirement.split("==")[0] in PYPI:
            with tempfile.TemporaryDirectory() as folder:
                run(sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", requirement, folder=folder)
                (wheel,) = Path(folder).glob("*.whl")
                files[wheel.name] = {"from": f"pypi {requirement}", "sha256": digest(wheel.read_bytes())}
    for name in NPM:
        about = json.loads(run("npm", "view", "--json", name, "version", folder=HERE))
        for kind in ("js", "licence"):
            file = f"{slug(name)}.{kind}"
            files[file] = {"from": f"npm {name}@{about}", "sha256": digest(from_npm(f"{name}@{about}", file))}
    text = json.dumps({"pyodide": version, "info": theirs["info"], "files": files}, indent=1)
    (HERE / "lock.json").write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    lock(sys.argv[2]) if sys.argv[1:2] == ["lock"] else main()
