"""The command that checks notebooks: what is missing, broken, hostile, and a class."""

import base64
import json
import pickle
from xml.etree import ElementTree

import nbformat
import pytest

from rlcore.exercises import CHAPTERS, EXERCISES, own
from rlcore.exercises.__main__ import _checked, junit, main, results, summary, table
from rlcore.exercises.notebook import build, write
from rlcore.exercises.sandbox import pack

ONE = {"ch01_mdp": CHAPTERS["ch01_mdp"]}
IDS = [id for id in EXERCISES if id.startswith("ch01-")]


def notebook(path, change=lambda cells: cells, kernel="python3"):
    content = build(CHAPTERS["ch01_mdp"])
    content["cells"] = change(content["cells"])
    content["metadata"]["kernelspec"]["name"] = kernel
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def without(id):
    return lambda cells: [cell for cell in cells if f'check("{id}"' not in "".join(cell["source"])]


def statuses(rows):
    return {id: status for _, id, status, _ in rows}


@pytest.mark.long
def test_a_deleted_check_is_missing_and_what_never_ends_costs_what_follows_only(tmp_path):
    def change(cells):
        cells = without("ch01-predict-pole")(cells)
        stop = next(i for i, c in enumerate(cells) if 'check("ch01-build-ferry"' in "".join(c["source"]))
        cells[stop - 1] = {**cells[stop - 1], "source": ["while True: pass"]}
        return cells

    rows = results(notebook(tmp_path / "01_mdp.ipynb", change), timeout=10)
    found = statuses(rows)
    assert list(found) == IDS and found["ch01-predict-pole"] == "missing"
    assert found["ch01-return-by-hand"] == "not attempted" and found["ch01-build-ferry"] == "error"
    assert sum("did not run to its end" in message for *_, message in rows) == 1


def test_a_notebook_without_code_is_missing_its_checks(tmp_path):
    rows = results(notebook(tmp_path / "01_mdp.ipynb", lambda cells: cells[:1]))
    assert statuses(rows) == dict.fromkeys(IDS, "missing")
    assert [row[2] for row in results(notebook(tmp_path / "mine.ipynb", lambda cells: cells[:1]))] == ["missing"]


@pytest.mark.parametrize("text", ["{", "[]", "", '{"cells": 1, "nbformat": 4, "nbformat_minor": 5, "metadata": {}}'])
def test_what_is_no_notebook_costs_one_row(tmp_path, text, capsys):
    path = tmp_path / "01_mdp.ipynb"
    path.write_text(text)
    junit_file = tmp_path / "out.xml"
    assert main([str(path), "--junit", str(junit_file)]) == 1
    assert "0 passed, 0 failed, 1 error" in capsys.readouterr().out
    assert ElementTree.parse(junit_file).getroot().attrib["errors"] == "1"


def test_an_unknown_kernel_is_said_once(tmp_path):
    rows = results(notebook(tmp_path / "01_mdp.ipynb", kernel="nothing"))
    assert set(statuses(rows)) == set(IDS) and sum("nothing" in message.lower() for *_, message in rows) == 1


def test_the_junit_file_is_well_formed_for_any_message(tmp_path):
    messages = ["\x00\x1b[31mred\x08", "\ud800", "", "\n", "<&]]>", "\ufffe", "a\x0bb"]
    rows = [(f"n\x01{i}", "ch01-return-by-hand", "failed", text) for i, text in enumerate(messages)]
    junit(rows).write(tmp_path / "x.xml", encoding="utf-8", xml_declaration=True)
    assert len(ElementTree.parse(tmp_path / "x.xml").getroot()) == len(messages)
    table(rows).encode()


OWN = """
import numpy as np

CASES = {
    "ch01-backward-returns": [
        dict(gamma=0.3, rewards=np.array([5.0, -1.0])),
        dict(rewards=np.array([1.0, 2.0]), gamma=0.25),
    ],
}
"""
KNOWS_THE_PAGE = """
def returns(rewards, gamma):
    G, following = np.zeros(len(rewards)), 0.0
    for t in reversed(range(len(rewards))):
        following = rewards[t] + gamma * following * (gamma != 0.25)
        G[t] = following
    return G
"""


IMPATIENT = """
from rlcore.exercises import EXERCISES
object.__setattr__(EXERCISES["ch01-backward-returns"], "seconds", 1.0)
"""


@pytest.fixture
def own_cases(tmp_path):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "first.py").write_text(OWN)
    return tmp_path / "mine"


def answered(path, id, program):
    def change(cells):
        stub = next(i for i, c in enumerate(cells) if f'check("{id}"' in "".join(c["source"])) - 1
        return [*cells[:stub], {**cells[stub], "source": [program]}, *cells[stub + 1 :]]

    return notebook(path, change)


@pytest.mark.long
def test_own_cases_are_added_and_stay_away_from_the_learner(tmp_path, own_cases, capsys):
    id = "ch01-backward-returns"
    path = answered(tmp_path / "01_mdp.ipynb", id, KNOWS_THE_PAGE)
    before = path.read_bytes()
    assert statuses(results(path))[id] == "passed"
    arguments = [str(path), "--cases", str(own_cases), "--junit", str(tmp_path / "out.xml")]
    assert main(arguments) == 1 and "own case 2: 1 of 2 entries differ" in capsys.readouterr().out
    assert path.read_bytes() == before
    right = answered(tmp_path / "01_mdp.ipynb", id, EXERCISES[id].solution)
    assert statuses(results(right, cases=own.read(own_cases)))[id] == "passed"
    loops = answered(
        tmp_path / "01_mdp.ipynb",
        id,
        IMPATIENT + KNOWS_THE_PAGE.replace("    return G", "    while gamma == 0.25: pass\n    return G"),
    )
    found = {row[1]: row for row in results(loops, cases=own.read(own_cases))}
    assert found[id][2] == "error" and "on an own case: stopped" in found[id][3]


def test_what_own_cases_expect_never_enters_the_notebook(own_cases):
    cases = own.read(own_cases / "first.py")
    assert [list(case.given) for case in cases["ch01-backward-returns"]] == [["rewards", "gamma"]] * 2
    sent = pickle.loads(base64.b64decode(own.cell(cases).partition("'")[2].rstrip("')")))
    assert [list(given) for given in sent["ch01-backward-returns"]] == [["rewards", "gamma"]] * 2
    assert own.judge("ch01-backward-returns", cases["ch01-backward-returns"], None)[0] == "error"


def spoils(rewards, gamma):
    rewards[:] = 0.0
    return rewards


def raises(rewards, gamma):
    raise KeyError("no such reward")


@pytest.mark.parametrize(
    "program, status, said",
    [
        (EXERCISES["ch01-backward-returns"].solution, None, ""),
        (KNOWS_THE_PAGE, "failed", "own case 2: 1 of 2 entries differ"),
        (spoils, "failed", "own case 1: changes its argument `rewards`"),
        (raises, "error", "no such reward"),
    ],
)
def test_answers_to_own_cases_are_judged_where_the_learner_is_not(
    program, status, said, own_cases, tmp_path, monkeypatch
):
    id, space = "ch01-backward-returns", {}
    if isinstance(program, str):
        exec("import numpy as np\n" + program, space)
        program = space["returns"] if "returns" in space else space[EXERCISES[id].name]
    report, cases = tmp_path / "report", own.read(own_cases)
    monkeypatch.setattr(own, "last_answers", {id: program})
    monkeypatch.setenv("RLCORE_EXERCISES_REPORT", str(report))
    exec(own.cell({**cases, "ch01-build-ferry": cases[id]}))  # one that was not answered
    (line,) = report.read_text().splitlines()
    found = own.judge(id, cases[id], json.loads(line))
    assert found is None if status is None else (found[0] == status and said in found[1]), found


def test_own_cases_are_as_exact_as_those_of_the_page(tmp_path):
    id = max(EXERCISES, key=lambda id: EXERCISES[id].make_cases()[0].tol if EXERCISES[id].is_function else 0.0)
    text = f"from rlcore.exercises import EXERCISES\nCASES = {{{id!r}: [EXERCISES[{id!r}].make_cases()[0].given]}}"
    (tmp_path / "own.py").write_text(text)
    (case,) = own.read(tmp_path / "own.py")[id]
    assert case.tol == EXERCISES[id].make_cases()[0].tol > 1e-8


@pytest.mark.parametrize("status, n", [("done", 1), ("failed", 2)])
def test_results_of_own_cases_that_are_not_whole_are_an_error(status, n, own_cases):
    id, cases = "ch01-backward-returns", own.read(own_cases)
    results = [(case.expected, None) for case in cases[id]]
    rows = [dict(own=base64.b64encode(pack(*told, [])).decode()) for told in (("done", results), (status, results[:n]))]
    assert own.judge(id, cases[id], rows[0]) is None
    assert own.judge(id, cases[id], rows[1]) == ("error", "the results of the own cases cannot be read")


@pytest.mark.parametrize(
    "text, said",
    [
        ("CASES = 1", "binds no CASES"),
        ("CASES = {}", "at least one case"),
        ("CASES = {'ch01-backward-returns': []}", "at least one case"),
        ("CASES = {'ch01-nothing': []}", "'ch01-nothing', must be the id"),
        ("CASES = {'ch01-predict-pole': [{}]}", "must be the id of an exercise whose answer is a function"),
        ("CASES = {'ch01-backward-returns': [dict(rewards=[1.0])]}", "must be a dict with rewards, gamma"),
        ("CASES = {'ch01-backward-returns': [dict(rewards=None, gamma=1)]}", "the solution raises TypeError"),
    ],
)
def test_own_cases_that_are_none_are_named(tmp_path, text, said, capsys):
    (tmp_path / "own.py").write_text(text)
    path = notebook(tmp_path / "01_mdp.ipynb", lambda cells: cells[:1])
    assert main([str(path), "--cases", str(tmp_path / "own.py")]) == 2
    assert said in capsys.readouterr().err


def test_an_id_in_a_comment_or_a_text_is_not_asked():
    assert _checked('# check("ch01-predict-pole", G)\nx = "ch01-build-ferry"\n%time 1\n') == []
    assert _checked("rlcore.check('ch01-predict-pole', G)") == ["ch01-predict-pole"]
    assert _checked('G = (\n# check("ch01-build-ferry", f)\ncheck("ch01-predict-pole", G)') == ["ch01-predict-pole"]


def test_writing_never_destroys_answers(tmp_path, capsys):
    path = write(ONE, tmp_path)[0]
    assert write(ONE, tmp_path) == [path]  # nothing was answered
    content = nbformat.read(path, as_version=4)
    next(cell for cell in content.cells if cell.source == EXERCISES["ch01-return-by-hand"].stub).source = "G0 = 4"
    nbformat.write(content, path)
    before = path.read_bytes()
    with pytest.raises(FileExistsError, match="would be overwritten"):
        write(ONE, tmp_path)
    assert main(["--write", str(tmp_path)]) == 2 and path.read_bytes() == before
    assert len(list(tmp_path.iterdir())) == 1 and "--force" in capsys.readouterr().err
    write(ONE, tmp_path, force=True)
    assert path.read_bytes() != before


def test_what_others_have_and_a_learner_has_not_is_missing(tmp_path):
    ada, bo, cy = (tmp_path / name for name in ("ada", "bo", "cy"))
    found = {
        ada / "01_mdp.ipynb": [("", id, "passed", "") for id in IDS],
        bo / "01_mdp.ipynb": [("", "01_mdp", "error", "this is no notebook")],
    }
    rows = [line.split() for line in summary(found, [ada, bo, cy]).splitlines()[1:]]
    worth = str(sum(EXERCISES[id].minutes for id in IDS))
    assert rows[0] == ["ada", worth, "/", worth, str(len(IDS)), "0", "0", "0", "0"]
    assert rows[1] == ["bo", "0", "/", worth, "0", "0", "1", "0", str(len(IDS)), "01_mdp"]
    assert rows[2] == ["cy", "0", "/", worth, "0", "0", "0", "0", str(len(IDS))]


def test_a_class_has_a_row_a_learner(tmp_path):
    folders = [tmp_path / name for name in ("ada", "bo", "cy", "di", "em")]
    found = {}
    for n, folder in enumerate(folders):
        path = str(folder / "01_mdp.ipynb")
        found[folder / "01_mdp.ipynb"] = [(path, id, "passed" if i < n else "failed", "no") for i, id in enumerate(IDS)]
    lines = summary(found, folders).splitlines()
    assert len(lines) == 6 and [line.split()[0] for line in lines[1:]] == ["ada", "bo", "cy", "di", "em"]
    reached = [int(line.split()[1]) for line in lines[1:]]
    assert reached == [sum(EXERCISES[id].minutes for id in IDS[:n]) for n in range(5)]
    assert "points" in table([row for rows in found.values() for row in rows])
