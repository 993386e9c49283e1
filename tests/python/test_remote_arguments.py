"""Promise: keywords and options arrive as they were sent, or are refused before, in the words that
a local environment has for them."""

from __future__ import annotations

from contextlib import closing
from decimal import Decimal
from fractions import Fraction

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from remote_helpers import Server, need_server
from rodgym.errors import RodgymError
from rodgym.remote import wire

need_server()

SWING_UP = "rodgym/PendulumSwingUp-v0"
THRUST = "rodgym/FinThrust-v0"


@pytest.fixture(scope="module")
def server():
    # A message of 1 MiB, so that snapshots of a few hundred environments do not fit into one.
    server = Server("--max-message-mib", "1")
    yield server
    server.stop()


def words(make) -> str:
    with pytest.raises(RodgymError) as refused:
        make()
    return f"{refused.type.__name__}: {refused.value}"


ODD = [
    float("nan"), float("inf"), -np.inf, np.float32("nan"), 2**64, -(2**63) - 1, 1j,
    range(3), b"abc", {1, 2}, {1: 2}, Decimal("0.007"), Fraction(7, 1000), object(), True, "wide",
    np.array([0.007]), [[0.007]], np.datetime64("2020-01-01"),
]  # fmt: skip


@pytest.mark.parametrize("value", ODD, ids=lambda value: type(value).__name__)
@pytest.mark.parametrize("name", ["width", "nodes", "torque_disturbance", "sensor_noise"])
def test_what_a_local_environment_refuses_is_refused_in_the_same_words(server, name, value):
    def remote():
        rodgym.remote.connect(server.address, SWING_UP, 2, **{name: value})

    assert words(remote) == words(lambda: gym.make_vec(SWING_UP, num_envs=2, **{name: value}))


@pytest.mark.parametrize(
    "options",
    [
        {"parameters": {"width": float("nan")}},
        {"parameters": {"width": 2**70}},
        {"parameters": {"width": "wide"}},
        {"parameters": range(2)},
        {"state": {"angles": [float("nan")] * 6, "rates": [0.0] * 6}},
    ],
)
def test_options_that_a_local_environment_refuses_are_refused(server, options):
    with closing(rodgym.remote.connect(server.address, SWING_UP, 2)) as env:
        env.reset(seed=1)
        before = env.get_state()
        remote = words(lambda: env.reset(options=options))
        assert env.get_state() == before
    local = gym.make_vec(SWING_UP, num_envs=2)
    assert remote.partition(":")[0] == words(lambda: local.reset(options=options)).partition(":")[0]


@pytest.mark.parametrize("value", [np.float64(0.008), np.float32(0.008), np.array(0.008), 0.008])
def test_numbers_of_numpy_are_numbers(server, value):
    with closing(rodgym.remote.connect(server.address, SWING_UP, 1, width=value)) as env:
        assert env.unwrapped._batch.about["config"]["width"] == float(value)


@pytest.mark.parametrize("cutoff", [None, 2, 2.5])
def test_none_and_integers_arrive_as_they_are(server, cutoff):
    local = gym.make(THRUST, command_cutoff=cutoff).unwrapped.core_spec
    with closing(rodgym.remote.connect(server.address, THRUST, 1, command_cutoff=cutoff)) as env:
        assert env.unwrapped._batch.about["config"] == local["config"]


def test_a_fin_of_two_hundred_nodes_travels(server):
    nodes = 200
    geometry = {
        "edge_length": 0.14 / (nodes - 1),
        "height": 0.115,
        "pivot": 60,
        "widths": np.linspace(0.018, 0.002, nodes),
        "areas": list(0.115 * np.linspace(0.018, 0.002, nodes)),
    }
    fin = {"geometry": geometry, "stiffness_profile": tuple(np.linspace(2.0, 0.5, nodes))}
    local = gym.make_vec(THRUST, num_envs=2, **fin)
    with closing(rodgym.remote.connect(server.address, THRUST, 2, **fin)) as env:
        assert np.array_equal(env.reset(seed=3)[0], local.reset(seed=3)[0])
        action = np.full((2, 1), 0.5)
        assert np.array_equal(env.step(action)[0], local.step(action)[0])
        assert env.unwrapped._batch.about["config"] == local.unwrapped._batch.about["config"]


def test_long_lists_of_numbers_are_arrays_and_nothing_else_is():
    long = [0.5] * wire.LONG
    flags = [True] * wire.LONG
    values = {"a": 1, "b": long, "c": {"d": long, "e": "f"}, "g": long[:-1], "h": flags}
    rest, arrays = wire.split_lists(values)
    assert rest == {"a": 1, "c": {"e": "f"}, "g": long[:-1], "h": flags}
    assert set(arrays) == {"kwargs:b", "kwargs:c.d"} and arrays["kwargs:b"].tolist() == long


def test_snapshots_beyond_the_servers_message_travel_in_parts(server):
    with closing(rodgym.remote.connect(server.address, SWING_UP, 300, nodes=101)) as env:
        env.reset(seed=1)
        states = env.get_state()
        assert sum(map(len, states)) > env.unwrapped._batch.native.message_bytes == 1 << 20
        env.step(np.ones((300, 1)))
        env.set_state(states)
        assert env.get_state() == states


@pytest.mark.parametrize(
    "options",
    [
        {"parameters": None},
        {"state": None},
        {},
        {"x": None},
        {"parameters": {"width": 0.007}, "x": 1, "angles": [0.0]},
        {"parameters": [1, 2.5]},
        {"parameters": "width"},
        {"state": "x"},
        {"state": {}},
        {"state": {"angles": [0.0] * 3, "rates": [0.0] * 3}},
        {"state": {"angles": None, "rates": None}},
        {"state": {"angles": "x", "rates": [0] * 6}},
        {"state": {"angles": 0, "rates": 0}},
        {"state": {"angles": [True] * 6, "rates": [0] * 6}},
        {"state": {"angles": ["0.1"] * 6, "rates": [0] * 6}},
        {"state": {"angles": [0.1] * 6, "rates": [0] * 6}},
        {"state": {"positions": [[0.0, 0.0], [1.0]], "velocities": []}},
    ],
    ids=str,
)
@pytest.mark.parametrize("batch", [True, False], ids=["batch", "one"])
def test_options_are_taken_or_refused_as_locally_and_in_the_same_words(server, options, batch):
    def outcome(env) -> str:
        try:
            return env.reset(seed=1, options=options)[0].tobytes().hex()
        except RodgymError as error:
            return f"{type(error).__name__}: {error}"

    if batch:
        local, remote = (
            gym.make_vec(SWING_UP, 2),
            rodgym.remote.connect(server.address, SWING_UP, 2),
        )
    else:
        local = gym.make(SWING_UP)
        remote = gym.make("rodgym/Remote-v0", server=server.address, env_id=SWING_UP)
    with closing(remote), closing(local):
        assert outcome(remote) == outcome(local)


def test_a_mask_for_one_environment_is_refused_in_the_same_words(server):
    options = {"reset_mask": [True]}
    local = gym.make(SWING_UP)
    with closing(gym.make("rodgym/Remote-v0", server=server.address, env_id=SWING_UP)) as env:
        refused = words(lambda: env.reset(options=options))
    assert refused == words(lambda: local.reset(options=options))


@pytest.mark.parametrize(
    "change",
    [
        lambda env: env.set_randomize({"width": (2**70, 3)}),
        lambda env: env.set_randomize({"width": (-(2**63) - 1, 3)}),
        lambda env: env.set_randomize({1: (0.0, 1.0)}),
        lambda env: env.set_randomize({"\ud800": (0.0, 1.0)}),
        lambda env: env.set_parameters(**{"\ud800": 1.0}),
    ],
)
def test_settings_that_no_message_can_say_leave_the_environment_as_it_was(server, change):
    local = gym.make_vec(SWING_UP, 2).unwrapped
    local.reset(seed=1)
    with closing(rodgym.remote.connect(server.address, SWING_UP, 2)) as env:
        env.reset(seed=1)
        assert words(lambda: change(env)) == words(lambda: change(local))
        assert np.array_equal(env.step(np.ones((2, 1)))[0], local.step(np.ones((2, 1)))[0])


@pytest.mark.parametrize("value", [2**70, "\ud800", object()], ids=ascii)
def test_a_call_that_cannot_be_packed_was_not_made(server, value):
    with closing(rodgym.remote.connect(server.address, SWING_UP, 2)) as env:
        env.reset(seed=1)
        native, before = env.unwrapped._batch.native, env.get_state()
        said = words(lambda: native._change("reset", {"seed": value}, {}, lambda reply: None))
        assert "'reset' cannot be sent" in said
        assert not native.pending
        assert env.get_state() == before


@pytest.mark.parametrize("recover", ["raise", "restart"])
def test_what_is_too_large_for_the_server_is_not_sent(server, recover):
    """The server would hang up on it, and libzmq may end a process whose message was cut there."""
    long = np.zeros(200_000)
    with closing(rodgym.remote.connect(server.address, SWING_UP, 2, recover=recover)) as env:
        env.reset(seed=1)
        before = env.get_state()
        for call in (
            lambda: env.reset(options={"state": {"angles": long, "rates": long}}),
            lambda: env.set_parameters(width=long + 0.008),
        ):
            assert "bytes; this server takes 1048576" in words(call)
            assert env.unwrapped._batch.native.connection.resent == 0
        assert env.get_state() == before
    with pytest.raises(rodgym.remote.LimitError, match="this server takes"):
        rodgym.remote.connect(server.address, SWING_UP, 2, width=long)
