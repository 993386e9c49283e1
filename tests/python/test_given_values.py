"""Promise: seeds, actions and step counts mean the same wherever they are given, whatever package
their type comes from; what cannot be meant is refused by name, before any work."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
import rodgym
import rodgym.evaluation
from conftest import FINS, SWING_UP, assert_same
from gymnasium.vector import AutoresetMode
from rodgym.errors import ParameterError, ShapeError
from rodgym.evaluation import PolicyError, evaluate, record

SHORT = {"max_episode_steps": 3}


def zero_dimensional():
    """A seed of 7 in types other than `int`."""
    values = [np.int64(7), np.uint8(7), np.array(7)]
    try:
        import torch
    except ImportError:
        return values
    return [*values, torch.tensor(7)]


@pytest.mark.parametrize("seed", zero_dimensional(), ids=repr)
def test_a_seed_is_a_seed_in_every_integer_type(seed):
    single, batch = gym.make(SWING_UP), gym.make_vec(SWING_UP, num_envs=2)
    assert_same(single.reset(seed=seed), single.reset(seed=7))
    assert_same(batch.reset(seed=seed), batch.reset(seed=7))
    assert_same(batch.reset(seed=[seed, None])[0][0], batch.reset(seed=7)[0][0])
    # What has no seed of its own takes one from NumPy's generator: that is seeded too.
    batches = [gym.make_vec(SWING_UP, num_envs=2) for _ in range(2)]
    for one, given in zip(batches, (seed, 7), strict=True):
        one.reset(seed=given)
    assert batches[0].np_random.integers(2**60) == batches[1].np_random.integers(2**60)
    assert evaluate("zero", SWING_UP, [seed], env_kwargs=SHORT).seeds == (7,)
    played = record("zero", SWING_UP, seed, env_kwargs=SHORT)
    assert type(played.seed) is int
    assert_same(played.rewards, record("zero", SWING_UP, 7, env_kwargs=SHORT).rewards)


@pytest.mark.parametrize("seed", zero_dimensional(), ids=repr)
def test_a_seed_is_a_seed_for_stable_baselines(seed):
    sb3 = pytest.importorskip("rodgym.sb3")
    env = sb3.RodVecEnv(SWING_UP, 2)
    for given in (seed, 7):
        assert env.seed(given) == [7, 8]
    first = sb3.make_vec_env(SWING_UP, 2, seed=seed).reset()
    assert_same(first, sb3.make_vec_env(SWING_UP, 2, seed=7).reset())


@pytest.mark.parametrize(
    "seed", [np.array(-1), np.array(7.0), np.array([7, 8.5]), b"ab", {7, 8}, {7: 1, 8: 2}], ids=repr
)
def test_what_is_no_seed_of_a_batch_is_refused_and_changes_nothing(seed):
    """Bytes were two seeds, a set was seeds in an order that nobody chose."""
    batch = gym.make_vec(SWING_UP, num_envs=2)
    batch.reset(seed=1)
    before = batch.get_state()
    with pytest.raises(ParameterError, match="seed = "):
        batch.reset(seed=seed)
    assert batch.get_state() == before
    with pytest.raises(ParameterError, match="seed"):
        evaluate("zero", SWING_UP, seed, env_kwargs=SHORT)
    with pytest.raises(ParameterError, match="seed = "):
        record("zero", SWING_UP, seed, env_kwargs=SHORT)


def test_sequences_arrays_and_iterators_are_seeds_in_their_order():
    batch = gym.make_vec(SWING_UP, num_envs=2)
    wanted = batch.reset(seed=[7, 8])
    for seed in ((7, 8), range(7, 9), np.array([7, 8]), iter([7, 8])):
        assert_same(batch.reset(seed=seed), wanted)
    assert evaluate("zero", SWING_UP, np.arange(7, 9), env_kwargs=SHORT).seeds == (7, 8)


def tensors():
    """The actions 0.5 and -0.25, which every type has exactly."""
    torch = pytest.importorskip("torch")
    for name in ("float16", "bfloat16", "float32", "float64"):
        for gradient in (False, True):
            yield torch.tensor([[0.5], [-0.25]], dtype=getattr(torch, name), requires_grad=gradient)


def test_tensors_are_actions_by_their_values():
    """Those of bfloat16 and those that carry gradients are no arrays of NumPy."""
    pytest.importorskip("stable_baselines3")
    from rodgym.sb3 import RodVecEnv

    def play(action):
        single, batch, sb3 = gym.make(SWING_UP), gym.make_vec(SWING_UP, num_envs=2), None
        sb3 = RodVecEnv(SWING_UP, 2)
        single.reset(seed=0), batch.reset(seed=0), sb3.seed(0), sb3.reset()
        return single.step(action[0]), batch.step(action), sb3.step(action)

    wanted = play(np.array([[0.5], [-0.25]], np.float32))
    for action in tensors():
        assert_same(play(action), wanted)


def test_tensors_are_arrays_of_numbers_everywhere():
    torch = pytest.importorskip("torch")
    env = gym.make(SWING_UP)
    observation, _ = env.reset(seed=0)
    law = rodgym.baselines.Lqr.for_env(env)
    angles = np.full(6, 0.5)
    for dtype in (torch.float64, torch.bfloat16):
        rod = rodgym.sim.Pendulum()
        rod.set_angles(torch.tensor(angles, dtype=dtype, requires_grad=True))
        np.testing.assert_allclose(rod.angles, angles, atol=1e-15)
    carrying = torch.tensor(observation, requires_grad=True)
    assert_same(law.predict(carrying)[0], law.predict(observation)[0])
    with pytest.raises(ShapeError, match="angles must be an array of numbers"):
        rodgym.sim.Pendulum().set_angles([1j] * 6)


class Told:
    """A policy that wants (n, d), as Stable-Baselines3's own are called, and answers so."""

    def __init__(self, answer):
        self.answer = answer

    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        n, _ = observation.shape
        return self.answer(n)


def test_a_policy_sees_rows_in_evaluations_and_recordings():
    def same(n):
        return np.full((n, 1), 0.5, np.float32), None

    wanted = evaluate(Told(same), SWING_UP, [3], env_kwargs=SHORT)
    played = record(Told(same), SWING_UP, 3, env_kwargs=SHORT)
    assert played.rewards.sum() == wanted.columns["return"][0]
    assert played.actions.shape == (3, 1) and played.policy == wanted.policy == "Told"


def test_actions_with_gradients_are_evaluated_by_value():
    torch = pytest.importorskip("torch")
    wanted = evaluate(Told(lambda n: (np.full((n, 1), 0.5), None)), SWING_UP, [3], env_kwargs=SHORT)
    for kind in (torch.float32, torch.bfloat16):
        law = Told(lambda n, kind=kind: (torch.full((n, 1), 0.5, dtype=kind).requires_grad_(), 0))
        assert_same(evaluate(law, SWING_UP, [3], env_kwargs=SHORT).columns, dict(wanted.columns))
        assert record(law, SWING_UP, 3, env_kwargs=SHORT).actions.tolist() == [[0.5]] * 3


@pytest.mark.parametrize(
    ("answer", "named"),
    [
        (lambda n: np.zeros((n, 1)), r"(?s)predict returned array.*\(actions, state\) is needed"),
        (lambda n: (np.zeros(n), None), r"actions of shape \(\d,\) for observations of shape \("),
        (lambda n: (np.zeros((n + 1, 1)), None), "one row of actions a row"),
    ],
)
def test_what_a_policy_must_not_answer_is_told(answer, named):
    """Two episodes took the rows of an array for actions and state."""
    with pytest.raises(PolicyError, match=named):
        evaluate(Told(answer), SWING_UP, range(2), env_kwargs=SHORT)
    with pytest.raises(PolicyError, match=named):
        record(Told(answer), SWING_UP, 0, env_kwargs=SHORT)


def callers():
    """All that plays episodes to their end, as functions of `env_kwargs`."""

    def compare(kwargs):
        report = pytest.importorskip("rodgym.report.comparison")
        from rodgym.runs import Run

        report.compare([report.Entrant("zero", "zero")], SWING_UP, Run("x"), env_kwargs=kwargs)

    def train(kwargs):
        pytest.importorskip("stable_baselines3")
        from rodgym.runs import Run
        from rodgym.training import train

        train(SWING_UP, Run("x"), env_kwargs=kwargs)

    def study(kwargs):
        from rodgym.study.case import run_case

        below = {f"env.{key}": value for key, value in kwargs.items()}
        run_case({"env": SWING_UP, "seeds": 1, "policy": "zero", **below})

    return {
        "evaluate": lambda kwargs: evaluate("zero", SWING_UP, [0], env_kwargs=kwargs),
        "record": lambda kwargs: record("zero", SWING_UP, 0, env_kwargs=kwargs),
        "compare": compare,
        "train": train,
        "study": study,
    }


REFUSED = [
    ({"max_episode_steps": -1}, "max_episode_steps = -1 is not allowed.* at least 1"),
    ({"max_episode_steps": 0}, "max_episode_steps = 0"),
    ({"max_episode_steps": 1.5}, "max_episode_steps = 1.5"),
    ({"max_episode_steps": True}, "max_episode_steps = True"),
    ({"autoreset_mode": "SameStep"}, "'autoreset_mode' is not allowed here"),
    ({"autoreset_mode": AutoresetMode.DISABLED}, "'autoreset_mode' is not allowed here"),
    ({"num_envs": 2}, "'num_envs' is not allowed here"),
    ({"vectorization_mode": "sync"}, "'vectorization_mode'"),
    ({"env_id": FINS[0]}, "'env_id' is not allowed here"),
]


@pytest.mark.parametrize("caller", callers())
@pytest.mark.parametrize(("kwargs", "named"), REFUSED, ids=str)
def test_episodes_have_an_end_and_conditions_of_the_evaluation(
    caller, kwargs, named, tmp_path, monkeypatch
):
    """The first never came back; the fifth ended in NumPy's error about shapes; the last played
    another environment under this one's name."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ParameterError, match=named):
        callers()[caller](kwargs)
    assert not list(tmp_path.iterdir())


def test_whole_numbers_of_numpy_limit_an_episode():
    for steps in (np.int64(3), np.array(3)):
        kwargs = {"max_episode_steps": steps}
        assert evaluate("zero", SWING_UP, [0], env_kwargs=kwargs).mean("length") == 0.03
        assert len(record("zero", SWING_UP, 0, env_kwargs=kwargs).time) == 3


def test_an_environment_of_ones_own_without_a_limit_is_refused():
    name = "test/NoEnd-v0"
    gym.register(
        id=name,
        entry_point="rodgym.envs:PendulumEnv",
        vector_entry_point="rodgym.vector:RodVectorEnv",
        kwargs={"env_id": "rodgym/PendulumSwingUp-v0", "max_episode_steps": -1},
    )
    try:
        with pytest.raises(ParameterError, match="without a time limit"):
            evaluate("zero", name, [0])
    finally:
        gym.registry.pop(name)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({"frame_rate": -1}, "frame_rate = -1"),
        ({"frame_rate": float("nan")}, "frame_rate = nan"),
        ({"frame_rate": "a"}, "frame_rate = 'a'"),
        ({"max_seconds": -1}, "max_seconds = -1"),
        ({"max_seconds": float("nan")}, "max_seconds = nan"),
        ({"max_seconds": None}, "max_seconds = None"),
        ({"frame_rate": 5, "env_kwargs": {"render_mode": None}}, "render_mode = None"),
        ({"seed": None}, "seed = None"),
    ],
    ids=str,
)
def test_what_a_recording_cannot_mean_is_refused(arguments, named):
    with pytest.raises(ParameterError, match=named):
        record("zero", SWING_UP, **{"seed": 0, "env_kwargs": SHORT, **arguments})


def test_what_a_study_chooses_is_refused_when_it_is_read():
    from rodgym.study.spec import StudyError, parse

    content = {"env": SWING_UP, "sweep": {"policy": ["zero"]}}
    with pytest.raises(StudyError, match=r"'env\.num_threads' is not allowed"):
        parse({**content, "fixed": {"env.num_threads": 2}}, "x")
    with pytest.raises(ParameterError, match="max_episode_steps = -1"):
        parse({**content, "fixed": {"env.max_episode_steps": -1}}, "x")


def test_a_server_takes_the_same_values():
    from remote_helpers import need_server, serving

    need_server()
    import rodgym.remote

    with serving() as server:
        local = gym.make_vec(SWING_UP, num_envs=2)
        remote = rodgym.remote.connect(server.address, SWING_UP, 2)
        single = gym.make("rodgym/Remote-v0", server=server.address, env_id=SWING_UP)
        twin = gym.make(SWING_UP).unwrapped
        for seed in (np.array(7), [np.array(7), 8], np.array([7, 8])):
            assert_same(remote.reset(seed=seed), local.reset(seed=seed))
        assert_same(single.reset(seed=np.array(7)), twin.reset(seed=7))
        beyond = np.array([[1e300], [-1e300]])
        for action in [beyond, *tensors()]:
            assert_same(remote.step(action), local.step(action))
            assert_same(single.unwrapped.step(action[0]), twin.step(action[0]))
        for action in ([["x"]] * 2, [[1j]] * 2, np.zeros((3, 1)), None):
            messages = []
            for env in (remote, local):
                with pytest.raises(ShapeError) as caught:
                    env.step(action)
                messages.append(str(caught.value))
            assert messages[0] == messages[1]
        with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'"):
            rodgym.remote.connect(server.address, SWING_UP, 2, frameskip=1)
        assert remote.autoreset_mode is AutoresetMode.NEXT_STEP
        remote.close(), single.close()
