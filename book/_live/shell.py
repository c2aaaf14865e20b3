"""Runs a page's cells in the browser: what a cell prints, shows and raises goes to `tell` as it comes."""

import ast
import importlib
import io
import json
import linecache
import os
import sys
import sysconfig
import time
import traceback
import zipfile
from base64 import b64encode
from contextlib import redirect_stderr, redirect_stdout
from hashlib import sha256
from importlib.machinery import PathFinder
from types import SimpleNamespace

from needs import analyse

SITE = sysconfig.get_path("purelib")
PRINTED = 200_000  # characters of one cell that are shown

if sys.platform == "emscripten":  # gymnasium imports multiprocessing, which has no C half here
    os.environ["MPLBACKEND"] = "agg"
    sys.modules["_multiprocessing"] = SimpleNamespace(SemLock=SimpleNamespace(SEM_VALUE_MAX=1), sem_unlink=None)


class Late:
    """The last to be asked for a module: fetches the archive of packages that has it."""

    def __init__(self, late, hashes, fetch):
        self.late, self.hashes, self.fetch, self.have = late, hashes, fetch, set()

    def find_spec(self, name, path=None, target=None):
        for archive in self.late.get(name.split(".")[0], ()):
            if archive not in self.have:
                self.unpack(archive)
                if spec := PathFinder.find_spec(name, path):
                    return spec
        return None

    def unpack(self, archive):
        data = self.fetch(f"{archive}.zip")
        if "sha256-" + b64encode(sha256(data).digest()).decode() != self.hashes[f"{archive}.zip"]:
            raise ImportError(f"the file {archive}.zip is not the one that this book names")
        zipfile.ZipFile(io.BytesIO(data)).extractall(SITE)
        self.have.add(archive)
        importlib.invalidate_caches()


class Stream(io.TextIOBase):
    """What a cell prints, cut where it is too much."""

    def __init__(self, name, shell):
        self.name, self.shell, self.left = name, shell, PRINTED

    def write(self, text):
        if self.left > 0:
            more = "\n... more is not shown\n" if len(text) > self.left else ""
            self.shell.put(self.name, text[: self.left] + more)
            self.left -= len(text)
        return len(text)

    def flush(self):
        self.shell.flush()


def bundle(value):
    """A value as what a page can show: MIME type -> text."""
    if isinstance(value, getattr(sys.modules.get("matplotlib.figure"), "Figure", ())):
        out = io.BytesIO()
        value.savefig(out, format="png", dpi=2 * value.dpi)
        return {"text/plain": repr(value), "image/png": b64encode(out.getvalue()).decode()}
    made, pretty = type(value), []
    if hasattr(made, "_repr_mimebundle_"):
        return {kind: text for kind, text in value._repr_mimebundle_().items() if "widget" not in kind}
    if hasattr(made, "_repr_pretty_"):
        value._repr_pretty_(SimpleNamespace(text=pretty.append), False)
    data = {"text/plain": "".join(pretty) or repr(value)}
    if hasattr(made, "_repr_html_"):
        data["text/html"] = value._repr_html_()
    if hasattr(made, "_repr_png_"):
        data["image/png"] = b64encode(value._repr_png_()).decode()
    return data


class Shell:
    """The cells of one page: what each has made, so that the order of clicks changes nothing."""

    def __init__(self, tell):
        self.tell = tell
        self.made = {}  # cell -> (source, what it bound)
        self.stamp, self.count = {}, 0  # cell -> when it last ran
        self.touched = {}  # cell -> the cells that since changed in place what it made
        self.stream, self.parts, self.sent = "", [], 0.0  # printed and not yet sent

    def put(self, name, text):
        """Send what is printed, ten times a second at most, so that a loop that prints does not stop the page."""
        if name != self.stream:
            self.flush()
        self.stream = name
        self.parts.append(text)
        if time.monotonic() > self.sent + 0.1:
            self.flush()

    def flush(self):
        if self.parts:
            self.tell(json.dumps({"type": "stream", "name": self.stream, "text": "".join(self.parts)}))
            self.parts, self.sent = [], time.monotonic()

    def emit(self, output):
        self.flush()
        self.tell(json.dumps(output))

    def show(self, value):
        if value is not None:
            self.emit({"type": "display", "data": bundle(value)})

    def plan(self, sources, n):
        """Cells to run, in order, so that cell n finds what it would find in the notebook; n is the last."""
        needs, changed = analyse(sources)
        stale, more = set(), {n}

        def fresh(i):
            touching = [j for j in needs[n] if i in changed[j]]
            return (
                i in self.made
                and self.made[i][0] == sources[i]
                and self.touched[i] == touching
                and not stale & {*needs[i], *touching}
                and all(self.stamp[j] < self.stamp[i] for j in needs[i])
            )

        while more - stale:
            stale |= more
            more = {i for i in needs[n] if not fresh(i)}
        return [i for i in (*needs[n], n) if i in stale]

    def run(self, sources, n):
        """Run one cell of a plan; whether it ended well."""
        needs, changed = analyse(sources)
        names = {"__name__": "__main__", "display": lambda *values: [self.show(value) for value in values]}
        for i in needs[n]:
            names.update(self.made[i][1])
        before = dict(names)
        well = self.execute(sources[n], f"<cell {n + 1}>", names)
        self.count += 1
        mine = {key: value for key, value in names.items() if key not in before or before[key] is not value}
        self.made[n], self.stamp[n], self.touched[n] = (sources[n], mine), self.count, []
        for i in changed[n]:
            self.touched[i].append(n)
        if not well:
            self.made.pop(n)
        return well

    def execute(self, source, name, names):
        linecache.cache[name] = (len(source), None, source.splitlines(True), name)
        with redirect_stdout(Stream("stdout", self)), redirect_stderr(Stream("stderr", self)):
            try:
                tree = ast.parse(source, name)
                last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
                exec(compile(tree, name, "exec"), names)
                if last:
                    self.show(eval(compile(ast.Expression(last.value), name, "eval"), names))
                self.figures()
                return True
            except BaseException as error:
                trace = error.__traceback__
                while trace and trace.tb_frame.f_code.co_filename == __file__:
                    trace = trace.tb_next
                self.emit({"type": "error", "text": "".join(traceback.format_exception(type(error), error, trace))})
                return False
            finally:
                self.flush()

    def figures(self):
        plt = sys.modules.get("matplotlib.pyplot")
        for number in plt.get_fignums() if plt else ():
            self.show(plt.figure(number))
            plt.close(number)
