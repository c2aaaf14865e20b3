"""Files of results and agents: the same thing in another process, learning that goes on, and files that are refused."""

import copy
import json
import pickle
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from agents import Counter, make_small
from worlds import awkward

from rlcore.core.agents import ActorCritic, Normaliser
from rlcore.core.files import whole
from rlcore.core.results import Run
from rlcore.core.schedules import decaying
from rlcore.dp import value_iteration
from rlcore.envs import random_walk
from rlcore.gae import learning_data
from rlcore.judging import evaluate, learning_curve
from rlcore.mdp import FiniteMDP
from rlcore.nn import MLP
from rlcore.optimizers import SGD, Adam
from rlcore.planning import dyna_q
from rlcore.ppo import PPOConfig, improve, ppo
from rlcore.saving import load, save
from rlcore.td import q_learning
from rlcore.traces import watkins_q_lambda
from rlcore.trpo import TRPOConfig, trpo

ROOT = Path(__file__).parents[1]
SMALL = dict(horizon=32, minibatch=16, epochs=2, hidden=(8,))


def rng(seed=0):
    return np.random.default_rng(seed)


def same(one, two):
    """The same kinds and the same bits, whatever is inside what."""
    assert type(one) is type(two)
    if isinstance(one, dict):
        assert one.keys() == two.keys()
        for key in one:
            same(one[key], two[key])
    elif isinstance(one, (list, tuple)):
        assert len(one) == len(two)
        for a, b in zip(one, two):
            same(a, b)
    elif isinstance(one, (np.ndarray, np.generic)):
        assert one.dtype == two.dtype
        np.testing.assert_array_equal(one, two)
        assert np.array(one).tobytes() == np.array(two).tobytes()
    elif isinstance(one, np.random.Generator):
        assert one.random() == two.random() and one.spawn(1)[0].random() == two.spawn(1)[0].random()
    elif hasattr(one, "__func__"):
        same(one.__self__, two.__self__)
    elif isinstance(one, MLP):
        same(one.__getstate__(), two.__getstate__())
    elif hasattr(one, "__dict__"):
        hidden = {"_work"}  # where Adam works; nothing is kept in it
        same(*({k: v for k, v in vars(x).items() if k not in hidden} for x in (one, two)))
    else:
        assert one == two or one != one


def kept(thing, folder, **options):
    save(thing, folder / "file.rl")
    return load(folder / "file.rl", **options)


def runs():
    mdp = random_walk(5)
    options = dict(alpha=0.1, epsilon=0.2, record=2)
    yield q_learning(awkward(start=0), 0.9, 5, rng=rng(), **options)
    yield watkins_q_lambda(mdp, 0.9, 0.5, 5, rng=rng(), **options)
    yield dyna_q(mdp, 0.9, 5, n_planning=2, rng=rng(), **options)
    yield value_iteration(mdp, 0.9, record=1)
    yield ppo("CartPole-v1", rng=rng(), n_steps=64, config=PPOConfig(**SMALL, normalise_observations=True))
    yield ppo("Pendulum-v1", rng=rng(), n_steps=64, config=PPOConfig(**SMALL, shared=True))
    yield trpo("Pendulum-v1", rng=rng(), n_steps=64, config=TRPOConfig(**SMALL))


@pytest.mark.parametrize("result", list(runs()), ids=lambda result: repr(result)[:40])
def test_a_result_comes_back_as_it_was(result, tmp_path):
    same(result, kept(result, tmp_path))


@pytest.mark.parametrize("kind", ["PCG64", "PCG64DXSM", "MT19937", "Philox", "SFC64"])
def test_a_generator_goes_on(kind, tmp_path):
    generator = np.random.Generator(getattr(np.random, kind)(3))
    generator.integers(10, dtype=np.int32)  # half of the drawn bits are left over
    generator.spawn(2)
    again = kept(generator, tmp_path)
    np.testing.assert_array_equal(*(g.integers(10, size=9, dtype=np.int32) for g in (generator, again)))
    same(generator, again)


def test_plain_things_come_back(tmp_path):
    things = {
        "numbers": [1, 2.5, -0.0, float("inf"), True, None, 10**40],
        (1, "pair"): (np.float32(0.1), np.arange(6).reshape(2, 3).T, np.zeros((0, 3)), "\u03c0"),
        3: {"nested": [[], (), {}]},
    }
    same(things, kept(things, tmp_path))


def test_judgements_and_settings_come_back(tmp_path):
    judged = evaluate(np.ones((5, 1)), random_walk(3), 9, rng=rng())
    runs = [q_learning(random_walk(3), 1.0, 9, alpha=0.1, epsilon=0.1, rng=rng(seed)) for seed in range(3)]
    schedule, config = decaying(0.5, power=0.7), PPOConfig(**SMALL, clip=0.3)
    same([judged, learning_curve(runs)], kept([judged, learning_curve(runs)], tmp_path))
    assert kept([schedule, config, TRPOConfig(delta=0.02)], tmp_path) == [schedule, config, TRPOConfig(delta=0.02)]


def test_what_no_file_holds_is_refused(tmp_path):
    endless = [1]
    endless.append({"again": endless})
    for thing, message in (
        (endless, "got list that holds itself"), (np.ma.masked_array([1.0, 2.0], [False, True]), "got a masked array"),
        (np.array([None]), "got an array of object"), (range(3), "got range"), ({1, 2}, "got"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"^thing: {message}.*must "):
            save(thing, tmp_path / "file.rl")
    with pytest.raises(ValueError, match="^path: got .*, must be in a folder that exists$"):
        save(1, tmp_path / "none" / "file.rl")
    assert not list(tmp_path.iterdir())


def test_a_name_may_be_a_string(tmp_path):
    with whole(str(tmp_path / "whole")) as out:
        out.write("all of it")
    assert [path.read_text() for path in tmp_path.iterdir()] == ["all of it"]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))], ids=["copy", "pickle"])
def test_copies_of_agents_are_their_own(copied):
    """A TorchNet's, too: its parameters are views of its theta, not of the first one's."""
    pytest.importorskip("torch")
    agent = make_small(torch_net=True, dtype=np.float32, optimizer=Adam)
    again = copied(Run(np.zeros(1), np.ones(1, int), V=agent.values, policy=agent)).policy
    x = np.ones((1, 3), np.float32)
    np.testing.assert_array_equal(again.net.forward(x), agent.net.forward(x))
    again.net.theta[:] = 0
    assert not again.net.forward(x).any() and agent.net.forward(x).any()
    again.net.step(again.net.backward(np.ones((1, 2), np.float32)))
    assert again.net.theta.any()


def test_what_is_one_thing_stays_one_thing(tmp_path):
    net = MLP([2, 3, 1], optimizer=Adam(), rng=rng())
    agent = ActorCritic(MLP([2, 3, 2], optimizer=Adam(), rng=rng()), net)
    one, two, again = kept([agent, net, agent], tmp_path)
    assert one is again and one.critic is two
    run = ppo("CartPole-v1", rng=rng(), n_steps=32, config=PPOConfig(**SMALL))
    found = kept(run, tmp_path)
    assert found.V.__self__ is found.policy
    assert found.history.kl.tolist() == run.history.kl.tolist()


def test_processes_keep_their_names(tmp_path):
    mdp = FiniteMDP.from_outcomes({(0, 0): [(1.0, 1, 2.0)]}, state_names=["a", (0, 1)], action_names=["go"])
    again = kept(mdp, tmp_path)
    assert again == mdp and not again.prob.flags.writeable


# ---------------------------------------------------------------------- learning goes on


def test_tabular_learning_goes_on(tmp_path):
    mdp, options = awkward(start=0), dict(alpha=0.1, epsilon=0.2)
    whole = q_learning(mdp, 0.9, 20, rng=rng(), **options)
    generator = rng()
    half = q_learning(mdp, 0.9, 10, rng=generator, **options)
    found = kept({"run": half, "rng": generator}, tmp_path)
    rest = q_learning(mdp, 0.9, 10, Q0=found["run"].Q, rng=found["rng"], **options)
    same(rest.Q, whole.Q)
    same(rest.returns, whole.returns[10:])


@pytest.mark.parametrize("optimizer", [SGD(0.1), SGD(0.1, momentum=0.9), Adam()], ids=["SGD", "momentum", "Adam"])
@pytest.mark.parametrize("before", [0, 3])
def test_an_optimizer_goes_on(optimizer, before, tmp_path):
    net = MLP([2, 3, 1], optimizer=optimizer, rng=rng())
    gradients = rng(1).normal(size=(6, net.theta.size)).astype(np.float32)
    for g in gradients[:before]:
        net.step(g)
    again = kept(net, tmp_path)
    for g in gradients[before:]:
        net.step(g)
        again.step(g)
    same(net, again)
    assert again.weights[0].base is not None and np.shares_memory(again.weights[0], again.theta)


@pytest.mark.parametrize("world", ["CartPole-v1", "Pendulum-v1"])
@pytest.mark.parametrize("shared", [False, True])
def test_ppo_goes_on(world, shared, tmp_path):
    """The next update has the same bits, log_std, normaliser and moments included."""
    config = PPOConfig(**SMALL, normalise_observations=True, shared=shared)
    generator = rng()
    run = ppo(world, rng=generator, n_steps=96, config=config)
    found = kept({"agent": run.policy, "rng": generator}, tmp_path)
    one = ppo(world, rng=generator, n_steps=96, config=config, agent=run.policy)
    two = ppo(world, rng=found["rng"], n_steps=96, config=config, agent=found["agent"])
    same(one, two)
    assert one.policy is run.policy and one.policy.normaliser.n > 150
    if world == "Pendulum-v1":
        assert two.policy.log_std.any() and two.policy.log_std_optimizer.t >= 24


def test_trpo_goes_on(tmp_path):
    config = TRPOConfig(**SMALL)
    run = trpo("Pendulum-v1", rng=rng(), n_steps=64, config=config)
    again = kept(run.policy, tmp_path)
    same(*(trpo("Pendulum-v1", rng=rng(4), n_steps=64, config=config, agent=agent) for agent in (run.policy, again)))


def test_an_agent_must_fit():
    agent = ppo("CartPole-v1", rng=rng(), n_steps=32, config=PPOConfig(**SMALL)).policy
    options = dict(rng=rng(), n_steps=32)
    with pytest.raises(ValueError, match="^agent: .* must be"):
        ppo("Pendulum-v1", config=PPOConfig(**SMALL), agent=agent, **options)
    with pytest.raises(ValueError, match="^agent: .* must be"):
        ppo("Acrobot-v1", config=PPOConfig(**SMALL), agent=agent, **options)
    with pytest.raises(ValueError, match="^net: .* must be None"):
        ppo("CartPole-v1", config=PPOConfig(**SMALL), agent=agent, net=agent.net, **options)
    with pytest.raises(ValueError, match="^agent: .* must be"):
        ppo("CartPole-v1", config=PPOConfig(**SMALL, shared=True), agent=agent, **options)
    with pytest.raises(ValueError, match=r"^critic: .* must be None"):
        ppo("CartPole-v1", config=PPOConfig(**SMALL), agent=agent, critic=agent.critic, **options)


@pytest.mark.parametrize(
    "continuous, shared, n, critic, spread, message",
    [
        (False, False, 2, 2, 0, None), (True, False, 2, 2, 2, None), (False, True, 3, 0, 0, None),
        (False, False, 2, 2, 2, "got one with a critic and a log_std, must be one with shared = False, for discrete"),
        (True, False, 2, 2, 0, "got one with a critic and no log_std, must be one with shared = False, for continuous"),
        (False, False, 2, 0, 0, "got one with no critic and no log_std, must be one with shared = False"),
        (False, True, 3, 2, 0, "got one with a critic and no log_std, must be one with shared = True"),
        (False, False, 3, 2, 0, "its net: "), (False, False, 2, 3, 0, "its critic: "),
    ],
)  # fmt: skip
def test_an_agent_is_of_the_kind_that_is_learned(continuous, shared, n, critic, spread, message):
    """n outputs, a critic of so many inputs or none, a log_std of so many numbers or none."""

    def learner(*sizes):
        return MLP(sizes, optimizer=SGD(0.1), rng=rng())

    more = (np.zeros(spread), SGD(0.1)) if spread else ()
    agent = ActorCritic(learner(2, n), learner(critic, 1) if critic else None, *more)
    options = dict(n_steps=32, config=PPOConfig(**SMALL, shared=shared), agent=agent, rng=rng())
    if message is None:
        assert ppo(Counter(continuous=continuous), **options).policy is agent
    else:
        with pytest.raises(ValueError, match=f"^agent: {message}"):
            ppo(Counter(continuous=continuous), **options)


def module(width=3):
    import torch

    return torch.nn.Sequential(torch.nn.Linear(2, width), torch.nn.BatchNorm1d(width), torch.nn.Linear(width, 2))


def test_a_torch_network_goes_on(tmp_path):
    import torch

    from rlcore.torchnet import TorchNet

    torch.manual_seed(0)
    net, x = TorchNet(module(), lr=0.1), rng().normal(size=(5, 2)).astype(np.float32)
    net.forward(x)
    net.step(net.backward(np.ones((5, 2), np.float32)))
    agent = ActorCritic(net, MLP([2, 3, 1], rng=rng()), normaliser=Normaliser(2))
    again = kept(agent, tmp_path, modules=[module()])
    for one in (agent, again):
        one.net.forward(x)
        one.net.step(one.net.backward(np.ones((5, 2), np.float32)))
    np.testing.assert_array_equal(agent.net.theta, again.net.theta)
    np.testing.assert_array_equal(agent.net.forward(x), again.net.forward(x))
    assert again.net.module[1].num_batches_tracked == agent.net.module[1].num_batches_tracked
    with pytest.raises(ValueError, match="^modules: got too few, needs a torch.nn.Module"):
        load(tmp_path / "file.rl")
    with pytest.raises(ValueError, match="^modules: got Sequential, must be as the saved one"):
        load(tmp_path / "file.rl", modules=[module(4)])


ACTING = """
import sys
import numpy as np
from rlcore import load
agent = load(sys.argv[1])
print(agent.likeliest(np.array([0.1, 0.2, 0.3])).tolist())
print([name for name in ("numba", "torch", "gymnasium", "matplotlib") if name in sys.modules])
"""


def test_another_process_acts_alike(tmp_path):
    agent = ppo("Pendulum-v1", rng=rng(), n_steps=64, config=PPOConfig(**SMALL, normalise_observations=True)).policy
    save(agent, tmp_path / "agent.rl")
    command = [sys.executable, "-c", ACTING, str(tmp_path / "agent.rl")]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout == f"{agent.likeliest(np.array([0.1, 0.2, 0.3])).tolist()}\n[]\n"


# ---------------------------------------------------------------------- files


def test_numpy_opens_the_file_and_nothing_is_pickled(tmp_path):
    run = q_learning(random_walk(5), 0.9, 5, alpha=0.1, epsilon=0.2, rng=rng())
    save(run, tmp_path / "file.rl")
    with np.load(tmp_path / "file.rl", allow_pickle=False) as file:
        arrays = [file[name] for name in file.files if name != "rlcore.json"]
    assert any(np.array_equal(run.Q, array) for array in arrays)
    with zipfile.ZipFile(tmp_path / "file.rl") as archive:
        header = json.loads(archive.read("rlcore.json"))
    assert header["format"] == "rlcore" and header["version"] == 1 and header["content"]["kind"] == "Run"
    assert b"pickle" not in (tmp_path / "file.rl").read_bytes()


@pytest.mark.parametrize("thing", [object(), len, np.array([None]), {"f": lambda x: x}, Adam, {1, 2}, b"bytes"])
def test_what_cannot_be_kept_is_refused_and_leaves_the_old_file(thing, tmp_path):
    save([1], tmp_path / "file.rl")
    with pytest.raises(ValueError, match="^thing: got .*, must be"):
        save(thing, tmp_path / "file.rl")
    assert load(tmp_path / "file.rl") == [1] and [path.name for path in tmp_path.iterdir()] == ["file.rl"]


def test_a_disk_that_is_full_leaves_the_old_file(tmp_path, monkeypatch):
    save([1], tmp_path / "file.rl")

    def full(*args, **kwargs):
        raise OSError("no space left")

    monkeypatch.setattr(np.lib.format, "write_array", full)
    with pytest.raises(OSError, match="no space left"):
        save([np.zeros(3)], tmp_path / "file.rl")
    assert load(tmp_path / "file.rl") == [1] and [path.name for path in tmp_path.iterdir()] == ["file.rl"]


def test_cut_and_changed_files_are_refused(tmp_path):
    path = tmp_path / "file.rl"
    save(q_learning(random_walk(5), 0.9, 5, alpha=0.1, epsilon=0.2, rng=rng()), path)
    whole = path.read_bytes()
    for size in range(0, len(whole), 41):
        path.write_bytes(whole[:size])
        with pytest.raises(ValueError, match="^path: .*is cut, changed or of another program, must be what save wrote"):
            load(path)
    number = whole.index(b"NUMPY") + 200  # a byte of the first array's numbers
    path.write_bytes(whole[:number] + bytes([whole[number] ^ 1]) + whole[number + 1 :])
    with pytest.raises(ValueError, match="^path: .*is cut, changed"):
        load(path)


def test_foreign_and_newer_files_are_refused(tmp_path):
    path = tmp_path / "file.rl"
    for content in (b"", b"text", b"\x80\x04K\x01."):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="of another program, must be what save wrote"):
            load(path)
    with open(path, "wb") as file:
        np.savez(file, a=np.zeros(3))
    with pytest.raises(ValueError, match="of another program"):
        load(path)
    headers = [
        {"format": "other", "version": 1}, [], 3, {"format": "rlcore", "version": 1},
        {"format": "rlcore", "version": 1, "content": {"kind": "os.system", "fields": {}}},
        {"format": "rlcore", "version": 1, "content": {"array": 7}},
    ]  # fmt: skip
    for header in headers:
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("rlcore.json", json.dumps(header))
        with pytest.raises(ValueError, match="of another program"):
            load(path)
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("rlcore.json", json.dumps({"format": "rlcore", "version": 2, "content": {"new": 1}}))
    with pytest.raises(ValueError, match="^path: .* is of version 2, must be at most 1: a newer rlcore reads it"):
        load(path)
    with pytest.raises(ValueError, match="must be a file that is there"):
        load(tmp_path / "nothing.rl")


def test_improve_of_a_kept_agent_is_the_same_update(tmp_path):
    """Without an environment: the data of one rollout, once more."""
    from rlcore.core.rollouts import collect, vector_env

    config = PPOConfig(**SMALL)
    run = ppo("CartPole-v1", rng=rng(), n_steps=32, config=config)
    env = vector_env("CartPole-v1")
    s, _ = env.reset(seed=1)
    rollout, _ = collect(env, run.policy, s, np.zeros(1, bool), 32, rng=rng(2))
    again = kept(run.policy, tmp_path)
    for agent in (run.policy, again):
        improve(agent, learning_data(agent, rollout, config), config, 1.0, rng(3))
    same(run.policy, again)


def test_a_file_beside_it_is_left_alone(tmp_path):
    (tmp_path / "mine.part").write_text("the user's own")
    save([1], tmp_path / "mine")
    long = tmp_path / ("n" * 250)
    save([2], long)
    assert load(tmp_path / "mine") == [1] and load(long) == [2]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine", "mine.part", long.name]
    assert (tmp_path / "mine.part").read_text() == "the user's own"


@pytest.mark.parametrize("version", [0, "x", None, True, 1.0])
def test_a_version_that_never_was_is_another_program(tmp_path, version):
    save([1], tmp_path / "a")
    with zipfile.ZipFile(tmp_path / "a") as old, zipfile.ZipFile(tmp_path / "b", "w") as new:
        header = json.loads(old.read("rlcore.json"))
        new.writestr("rlcore.json", json.dumps(header | {"version": version}))
    with pytest.raises(ValueError, match="is cut, changed or of another program"):
        load(tmp_path / "b")


def test_files_changed_anywhere_are_refused_or_read(tmp_path):
    """Whatever byte is another: a ValueError, or what was saved."""
    save(q_learning(random_walk(3), 0.9, 2, alpha=0.5, epsilon=0.1, rng=rng()), tmp_path / "a")
    whole, flips = (tmp_path / "a").read_bytes(), rng()
    for place in flips.integers(len(whole), size=300):
        broken = bytearray(whole)
        broken[place] ^= int(flips.integers(1, 256))
        (tmp_path / "b").write_bytes(broken)
        try:
            load(tmp_path / "b")
        except ValueError as error:
            assert str(error).startswith("path: ")


def test_a_file_that_may_not_be_read_is_not_called_broken(tmp_path, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", str(path))

    save([1], tmp_path / "a")
    monkeypatch.setattr(zipfile, "ZipFile", refuse)  # root may read everything
    with pytest.raises(ValueError, match="must be a file that may be read"):
        load(tmp_path / "a")
