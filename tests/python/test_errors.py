"""Promise: bad input is refused with an error that names it, and the state stays as it was."""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from conftest import SWING_UP
from rodgym import errors

NAN, INF = float("nan"), float("inf")


@pytest.mark.parametrize(
    ("kwargs", "named"),
    [
        ({"width": -0.001}, "width"),
        ({"width": 0.0}, "width"),
        ({"width": NAN}, "width = nan"),
        ({"width": INF}, "width = inf"),
        ({"width": "thick"}, "width"),
        ({"width": object()}, "width"),
        ({"widht": 0.007}, "widht"),
        ({"nodes": 1}, "nodes"),
        ({"nodes": 1002}, "nodes"),
        ({"nodes": 10**30}, "nodes"),
        ({"nodes": 6.5}, "nodes"),
        ({"youngs_modulus": -1.0}, "youngs_modulus"),
        ({"density": 0}, "density"),
        ({"bending_damping": -1e-4}, "bending_damping"),
        ({"torque_limit": -0.05}, "torque_limit"),
        ({"control_dt": 0.0}, "control_dt"),
        ({"physics_dt": 3e-3}, "physics_dt"),
        ({"physics_dt": 1e-3, "stepper": "verlet"}, "physics_dt"),
        ({"stepper": "euler"}, "stepper"),
        ({"observation": "all"}, "observation"),
        ({"randomize": {"width": (0.009, 0.006)}}, "width"),
        ({"randomize": {"width": (0.006,)}}, "width"),
        ({"randomize": {"colour": (0, 1)}}, "colour"),
        ({"randomize": {"width": (0.006, NAN)}}, "nan"),
        ({"sensor_noise": {"angle": -1.0}}, "angle"),
        ({"sensor_noise": {"smell": 1.0}}, "smell"),
        ({"start_angle": (1.0, -1.0)}, "start_angle"),
    ],
)
@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_keywords(make, kwargs, named):
    with pytest.raises(errors.ParameterError, match=named) as caught:
        make(SWING_UP, **kwargs)
    assert isinstance(caught.value, rodgym.RodgymError)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    ("kwargs", "named"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"num_envs": -1}, "num_envs = -1 is not allowed: it must be an integer from 1 to 1048576"),
        ({"num_envs": True}, "num_envs = True"),
        ({"num_envs": "3"}, "num_envs = '3'"),
        ({"env_id": 3}, "env_id = 3"),
        ({"num_envs": 1.5}, "num_envs = 1.5"),
        ({"num_threads": 0}, "num_threads"),
        ({"num_threads": -2}, "num_threads = -2 is not allowed: it must be an integer from 1"),
        ({"autoreset_mode": "Sometimes"}, "autoreset_mode = 'Sometimes'"),
        ({"max_episode_steps": 0}, "max_episode_steps"),
        ({"max_episode_steps": -7}, "max_episode_steps = -7.*at least 1, None or -1"),
        ({"render_mode": "ascii"}, "render_mode = 'ascii'"),
        ({"render_size": 3}, "render_size = 3"),
        ({"render_size": (64.0, 48.0)}, "render_size"),
        ({"render_size": (64, 48, 32)}, "render_size"),
        ({"render_size": (-1, 48)}, "render_size"),
        ({"render_size": (10**9, 48)}, "from 16 to 8192"),
    ],
)
def test_keywords_of_batches(kwargs, named):
    with pytest.raises(errors.ParameterError, match=named):
        rodgym.vector.RodVectorEnv(**{"env_id": SWING_UP, **kwargs})


def sb3_batch(**kwargs):
    pytest.importorskip("stable_baselines3")
    return rodgym.sb3.make_vec_env(SWING_UP, **kwargs)


@pytest.mark.parametrize(
    "make",
    [
        lambda **kwargs: gym.make(SWING_UP, **kwargs),
        lambda **kwargs: gym.make_vec(SWING_UP, **kwargs),
        lambda **kwargs: gym.make("rodgym/FinThrust-v0", **kwargs),
        sb3_batch,
        lambda **kwargs: rodgym.sim.Pendulum(**kwargs),
        lambda **kwargs: rodgym.sim.Fin(**kwargs),
    ],
    ids=["env", "batch", "fin", "sb3", "rod", "bare fin"],
)
def test_an_unknown_keyword_is_a_type_error_in_pythons_words(make):
    """TorchRL's `GymEnv` tries `frameskip` and catches exactly this."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'") as caught:
        make(frameskip=1)
    assert isinstance(caught.value, errors.UnknownKeywordError)
    assert isinstance(caught.value, errors.ParameterError)
    # A value that is not allowed is none.
    with pytest.raises(errors.ParameterError) as caught:
        make(youngs_modulus=-1.0)
    assert not isinstance(caught.value, TypeError)


def test_a_name_within_a_value_is_no_keyword():
    with pytest.raises(errors.ParameterError, match="unknown parameter 'widht'") as caught:
        gym.make(SWING_UP, randomize={"widht": (0.006, 0.009)})
    assert not isinstance(caught.value, TypeError)


def test_unknown_environment_names_the_known_ones():
    with pytest.raises(errors.UnknownEnvError, match=r"rodgym/Pendulum-v9.*PendulumSwingUp-v0"):
        rodgym.envs.RodEnv("rodgym/Pendulum-v9")


@pytest.mark.parametrize(
    ("action", "error", "named"),
    [
        ([NAN], errors.ActionError, "NaN"),
        ([INF], errors.ActionError, "inf"),
        ([-INF], errors.ActionError, "inf"),
        ([[0.0]], errors.ShapeError, r"\[1, 1\]"),
        ([0.0, 0.0], errors.ShapeError, r"\[2\]"),
        ([], errors.ShapeError, r"\[0\]"),
        (0.0, errors.ShapeError, r"\[\]"),
        (["left"], errors.ShapeError, "left"),
        ([1j], errors.ShapeError, "1j"),
        (None, errors.ShapeError, "None"),
        ("x", errors.ShapeError, "'x'"),
        ([[1.0], [2.0, 3.0]], errors.ShapeError, "actions must be numbers"),
    ],
)
def test_actions_of_a_single_environment(action, error, named):
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    env.step([0.3])
    before = env.get_state()
    with pytest.raises(error, match=named):
        env.step(action)
    assert env.get_state() == before


def test_actions_of_a_batch():
    env = gym.make_vec(SWING_UP, num_envs=3)
    env.reset(seed=0)
    before = env.get_state()
    for action, error, named in [
        ([[0.0], [NAN], [0.0]], errors.ActionError, "environment 1"),
        (np.zeros((3,)), errors.ShapeError, r"\[3\].*\[3, 1\]"),
        (np.zeros((1, 3)), errors.ShapeError, r"\[1, 3\]"),
        (np.zeros((2, 1)), errors.ShapeError, r"\[2, 1\]"),
        (np.zeros((3, 2), dtype=np.float32), errors.ShapeError, r"\[3, 2\]"),
    ]:
        with pytest.raises(error, match=named):
            env.step(action)
        assert env.get_state() == before


def test_actions_beyond_the_space_are_clipped_in_any_precision():
    results = []
    for action in (1.0, 7.0, 1e300, np.float32(3e38), 2):
        env = gym.make(SWING_UP).unwrapped
        env.reset(seed=0)
        results.append(env.step([action])[0].tobytes())
    assert len(set(results)) == 1


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"colour": 1}, "colour"),
        ({"parameters": {"widht": 0.007}}, "widht"),
        ({"parameters": {"width": -1.0}}, "width"),
        ({"parameters": {"width": NAN}}, "nan"),
        ({"parameters": 3}, "parameters"),
        ({"state": {"angles": [0.0]}}, "angles"),
        ({"state": {"angles": [0.0] * 6, "rates": [0.0] * 5}}, "rates"),
        ({"state": {"angles": [NAN] * 6, "rates": [0.0] * 6}}, "nan"),
        ({"state": {"positions": [[0.0, 0.0]] * 7, "velocities": [[0.0, 0.0]] * 7}}, "position"),
        ({"state": 4}, "state"),
        ([], r"options = \[\] is not allowed: it must be a dictionary, or None"),
        (3, "options = 3"),
    ],
)
def test_reset_options(options, named):
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    env.step([0.1])
    before = env.get_state()
    with pytest.raises(ValueError, match=named) as caught:
        env.reset(seed=1, options=options)
    assert isinstance(caught.value, rodgym.RodgymError)
    assert env.get_state() == before
    batch = gym.make_vec(SWING_UP, num_envs=2)
    batch.reset(seed=0)
    before = batch.get_state()
    with pytest.raises(ValueError, match=named):
        batch.reset(seed=1, options=options)
    assert batch.get_state() == before


def test_a_reset_mask_is_for_batches():
    env = gym.make(SWING_UP).unwrapped
    with pytest.raises(errors.ParameterError, match="must be left out here: a mask is for a batch"):
        env.reset(options={"reset_mask": np.ones(1, dtype=bool)})


@pytest.mark.parametrize("seed", [-1, 2**64, 1.5, "one", True, np.bool_(True), object()])
def test_seeds(seed):
    env = gym.make(SWING_UP).unwrapped
    with pytest.raises(errors.ParameterError, match="seed"):
        env.reset(seed=seed)
    batch = gym.make_vec(SWING_UP, num_envs=2)
    with pytest.raises(errors.ParameterError, match="seed"):
        batch.reset(seed=seed)
    with pytest.raises(ValueError, match="seed"):
        batch.reset(seed=[seed, 1])
    with pytest.raises(errors.ShapeError, match="3"):
        batch.reset(seed=[1, 2, 3])


def test_a_seed_of_numpy_is_a_seed_and_a_list_is_none():
    """A single environment once refused the first after its state had changed."""
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=np.int64(7))
    state = env.get_state()
    env.reset(seed=7)
    assert env.get_state() == state
    with pytest.raises(errors.ParameterError, match=r"seed = \[3\]"):
        env.reset(seed=[3])
    assert env.get_state() == state


@pytest.mark.parametrize(
    "mask", [[1, 0], np.zeros(2, dtype=bool), np.ones(3, dtype=bool), np.ones((2, 1), dtype=bool)]
)
def test_reset_masks(mask):
    env = gym.make_vec(SWING_UP, num_envs=2)
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(errors.ShapeError, match="reset_mask"):
        env.reset(options={"reset_mask": mask})
    assert env.get_state() == before


def test_stepping_before_the_first_reset():
    with pytest.raises(errors.ResetNeededError):
        gym.make(SWING_UP).unwrapped.step([0.0])
    with pytest.raises(gym.error.ResetNeeded):
        gym.make_vec(SWING_UP, num_envs=2).step(np.zeros((2, 1)))


def test_snapshots_that_are_damaged_or_foreign():
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    state = env.get_state()
    other = gym.make(SWING_UP, nodes=9).unwrapped
    other.reset(seed=0)
    task = gym.make("rodgym/PendulumBalance-v0").unwrapped
    task.reset(seed=0)
    damaged = [
        b"",
        b"x" * 100,
        state[:-1],
        state + b"\0",
        *(state[:i] + bytes([state[i] ^ 1]) + state[i + 1 :] for i in range(len(state))),
        other.get_state(),
        task.get_state(),
    ]
    for bad in damaged:
        with pytest.raises(errors.SnapshotError, match="snapshot is refused"):
            env.set_state(bad)
        assert env.get_state() == state


def test_a_batch_takes_all_snapshots_or_none():
    env = gym.make_vec(SWING_UP, num_envs=3)
    env.reset(seed=0)
    before = env.get_state()
    donor = gym.make_vec(SWING_UP, num_envs=3)
    donor.reset(seed=50)
    states = donor.get_state()
    with pytest.raises(errors.SnapshotError):
        env.set_state([states[0], states[1], b"broken"])
    assert env.get_state() == before
    with pytest.raises(errors.ShapeError, match="2 states were given for 3 environments"):
        env.set_state(states[:2])
    for index in (3, -1):
        with pytest.raises(IndexError, match=str(index)):
            env.set_state(states[:1], [index])
        with pytest.raises(errors.EnvIndexError):
            env.get_state([index])
    # A mask of the wrong length is no list of the indices 0 and 1.
    with pytest.raises(errors.ShapeError, match=r"has shape \(2,\), but \(3,\) is needed"):
        env.set_state(states[:2], [True, False])
    assert env.get_state([True, False, True]) == before[::2]
    assert env.get_state() == before


@pytest.mark.parametrize("state", [None, "x", 3, [1, 2]])
def test_what_is_no_snapshot_at_all(state):
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(errors.ParameterError, match="the bytes that get_state returned"):
        env.set_state(state)
    assert env.get_state() == before
    assert env.set_state(bytearray(before)).shape == (18,)
    batch = gym.make_vec(SWING_UP, num_envs=2)
    batch.reset(seed=0)
    kept = batch.get_state()
    for states in (state, [state, kept[1]], b"x"):
        with pytest.raises(errors.ParameterError, match="get_state returned"):
            batch.set_state(states)
        assert batch.get_state() == kept


@pytest.mark.parametrize(
    ("call", "error", "named"),
    [
        (lambda e: e.evaluate("lqr", SWING_UP, seeds=3), errors.ParameterError, "seeds = 3"),
        (lambda e: e.evaluate("lqr", SWING_UP, seeds=[]), errors.ParameterError, "at least one"),
        (lambda e: e.evaluate("lqr", SWING_UP, seeds=[None]), errors.ParameterError, "seed = None"),
        (lambda e: e.evaluate("lqr", SWING_UP, env_kwargs=3), errors.ParameterError, "env_kwargs"),
        (lambda e: e.evaluate("lqr", 3), errors.ParameterError, "env_id = 3"),
        (lambda e: e.evaluate(None, SWING_UP), rodgym.RodgymError, "policy = None"),
        (lambda e: e.record(3, SWING_UP), rodgym.RodgymError, "policy = 3"),
    ],
)
def test_evaluations_name_what_they_refuse(call, error, named):
    import rodgym.evaluation

    with pytest.raises(error, match=named) as caught:
        call(rodgym.evaluation)
    assert isinstance(caught.value, ValueError)


def test_numbers_and_strings_are_shown_as_python_shows_them():
    """A large number once took three hundred digits, a string lost its quotes."""
    for call, shown in [
        (lambda: rodgym.baselines.upright({"width": -1e300}), "width = -1e300 is"),
        (lambda: rodgym.baselines.thesis_run({}, duration=1e300), "duration = 1e300 is"),
        (lambda: rodgym.baselines.thesis_run({}, feedback="x"), "feedback = 'x' is"),
        (lambda: gym.make(SWING_UP).reset(seed="x"), "seed = 'x' is"),
    ]:
        with pytest.raises(errors.ParameterError, match=shown):
            call()


@pytest.mark.parametrize("function", ["upright", "analyse", "thesis_run"])
def test_a_misspelt_keyword_of_a_rod_is_refused(function):
    call = getattr(rodgym.baselines, function)
    with pytest.raises(errors.ParameterError, match="'widht'; known parameters: width"):
        call({"widht": 0.007})
    with pytest.raises(errors.ParameterError, match=r"nodes = 6\.5"):
        call({"nodes": 6.5})
    with pytest.raises(errors.ParameterError, match="rod = None is not allowed"):
        call(None)


def test_pictures_have_whole_numbers_of_pixels():
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    for width in ("x", 64.5, 1, True, 10**9):
        with pytest.raises(errors.ParameterError, match=r"width = .* pixels from 16 to 8192"):
            env.frame(width=width)
        with pytest.raises(errors.ParameterError, match="width"):
            env.svg(width)


def test_every_exception_is_a_rodgym_error():
    classes = [
        c for c in vars(errors).values() if isinstance(c, type) and c.__module__ == errors.__name__
    ]
    assert len(classes) >= 9
    assert all(issubclass(c, errors.RodgymError | Warning) for c in classes)
