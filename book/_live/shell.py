"""Runs a page's cells in the browser: what a cell prints, shows and raises goes to `tell` as it comes."""

import ast
import base64
import hashlib
import importlib
import io
import json
import linecache
import os
import sys
import time
import traceback
import types
import zipfile

from needs import analyse

SITE = next((path for path in sys.path if path.endswith("site-packages")), "")
HERE = (lambda: 0).__code__.co_filename
PRINTED = 200_000  # characters of one cell that are shown
SHOWN = ("_repr_html_", "text/html"), ("_repr_svg_", "image/svg+xml"), ("_repr_png_", "image/png")

if sys.platform == "emscripten":  # gymnasium imports multiprocessing, which has no C half here
    os.environ["MPLBACKEND"] = "agg"
    stub = types.ModuleType("_multiprocessing")
    stub.SemLock, stub.sem_unlink, stub.flags = type("SemLock", (), {"SEM_VALUE_MAX": 1}), None, {}
    sys.modules.setdefault("_multiprocessing", stub)


class Late:
    """Archives of packages that are fetched when one of their modules is first imported."""

    def __init__(self, late, sha256, fetch):
        self.late, self.sha256, self.fetch, self.have = late, sha256, fetch, set()

    def find_spec(self, name, path=None, target=None):
        archive = self.late.get(".".join(name.split(".")[:2])) or self.late.get(name.split(".")[0])
        if archive and archive not in self.have:
            self.unpack(archive, self.fetch(f"{archive}.zip"))
        return None

    def unpack(self, archive, data):
        if hashlib.sha256(data).hexdigest() != self.sha256[f"{archive}.zip"]:
            raise ImportError(f"the file {archive}.zip is not the one that this book names")
        zipfile.ZipFile(io.BytesIO(data)).extractall(SITE)
        self.have.add(archive)
        importlib.invalidate_caches()


class Stream(io.TextIOBase):
    """What a cell prints: sent ten times a second at most, so that a loop that prints does not stop the page."""

    def __init__(self, name, shell):
        self.name, self.shell, self.parts, self.sent, self.left = name, shell, [], 0.0, PRINTED

    def write(self, text):
        text, other = str(text), sys.stderr if self is sys.stdout else sys.stdout
        other.flush()  # what was printed before comes before
        if self.left > 0:
            more = "\n... more is not shown\n" if len(text) > self.left else ""
            self.parts.append(text[: self.left] + more)
            self.left -= len(text)
        if time.monotonic() > self.sent + 0.1:
            self.flush()
        return len(text)

    def flush(self):
        if self.parts:
            self.shell.tell(json.dumps({"type": "stream", "name": self.name, "text": "".join(self.parts)}))
            self.parts, self.sent = [], time.monotonic()

    def writable(self):
        return True


class Printer:
    """What _repr_pretty_ asks for."""

    def __init__(self):
        self.parts = []

    def text(self, text):
        self.parts.append(text)


def bundle(value):
    """A value as what a page can show: MIME type -> text."""
    if "matplotlib.figure" in sys.modules and isinstance(value, sys.modules["matplotlib.figure"].Figure):
        return {"text/plain": repr(value), "image/png": png(value)}
    if hasattr(value, "_repr_mimebundle_"):
        return {kind: text for kind, text in value._repr_mimebundle_().items() if "widget" not in kind}
    printer = Printer()
    if hasattr(value, "_repr_pretty_"):
        value._repr_pretty_(printer, False)
    data = {"text/plain": "".join(printer.parts) or repr(value)}
    for method, kind in SHOWN:
        made = getattr(value, method, lambda: None)()
        if made is not None:
            data[kind] = base64.b64encode(made).decode() if isinstance(made, bytes) else made
    return data


def png(figure):
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=2 * figure.dpi)
    return base64.b64encode(out.getvalue()).decode()


class Shell:
    """The cells of one page: what each has made, so that the order of clicks changes nothing."""

    def __init__(self, tell):
        self.tell = tell
        self.made = {}  # cell -> (source, what it bound)
        self.stamp, self.count = {}, 0  # cell -> when it last ran
        self.touched = {}  # cell -> the cells that since changed in place what it made

    def emit(self, output):
        for stream in (sys.stdout, sys.stderr):
            stream.flush()
        self.tell(json.dumps(output))

    def plan(self, sources, n):
        """Cells to run, in order, so that cell n finds what it would find in the notebook; n is the last."""
        needs, changed = analyse(sources)
        chain, stale = [*needs[n], n], {n}
        while True:
            more = set()
            for i in needs[n]:
                touching = [j for j in needs[n] if i in changed[j]]
                fresh = (
                    self.made.get(i, ("",))[0] == sources[i]
                    and self.touched.get(i, []) == touching
                    and not stale & {*needs[i], *touching}
                    and all(self.stamp[j] < self.stamp[i] for j in needs[i])
                )
                if not fresh:
                    more.add(i)
            if more <= stale:
                return [i for i in chain if i in stale]
            stale |= more

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

    def show(self, value):
        if value is not None:
            self.emit({"type": "display", "data": bundle(value)})

    def execute(self, source, name, names):
        linecache.cache[name] = (len(source), None, source.splitlines(True), name)
        out, err = sys.stdout, sys.stderr
        sys.stdout, sys.stderr = Stream("stdout", self), Stream("stderr", self)
        try:
            tree = ast.parse(source, name)
            last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
            exec(compile(tree, name, "exec"), names)
            if last is not None:
                self.show(eval(compile(ast.Expression(last.value), name, "eval"), names))
            self.figures()
        except BaseException as error:
            trace = error.__traceback__
            while trace and trace.tb_frame.f_code.co_filename == HERE:
                trace = trace.tb_next
            self.emit({"type": "error", "text": "".join(traceback.format_exception(type(error), error, trace))})
            return False
        finally:
            for stream in (sys.stdout, sys.stderr):
                stream.flush()
            sys.stdout, sys.stderr = out, err
        return True

    def figures(self):
        plt = sys.modules.get("matplotlib.pyplot")
        for number in plt.get_fignums() if plt else ():
            self.show(plt.figure(number))
            plt.close(number)
