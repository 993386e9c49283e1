"""Promise: the native batch equals Gymnasium's `SyncVectorEnv` over single environments.

Observations, rewards, flags and infos, element by element and to the bit, in all three autoreset
modes, through resets, masks, time limits and terminations.
"""

from __future__ import annotations

import gymnasium as gym
import numpy as np
import pytest
from conftest import BALANCE, FINS, RANDOM, RANDOM_FIN, SWING_UP, actions_for, assert_same
from gymnasium.vector import AutoresetMode, SyncVectorEnv

MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED]
N = 6
#: A torque that breaks the solver within some steps.
BRUTAL = {"torque_limit": 5.0, "bending_damping": 0.0}


def pair(env_id: str, mode: AutoresetMode, steps: int | None, **kwargs):
    """Our batch and the oracle, with the same keywords."""
    ours = gym.make_vec(
        env_id, num_envs=N, autoreset_mode=mode, max_episode_steps=steps, num_threads=1, **kwargs
    )
    oracle = SyncVectorEnv(
        [lambda: gym.make(env_id, max_episode_steps=steps, **kwargs)] * N, autoreset_mode=mode
    )
    return ours, oracle


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("env_id", "kwargs", "steps"),
    [
        (SWING_UP, {}, 23),
        (SWING_UP, RANDOM, 17),
        # Balance ends by falling and by time, at different steps in different environments.
        (BALANCE, {}, 60),
        (BALANCE, RANDOM, None),
        (SWING_UP, BRUTAL, 40),
    ],
)
def test_equals_sync_vector_env(env_id, kwargs, steps, mode, rng):
    ours, oracle = pair(env_id, mode, steps, **kwargs)
    assert ours.single_observation_space == oracle.single_observation_space
    assert ours.observation_space == oracle.observation_space
    assert ours.single_action_space == oracle.single_action_space
    assert ours.action_space == oracle.action_space
    assert ours.metadata["autoreset_mode"] is mode
    assert_same(ours.reset(seed=11), oracle.reset(seed=11))
    ends = failures = 0
    for t, action in enumerate(actions_for(rng, 200, N)):
        got = ours.step(action)
        for info in (got[4], got[4].get("final_info", {"solver_failure": False})):
            failures += int(np.sum(info["solver_failure"]))
        assert_same(got, oracle.step(action), f"step {t}")
        done = got[2] | got[3]
        ends += int(done.sum())
        if mode is AutoresetMode.DISABLED and done.any():
            options = {"reset_mask": done}
            assert_same(ours.reset(options=options), oracle.reset(options=dict(options)))
    assert ends > N, "the run must cross episode ends"
    assert (failures > 0) == (kwargs is BRUTAL)
    # A reset in the middle of episodes, without a seed: the streams go on.
    assert_same(ours.reset(), oracle.reset())
    assert_same(ours.step(action), oracle.step(action))


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("env_id", FINS)
def test_fins_equal_sync_vector_env(env_id, mode, rng):
    ours, oracle = pair(env_id, mode, 8, **RANDOM_FIN)
    assert ours.single_observation_space == oracle.single_observation_space
    assert_same(ours.reset(seed=11), oracle.reset(seed=11))
    for t, action in enumerate(actions_for(rng, 30, N)):
        got = ours.step(action)
        assert_same(got, oracle.step(action), f"step {t}")
        done = got[2] | got[3]
        if mode is AutoresetMode.DISABLED and done.any():
            options = {"reset_mask": done}
            assert_same(ours.reset(options=options), oracle.reset(options=dict(options)))


@pytest.mark.parametrize("mode", MODES)
def test_list_of_seeds_and_partial_reset(mode, rng):
    ours, oracle = pair(SWING_UP, mode, 40, **RANDOM)
    seeds = [3, 1, 4, 1, 5, 9]
    assert_same(ours.reset(seed=seeds), oracle.reset(seed=seeds))
    for action in actions_for(rng, 5, N):
        assert_same(ours.step(action), oracle.step(action))
    mask = np.array([True, False, True, False, False, True])
    some = [7, None, None, 8, None, 2]
    got = ours.reset(seed=some, options={"reset_mask": mask})
    assert_same(got, oracle.reset(seed=some, options={"reset_mask": mask}))
    for action in actions_for(rng, 60, N):
        got = ours.step(action)
        assert_same(got, oracle.step(action))
        done = got[2] | got[3]
        if mode is AutoresetMode.DISABLED and done.any():
            options = {"reset_mask": done}
            assert_same(ours.reset(options=options), oracle.reset(options=dict(options)))


def test_exact_parameters_hold_for_one_episode():
    ours, oracle = pair(SWING_UP, AutoresetMode.SAME_STEP, 4, **RANDOM)
    options = {"parameters": {"width": 0.0081}}
    got = ours.reset(seed=0, options=options)
    assert_same(got, oracle.reset(seed=0, options=options))
    assert set(got[1]["parameters"]["width"]) == {0.0081}
    action = np.zeros((N, 1), dtype=np.float32)
    for _ in range(4):
        got = ours.step(action)
        assert_same(got, oracle.step(action))
    widths = got[4]["parameters"]["width"]
    assert len(set(widths)) == N and ((widths >= 0.006) & (widths <= 0.009)).all()


def test_disabled_refuses_to_step_an_ended_environment():
    env = gym.make_vec(SWING_UP, num_envs=2, autoreset_mode="Disabled", max_episode_steps=1)
    env.reset(seed=0)
    action = np.zeros((2, 1), dtype=np.float32)
    env.step(action)
    before = env.get_state()
    with pytest.raises(gym.error.ResetNeeded, match="environment 0 has ended"):
        env.step(action)
    assert env.get_state() == before


@pytest.mark.parametrize("mode", AutoresetMode)
def test_a_batch_has_its_mode_where_gymnasiums_own_has_it(mode):
    ours = gym.make_vec(SWING_UP, num_envs=2, autoreset_mode=mode.value)
    theirs = SyncVectorEnv([lambda: gym.make(SWING_UP)], autoreset_mode=mode)
    assert ours.unwrapped.autoreset_mode is theirs.autoreset_mode is mode
    assert ours.metadata["autoreset_mode"] is mode


def test_options_of_the_caller_stay_as_they_are():
    env = gym.make_vec(SWING_UP, num_envs=2)
    options = {"reset_mask": np.array([True, True])}
    env.reset(seed=0, options=options)
    assert set(options) == {"reset_mask"}


def test_arrays_are_the_callers_own(rng):
    env = gym.make_vec(SWING_UP, num_envs=3)
    kept = [env.reset(seed=0)]
    kept += [env.step(action) for action in actions_for(rng, 3, 3)]
    copies = [np.array(result[0]) for result in kept]
    env.step(np.ones((3, 1), dtype=np.float32))
    for result, copy in zip(kept, copies, strict=True):
        assert np.array_equal(result[0], copy)
    for i, one in enumerate(kept):
        for other in kept[i + 1 :]:
            assert not np.shares_memory(one[0], other[0])


def test_copy_false_reuses_the_observation_array(rng):
    env = gym.make_vec(SWING_UP, num_envs=3, copy=False)
    twin = gym.make_vec(SWING_UP, num_envs=3)
    first, _ = env.reset(seed=0)
    assert_same(first, twin.reset(seed=0)[0])
    for action in actions_for(rng, 5, 3):
        observation, *_ = env.step(action)
        assert observation is first
        assert_same(observation, twin.step(action)[0])


def test_spec_is_json_and_makes_the_same_environment_again():
    env = gym.make_vec(SWING_UP, num_envs=2, autoreset_mode=AutoresetMode.SAME_STEP, width=0.008)
    assert env.spec.kwargs["autoreset_mode"] == "SameStep"
    text = env.spec.to_json()
    again = gym.make_vec(gym.envs.registration.EnvSpec.from_json(text))
    assert again.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert_same(again.reset(seed=5), env.reset(seed=5))


def test_max_episode_steps_means_what_it_means_in_gym_make():
    assert gym.make_vec(SWING_UP).max_episode_steps == 500
    assert gym.make_vec(SWING_UP, max_episode_steps=3).max_episode_steps == 3
    assert gym.make_vec(SWING_UP, max_episode_steps=-1).max_episode_steps is None


def test_wrappers_of_gymnasium_work(rng):
    env = gym.wrappers.vector.RecordEpisodeStatistics(
        gym.make_vec(SWING_UP, num_envs=3, max_episode_steps=10)
    )
    env = gym.wrappers.vector.NormalizeObservation(env)
    env.reset(seed=0)
    lengths = []
    for action in actions_for(rng, 25, 3):
        *_, infos = env.step(action)
        if "episode" in infos:
            lengths += infos["episode"]["l"][infos["_episode"]].tolist()
    assert lengths == [10] * 6
    listed = gym.wrappers.vector.DictInfoToList(gym.make_vec(SWING_UP, num_envs=2))
    _, infos = listed.reset(seed=0)
    assert infos[1]["parameters"]["width"] == 0.007


def test_members_show_their_machines():
    env = gym.make_vec(SWING_UP, num_envs=3)
    env.reset(seed=0, options={"reset_mask": np.array([True, True, True])})
    assert env.call("get_state") == tuple(env.get_state())
    positions = env.get_attr("positions")
    assert [p.shape for p in positions] == [(7, 2)] * 3
    env.set_attr("render_mode", [None, "rgb_array", None])
    assert env.get_attr("render_mode") == (None, "rgb_array", None)
    with pytest.raises(ValueError, match="2 values were given for 3 environments"):
        env.set_attr("render_mode", [None, None])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("run", range(3))
def test_equals_sync_vector_env_through_any_sequence_of_calls(mode, run):
    """Steps and all kinds of resets in random order, with episodes that end all the time."""
    rng = np.random.default_rng(run)
    ours, oracle = pair(BALANCE, mode, 7, start_bend=(-1.0, 1.0), **RANDOM)
    assert_same(ours.reset(seed=run), oracle.reset(seed=run))
    done = np.zeros(N, dtype=np.bool_)
    for t in range(300):
        needed = mode is AutoresetMode.DISABLED and done.any()
        if not needed and rng.random() < 0.85:
            action = rng.uniform(-1, 1, (N, 1)).astype(np.float32)
            got, expected = ours.step(action), oracle.step(action)
            done = got[2] | got[3]
        else:
            seed = [None, int(rng.integers(1000)), rng.integers(1000, size=N).tolist()][
                rng.integers(3)
            ]
            options = {}
            if rng.random() < 0.5:
                options["parameters"] = {"width": float(rng.uniform(0.006, 0.009))}
            mask = np.ones(N, dtype=np.bool_)
            if needed or rng.random() < 0.7:
                mask = rng.random(N) < 0.4
                mask |= done if needed else np.arange(N) == rng.integers(N)
                options["reset_mask"] = mask
            got = ours.reset(seed=seed, options=dict(options))
            expected = oracle.reset(seed=seed, options=dict(options))
            done &= ~mask
        assert_same(got, expected, f"call {t}")
