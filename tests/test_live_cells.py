"""Live pages without a browser: which cells a cell builds on, what a run shows, what is refused by its hash."""

import itertools
import json
import re
import subprocess
import sys
import zipfile
from hashlib import sha256

import pytest
from conftest import ROOT

sys.path.insert(0, str(ROOT / "book" / "_live"))
import fetch  # noqa: E402
import live  # noqa: E402
import needs  # noqa: E402
import shell  # noqa: E402

NOTEBOOKS = sorted(ROOT.glob("book/0*.ipynb"))


NEEDS = [  # cells; what the last of them needs
    (["a = 1", "b = 2", "print(a)"], [0]),
    (["a = 1", "a = 2", "print(a)"], [1]),  # the last that binds it
    (["a = []", "a.append(1)", "print(a)"], [0, 1]),  # and what changes it
    (["a = [1]", "a[0] = 2", "b = a"], [0, 1]),
    (["a = 1", "a += 1", "print(a)"], [0, 1]),
    (["a = 1", "a = a + 1", "print(a)"], [0, 1]),
    (["a = [2, 1]", "print(a)", "print(a)"], [0]),  # to print changes nothing
    (["net = make()", "train(net)", "print(net)"], [0, 1]),  # a call for its effect does
    (["net = make()", "net.step()", "print(net)"], [0, 1]),
    (["net = make()", "net.w.x[2] = 1", "print(net)"], [0, 1]),
    (["rng = default_rng(0)", "rng.normal()", "x = rng.normal()"], [0, 1]),  # every use of a generator
    (["rng, n = np.random.default_rng(0), 3", "x = f(rng)", "y = f(rng)"], [0, 1]),
    (["import numpy as np", "f = lambda x: np.sin(x)", "print(f(1))"], [0, 1]),  # what its function reads, too
    (["a = 1", "def f():\n    return a", "f()"], [0, 1]),
    (["a = 1", "def f(a):\n    return a", "f(2)"], [1]),
    (["x = 1", "y = 2", "print([x for x in range(3)], y)"], [1]),
    (["x = 1", "x = 2\nprint(x)", "y = 3"], []),
    (["u = 1", "w = 2", "for u in range(w):\n    v = u\n    print(u, v)"], [1]),
    (["u = 1", "for i in range(2):\n    print(u)\n    u = i"], [0]),
    (["u = 1", "with open('x') as u:\n    print(u)"], []),
    (["u = 1", "if input():\n    u = 2\nprint(u)"], [0]),
    (["import numpy as np", "f(np.x)", "np.seed = 3", "print(np)"], [0]),  # modules are taken to stay as they are
    (["A = 1", "B = (", "print(B)"], [1]),  # in error: it binds what it seems to
    (["def g(:\n    pass", "g()", "g()"], [0]),
    (["k = 1", "v = [2]", "print([k for k in v], {k for k in v}, {k: j for k, j in zip(v, v)})"], [1]),
    (["k = 1", "v = [[2]]", "print([[j + k for j in k] for k in v])"], [1]),
    (["k = 1", "v = [2]", "for k in v:\n    class A:\n        k = v\n        def f(self):\n            return w"], [1]),
    (["w = 1", "k = 2", "class A:\n    k = 3\n    j = k\n    def f(self):\n        return w"], [0]),
    (["u = 1", "del u"], [0]),
    (["u = 1", "return u\nv = 2", "v"], [1]),
]


@pytest.mark.parametrize(("sources", "needed"), NEEDS)
def test_a_cell_needs_what_made_and_changed_its_names(sources, needed):
    assert needs.analyse(sources)[0][-1] == needed


class Page:
    def __init__(self, *sources):
        self.sources, self.outputs = list(sources), []
        self.shell = shell.Shell(lambda text: self.outputs.append(json.loads(text)))

    def click(self, n):
        """The cells that ran, and what the last printed."""
        plan = self.shell.plan(self.sources, n)
        for cell in plan:
            self.outputs.clear()
            if not self.shell.run(self.sources, cell):
                break
        return plan, "".join(output.get("text", "") for output in self.outputs)


def test_what_is_there_is_not_made_again():
    page = Page("a = 1", "b = a + 1", "print(b)")
    assert page.click(2) == ([0, 1, 2], "2\n")
    assert page.click(2) == ([2], "2\n")
    page.sources[0] = "a = 5"
    assert page.click(2) == ([0, 1, 2], "6\n")
    page.sources[1] = "b = 7"
    assert page.click(2) == ([1, 2], "7\n")


def test_the_order_of_clicks_changes_no_result():
    page = Page("rng = default_rng(0)", "x = rng.integers(1000)\nprint(x)", "y = rng.integers(1000)\nprint(y)")
    page.sources[0] = "from numpy.random import default_rng\n" + page.sources[0]
    first, second = page.click(1)[1], page.click(2)[1]
    assert first != second
    for n in (2, 1, 1, 2, 2, 1):
        assert page.click(n)[1] == (first if n == 1 else second)


def test_a_list_that_a_cell_extends_is_made_anew():
    page = Page("a = [0]", "a.append(1)\nprint(a)", "a.append(2)\nprint(a)")
    for n in (2, 1, 2, 2, 1):
        assert page.click(n)[1] == ("[0, 1]\n" if n == 1 else "[0, 1, 2]\n")


def test_a_name_bound_twice_is_what_it_is_above():
    page = Page("a = 1", "print(a)", "a = 2", "print(a)")
    assert [page.click(n)[1] for n in (3, 1, 3, 1)] == ["2\n", "1\n", "2\n", "1\n"]


def test_a_cell_in_error_runs_again():
    page = Page("a = 1 / 0", "print(a)")
    plan, said = page.click(1)
    assert plan == [0, 1] and said.startswith("Traceback") and "<cell 1>" in said and "shell.py" not in said
    page.sources[0] = "a = 1"
    assert page.click(1) == ([0, 1], "1\n")


def test_what_a_cell_shows():
    page = Page("import sys\nprint('out')\nprint('err', file=sys.stderr)\n{'a': 1}", "None", "display(1)\n2")
    page.click(0)
    kinds = [output.get("name", output["type"]) for output in page.outputs]
    assert [kind for kind, _ in itertools.groupby(kinds)] == ["stdout", "stderr", "display"]
    assert page.outputs[-1]["data"] == {"text/plain": "{'a': 1}"}
    page.click(1)
    assert page.outputs == []
    page.click(2)
    assert [o["data"]["text/plain"] for o in page.outputs] == ["1", "2"]


def test_a_verdict_and_an_explorer_show_themselves():
    page = Page(
        "from rlcore.exercises import check\ncheck('ch04-edge-by-hand', ...)",
        "from rlcore.explore import explore\nfrom rlcore import plots\n"
        "import matplotlib.pyplot as plt\nexplore(lambda n: plt.figure(), title='T', n=[1, 2])",
        "import matplotlib.pyplot as plt\nfig, ax = plt.subplots()",
    )
    page.click(0)
    assert page.outputs[0]["data"]["text/plain"].startswith("not attempted")
    page.click(1)
    assert 'class="explore"' in page.outputs[0]["data"]["text/html"]
    assert not any("widget" in kind for kind in page.outputs[0]["data"])
    page.click(2)
    assert [sorted(o["data"]) for o in page.outputs] == [["image/png", "text/plain"]]


def test_endless_printing_is_cut():
    page = Page("for i in range(100_000):\n    print('x' * 10)")
    said = page.click(0)[1]
    assert shell.PRINTED < len(said) < shell.PRINTED + 100 and said.endswith("... more is not shown\n")
    assert len(page.outputs) < 1000


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.name)
def test_every_name_that_a_cell_reads_is_made_above(path):
    """So that no click can end in a NameError."""
    cells = [c for c in json.loads(path.read_text(encoding="utf-8"))["cells"] if c["cell_type"] == "code"]
    sources, made = ["".join(cell["source"]) for cell in cells], set()
    for source in sources:
        read, bound, *_ = needs.facts(source)
        assert read <= made | bound | {"display"}, source
        made |= bound


def test_a_package_is_fetched_when_it_is_first_imported(tmp_path, monkeypatch):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as file:
        file.writestr("mine_of_old/__init__.py", "value = 3")
    data, asked = (tmp_path / "a.zip").read_bytes(), []
    monkeypatch.setattr(shell, "SITE", str(tmp_path / "site"))
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    right, wrong = {"a.zip": fetch.integrity(data, "sha256")}, {"a.zip": "0" * 64}
    found = shell.Late({"mine_of_old": ["a"]}, right, lambda name: asked.append(name) or data)
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, found])
    import json.tool  # noqa: F401

    assert asked == []
    import mine_of_old

    assert mine_of_old.value == 3 and asked == ["a.zip"]
    with pytest.raises(ModuleNotFoundError):
        import mine_of_old.more  # noqa: F401
    assert asked == ["a.zip"]
    with pytest.raises(ImportError, match=r"the file a\.zip is not the one that this book names"):
        shell.Late({"x": ["a"]}, wrong, lambda name: data).find_spec("x")


def test_the_rest_of_a_package_is_fetched_when_it_is_asked_for(tmp_path, monkeypatch):
    data = {"a.zip": {"of_two/__init__.py": b"", "of_two/near.py": b""}, "b.zip": {"of_two/far.py": b"value = 4"}}
    data, asked = {name: fetch.zipped(files) for name, files in data.items()}, []
    hashes = {name: fetch.integrity(archive, "sha256") for name, archive in data.items()}
    monkeypatch.setattr(shell, "SITE", str(tmp_path))
    monkeypatch.syspath_prepend(str(tmp_path))
    found = shell.Late({"of_two": ["a", "b"]}, hashes, lambda name: asked.append(name) or data[name])
    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, found])
    import of_two.near  # noqa: F401

    assert asked == ["a.zip"]
    from of_two.far import value

    assert value == 4 and asked == ["a.zip", "b.zip"]


def test_a_file_counts_by_its_hash_wherever_it_comes_from(tmp_path, monkeypatch):
    hashes, right = [sha256(b"right").hexdigest()], {"here": lambda: b"wrong", "there": lambda: b"right"}
    monkeypatch.setattr(fetch, "FILES", tmp_path / "before")
    monkeypatch.delenv("LIVE_FILES", raising=False)
    with pytest.raises(SystemExit, match=r"a\.zip: not to be had \(here: another file, by its hash; .*ZeroDivision"):
        fetch.get("a.zip", hashes, {"here": lambda: b"wrong", "there": lambda: 1 / 0})
    assert fetch.get("a.zip", ["0" * 64, *hashes], right) == b"right"
    assert fetch.get("a.zip", hashes, {}) == b"right"  # kept
    (tmp_path / "before" / "a.zip").write_bytes(b"wrong")
    with pytest.raises(SystemExit, match=r"before: another file, by its hash\)"):
        fetch.get("a.zip", hashes, {})
    monkeypatch.setenv("LIVE_FILES", str(tmp_path / "mine"))
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "a.zip").write_bytes(b"right")
    assert fetch.get("a.zip", hashes, {}) == b"right"
    assert fetch.get("a.zip", [fetch.integrity(b"right", "sha512")], {}) == b"right"


def test_every_file_that_is_packed_has_its_hash_in_a_lock():
    assert all(entry["integrity"].startswith("sha512-") for entry in fetch.NPM.values())
    needed = {name for entry in fetch.NPM.values() for name in entry.get("dependencies", {})}
    assert needed - fetch.NPM.keys() == {"ws", "@types/emscripten"}
    for name in fetch.PYPI:
        requirement, hashes = fetch.pinned(name)
        assert requirement.startswith(f"{name}==") and hashes and all(len(digest) == 64 for digest in hashes)
    modules = re.findall(r"\./python/([\w-]+)\.js", (ROOT / "book" / "_live" / "live.js").read_text(encoding="utf-8"))
    assert modules and set(modules) <= {fetch.slug(name) for name in fetch.NPM}


def test_a_package_of_npm_finds_its_neighbours_beside_it():
    files = {
        "package.json": b'{"exports": {"import": "./dist/index.js", "require": "./dist/index.cjs"}}',
        "dist/index.js": b"import { a } from '@lezer/common';\nimport b from \"crelt\";\nimport c from './own.js';\n",
        "LICENSE": b"to be kept",
    }
    assert fetch.editor(files).decode().splitlines() == [
        'import { a } from "./lezer-common.js";',
        'import b from "./crelt.js";',
        "import c from './own.js';",
    ]
    assert fetch.licences("some", files) == "some\n\nto be kept"


def test_tests_stay_at_home_and_scipy_is_sent_in_two_parts():
    paths = ["scipy/__init__.py", "scipy/special/__init__.py", "scipy/stats/__init__.py", "scipy/stats/tests/a.py"]
    assert [path for path in paths if fetch.belongs(path, "scipy")] == paths[:2]
    assert [path for path in paths if fetch.belongs(path, "scipy-more")] == paths[2:3]
    assert fetch.belongs("numpy/core.py", "numpy") and not fetch.belongs("numpy/tests/test_core.py", "numpy")


def test_the_book_without_live_files_says_what_to_do(tmp_path):
    code = "import live, pathlib; live.FETCHED = pathlib.Path('nowhere'); "
    code += "live.prepare(None, type('Config', (), {'live': 'yes'}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT / "book" / "_live", capture_output=True, text=True)
    assert "run `make live`" in done.stderr


def test_the_seconds_are_those_of_cells_that_are_there():
    """A slow cell that was changed without being measured again would be offered as a quick one."""
    known = json.loads((ROOT / "book" / "_live" / "seconds.json").read_text(encoding="utf-8"))
    sources = [
        "".join(cell["source"])
        for path in NOTEBOOKS
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]
        if cell["cell_type"] == "code"
    ]
    assert set(known) <= {live.digest(source) for source in sources}
