"""Checkers are checked: stubs, solutions, every catalogued mistake, and answers that are wrong in unusual ways."""

import ast
import dataclasses
import functools
import itertools
import json
import re
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from xml.etree import ElementTree

import nbformat
import numpy as np
import pytest
import yaml

from rlcore.exercises import BUILDS, CHAPTERS, EXERCISES, KINDS, PAGES, TIERS, check, engine, hint, sandbox, solution
from rlcore.exercises.engine import Verdict, Wrong
from rlcore.exercises.notebook import _with_links, build, page_of, slug, write
from rlcore.exercises.sandbox import Crash, _attempt, _in_thread, run_guarded

ROOT = Path(__file__).parents[1]
LEDGER = yaml.load((ROOT / "book" / "concordance.yml").read_text(encoding="utf-8"), yaml.CSafeLoader)
ALL = list(EXERCISES.values())
FUNCTIONS = [e for e in ALL if callable(e.bind(e.stub))]
each = pytest.mark.parametrize("exercise", ALL, ids=lambda e: e.id)
each_function = pytest.mark.parametrize("exercise", FUNCTIONS, ids=lambda e: e.id)


def verdict(exercise, answer):
    found = check(exercise.id, answer)
    assert isinstance(found, Verdict) and found.message
    return found


BIND = engine.Exercise.bind
BIND_ONCE = functools.cache(BIND)


@pytest.fixture
def ours(monkeypatch):
    """Answers written here harm nobody: they run in this process, and a mistake that is a value is computed once."""
    monkeypatch.setattr(engine, "run_guarded", run_here)
    monkeypatch.setattr(engine.Exercise, "bind", lambda e, source: (BIND if e in FUNCTIONS else BIND_ONCE)(e, source))


def run_here(function, seconds):
    """run_guarded without a process: what never ends is stopped after so many lines, a hundred times what is usual."""
    lines = itertools.count()

    def trace(frame, event, arg):
        if frame.f_code.co_filename[1:-1] in EXERCISES:
            if next(lines) > 100_000:
                raise Crash("never ends")
            return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        status, value, _ = sandbox.unpack(sandbox.pack(*_attempt(function), []))
    finally:
        sys.settrace(before)
    if status == "crash":
        raise Crash(value)
    return value


# ---------------------------------------------------------------------- every exercise


@each
def test_the_untouched_stub_is_not_attempted(exercise):
    assert verdict(exercise, exercise.bind(exercise.stub)).status == "not attempted"


@each
def test_the_solution_passes(exercise):
    assert verdict(exercise, exercise.bind(exercise.solution)).status == "passed"


def _runs_and_tells(exercise, wrong):
    """False where what a mistake gives, a few zeros and ones, many others would give."""
    try:
        outputs = [got for got, _ in engine._results(exercise, exercise.bind(wrong.source))]
    except Exception:
        return True
    return engine.telling(outputs, exercise.make_cases()[0].tol)


@pytest.mark.long
@each
def test_every_mistake_gets_its_own_message(exercise, ours):
    messages = [wrong.message for wrong in exercise.wrong]
    assert len(set(messages)) == len(messages) >= 3
    for wrong in exercise.wrong:
        found = verdict(exercise, exercise.bind(wrong.source))
        if _runs_and_tells(exercise, wrong):
            assert (found.status, found.message) == ("failed", wrong.message)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@each
def test_no_line_of_the_solution_can_be_left_out(exercise, ours):
    lines = exercise.solution.splitlines()
    for i in range(len(lines)):
        if not lines[i]:
            continue
        try:
            answer = exercise.bind("\n".join(lines[:i] + lines[i + 1 :]))
        except Exception:  # what is left is no program, or does not define the answer
            continue
        assert verdict(exercise, answer).status != "passed", lines[i]


def first(*arguments):
    return arguments[0]


def told(given):
    """Arguments as text: generators by their state, not their place in memory."""
    rngs = {name: value.bit_generator.state for name, value in given.items() if isinstance(value, np.random.Generator)}
    return repr({**given, **rngs})


def expected_of(exercise, change):
    """An answer that knows the right results, changed."""
    results = {told(case.given): case.expected for case in exercise.make_cases()}
    names = list(exercise.make_cases()[0].given)
    return lambda *a: change(results[told(dict(zip(names, a)))])


@each_function
def test_usual_nonsense_fails_with_a_message(exercise, ours):
    nan = float("nan")
    answers = [lambda *a: 0, first, lambda *a: nan, lambda *a: None, lambda *a: np.full((2, 2), nan)]
    for answer in answers:
        found = verdict(exercise, answer)
        assert found.status == "failed" and ("expected" in found.message or found.message in messages(exercise))


def messages(exercise):
    return [wrong.message for wrong in exercise.wrong]


@each_function
def test_right_numbers_in_a_wrong_wrapping_fail(exercise, ours):
    for change in (lambda x: [x], lambda x: (x, x), str, lambda x: {"answer": x}):
        assert verdict(exercise, expected_of(exercise, change)).status == "failed"
    if isinstance(exercise.make_cases()[0].expected, np.ndarray):
        for change in (lambda x: x[None], lambda x: x.astype(str), lambda x: x.ravel()[:-1]):
            assert verdict(exercise, expected_of(exercise, change)).status == "failed"
        refused = verdict(exercise, expected_of(exercise, lambda x: x.tolist())).status == "failed"
        assert refused == exercise.rule(exercise.make_cases()[0]).arrays


@each_function
def test_an_answer_must_not_change_its_arguments(exercise, ours):
    right = exercise.bind(exercise.solution)

    def spoils(*arguments):
        result = right(*arguments)
        for value in arguments:
            if isinstance(value, np.ndarray):
                value.flags.writeable = True
                value[:] = 7 if value.dtype.kind != "b" else ~value
            elif isinstance(value, list):
                value.clear()
        return result

    if any(isinstance(value, (np.ndarray, list)) for value in exercise.make_cases()[0].given.values()):
        found = verdict(exercise, spoils)
        assert found.status == "failed" and "changes its argument" in found.message
    assert verdict(exercise, right).status == "passed"  # and what it is compared with has not changed


@pytest.mark.parametrize("exercise", [e for e in ALL if e not in FUNCTIONS], ids=lambda e: e.id)
def test_values_that_are_nonsense_fail(exercise, ours):
    for answer in (0, float("nan"), None, "yes", [], np.zeros(3), lambda: 0):
        assert verdict(exercise, answer).status == "failed"


@each
def test_cases_are_the_same_each_time_and_some_are_not_printed(exercise):
    one, two = exercise.make_cases(), exercise.make_cases()
    assert [(told(case.given), repr(case.expected)) for case in one] == [
        (told(case.given), repr(case.expected)) for case in two
    ]
    if exercise in FUNCTIONS:
        assert sum(not case.printed for case in one) >= 2


def test_an_answer_that_knows_only_the_printed_example_fails_and_is_told():
    found = check("ch01-backward-returns", lambda rewards, gamma: np.array([2.0, 6, 8, 4, 2]))
    assert found.status == "failed" and found.message.startswith("right on the example of the statement")


@each
def test_what_an_exercise_covers_exists(exercise):
    ids = {row["id"] for row in LEDGER}
    assert exercise.covers and set(exercise.covers) <= ids
    assert 1 <= exercise.minutes <= 30 and re.fullmatch(r"(ch\d\d|agent|network|ppo)-[a-z0-9-]+", exercise.id)


@pytest.mark.parametrize("name", CHAPTERS)
def test_a_chapter_has_eight_exercises_of_all_kinds_and_questions(name):
    mine = [e for e in ALL if e.id.startswith(name[:4] + "-")]
    assert len(mine) >= 8 and {e.kind for e in mine} == set(KINDS)
    assert len({e.name for e in mine}) == len(mine)  # an answer must not pass for that of another exercise
    assert 3 <= len(CHAPTERS[name].QUESTIONS) <= 5
    for question in CHAPTERS[name].QUESTIONS:
        assert all(text and why for text, _, why in question.choices)
        assert not any("$" in text for text, _, _ in question.choices)  # a summary shows no mathematics


# ---------------------------------------------------------------------- what can go wrong besides


ONE = EXERCISES["ch01-expected-reward"]


def with_wrong(source):
    wrong = (Wrong(source, "one"), *ONE.wrong)
    exercise = dataclasses.replace(ONE, id="ch00-replaced", wrong=wrong)
    del EXERCISES[exercise.id]
    return exercise.wrong[0].source


def test_a_wrong_answer_is_the_solution_with_replacements_or_a_program():
    program = "def expected_reward(prob, reward):\n    return (prob + reward).sum(axis=1)"
    assert with_wrong({"prob * reward": "prob + reward", "axis=2": "axis=1"}) == program
    assert with_wrong(textwrap.indent(program, "    ")) == program


@pytest.mark.parametrize(
    "text, before",
    [("no such text", {}), ("prob", {}), ("sum(axis=2)", {"axis=2": "axis=1"}), ("axis=2", {"prob *": "axis=2 *"})],
    ids=["missing", "twice", "missing by now", "twice by now"],
)
def test_a_text_to_replace_must_occur_exactly_once(text, before):
    with pytest.raises(ValueError, match=f"^exercise ch00-replaced: '{re.escape(text)}' must occur exactly once"):
        with_wrong({**before, text: "0"})


def test_the_learners_own_traceback_is_shown():
    def broken(prob, reward):
        return prob[99, 99]

    found = check(ONE.id, broken)
    assert found.status == "error" and "return prob[99, 99]" in found.message and "IndexError" in found.message
    assert "rlcore/exercises" not in found.message
    assert "positional argument" in check(ONE.id, lambda prob: prob).message


def loop():
    while True:
        pass


@pytest.mark.long
@pytest.mark.parametrize("answer, patience", [(loop, 1000), (lambda: time.sleep(3), 1)], ids=["loop", "sleep"])
def test_what_never_ends_is_stopped(answer, patience, monkeypatch):
    monkeypatch.setattr(sandbox, "PATIENCE", patience)
    with pytest.raises(Crash, match="never ends"):
        run_guarded(answer, 0.5)
    out = sys.stdout
    status, message, *_ = _in_thread(answer, 0.5)
    assert status == "crash" and "never ends" in message and sys.stdout is out


def test_an_answer_may_take_longer_than_it_computes(monkeypatch):
    monkeypatch.setattr(sandbox, "PATIENCE", 1000)
    assert run_guarded(lambda: time.sleep(0.6) or 7, 0.5) == 7
    assert _in_thread(lambda: time.sleep(0.6) or 7, 0.5) == ("done", 7, "", [])


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is limited on Linux only")
def test_a_huge_allocation_is_stopped():
    assert "memory" in check(ONE.id, lambda prob, reward: np.ones((10**6, 10**5))).message


def test_a_process_that_dies_and_a_result_that_cannot_travel():
    import os

    assert check(ONE.id, lambda prob, reward: os._exit(1)).status == "error"
    found = check(ONE.id, lambda prob, reward: lambda: 0)
    assert found.status == "failed" and "the result is a function, expected an array" in found.message


def test_prints_are_shown(capsys):
    check(ONE.id, lambda prob, reward: print("hello"))
    assert "hello" in capsys.readouterr().out


def test_hints_come_in_order_and_the_solution_after_them():
    id = "ch02-solve-exactly"
    assert "2 hints left" in str(solution(id))
    texts = [str(hint(id)) for _ in range(3)]
    assert texts[0].startswith("Hint 1 of 2") and texts[1] == texts[2] and texts[1].startswith("Hint 2 of 2")
    assert str(solution(id)) == EXERCISES[id].solution


def test_unknown_ids_are_named():
    for call in (lambda: check("ch02-nothing", 0), lambda: hint("x"), lambda: solution("x")):
        with pytest.raises(ValueError, match="^id: got"):
            call()


# ---------------------------------------------------------------------- notebooks and the command


@pytest.mark.parametrize("name", PAGES)
def test_the_committed_notebook_is_the_generated_one(name):
    path = ROOT / "book" / "exercises" / f"{PAGES[name].NOTEBOOK}.ipynb"
    assert json.loads(path.read_text(encoding="utf-8")) == build(PAGES[name])
    nbformat.validate(nbformat.read(path, as_version=4))


def texts(notebook, kind="markdown"):
    return ["".join(cell["source"]) for cell in notebook["cells"] if cell["cell_type"] == kind]


@pytest.mark.parametrize("name", CHAPTERS)
def test_a_page_goes_from_core_to_deep_and_from_short_to_long(name):
    text = "\n".join(texts(build(CHAPTERS[name])))
    assert re.findall(r"^## (Core|More|Deep)$", text, re.M) == ["Core", "More", "Deep"]
    ids = re.findall(r'<span id="([\w-]+)"></span>\n\n### \d+\.', text)
    assert ids == [e.id for e in engine.on_page(name[:4])] and set(ids) == {e.id for e in ALL if e.id[:4] == name[:4]}
    for tier in TIERS:
        mine = [EXERCISES[id] for id in ids if EXERCISES[id].tier == tier]
        assert 1 <= len(mine) <= 10 and [e.minutes for e in mine] == sorted(e.minutes for e in mine)
    order = [TIERS.index(EXERCISES[id].tier) for id in ids]
    assert order == sorted(order)


@pytest.mark.parametrize("name", CHAPTERS)
def test_sections_lead_to_their_exercises_and_back(name):
    path = ROOT / "book" / f"{CHAPTERS[name].NOTEBOOK}.ipynb"
    there, heading = {}, ""
    for line in "\n".join(texts(json.loads(path.read_text(encoding="utf-8")))).splitlines():
        heading = line.lstrip("# ") if re.match("##+ ", line) else heading
        there |= dict.fromkeys(re.findall(r"\{task\}`([\w-]+)`", line), heading)
    assert there == {e.id: e.section for e in engine.on_page(name[:4])}
    page = "\n".join(texts(build(CHAPTERS[name])))
    assert all(f"On [{h}](../{path.stem}.ipynb#{slug(h)})" in page for h in there.values())


@pytest.mark.parametrize("name", PAGES)
def test_a_reader_sees_no_key_of_a_record_and_no_verdict(name):
    notebook = build(PAGES[name])
    for text in texts(notebook):
        seen = re.sub(r"\]\([^)]*\)|<span[^>]*>|`[^`]*`", "", text)
        assert not re.search(r"\b(?:cl|om|alg|eq|fig|ex|err|table)-[a-z0-9]", seen), text
    checks = [c for c in notebook["cells"] if "".join(c["source"]).startswith("check(")]
    assert len(checks) == len(engine.on_page(page_of(PAGES[name])))
    for cell in checks:  # stored as it comes, shown only where it was run
        assert cell["outputs"] and "remove-output" in cell["metadata"]["tags"]


@pytest.mark.parametrize("name", [name for name in CHAPTERS if name != "ch06_nn"])
def test_a_proof_has_its_parts_and_a_model(name):
    for proof in CHAPTERS[name].PROOFS:
        assert len(proof.needs) >= 3 and len(proof.proof.split()) > 60
        page = "\n".join(texts(build(CHAPTERS[name])))
        shown = [proof.title, _with_links(proof.statement), _with_links(proof.proof), *proof.needs]
        assert all(part in page for part in shown)
        folded = page.partition(proof.title)[2]
        assert folded.index("<details>") < folded.index(proof.needs[0]) < folded.index(_with_links(proof.proof))
        for text in (proof.statement, proof.proof, *proof.needs):
            assert text.count("$") % 2 == 0


# ---------------------------------------------------------------------- longer builds


def learner(name, **programs):
    """The names of a notebook in which a learner solved all steps, but for those given."""
    scope = {}
    for exercise in engine.on_page(name):
        if exercise in FUNCTIONS:
            exec(exercise.setup, scope)
            exec(programs.get(exercise.name, exercise.solution), scope)
    return scope


@pytest.mark.parametrize("name", BUILDS)
def test_a_step_uses_the_learners_own_earlier_steps(name, ours):
    steps = engine.on_page(page_of(BUILDS[name]))
    scope = learner(page_of(BUILDS[name]))
    for step in steps[1:]:
        earlier = [EXERCISES[id] for id in step.uses]
        assert earlier == [e for e in steps if e in earlier]  # in their order, so that the first wrong one is named
        if step not in FUNCTIONS:
            continue
        called = [e for e in earlier if e.name in scope[step.name].__code__.co_names]
        for first in called:
            broken = learner(page_of(BUILDS[name]), **{first.name: f"def {first.name}(*_):\n    return None"})
            said = check(step.id, broken[step.name])
            assert said.status == "failed" and f"the earlier step `{first.name}` is wrong" in said.message


def test_an_earlier_step_is_said_to_be_the_cause(ours):
    forgets = EXERCISES["agent-traces"].wrong[1]
    scope = learner("agent", faded=forgets.source)
    said = check("agent-episode", scope["episode"]).message
    assert said == f"this step is right; the earlier step `faded` is wrong: {forgets.message}"
    scope = learner("agent", faded=forgets.source, episode=EXERCISES["agent-episode"].wrong[0].source)
    assert check("agent-episode", scope["episode"]).message == f"the earlier step `faded` is wrong: {forgets.message}"
    scope = learner("agent", faded=EXERCISES["agent-traces"].stub)
    assert "`faded` is not attempted yet" in check("agent-episode", scope["episode"]).message
    del scope["faded"]
    assert "`faded` is missing" in check("agent-episode", scope["episode"]).message
    scope = learner("agent", episode=EXERCISES["agent-episode"].wrong[0].source)
    assert check("agent-episode", scope["episode"]).message == EXERCISES["agent-episode"].wrong[0].message


def test_a_value_that_wrong_steps_made_names_them(ours):
    scope = learner("agent", faded=EXERCISES["agent-traces"].wrong[2].source) | {"check": check, "np": np}
    exec('said = check("agent-finds", np.ones((28, 4)))', scope)
    assert "the earlier step `faded` is wrong" in scope["said"].message
    assert "does not reach the goal" in check("agent-finds", np.ones((28, 4))).message


def test_a_solved_pole_and_a_caught_ball_need_no_certain_program():
    """What is judged is the result: other seeds, other numbers of rounds."""
    for id, old, new in (
        ("ppo-solved", "learn(50, np.random.default_rng(0))", "learn(60, np.random.default_rng(5))"),
        ("network-catches", "learn(400, np.random.default_rng(0))", "learn(450, np.random.default_rng(3))"),
        ("agent-finds", "default_rng(0)", "default_rng(7)"),
    ):
        exercise = EXERCISES[id]
        assert exercise.solution.count(old) == 1
        assert verdict(exercise, exercise.bind(exercise.solution.replace(old, new))).status == "passed"


def test_a_reference_to_an_equation_leads_to_the_chapter_that_has_it():
    pages = {row["id"]: row["page"].partition("#")[0] for row in LEDGER if row.get("page")}
    for number in range(1, 42):
        link = rf"\[equation \(\d\.{number}\)\]\(\.\./(\w+)\.ipynb#eq-{number}\)"
        page = re.fullmatch(link, _with_links(f"{{eq}}`eq-{number}`"))[1]
        assert page == pages[f"eq-{number}"], number
    again = (("nn", 20, 37, "06_neural_networks"), ("rf", 38, 39, "07_reinforce"), ("ppo", 40, 50, "08_ppo"))
    for series, first, last, page in again:
        for number in range(first, last + 1):  # the number shown is the document's, which counts from 20 again
            expected = f"[equation ({int(page[:2])}.{number})](../{page}.ipynb#eq-{series}-{number})"
            assert _with_links(f"{{eq}}`eq-{series}-{number}`") == expected
            assert pages.get(f"eq-{series}-{number}", page) == page, number


def run(*arguments, cwd):
    command = [sys.executable, "-m", "rlcore.exercises", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True)


@pytest.mark.long
def test_the_command_tells_right_from_wrong_and_untouched(tmp_path):
    path = write({"ch01_mdp": CHAPTERS["ch01_mdp"]}, tmp_path)[0]
    untouched = run(path, cwd=tmp_path)
    assert untouched.returncode == 0 and untouched.stdout.count("not attempted") >= 8
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.source == EXERCISES["ch01-return-by-hand"].stub:
            cell.source = EXERCISES["ch01-return-by-hand"].solution
        if cell.source == EXERCISES["ch01-expected-reward"].stub:
            cell.source = EXERCISES["ch01-expected-reward"].wrong[0].source
        if cell.source == EXERCISES["ch01-predict-pole"].stub:
            cell.source = "G0_pole = 1 / 0"
    nbformat.write(notebook, path)
    done = run(path, "--markdown", "summary.md", cwd=tmp_path)
    assert done.returncode == 1
    rows = {line.split()[0]: line for line in done.stdout.splitlines() if line.startswith("ch01-")}
    assert "passed" in rows["ch01-return-by-hand"]
    assert EXERCISES["ch01-expected-reward"].wrong[0].message in rows["ch01-expected-reward"]
    assert "error" in rows["ch01-predict-pole"]
    suite = ElementTree.parse(tmp_path / "exercises.xml").getroot()
    assert suite.attrib["tests"] == str(len(rows)) and suite.attrib["failures"] == "1"
    assert "| ch01-return-by-hand | passed |" in (tmp_path / "summary.md").read_text(encoding="utf-8")


@pytest.mark.long
def test_a_notebook_that_is_not_there_is_an_error(tmp_path):
    assert run("nothing.ipynb", cwd=tmp_path).returncode == 2 and run(cwd=tmp_path).returncode == 2


def test_nothing_of_rlcore_imports_the_exercises():
    for path in (ROOT / "rlcore").rglob("*.py"):
        if "exercises" not in path.parts:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
                names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not any(name.startswith("rlcore.exercises") for name in names), path
