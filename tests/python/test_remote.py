"""Promise: an environment on a server is the local one, to the bit, through every face."""

from __future__ import annotations

import copy
import pickle
import time

import gymnasium as gym
import numpy as np
import pytest
from conftest import BALANCE, PENDULUMS, RANDOM, SWING_UP, actions_for, assert_same
from gymnasium.vector import AutoresetMode
from remote_helpers import need_server, serving

need_server()

import rodgym.remote  # noqa: E402
from rodgym.errors import (  # noqa: E402
    ActionError,
    EnvIndexError,
    ParameterError,
    ResetNeededError,
    ShapeError,
    SnapshotError,
    UnknownEnvError,
)
from rodgym.evaluation import evaluate  # noqa: E402
from rodgym.remote import (  # noqa: E402
    LimitError,
    RemoteTimeoutError,
    RemoteVectorEnv,
    SessionLostError,
)
from rodgym.vector import RodVectorEnv  # noqa: E402


@pytest.fixture(scope="module")
def server():
    with serving("--idle-seconds", "3600") as server:
        yield server


@pytest.mark.parametrize("env_id", PENDULUMS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_a_remote_trajectory_equals_the_local_one(server, rng, env_id, mode):
    arguments = {"autoreset_mode": mode, "max_episode_steps": 7, **RANDOM}
    local = RodVectorEnv(env_id, 5, **arguments)
    remote = rodgym.remote.connect(server.address, env_id, 5, **arguments)
    assert_same(remote.reset(seed=3), local.reset(seed=3))
    for action in actions_for(rng, 20, 5):
        assert_same(remote.step(action), local.step(action))
    assert remote.single_observation_space == local.single_observation_space
    assert remote.config == local.config
    remote.close()


def test_masked_resets_seeds_and_options(server, rng):
    arguments = {"autoreset_mode": AutoresetMode.DISABLED, "max_episode_steps": 3}
    pair = (
        RodVectorEnv(SWING_UP, 3, **arguments),
        RemoteVectorEnv(server.address, SWING_UP, 3, **arguments),
    )
    angles = np.linspace(0.1, 0.7, 6)
    options = {"state": {"angles": angles, "rates": 0 * angles}, "parameters": {"width": 0.008}}

    def both(call):
        first, second = (call(env) for env in pair)
        assert_same(second, first)

    both(lambda env: env.reset(seed=[5, 2**63 + 1, 0]))
    for action in actions_for(rng, 3, 3):
        both(lambda env, action=action: env.step(action))
    for env in pair:
        with pytest.raises(ResetNeededError):
            env.step(np.zeros((3, 1)))
    mask = np.array([True, False, True])
    both(lambda env: env.reset(options={"reset_mask": mask}))
    both(lambda env: env.reset(options=options))
    both(lambda env: env.step(np.zeros((3, 1))))
    pair[1].close()


def test_snapshots_move_between_process_and_server(server, rng):
    local = RodVectorEnv(BALANCE, 3, **RANDOM)
    remote = RemoteVectorEnv(server.address, BALANCE, 3, **RANDOM)
    local.reset(seed=1)
    remote.reset(seed=99)
    for action in actions_for(rng, 5, 3):
        local.step(action)
    assert_same(remote.set_state(local.get_state()), local.set_state(local.get_state()))
    assert_same(remote.get_state([2, 0]), local.get_state([2, 0]))
    for action in actions_for(rng, 5, 3):
        assert_same(remote.step(action), local.step(action))
    for name in ("positions", "velocities", "parameters"):
        assert_same(remote.get_attr(name), local.get_attr(name))
    with pytest.raises(SnapshotError):
        remote.set_state([b"no snapshot"] * 3)
    remote.close()


def test_pickle_and_deepcopy_keep_the_state(server, rng):
    remote = RemoteVectorEnv(server.address, SWING_UP, 2)
    remote.reset(seed=4)
    remote.step(np.ones((2, 1)))
    copies = [pickle.loads(pickle.dumps(remote)), copy.deepcopy(remote)]
    for action in actions_for(rng, 3, 2):
        expected = remote.step(action)
        for twin in copies:
            assert_same(twin.step(action), expected)
    for env in (remote, *copies):
        env.close()


def test_the_single_environment_equals_the_local_one(server, rng):
    local = gym.make(SWING_UP, **RANDOM).unwrapped
    remote = gym.make(
        "rodgym/Remote-v0",
        server=server.address,
        env_id=SWING_UP,
        render_mode="rgb_array",
        **RANDOM,
    ).unwrapped
    assert_same(remote.reset(seed=3), local.reset(seed=3))
    for action in actions_for(rng, 10, 1):
        ours, theirs = remote.step(action[0]), local.step(action[0])
        assert_same(ours, tuple(theirs))
    assert_same(remote.positions, local.positions)
    assert_same(remote.scene(), local.scene())
    picture = remote.render()
    assert picture.shape == (480, 480, 3) and picture.std() > 0
    remote.close()


def test_make_vec_knows_the_remote_environment(server):
    env = gym.make_vec("rodgym/Remote-v0", num_envs=4, server=server.address, env_id=SWING_UP)
    assert isinstance(env, RemoteVectorEnv) and env.num_envs == 4
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    assert env.max_episode_steps == 500, "as registered, unless asked otherwise"
    env.reset(seed=0)
    env.close()


def test_sb3_sees_the_same_batch_through_the_wire(server, rng):
    pytest.importorskip("stable_baselines3")
    import rodgym.sb3

    local = rodgym.sb3.make_vec_env(SWING_UP, 3, seed=5, monitor=False, max_episode_steps=4)
    remote = rodgym.sb3.make_vec_env(
        SWING_UP, 3, seed=5, monitor=False, max_episode_steps=4, server=server.address
    )
    assert_same(remote.reset(), local.reset())
    for action in actions_for(rng, 9, 3):
        assert_same(remote.step(action), local.step(action))
    remote.close()


def test_what_a_local_batch_refuses_a_remote_one_refuses_likewise(server):
    with pytest.raises(UnknownEnvError, match="known ids"):
        rodgym.remote.connect(server.address, "rodgym/Nothing-v0")
    with pytest.raises(ParameterError, match="width"):
        rodgym.remote.connect(server.address, SWING_UP, width=-1.0)
    with pytest.raises(ParameterError, match="num_threads"):
        rodgym.remote.connect(server.address, SWING_UP, num_threads=3)
    with pytest.raises(ParameterError, match="recover"):
        rodgym.remote.connect(server.address, SWING_UP, recover="maybe")
    env = rodgym.remote.connect(server.address, SWING_UP, 2)
    with pytest.raises(ResetNeededError):
        env.step(np.zeros((2, 1)))
    env.reset(seed=0)
    before = env.get_state()
    with pytest.raises(ActionError):
        env.step(np.array([[0.0], [np.nan]]))
    with pytest.raises(ShapeError):
        env.step(np.zeros((3, 1)))
    with pytest.raises(EnvIndexError):
        env.get_state([2])
    assert env.get_state() == before
    env.close()


def test_snapshots_beyond_a_message_travel_in_parts(server, monkeypatch):
    import rodgym.remote.session

    env = rodgym.remote.connect(server.address, SWING_UP, 9)
    env.reset(seed=1)
    states = env.get_state()
    monkeypatch.setattr(rodgym.remote.session, "SNAPSHOT_BYTES", 2 * len(states[0]))
    env.step(np.ones((9, 1)))
    env.set_state(states)
    assert env.get_state() == states
    env.close()


def test_ping_tells_about_the_server(server):
    about = rodgym.remote.ping(server.address)
    assert about["versions"] == [1, 1] and SWING_UP in about["ids"]
    assert about["user"] == "local" and about["limits"]["window"] == 16


def test_a_silent_address_says_why():
    began = time.monotonic()
    with pytest.raises(RemoteTimeoutError, match="nothing listens there") as caught:
        rodgym.remote.ping("tcp://127.0.0.1:1", timeout=0.7)
    assert "tcp://127.0.0.1:1" in str(caught.value) and "no encryption" in str(caught.value)
    assert time.monotonic() - began < 3


def test_closing_gives_the_session_back():
    with serving("--max-sessions", "1", "--max-user-sessions", "1") as server:
        for _ in range(5):
            env = rodgym.remote.connect(server.address, SWING_UP)
            with pytest.raises(LimitError):
                rodgym.remote.connect(server.address, SWING_UP, timeout=0.3)
            env.close()
        # So does forgetting it.
        env = rodgym.remote.connect(server.address, SWING_UP)
        del env
        rodgym.remote.connect(server.address, SWING_UP).close()


def test_an_idle_session_is_lost_and_can_be_restored():
    with serving("--idle-seconds", "1") as server:
        plain = rodgym.remote.connect(server.address, SWING_UP)
        kept = rodgym.remote.connect(server.address, SWING_UP, recover="restart")
        local = RodVectorEnv(SWING_UP, 1)
        for env in (plain, kept, local):
            env.reset(seed=2)
        time.sleep(3.5)
        with pytest.raises(SessionLostError, match="idle"):
            plain.step(np.ones((1, 1)))
        assert_same(kept.step(np.ones((1, 1))), local.step(np.ones((1, 1))))
        kept.close()


def test_ppo_learns_the_same_policy_over_the_wire(server):
    pytest.importorskip("stable_baselines3")
    import rodgym.sb3
    import torch
    from stable_baselines3 import PPO

    torch.set_num_threads(1)
    policies = []
    for place in ({}, {"server": server.address}):
        env = rodgym.sb3.make_vec_env(SWING_UP, 8, seed=3, max_episode_steps=20, **place)
        model = PPO("MlpPolicy", env, n_steps=32, batch_size=64, n_epochs=2, seed=3, device="cpu")
        model.learn(768)
        returns = [episode["r"] for episode in model.ep_info_buffer]
        policies.append((model.policy.state_dict(), returns))
        env.close()
    (local, local_returns), (remote, remote_returns) = policies
    assert local_returns == remote_returns and len(local_returns) > 8
    for name, weights in local.items():
        assert torch.equal(weights, remote[name]), name


@pytest.mark.parametrize("design", ["each", "nominal", {"width": 0.008}])
def test_a_score_over_the_wire_is_the_local_one_to_the_bit(server, design):
    """Whatever a controller was designed for: the parameters that an episode draws travel too."""
    drawn = {"randomize": {"width": (0.006, 0.010)}}
    there = {"server": server.address, "env_id": SWING_UP, **drawn}
    local = evaluate("lqr", SWING_UP, range(6), env_kwargs=drawn, design=design)
    remote = evaluate("lqr", "rodgym/Remote-v0", range(6), env_kwargs=there, design=design)
    assert remote.design == local.design
    for name, values in local.columns.items():
        assert np.array_equal(remote.columns[name], values, equal_nan=True), name
    assert np.array_equal(remote.parameters["width"], local.parameters["width"])
    pytest.importorskip("stable_baselines3")
    zoo = evaluate("zoo", "rodgym/Remote-v0", range(2), env_kwargs=there)
    assert zoo.columns["return"] == pytest.approx(
        evaluate("zoo", SWING_UP, range(2), env_kwargs=drawn).columns["return"], rel=1e-6
    )
