"""What a user installs: NumPy and SciPy are enough, all else has an extra and says so; version, changelog, files."""

import ast
import datetime
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pdf
import pytest
import release
import yaml
from packaging.requirements import Requirement

import rlcore
from rlcore.core.extras import extra

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
NEEDS = [Requirement(text) for text in PROJECT["project"]["dependencies"]]
EXTRAS = {
    name: [Requirement(text) for text in needs]
    for name, needs in PROJECT["project"]["optional-dependencies"].items()
}  # fmt: skip
OTHER_NAMES = {"PIL": "pillow", "sklearn": "scikit-learn"}  # of the package that holds the module
COMES_WITH = {"cycler": "matplotlib", "matplotlib_inline": "ipykernel"}


# ---------------------------------------------------------------------- extras


def foreign_imports(path):
    """(line, package, extra or None) of each import of what is neither Python's, nor ours, nor always there."""
    always = sys.stdlib_module_names | {"rlcore"} | {need.name for need in NEEDS}

    def walk(node, within):
        match node:
            case ast.If(ast.Name("TYPE_CHECKING")):
                return
            case ast.With([ast.withitem(ast.Call(ast.Name("extra"), [ast.Constant(name)]))]):
                within = name
        for name in release.imported(ast.unparse(node)) if isinstance(node, ast.Import | ast.ImportFrom) else ():
            if name not in always:
                yield node.lineno, COMES_WITH.get(name, OTHER_NAMES.get(name, name)), within
        for child in ast.iter_child_nodes(node):
            yield from walk(child, within)

    return walk(ast.parse(path.read_text(encoding="utf-8")), None)


def test_every_package_that_is_imported_comes_with_the_extra_that_the_import_names():
    found = set()
    for path in sorted((ROOT / "rlcore").rglob("*.py")):
        for line, package, name in foreign_imports(path):
            where = f"{path.relative_to(ROOT)}:{line}: {package}"
            found.add(package)
            if name is not None:
                assert package in {need.name for need in EXTRAS[name]}, f"{where} is not in the extra {name}"
            elif path.parent.name != "plots":  # its style.py is imported first and asks for them
                # looked for before they are imported
                assert package in ("numba", "tqdm", "IPython"), (
                    f"{where} is in no `with extra(...)`"
                )  # looked for before
    brought = {need.name for needs in EXTRAS.values() for need in needs} - {"rlcore"}
    assert brought - found == {"mujoco", "distributed"}  # gymnasium loads the one, a cluster's executor is the other


BARE = f"""
import sys
from importlib.metadata import packages_distributions
for name in set(packages_distributions()) - {{"numpy", "scipy", "rlcore"}}:
    sys.modules[name] = None
{release.IMPORTS}
"""


def test_numpy_and_scipy_are_enough_for_all_but_what_names_its_extra():
    done = subprocess.run([sys.executable, "-c", BARE], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert release.unexpected(done.stdout) == []


def test_what_is_missing_is_named_with_its_extra_and_other_errors_stay_as_they_are():
    advice = r"^absent_package .* pip install 'rlcore\[gym\]'$"
    with pytest.raises(ModuleNotFoundError, match=advice) as caught, extra("gym"):
        import absent_package.inner  # noqa: F401
    assert caught.value.name == "absent_package"
    with pytest.raises(ImportError, match="cannot import name 'nowhere'"), extra("gym"):
        from sys import nowhere  # noqa: F401
    with pytest.raises(ValueError, match="^as it was$"), extra("gym"):
        raise ValueError("as it was")


def test_what_an_extra_asks_for_is_what_is_tested():
    lines = (ROOT / "requirements.txt").read_text(encoding="utf-8").splitlines()
    pins = [Requirement(line) for line in lines if "==" in line]
    pins = {pin.name: str(pin.specifier).removeprefix("==") for pin in pins}
    for need in NEEDS + sum(EXTRAS.values(), []):
        assert need.name == "rlcore" or need.specifier.contains(pins[need.name]), str(need)
    (everything,) = EXTRAS["all"]
    assert everything.name == "rlcore" and everything.extras == set(EXTRAS) - {"all"}
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^\| `(\w+)` \|", readme, re.M)) == set(EXTRAS)


# ---------------------------------------------------------------------- versions


def test_there_is_one_version():
    assert PROJECT["project"]["dynamic"] == ["version"] and "version" not in PROJECT["project"]
    assert rlcore.__version__ == release.version()
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    dated = re.search(rf"^## \[{re.escape(rlcore.__version__)}\] - (\S+)$", CHANGELOG, re.M)
    assert (citation["version"], str(citation["date-released"])) == (rlcore.__version__, dated[1])


CHANGELOG = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_the_changelog_keeps_its_form():
    first, *releases = re.findall(r"^## (.*)$", CHANGELOG, re.M)
    assert first == "[Unreleased]" and releases
    found = [re.fullmatch(r"\[(\d+)\.(\d+)\.(\d+)\] - (\d{4}-\d\d-\d\d)", line).groups() for line in releases]
    order = [(*map(int, numbers), datetime.date.fromisoformat(date)) for *numbers, date in found]
    assert order == sorted(order, reverse=True)
    assert set(re.findall(r"^### (.*)$", CHANGELOG, re.M)) <= {
        "Added", "Changed", "Deprecated", "Removed", "Fixed", "Security",
    }  # fmt: skip


# ---------------------------------------------------------------------- the script


def test_notes_are_those_of_one_version(tmp_path, monkeypatch):
    text = "# C\n\n## [Unreleased]\n\n- new\n\n## [1.2.0] - 2026-01-02\n\n- a\n- b\n\n## [1.1.0] - 2026-01-01\n\n- c\n"
    (tmp_path / "CHANGELOG.md").write_text(text, encoding="utf-8")
    monkeypatch.setattr(release, "ROOT", tmp_path)
    assert [release.notes(v) for v in ("1.2.0", "1.1.0", "1.0.0", "1.2")] == ["- a\n- b\n", "- c\n", None, None]


@pytest.mark.parametrize("tag", ["v0.0.1", rlcore.__version__, ""])
def test_a_tag_that_is_not_the_version_is_refused_before_anything_is_built(tag, monkeypatch):
    monkeypatch.setattr(release, "build", lambda work: pytest.fail("built"))
    with pytest.raises(release.Failed, match=f"^tag: got {tag};"):
        release.main(tag)


def test_a_version_without_a_dated_entry_is_not_released(monkeypatch):
    monkeypatch.setattr(release, "build", lambda work: pytest.fail("built"))
    monkeypatch.setattr(release, "version", lambda: "99.0.0")
    with pytest.raises(release.Failed, match="CHANGELOG.md"):
        release.main("v99.0.0")


def test_every_python_example_of_the_readme_is_found_and_can_be_compiled():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    found = list(release.examples(text))
    assert len(found) == text.count("```python") >= 4 and "study.py" in dict(found)
    for name, source in found:
        compile(source, name, "exec")
    assert [bool(release.imported(source) & release.CLUSTER) for _, source in found].count(False) >= 2


def test_imports_are_found_wherever_they_stand():
    source = "import a.b, c\nfrom d.e import f\ndef g():\n    from . import h\n    import i as j\n"
    assert release.imported(source) == {"a", "c", "d", "i"}


def test_unexpected_names_what_imports_too_much_and_what_no_longer_fails():
    fine = "rlcore.plots plots\nrlcore.plots.ch01 plots\nrlcore.envs.gym gym\nrlcore.losses deep\n"
    assert release.unexpected(fine) == []
    assert release.unexpected(fine.replace("gym gym", "gym plots")) == ["rlcore.envs.gym: plots"]
    assert release.unexpected(fine + "rlcore.dp plots\n") == ["rlcore.dp: plots"]
    assert release.unexpected(fine.replace("rlcore.losses deep\n", "")) == ["rlcore.losses imports without deep"]
    assert release.unexpected(fine + "rlcore.td ImportError('x y')\n") == ["rlcore.td: ImportError('x y')"]


@pytest.mark.parametrize(
    "stderr, wanted",
    [("ModuleNotFoundError: x is not installed, it comes with: pip install 'rlcore[plots]'", "rlcore[plots]"),
     ("ModuleNotFoundError: No module named 'gymnasium'", "rlcore[gym]"),
     ("ModuleNotFoundError: No module named 'torch.nn'", "rlcore[deep]"),
     ("ModuleNotFoundError: No module named 'unheard_of'", None),
     ("ValueError: gamma: got 2", None)],
)  # fmt: skip
def test_an_example_gets_the_extra_that_it_lacks(stderr, wanted):
    assert release.missing(stderr) == wanted


def test_an_example_that_fails_for_another_reason_or_goes_on_failing_is_reported(tmp_path):
    installed = []
    arguments = (sys.executable, installed.append, "example.py")
    assert release.try_example(*arguments, "print(1)\n", tmp_path) == "runs"
    with pytest.raises(release.Failed, match="ZeroDivisionError"):
        release.try_example(*arguments, "1 / 0\n", tmp_path)
    with pytest.raises(release.Failed, match="rlcore.gym"):
        release.try_example(*arguments, "raise SystemExit(\"pip install 'rlcore[gym]'\")\n", tmp_path)
    assert installed == ["rlcore[gym]"]
    assert "compiled only" in release.try_example(*arguments, "import dask_jobqueue\n", tmp_path)


def test_a_release_is_published_by_nothing_but_a_tag_after_all_tests():
    workflow = yaml.load((ROOT / ".github" / "workflows" / "release.yml").read_text(encoding="utf-8"), yaml.BaseLoader)
    assert workflow["on"] == {"push": {"tags": ["v*"]}}
    jobs = workflow["jobs"]
    assert set(jobs["publish"]["needs"]) == {"test", "build", "book"} == set(jobs) - {"publish"}
    assert [name for name, job in workflow["jobs"].items() if "permissions" in job] == ["publish"]
    commands = [step.get("run") for step in workflow["jobs"]["build"]["steps"]]
    assert 'python tests/release.py "$GITHUB_REF_NAME"' in commands
    (book,) = [step for step in jobs["book"]["steps"] if "make" in step.get("run", "")]
    assert book["run"] == 'make pdf epub bundle SIZES="A4 Letter" PYTHON=python'
    assert book["env"]["BOOK_RELEASE"] == "${{ github.ref_name }}"
    publish = jobs["publish"]["steps"][-1]["run"]
    assert "sha256sum" in publish and publish.index("SHA256SUMS") < publish.index("gh release create")


def test_the_site_offers_what_a_release_has():
    sys.path.insert(0, str(ROOT / "book" / "_ext"))
    from companion import downloads

    made = {f"{volume}-{size}.pdf" for volume in pdf.VOLUMES for size in pdf.SIZES} | {"book.epub", "site.zip"}
    assert set(downloads.FILES.values()) == made


def test_the_notes_say_how_to_cite(tmp_path, monkeypatch):
    (tmp_path / "CITATION.cff").write_text(
        'title: "A: B"\nauthors:\n  - name: "C"\ndate-released: 2026-01-02\n', encoding="utf-8"
    )
    monkeypatch.setattr(release, "ROOT", tmp_path)
    monkeypatch.setattr(release, "version", lambda: "1.2.0")
    assert release.citation() == "C: *A: B*, version 1.2.0, 2026-01-02."
