"""Box and code lie side by side: what a box sets, the code beside it sets in the same order, by the same names."""

import ast
import json
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BOX = re.compile(r"````\{prf:algorithm\} ([^\n]*)\n(.*?)````", re.S)
SHOWN = re.compile(r"literalinclude\} \.\./(\S+)\n(?::.*\n)*?:pyobject: (\w+)")
GREEK = {"alpha": "alpha", "gamma": "gamma", "lambda": "lam", "epsilon": "epsilon", "varepsilon": "epsilon",
         "delta": "delta", "pi": "pi", "theta": "theta"}  # fmt: skip
NAMES = {
    "S": "s", "S'": "s_next", "A": "a", "A'": "a_next", "A^*": "best", "R": "r", r"\delta": "delta", r"\Delta": "delta",
    r"\theta": "theta", r"\pi'": "pi_new", "Model": "memory",
}  # fmt: skip
WORDS = re.compile(
    r"Initialise \$(?P<start>S)|Choose \$(?P<choice>A'?)\$|observe \$(?P<seen>R, S')\$"
    r"|(?P<set>\\[dD]elta|\\theta|\\pi'|A\^\*|Model|[GQVEASRg]'?)(?:_\{?[\w\\']+\}?)?(?:\([^()]*\))?(?P<more>, S'|, A)?"
    r" *\\leftarrow"
)
CALLS = {"visit": ["E"], "credit": ["table", "E"], "add_score": ["g"], "episode": ["s_next", "r"], "remember": []}
WITHIN = {  # what stands for what in the code: tables that change, and the remembered step that Dyna replays
    "e": "E", "change": "V", "q": "Q", "average": "V", "V_new": "V", "plan": "Q", "i": "s", "b": "a", "r_model": "r",
    "V_next": "s_next",
}  # fmt: skip
LEFT_OUT = {  # box: why its lines are not those of the code
    "box-model-learning": "the code counts all transitions at once",
    "box-mpc": "the plans are arrays, not a loop", "box-policy-iteration": "evaluation is a linear system",
    "box-policy-improvement": "all states at once", "box-trpo": "the network's parts are functions of their own",
    "box-ppo": "an update of a network, by parts", "box-backprop": "the layers are methods of MLP",
    "alg-box-marginals": "sums over axes of arrays", "alg-box-operators": "one function a line",
    "box-reinforce": "what is shown is one episode's gradient; `reinforce` takes the step",
    "alg-box-rollout": "its box draws, and sets nothing",
    "alg-box-greedy": "one function a line", "alg-box-search": "a recursion",
}  # fmt: skip


def boxes():
    for path in sorted((ROOT / "book").glob("0*.ipynb")):
        for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
            source = "".join(cell["source"])
            found = [*BOX.finditer(source)]
            for box, after in zip(found, [*found[1:], None]):
                shown = SHOWN.findall(source[box.end() : after and after.start()])
                if shown:
                    yield re.search(r":label: (\S+)", box[2])[1], box[2], shown


BOXES = {label: (text, shown) for label, text, shown in boxes()}


def code(path, name):
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    return next(node for node in tree.body if getattr(node, "name", None) == name)


def assigned_in_box(text):
    """Names, in the code's words, of what the lines of a box set, in their order."""
    found = []
    for match in WORDS.finditer(re.sub(r"\(if [^()]*(?:\([^()]*\)[^()]*)*\)", "", text)):
        if match["seen"]:
            found += ["s_next", "r"]
            continue
        word = match["start"] or match["choice"] or match["set"]
        found.append(NAMES.get(word, word))
        if match["more"]:
            found.append(NAMES.get(match["more"].removeprefix(", "), "s_next"))
    return found


def assigned_in_code(function):
    """What the statements of a function set, in their order; a call that changes a table sets that table."""
    found = []
    nodes = [node for node in ast.walk(function) if hasattr(node, "lineno")]
    for node in sorted(nodes, key=lambda node: (node.lineno, node.col_offset)):
        targets = (
            node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AugAssign) else []
        )
        for target in targets:
            for part in target.elts if isinstance(target, ast.Tuple) else [target]:
                names = [n.id for n in ast.walk(part) if isinstance(n, ast.Name)]
                found += [WITHIN.get(names[0], names[0])] if names else []
        if isinstance(node, ast.Call) and getattr(node.func, "id", "") in CALLS:
            table = getattr(node.args[0], "id", "") if node.args else ""
            found += [WITHIN.get(table, table) if name == "table" else name for name in CALLS[node.func.id]]
    return found


def missing(wanted, found):
    """The first of `wanted` that does not come in its turn; None where they all do, whatever lies between."""
    rest = iter(found)
    return next((name for name in wanted if all(name != other for other in rest)), None)


@pytest.mark.parametrize("label", [label for label in BOXES if label not in LEFT_OUT])
def test_a_box_and_its_code_name_the_same_quantities(label):
    text, shown = BOXES[label]
    names = {n.id for path, name in shown for n in ast.walk(code(path, name)) if isinstance(n, ast.Name)}
    names |= {n.arg for path, name in shown for n in ast.walk(code(path, name)) if isinstance(n, ast.arg)}
    used = {GREEK[word] for word in re.findall(r"\\([a-z]+)", text) if word in GREEK}
    names |= {"theta"} & {"theta" for name in names if name in ("tol", "delta")}  # a tolerance
    absent = used - names
    assert not absent, f"{label}: {absent} stand in the box, not in the code"


@pytest.mark.parametrize("label", [label for label in BOXES if label not in LEFT_OUT])
def test_a_box_and_its_code_set_the_same_things_in_the_same_order(label):
    text, shown = BOXES[label]
    wanted, found = assigned_in_box(text), [x for path, name in shown[:1] for x in assigned_in_code(code(path, name))]
    assert wanted and missing(wanted, found) is None, f"{label}: {wanted} beside {found}"


def test_every_box_left_out_exists():
    assert set(LEFT_OUT) <= set(BOXES) and len(BOXES) > 25


@pytest.mark.parametrize("first, second", [("s_next, r, terminated", "Q[s, a] +="), ("a_next = ", "Q[s, a] +=")])
def test_lines_in_another_order_are_noticed(first, second):
    lines = ast.unparse(code("rlcore/td.py", "sarsa")).splitlines()
    i, j = (next(k for k, line in enumerate(lines) if line.lstrip().startswith(start)) for start in (first, second))
    lines[i], lines[j] = lines[j], lines[i]
    function = ast.parse("\n".join(lines)).body[0]
    assert missing(assigned_in_box(BOXES["box-sarsa"][0]), assigned_in_code(function)) is not None
