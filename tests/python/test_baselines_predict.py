"""Controllers answer as Stable-Baselines3 policies do: shapes, memory, batches, bad arguments."""

import pickle
from types import SimpleNamespace

import numpy as np
import pytest
from gymnasium.spaces import Box
from rodgym._native import controllers
from rodgym.baselines import CONTROLLERS, HybridLqr, Lqg, Lqr
from rodgym.errors import ParameterError, ShapeError

EDGES = 6
CONFIG = {
    "width": 0.007, "length": 0.3, "nodes": 7, "density": 1500.0, "youngs_modulus": 1e7,
    "damping": 0.0, "bending_damping": 5e-4, "gravity": 9.81, "torque_limit": 0.05,
    "control_dt": 0.01,
}  # fmt: skip


def stand_in(size=3 * EDGES, **changes):
    """What `for_env` reads of an environment, without its physics."""
    space = Box(-1.0, 1.0, (size,), np.float32)
    numbers = {"low": [-1.0] * size, "high": [1.0] * size, "names": ["?"] * size}
    spec = {
        "id": "?",
        "machine": "pendulum",
        "config": {**CONFIG, **changes},
        "observation": numbers,
    }
    return SimpleNamespace(core_spec=spec, observation_space=space)


def observation(angle, rate=0.0):
    one = np.ones(EDGES, dtype=np.float32)
    return np.concatenate([np.cos(angle) * one, np.sin(angle) * one, rate / 10 * one])


def test_one_observation_gives_one_action():
    action, state = HybridLqr.for_env(stand_in()).predict(observation(np.pi + 0.01))
    assert action.shape == (1,) and action.dtype == np.float32
    # The sampled gains with bending damping sum to 0.18537 over the angles.
    assert action[0] == pytest.approx(-0.01 * 0.18537 / 0.05, rel=1e-3)
    assert state.shape == (1, 1)


def test_a_batch_is_its_rows():
    lqr = HybridLqr.for_env(stand_in())
    angles = np.linspace(0, 2 * np.pi, 1024)
    rows = np.stack([observation(angle, rate=1.0) for angle in angles])
    actions, state = lqr.predict(rows)
    actions, state = lqr.predict(rows, state, np.arange(1024) % 3 == 0, deterministic=True)
    assert actions.shape == (1024, 1) and np.all(np.abs(actions) <= 1)
    for i in (0, 1, 500, 512, 1023):
        single, memory = lqr.predict(rows[i])
        if i % 3:
            single, memory = lqr.predict(rows[i], memory, np.array([False]))
        assert single[0] == actions[i, 0]
        assert memory[0] == state[i]


def test_the_state_given_is_never_changed():
    lqr = HybridLqr.for_env(stand_in())
    _, first = lqr.predict(observation(0.0))
    kept = first.copy()
    later, second = lqr.predict(observation(0.0), first)
    assert np.array_equal(first, kept) and not np.array_equal(first, second)
    again, _ = lqr.predict(observation(0.0), second, np.array([True]))
    fresh, _ = lqr.predict(observation(0.0))
    assert again == fresh and later != fresh


def test_the_design_follows_the_environment():
    wide = HybridLqr.for_env(stand_in(width=0.009)).predict(observation(np.pi + 0.01))[0]
    slim = HybridLqr.for_env(stand_in(width=0.007)).predict(observation(np.pi + 0.01))[0]
    assert wide < slim < 0


#: Laws that see base angle and rate only.
OUTPUT_FEEDBACK = ("lqg", "lqg-adaptive", "thesis-lqg")


@pytest.mark.parametrize(
    "name", [name for name, machine in controllers() if machine == stand_in().core_spec["machine"]]
)
def test_a_pickled_controller_acts_alike(name):
    size = 3 if name in OUTPUT_FEEDBACK else 3 * EDGES
    law = CONTROLLERS[name].for_env(stand_in(size))
    copy = pickle.loads(pickle.dumps(law))
    rows = np.stack([observation(angle)[:size] for angle in (0.1, 3.0)])
    assert np.array_equal(copy.predict(rows)[0], law.predict(rows)[0])
    assert copy.config == CONFIG


def test_a_lost_sample_is_bridged_by_output_feedback_alone():
    law = Lqg.for_env(stand_in(3))
    rows = np.array([[-1.0, 0.01, 0.0], [-1.0, 0.01, 0.0]], dtype=np.float32)
    _, state = law.predict(rows)
    rows[1] = np.nan
    actions, _ = law.predict(rows, state)
    assert np.all(np.isfinite(actions))
    # At rest the prediction is near the sample that it stands in for.
    assert abs(actions[0, 0] - actions[1, 0]) < 0.1
    full = Lqr.for_env(stand_in())
    with pytest.raises(ParameterError, match="must be finite"):
        full.predict(np.full(18, np.nan))


def test_what_cannot_be_controlled_is_refused():
    with pytest.raises(ParameterError, match="observation='full', 18 numbers"):
        Lqr.for_env(stand_in(size=3))
    with pytest.raises(ParameterError, match="must be an environment of rodgym"):
        Lqr.for_env(SimpleNamespace(observation_space=Box(-1, 1, (18,))))
    with pytest.raises(ParameterError, match="width = -1"):
        Lqr.for_env(stand_in(width=-1.0))
    lqr = Lqr.for_env(stand_in())
    with pytest.raises(ShapeError, match="observation has shape"):
        lqr.predict(np.zeros((2, 17)))
    with pytest.raises(ShapeError, match="state has shape"):
        lqr.predict(np.zeros((2, 18)), np.zeros((3, 1)))
    with pytest.raises(ParameterError, match=r"observation\[0, 4\] = NaN"):
        lqr.predict(np.where(np.arange(18) == 4, np.nan, 0.0))
