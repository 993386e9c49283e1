"""On a Ray cluster: the same environments, and the same table whatever dies on the way."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from conftest import RANDOM, SWING_UP, actions_for, assert_same
from gymnasium.wrappers.vector import DictInfoToList
from ray_helpers import LONG, Killer, alive, name, need_ray, processes, running_cases, short_folder
from remote_helpers import serving, until
from test_extras import run as run_with

need_ray("ray.tune", 'Ray is not installed: pip install "rodgym[ray]"')

import ray  # noqa: E402
import rodgym.ray  # noqa: E402
from rodgym.errors import ParameterError  # noqa: E402
from rodgym.evaluation.policies import PolicyError  # noqa: E402
from rodgym.ray.environments import OwnSeeds  # noqa: E402
from rodgym.study import StudyError, read, run_case, run_study  # noqa: E402
from rodgym.study.spec import parse  # noqa: E402

PLAN = {
    "env": SWING_UP,
    "seeds": 32,
    "fixed": {"env.nodes": 12, "env.randomize": {"width": [0.006, 0.009]}},
    "sweep": {
        "policy": ["lqr", "lqr-hybrid", "zero"],
        "env.width": [0.007, 0.008],
        "seed": [0, 99],
    },
}


@pytest.fixture(scope="module")
def plan(tmp_path_factory):
    path = tmp_path_factory.mktemp("plan") / "plan.yml"
    # JSON is YAML.
    path.write_text(json.dumps(PLAN))
    return path


@pytest.fixture(scope="module")
def finished(plan, tmp_path_factory):
    """The table as this process computes it alone."""
    table = tmp_path_factory.mktemp("local") / "table.csv"
    run_study(read(plan), table)
    return table.read_bytes()


@pytest.fixture(scope="module")
def address():
    """A cluster of two workers that this process is connected to."""
    with short_folder() as folder, rodgym.ray.cluster("local", 2, _temp_dir=folder):
        yield ray.get_runtime_context().gcs_address
    assert not [name(process) for process in processes() if folder in name(process)]


class Counted:
    """Counts the rows as they come, and does something at one of them."""

    def __init__(self, at=0, action=lambda: None):
        self.at, self.action, self.seen = at, action, []

    def __call__(self, done, cases):
        self.seen.append(done)
        if done == self.at:
            self.action()


def test_a_two_worker_study_equals_the_local_one_bit_for_bit(plan, finished, address, tmp_path):
    run_study(read(plan), tmp_path / "table.csv", rodgym.ray.backend(workers=2))
    assert (tmp_path / "table.csv").read_bytes() == finished
    # The numbers themselves too, not only the digits that a table shows.
    cases = list(enumerate(read(plan).cases()))[:2]
    rows = dict(rodgym.ray.backend()(cases))
    assert_same(rows, {number: run_case(case) for number, case in cases})


def test_a_trained_policy_needs_to_be_on_the_drivers_machine_only(address, tmp_path, monkeypatch):
    pytest.importorskip("stable_baselines3")
    shutil.copy(Path(rodgym.__file__).parent / "zoo" / "PendulumSwingUp-v0.zip", tmp_path / "p.zip")
    # Workers do not stand where the driver stands.
    monkeypatch.chdir(tmp_path)
    study = parse({"env": SWING_UP, "sweep": {"policy": "p.zip", "seed": [0, 1]}}, "trained")
    run_study(study, tmp_path / "ray.csv", rodgym.ray.backend())
    run_study(study, tmp_path / "local.csv")
    table = (tmp_path / "ray.csv").read_bytes()
    assert table == (tmp_path / "local.csv").read_bytes()
    # Another policy under the same name is another study.
    shutil.copy(Path(rodgym.__file__).parent / "zoo" / "FinThrust-v0.zip", tmp_path / "p.zip")
    with pytest.raises(StudyError, match="before it was changed"):
        run_study(study, tmp_path / "ray.csv")
    assert (tmp_path / "ray.csv").read_bytes() == table


def test_an_exported_policy_takes_its_card_along(address, tmp_path, monkeypatch):
    pytest.importorskip("onnxruntime")
    from rodgym.export import export

    export("zoo", tmp_path / "p.onnx", SWING_UP)
    monkeypatch.chdir(tmp_path)
    study = parse({"env": SWING_UP, "sweep": {"policy": "p.onnx", "seed": [0, 1]}}, "exported")
    run_study(study, tmp_path / "ray.csv", rodgym.ray.backend())
    run_study(study, tmp_path / "local.csv")
    assert (tmp_path / "ray.csv").read_bytes() == (tmp_path / "local.csv").read_bytes()


def test_a_worker_killed_in_mid_study_loses_and_doubles_nothing(plan, finished, address, tmp_path):
    killer = Killer()
    counted = Counted(2, killer.start)
    run_study(read(plan), tmp_path / "table.csv", rodgym.ray.backend(workers=2), counted)
    killer.join()
    assert killer.victim and not alive(killer.victim)
    assert counted.seen == list(range(len(read(plan)) + 1))
    assert (tmp_path / "table.csv").read_bytes() == finished


def test_a_study_killed_and_resumed_gives_the_same_table(plan, finished, address, tmp_path):
    command = [sys.executable, "-m", "rodgym", "study", str(plan), "--name", "s"]
    command += ["--runs", str(tmp_path), "--ray", address, "--workers", "2"]
    table = tmp_path / "s" / "table.csv"

    def rows():
        return table.read_text().count("\n") if table.exists() else 0

    study = subprocess.Popen(command, stderr=subprocess.PIPE)
    until(lambda: rows() > 3, 300)
    study.kill()
    study.communicate()
    before = rows()
    assert before < finished.count(b"\n") and table.read_bytes() != finished
    again = subprocess.run(command, capture_output=True, text=True, check=True)
    assert f"{before - 1} of {finished.count(b'%c' % 10) - 1} cases" in again.stderr
    assert table.read_bytes() == finished


def test_the_extra_ray_is_enough_for_a_study(address, tmp_path):
    """The progress bar once needed what trains agents. (The driver is told; workers are not.)"""
    words = ["study", "plan.yml", "--ray", address, "--runs", "runs"]
    ((code, out, err, made),) = run_with("ray", [words], tmp_path)
    assert code == 0, err
    assert made == ["runs"] and "picture:" in out and "2 of 2 cases" in err
    ((code, _, err, made),) = run_with("report", [words], tmp_path / "runs")
    assert (code, made) == (2, []) and "this needs ray: pip install 'rodgym[ray]'" in err


def test_what_is_wrong_with_a_case_is_said_as_without_ray(address, tmp_path):
    content = {"env": SWING_UP, "sweep": {"policy": "lqr", "env.width": [0.007, -1.0]}}
    with pytest.raises(ParameterError, match=r"width = -1") as with_ray:
        run_study(parse(content, "bad"), tmp_path / "a.csv", rodgym.ray.backend())
    # What else was running is called off.
    until(lambda: not running_cases())
    with pytest.raises(ParameterError, match=r"width = -1") as without:
        run_study(parse(content, "bad"), tmp_path / "b.csv")
    assert str(with_ray.value) == str(without.value)
    missing = {"env": SWING_UP, "sweep": {"policy": "nowhere.zip"}}
    with pytest.raises(PolicyError, match=r"nowhere\.zip"):
        run_study(parse(missing, "bad"), tmp_path / "c.csv", rodgym.ray.backend())


def test_a_case_that_kills_every_worker_ends_the_study(address, tmp_path, monkeypatch):
    monkeypatch.setattr("rodgym.ray.study.RETRIES", 0)
    # Long enough to be killed in.
    content = {"env": SWING_UP, "seeds": 5000, "sweep": {"policy": "lqr"}}
    with pytest.raises(StudyError, match="given up after 1 lost workers"):
        run_study(
            parse(content, "x"),
            tmp_path / "a.csv",
            rodgym.ray.backend(),
            Counted(0, Killer().start),
        )


def test_registered_environments_are_ours_wherever_ray_makes_them(address, rng):
    from ray.tune.registry import ENV_CREATOR, _global_registry

    rodgym.ray.register()
    for env_id in rodgym.ENVIRONMENTS:
        assert _global_registry.contains(ENV_CREATOR, env_id)
    actions = actions_for(rng, 20, 3)

    @ray.remote(num_cpus=2)
    class Runner:
        """What an env runner does, in a process that has not imported rodgym by itself."""

        def batch(self, config):
            env = _global_registry.get(ENV_CREATOR, SWING_UP)(config)
            results = [env.reset(seed=[1, 2, 3]), *(env.step(a) for a in actions)]
            threads = env.unwrapped.num_threads
            return results, threads, os.environ["OMP_NUM_THREADS"]

        def single(self, config):
            env = _global_registry.get(ENV_CREATOR, SWING_UP)(config)
            return env.reset(seed=1), [env.step(a[0]) for a in actions], env.spec.max_episode_steps

    runner = Runner.remote()
    results, threads, openmp = ray.get(runner.batch.remote({**RANDOM, "num_envs": 3}))
    ours = gym.make_vec(SWING_UP, num_envs=3, **RANDOM)
    assert_same(results, [ours.reset(seed=[1, 2, 3]), *(ours.step(a) for a in actions)])
    assert (threads, openmp) == (2, "1")
    _, threads, _ = ray.get(runner.batch.remote({"num_envs": 3, "num_threads": 1}))
    assert threads == 1
    one = gym.make(SWING_UP, **RANDOM)
    single = one.reset(seed=1), [one.step(a[0]) for a in actions], 500
    assert_same(ray.get(runner.single.remote(RANDOM)), single)


def test_a_server_serves_ray(rng):
    from remote_helpers import need_server

    need_server()
    actions = actions_for(rng, 20, 3)
    with serving() as server:
        far = {"server": server.address, "num_envs": 3, "width": 0.0081}
        env = rodgym.ray.make(SWING_UP, far)
        assert type(env.unwrapped).__name__ == "RemoteVectorEnv"
        results = [env.reset(seed=[1, 2, 3]), *(env.step(a) for a in actions)]
        env.close()
    ours = gym.make_vec(SWING_UP, num_envs=3, width=0.0081)
    assert_same(results, [ours.reset(seed=[1, 2, 3]), *(ours.step(a) for a in actions)])


def test_infos_reach_rllib_as_those_of_single_environments(rng):
    """RLlib turns a batch's infos into a list; Gymnasium's own batch is the oracle."""
    short = {"max_episode_steps": 5}
    batch = DictInfoToList(rodgym.ray.make(SWING_UP, {"num_envs": 3, **short}))
    oracle = DictInfoToList(gym.vector.SyncVectorEnv([lambda: gym.make(SWING_UP, **short)] * 3))
    seeds = [1, 2, 3]
    assert_same(batch.reset(seed=seeds), oracle.reset(seed=seeds))
    for action in np.clip(actions_for(rng, 12, 3), -1, 1):
        assert_same(batch.step(action), oracle.step(action))


def test_env_runners_with_neighbouring_seeds_play_different_episodes():
    first, second, again = (
        rodgym.ray.make(SWING_UP, {"num_envs": 32}).reset(seed=seed)[0] for seed in (7, 8, 7)
    )
    assert len(np.unique(np.concatenate([first, second]), axis=0)) == 64
    assert_same(again, first)
    assert isinstance(rodgym.ray.make(SWING_UP, {"num_envs": 2}), OwnSeeds)


def test_a_batch_that_rllib_would_misread_is_refused():
    with pytest.raises(ParameterError, match="autoreset_mode = 'SameStep'"):
        rodgym.ray.make(SWING_UP, {"num_envs": 2, "autoreset_mode": "SameStep"})


@pytest.mark.skipif(not LONG, reason="long: make ray")
def test_a_machine_lost_in_mid_study_loses_and_doubles_nothing(plan, finished, tmp_path):
    """Two machines beside the head, each a process tree of its own; one goes down."""
    script = f"""
import sys
from pathlib import Path
import ray_helpers
from ray.cluster_utils import Cluster
import rodgym.ray
from rodgym.study import read, run_study

with ray_helpers.short_folder() as folder:
    head = {{"num_cpus": 0, "include_dashboard": False, "temp_dir": folder}}
    cluster = Cluster(True, head_node_args=head)
    nodes = [cluster.add_node(num_cpus=1) for _ in range(2)]

    def kill(done, cases):
        print(done, flush=True)
        if done == 3:
            cluster.remove_node(nodes[0], allow_graceful=False)

    run_study(read({str(plan)!r}), Path(sys.argv[1]), rodgym.ray.backend(cluster.address), kill)
    cluster.shutdown()
"""
    command = [sys.executable, "-c", script, str(tmp_path / "table.csv")]
    here = {**os.environ, "PYTHONPATH": os.pathsep.join([os.path.dirname(__file__), *sys.path])}
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=here)
    # (Ray's own lines stand between them.)
    seen = [int(line) for line in done.stdout.splitlines() if line.isdigit()]
    assert seen == list(range(len(read(plan)) + 1))
    assert (tmp_path / "table.csv").read_bytes() == finished


@pytest.mark.skipif(not LONG, reason="long: make ray")
def test_a_killed_driver_leaves_no_cluster_behind(plan, tmp_path):
    command = [sys.executable, "-m", "rodgym", "study", str(plan), "--name", "s"]
    command += ["--runs", str(tmp_path), "--ray", "local", "--workers", "1"]
    study = subprocess.Popen(command, stderr=subprocess.DEVNULL)
    table = tmp_path / "s" / "table.csv"
    try:
        until(lambda: table.exists() and table.stat().st_size > 0, 300)
        before = processes(study.pid)
    finally:
        study.kill()
        study.wait()
    assert len(before) > 3
    until(lambda: not any(alive(process) for process in before), 180)
