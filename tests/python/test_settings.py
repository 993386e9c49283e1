"""Promise: parameters and ranges that are changed between episodes are those of the next episode,
as if the environment had been made with them, alone, in a batch, under SB3 and on a server;
snapshots keep them. A setting that would do nothing is refused, and names the call that does.
"""

from __future__ import annotations

import copy
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import BALANCE, FINS, SWING_UP, actions_for, assert_same
from rodgym import errors
from rodgym.vector import RodVectorEnv

RANGES = {"width": (0.006, 0.009), "density": ("log_uniform", 1200.0, 1800.0)}


def play(env: Any, actions: np.ndarray) -> list[Any]:
    return [env.step(action) for action in actions]


@contextmanager
def unchanged(env: Any) -> Iterator[None]:
    before = env.get_state()
    yield
    assert env.get_state() == before


def test_a_changed_environment_is_one_made_so(rng):
    """The stepper stays the one that it was made with, so it is named here."""
    actions = actions_for(rng, 20, 1)[:, 0]
    kept = {"stepper": "implicit"}
    for settings, keywords in [
        (lambda e: e.set_parameters(width=0.0081, gravity=0), {"width": 0.0081, "gravity": 0.0}),
        (lambda e: e.set_randomize(RANGES), {"randomize": RANGES}),
        (
            lambda e: (e.set_randomize(RANGES), e.set_parameters(width=0.007)),
            {"width": 0.007, "randomize": {"density": RANGES["density"]}},
        ),
    ]:
        env = gym.make(SWING_UP, **kept).unwrapped
        env.reset(seed=0)
        play(env, actions)
        settings(env)
        made = gym.make(SWING_UP, **kept, **keywords).unwrapped
        for seed in (7, None):
            assert_same(env.reset(seed=seed), made.reset(seed=seed))
            assert_same(play(env, actions), play(made, actions))
        for name, value in keywords.items():
            if name != "randomize":
                assert env.parameters[name] == getattr(env, name) == value


def test_nothing_changes_before_the_next_episode(rng):
    env, twin = (gym.make(SWING_UP).unwrapped for _ in range(2))
    actions = actions_for(rng, 10, 1)[:, 0]
    for one in (env, twin):
        one.reset(seed=1)
    env.set_parameters(torque_limit=0.02)
    assert env.parameters["torque_limit"] == env.torque_limit == 0.05
    assert_same(play(env, actions), play(twin, actions))
    assert env.reset()[1]["parameters"]["torque_limit"] == 0.02
    # What a reset is told holds for that episode.
    exact = {"parameters": {"torque_limit": 0.04}}
    assert env.reset(options=exact)[1]["parameters"]["torque_limit"] == 0.04
    assert env.reset()[1]["parameters"]["torque_limit"] == 0.02


def test_default_draws_of_a_task_can_be_ended():
    env = gym.make(FINS[0]).unwrapped
    env.set_parameters(youngs_modulus=1e6)
    drawn = {env.reset(seed=s)[1]["parameters"]["youngs_modulus"] for s in range(3)}
    assert drawn == {1e6}
    env.set_randomize({"youngs_modulus": (2e5, 3e5)})
    drawn = {env.reset(seed=s)[1]["parameters"]["youngs_modulus"] for s in range(3)}
    assert len(drawn) == 3 and all(2e5 <= x <= 3e5 for x in drawn)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize("num_envs", [3, 19])
def test_a_batch_is_as_many_single_environments(mode, num_envs, rng):
    """Widths of their own, ranges, autoresets: to the bit."""
    kwargs = {"max_episode_steps": 5}
    batch = gym.make_vec(SWING_UP, num_envs=num_envs, autoreset_mode=mode, **kwargs)
    theirs = gym.vector.SyncVectorEnv(
        [lambda: gym.make(SWING_UP, **kwargs) for _ in range(num_envs)],
        autoreset_mode=gym.vector.AutoresetMode(mode),
    )
    widths = np.linspace(0.006, 0.008, num_envs)
    assert_same(batch.reset(seed=4), theirs.reset(seed=4))
    for round_ in range(3):
        if round_ == 1:
            batch.set_parameters(width=widths, length=0.31)
            for env, width in zip(theirs.envs, widths, strict=True):
                env.unwrapped.set_parameters(width=width, length=0.31)
        if round_ == 2:
            batch.set_randomize({"density": (1400.0, 1600.0)})
            theirs.call("set_randomize", {"density": (1400.0, 1600.0)})
        for action in actions_for(rng, 7, num_envs):
            assert_same(batch.step(action), theirs.step(action))
    assert batch.get_attr("width") == tuple(widths)
    assert batch.call("parameters")[1]["length"] == 0.31


def test_members_of_a_batch_have_settings_of_their_own():
    batch = gym.make_vec(SWING_UP, num_envs=12)
    batch.reset(seed=0)
    batch.members[9].set_parameters(width=0.0065)
    widths = batch.reset()[1]["parameters"]["width"]
    assert widths.tolist() == [0.007] * 9 + [0.0065] + [0.007] * 2


def keepers() -> dict[str, Callable[[Any], Any]]:
    def snapshot(env: Any) -> Any:
        twin = gym.make(SWING_UP).unwrapped
        twin.set_state(env.get_state())
        return twin

    return {
        "pickle": lambda env: pickle.loads(pickle.dumps(env)),
        "deepcopy": copy.deepcopy,
        "snapshot": snapshot,
    }


@pytest.mark.parametrize("keeper", keepers())
def test_snapshots_and_pickles_keep_settings(keeper):
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    env.set_randomize({"width": (0.0065, 0.0075)})
    twin = keepers()[keeper](env)
    for _ in range(3):
        ours, theirs = env.reset(), twin.reset()
        assert_same(theirs, ours)
        assert 0.0065 <= ours[1]["parameters"]["width"] <= 0.0075
    plain = gym.make(SWING_UP).unwrapped
    plain.reset(seed=0)
    env.set_state(plain.get_state())
    assert_same(env.reset(), plain.reset())


def test_snapshots_of_another_layout_are_refused_by_their_version():
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    state = env.get_state()
    old = state[:6] + b"\x03\x00" + state[8:]
    with pytest.raises(errors.SnapshotError, match="version 3, but this library reads 4"):
        env.set_state(old)


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda e: e.set_parameters(widht=0.007), errors.ParameterError, "'widht'; known.*width"),
        (lambda e: e.set_parameters(nodes=9), errors.ParameterError, "'nodes'; known"),
        (lambda e: e.set_parameters(width=-1.0), errors.ParameterError, r"width = -1\.0.*0\.0005"),
        (lambda e: e.set_parameters(width=float("nan")), errors.ParameterError, "width = nan"),
        (lambda e: e.set_parameters(width=None), errors.ParameterError, "width = None"),
        (lambda e: e.set_parameters(width=True), errors.ParameterError, "width = True"),
        (lambda e: e.set_parameters(width="x"), errors.ParameterError, "width = 'x'"),
        (lambda e: e.set_parameters(width=1j), errors.ParameterError, "width = 1j"),
        (lambda e: e.set_parameters(width=[]), errors.ParameterError, r"width = \[\]"),
        (lambda e: e.set_parameters(width=[0.007] * 3), errors.ShapeError, r"width.*\(3,\)"),
        (lambda e: e.set_parameters(width=[[0.007]]), errors.ParameterError, "width"),
        (lambda e: e.set_parameters(length=0.3, width=9.0), errors.ParameterError, "width"),
        (
            lambda e: e.set_parameters(length=0.05, youngs_modulus=3e7),
            errors.ParameterError,
            "verlet stepper is",
        ),
        (lambda e: e.set_randomize(None), errors.ParameterError, "ranges = None"),
        (lambda e: e.set_randomize({"widht": (1, 2)}), errors.ParameterError, "widht"),
        (lambda e: e.set_randomize({"width": 0.007}), errors.ParameterError, r"randomize\['width'"),
        (lambda e: e.set_randomize({"width": (2, 1)}), errors.ParameterError, r"low <= high"),
        (lambda e: e.set_randomize({"width": (0.01, 1.0)}), errors.ParameterError, r"low <= high"),
        (lambda e: e.set_randomize({"width": (0.0, np.inf)}), errors.ParameterError, "inf"),
        (
            lambda e: e.set_randomize({"length": (0.05, 0.3), "youngs_modulus": (1e7, 3e7)}),
            errors.ParameterError,
            "verlet",
        ),
    ],
)
def test_what_is_refused_changes_nothing(call, error, named):
    single, batch = gym.make(SWING_UP).unwrapped, gym.make_vec(SWING_UP, num_envs=2)
    for env in (single, batch):
        env.reset(seed=0)
        with unchanged(env), pytest.raises(error, match=named):
            call(env)


def test_one_wrong_value_of_a_batch_refuses_all():
    batch = gym.make_vec(SWING_UP, num_envs=3)
    batch.reset(seed=0)
    with unchanged(batch), pytest.raises(errors.ParameterError, match=r"width\[2\] = 9"):
        batch.set_parameters(width=[0.007, 0.008, 9.0])


def test_reset_options_are_checked_with_the_settings_of_each():
    """Short rods need shorter Verlet steps, stiff ones too."""
    batch = gym.make_vec(SWING_UP, num_envs=3, stepper="verlet", physics_dt=2e-4)
    batch.reset(seed=0)
    batch.members[1].set_parameters(length=0.1)
    options = {"parameters": {"youngs_modulus": 1.6e7}}
    with unchanged(batch), pytest.raises(errors.ParameterError, match="verlet"):
        batch.reset(options=options)
    mask = np.array([True, False, True])
    batch.reset(options={**options, "reset_mask": mask})


def faces() -> dict[str, Callable[[], Any]]:
    def member() -> Any:
        return gym.make_vec(SWING_UP, num_envs=2).members[1]

    return {
        "single": lambda: gym.make(SWING_UP).unwrapped,
        "wrapped": lambda: gym.make(SWING_UP),
        "member": member,
        "batch": lambda: gym.make_vec(SWING_UP, num_envs=2),
    }


@pytest.mark.parametrize(
    ("name", "value", "told"),
    [
        ("width", 0.0081, r"set_parameters\(width=...\)"),
        ("gravity", 0, r"set_parameters\(gravity=...\)"),
        ("nodes", 9, "give nodes=.* when it is made"),
        ("control_dt", 0.02, "give control_dt=.* when it is made"),
        ("randomize", {}, "set_randomize"),
        ("colour", "red", "set_parameters and set_randomize"),
    ],
)
@pytest.mark.parametrize("face", faces())
def test_setting_what_is_no_attribute_is_refused(face, name, value, told):
    env = faces()[face]()
    if face == "wrapped":
        if name == "colour":
            pytest.skip("a wrapper keeps what is its own")
        with pytest.raises(errors.SettingError, match=told):
            env.set_wrapper_attr(name, value)
        return
    with pytest.raises(errors.SettingError, match=told) as refused:
        setattr(env, name, value)
    assert isinstance(refused.value, AttributeError)
    if face == "batch":
        with pytest.raises(errors.SettingError, match=told):
            env.set_attr(name, value)
        with pytest.raises(errors.SettingError, match=told):
            env.set_attr(name, [value, value])


def test_what_libraries_set_can_be_set():
    env = gym.make(SWING_UP).unwrapped
    env.spec, env.metadata = copy.deepcopy(env.spec), {**env.metadata, "mine": 1}
    env.render_mode = "rgb_array"
    env.np_random, env._np_random_seed = np.random.default_rng(3), 3
    env.action_space = env.observation_space = gym.spaces.Box(-1.0, 1.0, (1,))
    batch = gym.make_vec(SWING_UP, num_envs=2)
    batch.spec, batch.metadata = copy.deepcopy(batch.spec), {}
    batch.single_action_space = batch.action_space = gym.spaces.Box(-1.0, 1.0, (1,))
    batch.closed, batch.num_threads = False, 1
    batch.np_random, batch._np_random_seed = np.random.default_rng(3), 3
    batch.set_attr("render_mode", ["rgb_array", None])
    assert batch.get_attr("render_mode") == ("rgb_array", None)


class Mine(rodgym.envs.PendulumEnv):
    def __init__(self) -> None:
        super().__init__(SWING_UP)
        self.counter = 0


def test_a_class_of_ones_own_has_attributes_of_its_own():
    env = Mine()
    env.counter += 1
    assert env.counter == 1
    with pytest.raises(errors.SettingError, match=r"set_parameters\(width"):
        env.width = 0.008


def test_bare_machines_keep_what_they_were_made_with():
    rod = rodgym.sim.Pendulum()
    with pytest.raises(errors.SettingError, match="give gravity="):
        rod.gravity = 0.0
    with pytest.raises(errors.SettingError, match="cannot be set"):
        rod.time = 3.0


def test_sb3_batches_have_the_calls_and_refuse_the_rest():
    sb3 = pytest.importorskip("rodgym.sb3")
    env = sb3.make_vec_env(BALANCE, n_envs=3, seed=0, max_episode_steps=4)
    env.reset()
    inner = env.venv
    for target, name, value in [(inner, "width", 0.008), (inner, "gravity", 0)]:
        with pytest.raises(errors.SettingError, match=f"set_parameters.{name}"):
            setattr(target, name, value)
        with pytest.raises(errors.SettingError, match=f"set_parameters.{name}"):
            env.set_attr(name, value)
    env.set_parameters(width=[0.0068, 0.007, 0.0072])
    env.env_method("set_parameters", indices=[1], gravity=9.0)
    env.env_method("set_randomize", {"density": (1500.0, 1501.0)}, indices=2)
    for _ in range(5):
        env.step(np.zeros((3, 1), dtype=np.float32))
    begun = [info["parameters"] for info in inner.reset_infos]
    assert [p["width"] for p in begun] == [0.0068, 0.007, 0.0072] == env.get_attr("width")
    assert [p["gravity"] for p in begun] == [9.81, 9.0, 9.81]
    assert begun[0]["density"] == 1500.0 < begun[2]["density"] < 1501.0


def test_options_that_wait_for_a_reset_say_so():
    sb3 = pytest.importorskip("rodgym.sb3")
    env = sb3.RodVecEnv(SWING_UP, 2)
    env.seed(0)
    env.reset()
    still = np.zeros((2, 1), dtype=np.float32)
    env.set_options({"parameters": {"width": 0.008}})
    with pytest.warns(UserWarning, match=r"waits for reset\(\).*set_parameters"):
        env.step(still)
    env.step(still)
    env.reset()
    assert env.get_attr("width") == [0.008, 0.008]
    env.set_options({"parameters": {"width": 0.008}})
    env.reset()
    env.step(still)


@pytest.fixture(scope="module")
def server() -> Iterator[Any]:
    import remote_helpers

    remote_helpers.need_server()
    served = remote_helpers.Server()
    yield served
    served.stop()


def test_remote_settings_are_the_local_ones(server, rng):
    from rodgym.remote import RemoteEnv, RemoteVectorEnv

    n, kwargs = 20, {"max_episode_steps": 5}
    ours, theirs = (
        RodVectorEnv(SWING_UP, n, **kwargs),
        RemoteVectorEnv(server.address, SWING_UP, n, **kwargs),
    )
    widths = np.linspace(0.006, 0.008, n)
    for env in (ours, theirs):
        env.reset(seed=2)
        env.set_parameters(width=widths, length=0.31)
        env.members[3].set_randomize(RANGES)
    for action in actions_for(rng, 12, n):
        assert_same(theirs.step(action), ours.step(action))
    assert theirs.get_state() == ours.get_state()
    for call, error, named in [
        (lambda e: e.set_parameters(widht=1.0), errors.ParameterError, "widht"),
        (lambda e: e.set_parameters(width=float("nan")), errors.ParameterError, "width = nan"),
        (lambda e: e.set_parameters(width=[0.007] * 19 + [9.0]), errors.ParameterError, "19"),
        (lambda e: e.set_parameters(width=[0.007] * 2), errors.ShapeError, r"\(2,\)"),
        (lambda e: e.set_randomize({"width": (2, 1)}), errors.ParameterError, "low <= high"),
        (lambda e: setattr(e, "width", 0.007), errors.SettingError, "set_parameters"),
    ]:
        for env in (ours, theirs):
            with unchanged(env), pytest.raises(error, match=named):
                call(env)
    single, twin = RemoteEnv(server.address, SWING_UP), gym.make(SWING_UP).unwrapped
    for env in (single, twin):
        env.reset(seed=0)
        env.set_parameters(width=0.0065)
    assert_same(single.reset(), twin.reset())
    assert single.width == 0.0065
    theirs.close()
    single.close()
