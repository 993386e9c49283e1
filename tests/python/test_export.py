"""Promise: an exported policy answers as the one that was trained, memory included, and plays."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import onnxruntime
import pytest
import torch
from rodgym import machines
from rodgym.cli import main
from rodgym.distil.policy import StudentPolicy, save
from rodgym.distil.student import Shape, Student
from rodgym.evaluation import evaluate, load_policy
from rodgym.evaluation.policies import PolicyError
from rodgym.export import export
from rodgym.export.network import check_same
from rodgym.runs import Run
from rodgym.training import load_recipe, train
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

ENV = "rodgym/PendulumSwingUpBase-v0"
SHORT = {"max_episode_steps": 60, "sensor_noise": {"angle": 0.001, "rate": 0.01}}
SHAPES = {
    "mlp": Shape(3, 1, frames=24),
    "relu": Shape(3, 1, frames=3, hidden=(32, 16, 8), activation="ReLU"),
    "one frame": Shape(3, 1, frames=1, own_actions=False, hidden=(), activation="ELU"),
    "gru": Shape(3, 1, "gru", 1, units=24, hidden=(16,)),
    "fin": Shape(4, 2, "gru", 1, own_actions=False, units=5, hidden=(6,), activation="ELU"),
}


def student_file(shape: Shape, path: Path) -> StudentPolicy:
    torch.manual_seed(1)
    student = Student(shape, [-1] * shape.action, [1] * shape.action)
    student.normalise(torch.randn(50, shape.frame) * 3 + 0.5)
    for value in student.head.parameters():
        # Answers of all sizes, beyond the bounds too.
        value.data *= 2
    save(student, path, {"env": ENV, "env_kwargs": SHORT, "algorithm": "DAgger"})
    return StudentPolicy(student)


def play(path: Path, policy: object, size: int) -> None:
    """Both answer the same over 60 steps with noise, lost samples and new episodes."""
    session = onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    memory = np.zeros((7, session.get_inputs()[1].shape[1]), np.float32)
    state, start = None, np.ones(7, bool)
    rng = np.random.default_rng(3)
    answers = []
    for _ in range(60):
        seen = rng.normal(0, 1, (7, size)).astype(np.float32)
        if isinstance(policy, StudentPolicy):
            seen[rng.random(7) < 0.2, 1] = np.nan
        start = rng.random(7) < 0.05
        memory[start] = 0
        action, memory = session.run(None, {"observation": seen, "state": memory})
        wanted, state = policy.predict(seen, state, start, deterministic=True)  # type: ignore[attr-defined]
        np.testing.assert_allclose(action, wanted, rtol=0, atol=1e-6)
        answers.append(action)
    assert np.abs(answers).max() <= 1 and np.std(answers) > 0.001


@pytest.mark.parametrize("name", SHAPES)
def test_a_student_answers_the_same_to_a_millionth(name: str, tmp_path: Path) -> None:
    shape = SHAPES[name]
    policy = student_file(shape, tmp_path / "policy.zip")
    from rodgym.export.graph import model_of

    (tmp_path / "policy.onnx").write_bytes(model_of(policy.student).SerializeToString())
    play(tmp_path / "policy.onnx", policy, shape.observation)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC", "TD3"])
def test_a_trained_policy_answers_the_same_to_a_millionth(algorithm: str, tmp_path: Path) -> None:
    changes = {"n_timesteps": 64, "n_envs": 8, "frame_stack": 3}
    changes["vec_env_wrapper"] = "rodgym.training.OwnActions"
    quick = {"PPO": {"n_steps": 8, "batch_size": 64}}.get(algorithm, {"learning_starts": 32})
    recipe = load_recipe(ENV, algorithm).with_changes({**changes, **quick})
    run = Run("run", tmp_path)
    trained = train(ENV, run, recipe=recipe, env_kwargs=SHORT, quiet=True)
    sidecar = export(str(trained.policy), tmp_path / "policy.onnx")
    policy = load_policy(str(trained.policy), gym.make(ENV, **SHORT))
    play(tmp_path / "policy.onnx", policy, 3)
    assert json.loads(sidecar.read_text())["algorithm"] == algorithm


@pytest.mark.parametrize("env_id", ["rodgym/PendulumSwingUp-v0", "rodgym/FinThrust-v0"])
def test_the_policies_that_ship_can_be_exported(env_id: str, tmp_path: Path) -> None:
    export("zoo", tmp_path / "zoo.onnx", env_id)
    env = gym.make(env_id)
    assert env.observation_space.shape is not None
    play(tmp_path / "zoo.onnx", load_policy("zoo", env), env.observation_space.shape[0])


def test_an_exported_policy_plays_without_what_trained_it(tmp_path: Path) -> None:
    """Only the extra `export` is there: in another process, which cannot import PyTorch."""
    export("zoo", tmp_path / "zoo.onnx", ENV)
    absent = "import sys; sys.modules |= {'torch': None, 'stable_baselines3': None}"
    words = ["evaluate", str(tmp_path / "zoo.onnx"), "--seeds", "2", "--runs", str(tmp_path)]
    code = f"{absent}; from rodgym.cli import main; sys.exit(main({words!r}))"
    ran = subprocess.run([sys.executable, "-c", code], text=True, capture_output=True)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "mean of 2 episodes" in ran.stdout, ran.stdout


def test_a_policy_with_more_before_it_than_frames_is_refused(tmp_path: Path) -> None:
    env = VecNormalize(DummyVecEnv([lambda: gym.make(ENV, **SHORT)]))
    model = PPO("MlpPolicy", env, n_steps=64, batch_size=64, learning_rate=0.01, device="cpu")
    model.learn(256)
    model.save(tmp_path / "policy.zip")
    env.save(str(tmp_path / "vecnormalize.pkl"))
    with pytest.raises(PolicyError, match="Normalized cannot be exported"):
        export(str(tmp_path / "policy.zip"), tmp_path / "policy.onnx", ENV, SHORT)
    assert not (tmp_path / "policy.onnx").exists()
    # What is not known to stand there shows in the answers.
    policy = student_file(SHAPES["mlp"], tmp_path / "policy.zip")
    other = student_file(SHAPES["mlp"], tmp_path / "policy.zip")
    check_same(policy.student, other, gym.make(ENV).observation_space)
    other.student.mean += 0.1
    with pytest.raises(PolicyError, match="answer otherwise than it does"):
        check_same(policy.student, other, gym.make(ENV).observation_space)


def test_the_program_exports_and_evaluates(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "runs/mine").mkdir(parents=True)
    student_file(SHAPES["gru"], tmp_path / "runs/mine/policy.zip")
    assert main(["export", "runs/mine"]) == 0
    assert main(["evaluate", "runs/mine/policy.onnx", "--seeds", "3", "--name", "a"]) == 0
    assert main(["evaluate", "runs/mine", "--seeds", "3", "--name", "b"]) == 0
    first, second = (
        np.loadtxt(f"runs/{name}/scores.csv", delimiter=",", skiprows=1, usecols=2) for name in "ab"
    )
    np.testing.assert_allclose(first, second, atol=1e-4)
    about = json.loads((tmp_path / "runs/mine/policy.json").read_text())
    spec = machines.spec_of(gym.make(ENV))
    assert about["period"] == {"value": 0.01, "unit": "s"}
    assert about["inputs"]["observation"]["order"] == spec["observation"]["names"]
    assert about["inputs"]["state"]["shape"] == ["n", 25]
    assert about["outputs"]["action"]["order"] == spec["action"]["names"]
    assert about["parameters"]["torque_limit"] == {"value": 0.05, "unit": "N m"}
    result = evaluate("runs/mine/policy.onnx", ENV, seeds=range(2), env_kwargs=SHORT)
    assert result.columns["length"].tolist() == [0.6, 0.6]

    with pytest.raises(PolicyError, match="sees 3 numbers; this environment shows 18"):
        load_policy("runs/mine/policy.onnx", gym.make("rodgym/PendulumSwingUp-v0"))
    capsys.readouterr()
    for words, message in (
        (["export", "runs/mine", "--out", "policy.pt"], "must end in .onnx"),
        (["export", "lqr"], "'lqr'"),
        (["export", "nothing.zip"], "neither a file nor"),
        (["export", "runs/mine/policy.onnx", "--out", "b.onnx"], "cannot be exported"),
    ):
        assert main(words) == 2
        assert message in capsys.readouterr().err
    (tmp_path / "runs/mine/policy.onnx").write_bytes(b"damaged")
    with pytest.raises(PolicyError, match="holds no policy"):
        load_policy("runs/mine/policy.onnx", gym.make(ENV))
    (tmp_path / "runs/mine/policy.json").unlink()
    with pytest.raises(PolicyError, match="not a policy saved by rodgym"):
        load_policy("runs/mine/policy.onnx", gym.make(ENV))
