r"""The processes on which derivations are evaluated: what they all need, and how a derivation is described."""

import itertools
from dataclasses import dataclass, field
from functools import cache

import numpy as np
from latex import Scope

from rlcore.bellman import expectation_backup, expectation_backup_q, optimality_backup, optimality_backup_q
from rlcore.mdp import FiniteMDP


@dataclass(frozen=True)
class Derivation:
    """chapter; worlds: () -> (scope, values of the free variables) ...; texts that begin a line, and why it is special.

    unread: the line cannot be evaluated. slack: an inequality that no process here turns into an equality.
    """

    chapter: int
    worlds: object
    unread: dict = field(default_factory=dict)
    slack: dict = field(default_factory=dict)


class Unknown(KeyError):
    """What a later step of the process decides."""


class Process(Scope):
    """A process with policies, and arrays by name and subscript: v_\\pi, P_\\pi, V, Q.

    policies: {"pi": (S, A), ...}. Expectations are sums over the steps that they speak of; what comes after them is
    worth v of the policy, so that arrays must hold v_\\pi for every policy that an expectation of G_t follows.
    """

    STEPS = 4

    def __init__(self, mdp, gamma, policies, arrays, greek=None, trajectories=()):
        n, m = mdp.prob.shape[:2]
        rewards = sorted({*mdp.reward[mdp.prob > 0]})
        super().__init__({"s": range(n), "a": range(m), "r": rewards, "x": range(n)}, {}, None, gamma, greek,
                         trajectories)  # fmt: skip
        self.outcomes = {
            (s, a): [
                (s_next, r, p) for s_next, r in itertools.product(range(n), rewards) if (p := mdp.p(s_next, r, s, a))
            ]
            for s, a in np.ndindex(n, m)
        }
        self.p = {(s_next, r, s, a): p for (s, a), found in self.outcomes.items() for s_next, r, p in found}
        P, r = mdp.transition_probs(), mdp.expected_reward()
        self.tables = {
            ("p|1", "", 4): lambda s_next, r, s, a: self.p.get((s_next, r, s, a), 0.0),
            ("p|0", "", 3): lambda s_next, s, a: P[int(s), int(a), int(s_next)],
            ("r", "", 2): r, ("r", "", 3): mdp.expected_reward_sas(),
            ("I", "", 0): np.eye(n), ("ones", "", 0): np.ones(n),
            ("T", "*", 1): backup(optimality_backup, optimality_backup_q, mdp, gamma=gamma),
        }  # fmt: skip
        for name, pi in policies.items():
            rows = pi[:, :, None]
            self.tables |= {
                (name + "|0", "", 2): lambda a, s, pi=pi: pi[int(s), int(a)],
                (name, "", 1): pi.argmax(axis=1),
                ("P", name, 0): (rows * P).sum(axis=1), ("r", name, 0): (pi * r).sum(axis=1),
                ("T", name, 1): backup(expectation_backup, expectation_backup_q, mdp, pi, gamma=gamma),
            }  # fmt: skip
        self.tables |= {(*key, 0): array for key, array in arrays.items()}

    def call(self, name, subscript, args):
        if (name, subscript, len(args)) in self.tables:
            return super().call(name, subscript, args)
        if name == "delta":
            raise Unknown(name, *args)
        array = self.tables[name, subscript, 0]
        if len(args) == 1 and np.ndim(args[0]):  # P_\pi (v - w), r (...)
            return array @ args[0]
        return array[tuple(int(x) for x in args)]

    def variable(self, letter, at, names):
        """R_t, S_t, A_t of the steps seen; G_t: the rewards seen from t on, then what is to be expected."""
        if letter != "G":
            raise Unknown(letter, at)
        total, weight = 0.0, 1.0
        while ("R", at + 1) in names:
            total, weight, at = total + weight * names["R", at + 1], weight * self.gamma, at + 1
        if ("S", at) not in names:
            raise Unknown(letter, at)
        state = [names["S", at]]
        if ("A", at) in names:
            return total + weight * self.call("q", names["policy"], [*state, names["A", at]])
        return total + weight * self.call("v", names["policy"], state)

    def expect(self, kind, policy, what, given, names):
        plain = {key: x for key, x in names.items() if not (isinstance(key, tuple))}
        fixed = {(letter, at(self, names)): x(self, names) for letter, at, x in given if letter != "..."}
        if len(fixed) < len(given):
            fixed |= {key: x for key, x in names.items() if isinstance(key, tuple) and key[0] in ("S", "A", "R")}
        if not fixed or ("tau", 0) in fixed:
            found = [(p, {**names, **seen}) for p, seen in self.trajectories
                     if all(seen.get(key) == x for key, x in fixed.items())]  # fmt: skip
            weight = sum(p for p, _ in found) if fixed else 1.0
            return sum(p * self.seen(kind, what, seen) for p, seen in found) / weight
        plain["policy"] = policy
        start = min(at for letter, at in fixed if letter == "S")
        total, weight = self.go_on(
            1.0, {**plain, ("S", start): fixed["S", start]}, start, start, (kind, policy, what, fixed)
        )
        return total / weight

    def seen(self, kind, what, names):
        if kind == r"\E":
            return what(self, names)
        return float(all(names[letter, at(self, names)] == x(self, names) for letter, at, x in what))

    def go_on(self, p, names, now, start, of):
        """(sum of p X, sum of p) over all that can follow, until X and the condition are known."""
        kind, policy, what, fixed = of
        if fixed.keys() <= names.keys():
            try:
                return p * self.seen(kind, what, names), p
            except Unknown:
                pass
            except KeyError:
                if kind == r"\E":
                    raise
        if now - start == self.STEPS:
            raise KeyError("an expectation of what is never seen")
        if ("A", now) not in fixed and not policy:
            raise SyntaxError("an expectation needs an action or a policy")
        s, total, weight = names["S", now], 0.0, 0.0
        for a in [fixed["A", now]] if ("A", now) in fixed else self.sets["a"]:
            chance = self.call(policy + "|0", "", [a, s]) if policy and ("A", now) not in fixed else 1.0
            for s_next, r, q in self.outcomes[s, a]:
                seen = {("A", now): a, ("R", now + 1): r, ("S", now + 1): s_next}
                if not chance or any(fixed.get(key, x) != x for key, x in seen.items()):
                    continue
                if ("V", "", 0) in self.tables:
                    V = self.tables["V", "", 0]
                    seen["delta", now] = r + self.gamma * V[s_next] - V[s]
                x, y = self.go_on(p * chance * q, {**names, **seen}, now + 1, start, of)
                total, weight = total + x, weight + y
        return total, weight


def backup(of_v, of_q, *given, gamma):
    """T_pi or T_* of an array of values, (S,) or (S, A), which remembers what it has computed."""
    known = {}

    def value(x):
        key = x.shape, x.tobytes()
        if key not in known:
            known[key] = (of_v if x.ndim == 1 else of_q)(*given, x, gamma)
        return known[key]

    return value


def rng(seed=0):
    return np.random.default_rng(seed)


@cache
def random_mdp(seed, n=3, m=2, more=0.0):
    """p(s', r | s, a) > 0 for every s' and both rewards."""
    draw = rng(seed)
    p, rewards = draw.dirichlet(np.ones(2 * n), size=(n, m)), (more - 1.5, more + 2.0)
    next_state = np.broadcast_to(np.repeat(np.arange(n), 2), p.shape)
    reward = np.broadcast_to(np.tile(rewards, n), p.shape)
    return FiniteMDP(next_state, p, reward, np.ones((n, m), bool), np.zeros(n, bool), np.ones(n) / n)


def times(*values, **names):
    """Every combination of values of the free variables: times(s=(0, 1), t=(0,))."""
    return [dict(zip(names, x)) for x in itertools.product(*names.values())]


GAMMAS = (0.7, 0.4)


class Numbers(Scope):
    """Random numbers without steps: an expectation is a sum over their outcomes."""

    def expect(self, kind, policy, what, given, names):
        if given or policy or kind != r"\E":
            raise SyntaxError("an expectation without a condition is meant")
        return sum(p * what(self, {**names, **seen}) for p, seen in self.trajectories)
