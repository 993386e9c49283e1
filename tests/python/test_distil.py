"""Promises of `rodgym distil`: the teacher's answers are learnt from the same rods, a distillation
that was cut off goes on to the same student, and a student plays like any policy."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rodgym.sb3
import torch
from rodgym import baselines
from rodgym.cli import main
from rodgym.distil import Recipe, RecipeError, distil, load_recipe
from rodgym.distil.handover import HandOver
from rodgym.distil.learn import episodes, windows
from rodgym.distil.lost import Lossy
from rodgym.distil.policy import StudentPolicy
from rodgym.distil.rounds import Pair, teach
from rodgym.distil.student import Shape, Student
from rodgym.errors import ParameterError, ShapeError
from rodgym.evaluation import evaluate, load_policy, record
from rodgym.evaluation.policies import PolicyError, read_card
from rodgym.runs import Run, RunError

ENV = "rodgym/PendulumSwingUpBase-v0"
NOISE = {"sensor_noise": {"angle": 0.001, "rate": 0.01}}
SHORT = {"max_episode_steps": 40, **NOISE}
#: A distillation of a second.
TINY = Recipe(
    frames=4, hidden=(16,), rounds=3, rods=8, guided=(1.0, 0.5), batches=20, batch_size=64
)
TINY_GRU = TINY.with_changes({"net": "gru", "units": 8, "batch_size": 4})


def made_student(net: str = "mlp", seed: int = 0) -> Student:
    torch.manual_seed(seed)
    return Student(Shape(3, 1, net, 4 if net == "mlp" else 1, hidden=(16,), units=8), [-1], [1])


def test_the_answers_are_those_of_the_teacher_on_the_true_state() -> None:
    env_kwargs = {**SHORT, "randomize": {"youngs_modulus": (7e6, 13e6)}}
    pair = Pair(ENV, env_kwargs, 6)
    seeds = np.random.default_rng(5).integers(2**63, size=6).tolist()
    lessons = teach(made_student(), "lqr", pair, np.random.default_rng(5), guided=0.5)
    pair.close()
    # The same rods without noise, every edge seen: the first half is driven by the regulator.
    env = gym.make_vec(
        "rodgym/PendulumSwingUpBase-v0",
        num_envs=6,
        **{**env_kwargs, "observation": "full", "sensor_noise": {}},
    )
    teacher = baselines.make("lqr", env)
    truth, _ = env.reset(seed=seeds)
    state = None
    for step in range(40):
        answer, state = teacher.predict(truth, state, np.zeros(6, bool) if step else None)
        np.testing.assert_array_equal(lessons.answers[:, step].numpy(), answer)
        # What was done is the last number of the next frame.
        done = lessons.frames[:, step + 1, -1:].numpy() if step < 39 else answer
        np.testing.assert_array_equal(done[:3], answer[:3])
        noise = lessons.frames[:, step, 1].numpy() - truth[:, 6]
        assert 0 < np.abs(noise).max() < 0.006
        truth, *_ = env.step(done)
    assert lessons.alive.all() and lessons.steps == 240
    assert not np.array_equal(lessons.answers[3:, 5:], lessons.frames[3:, 6:, -1:])


def test_a_teacher_of_two_is_up_as_soon_as_a_policy_and_stands_as_still_as_a_regulator() -> None:
    sight = {"observation": "full", "youngs_modulus": 7e6}
    env = gym.make_vec(ENV, num_envs=3, **sight)
    teacher = HandOver(env)
    seen, _ = env.reset(seed=5)
    answer, state = teacher.predict(seen)
    # Hanging rods are the policy's.
    assert not state[2].any()
    np.testing.assert_array_equal(answer, teacher.swing.predict(seen, deterministic=True)[0])
    played = {
        name: evaluate(name, ENV, range(200, 210), env_kwargs=sight)
        for name in ("rodgym.distil.handover:HandOver", "zoo:sighted", "lqr")
    }
    both, swing, hold = played.values()
    assert both.mean("upright") == 1
    assert both.mean("return") > hold.mean("return") + 3
    assert both.columns["sway"].max() < 0.1 * swing.columns["sway"].min()


def test_a_teacher_of_two_must_see_every_edge() -> None:
    with pytest.raises(PolicyError, match="observation='full'"):
        HandOver(gym.make(ENV))


def test_noise_beside_a_disturbance_is_refused_because_rods_would_part() -> None:
    with pytest.raises(ParameterError, match=r"torque_disturbance = 0\.001"):
        Pair(ENV, {**SHORT, "torque_disturbance": 0.001}, 2)
    Pair(ENV, {"torque_disturbance": 0.001}, 2).close()


def test_windows_end_at_their_answer_and_begin_with_zeros() -> None:
    pair = Pair(ENV, {"max_episode_steps": 6}, 3)
    lessons = [teach(made_student(), "lqr", pair, np.random.default_rng(0), 1.0) for _ in "ab"]
    pair.close()
    shown, answers = next(windows(lessons, 4, 200, torch.Generator().manual_seed(0)))
    assert shown.shape == (200, 4, 4)
    for window, answer in zip(shown, answers, strict=True):
        rod, step = np.argwhere((lessons[0].frames == window[-1]).all(2).numpy())[0]
        assert answer == lessons[0].answers[rod, step]
        before = max(0, 3 - step)
        assert not window[:before].any()
        assert torch.equal(window[before:], lessons[0].frames[rod, step - 3 + before : step + 1])
    whole, answers = next(episodes(lessons, 5, torch.Generator().manual_seed(0)))
    assert whole.shape == (5, 6, 4) and answers.isfinite().all()


@pytest.mark.parametrize("net", ["mlp", "gru"])
def test_a_student_steps_as_it_learns(net: str) -> None:
    student = made_student(net)
    pair = Pair(ENV, SHORT, 4)
    lessons = teach(student, "lqr", pair, np.random.default_rng(1), 1.0, lost_samples=0.5)
    pair.close()
    student.normalise(lessons.frames.flatten(0, 1))
    lost = (lessons.frames[..., :2] == 0).all(2)
    assert 0 < lost.sum() < 80 and not lost[:, 0].any()
    with torch.no_grad():
        state = torch.zeros(4, student.shape.state)
        stepped = []
        for frame in lessons.frames.unbind(1):
            seen = torch.where(lost[:, len(stepped), None], torch.nan, frame[:, :3])
            state = student.with_action(state, frame[:, 3:])
            action, state = student.step(seen, state)
            stepped.append(action)
        if net == "gru":
            whole = student(lessons.frames)
        else:
            padded = torch.nn.functional.pad(lessons.frames, (0, 0, 3, 0))
            view = padded.unfold(1, 4, 1).transpose(2, 3)
            whole = torch.stack([student(view[:, step]) for step in range(40)], 1)
    torch.testing.assert_close(torch.stack(stepped, 1), whole.clamp(-1, 1))


@pytest.mark.parametrize("recipe", [TINY, TINY_GRU], ids=["mlp", "gru"])
def test_a_distillation_that_was_cut_off_goes_on_to_the_same_student(
    recipe: Recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = distil(ENV, Run("whole", tmp_path), recipe=recipe, seed=3, env_kwargs=SHORT, quiet=True)
    assert whole.rounds == 3 and whole.steps == 3 * 8 * 40 and not whole.interrupted

    from rodgym.distil import dagger

    fit, calls = dagger.fit, []

    def cut_off(*args: object) -> float:
        calls.append(1)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return fit(*args)  # type: ignore[arg-type]

    monkeypatch.setattr(dagger, "fit", cut_off)
    run = Run("cut", tmp_path)
    cut = distil(ENV, run, recipe=recipe, seed=3, env_kwargs=SHORT, quiet=True)
    assert cut.interrupted and cut.rounds == 1 and cut.policy.is_file()
    (run.path / "policy.zip").rename(tmp_path / "elsewhere")
    with pytest.raises(RunError, match="from a distillation that was stopped"):
        distil(ENV, run, recipe=recipe, seed=3, env_kwargs=SHORT, quiet=True)
    (tmp_path / "elsewhere").rename(run.path / "policy.zip")
    with pytest.raises(RunError, match="its seed is 3, not 4"):
        distil(ENV, run, recipe=recipe, seed=4, env_kwargs=SHORT, quiet=True, resume=True)
    rest = distil(ENV, run, recipe=recipe, seed=3, env_kwargs=SHORT, quiet=True, resume=True)
    assert len(calls) == 4 and not (run.path / "distil.checkpoint").exists()

    curves = [[[row[0], row[1], *row[4:]] for row in one.curve] for one in (whole, rest)]
    assert curves[0] == curves[1]
    env = gym.make(ENV, **SHORT)
    first, second = (load_policy(str(one.policy), env) for one in (whole, rest))
    assert isinstance(first, StudentPolicy) and isinstance(second, StudentPolicy)
    for name, value in first.student.state_dict().items():
        assert torch.equal(value, second.student.state_dict()[name]), name
    assert first.card["best_round"] == whole.best_round and first.card["teacher"] == "lqr"
    with pytest.raises(RunError, match="not there: no distillation of this name"):
        distil(ENV, run, recipe=recipe, seed=3, env_kwargs=SHORT, quiet=True, resume=True)


def test_a_killed_program_resumes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["distil", "--runs", str(tmp_path), "--name", "killed"]
    words += ["--env-arg", "max_episode_steps=40"]
    for change in ("frames=4", "hidden=[16]", "rods=8", "batch_size=64", "rounds=2", "batches=300"):
        words += ["--set", change]
    program = subprocess.Popen([sys.executable, "-m", "rodgym", *words], stderr=subprocess.DEVNULL)
    checkpoint = tmp_path / "killed/distil.checkpoint"
    while program.poll() is None and not checkpoint.exists():
        time.sleep(0.01)
    program.kill()
    program.wait()
    assert checkpoint.exists() and not (tmp_path / "killed/policy.zip").exists()
    assert main([*words, "--resume"]) == 0
    assert "taught for 2 rounds, 640 steps" in capsys.readouterr().out


def test_a_student_is_a_policy_like_others(tmp_path: Path) -> None:
    run = Run("student", tmp_path)
    made = distil(ENV, run, recipe=TINY, env_kwargs=SHORT, quiet=True)
    source = str(run.path)
    result = evaluate(source, ENV, seeds=range(5), env_kwargs=SHORT)
    # One alone.
    one = record(source, ENV, seed=3, env_kwargs=SHORT)
    assert one.rewards.sum() == pytest.approx(result.columns["return"][3], abs=1e-4)
    # In a `VecEnv`: each environment its own memory.
    env = rodgym.sb3.make_vec_env(ENV, 5, 0, env_kwargs=SHORT)
    policy = load_policy(str(made.policy), gym.make(ENV, **SHORT))
    observation, state, start, total = env.reset(), None, np.ones(5, bool), np.zeros(5)
    for _ in range(40):
        action, state = policy.predict(observation, state, start, deterministic=True)
        observation, reward, start, _ = env.step(action)
        total += reward
    np.testing.assert_allclose(total, result.columns["return"], atol=1e-4)
    # A new episode forgets the last one.
    fresh, _ = policy.predict(observation)
    again, _ = policy.predict(observation, state, np.ones(5, bool))
    later, _ = policy.predict(observation, state, np.zeros(5, bool))
    assert np.array_equal(fresh, again) and not np.array_equal(fresh, later)
    card = read_card(made.policy)
    assert card["kind"] == "student" and card["recipe"]["frames"] == 4
    with pytest.raises(PolicyError, match="sees 3 numbers; this environment shows 18"):
        load_policy(source, gym.make("rodgym/PendulumSwingUp-v0"))
    with pytest.raises(ShapeError, match=r"shape \(2, 5\)"):
        policy.predict(np.zeros((2, 5)))
    with pytest.raises(ShapeError, match="state has shape"):
        policy.predict(observation, np.zeros((5, 2)))


def test_a_student_is_taught_and_plays_over_the_network(tmp_path: Path) -> None:
    from remote_helpers import need_server, serving

    need_server()
    recipe = TINY.with_changes({"rounds": 1})
    here = distil(ENV, Run("here", tmp_path), recipe=recipe, env_kwargs=SHORT, quiet=True)
    with serving() as server:
        there = {"server": server.address, "env_id": ENV, **SHORT}
        made = distil(
            "rodgym/Remote-v0", Run("there", tmp_path), recipe=recipe, env_kwargs=there, quiet=True
        )
        assert [row[4:] for row in made.curve] == [row[4:] for row in here.curve]
        played = evaluate(str(here.policy), "rodgym/Remote-v0", range(3), env_kwargs=there)
    local = evaluate(str(here.policy), ENV, range(3), env_kwargs=SHORT)
    assert played.columns["return"].tolist() == local.columns["return"].tolist()


def test_variants_and_lost_samples_are_taught_and_validated(tmp_path: Path) -> None:
    late = ({}, {"actuator_delay": 0.02})
    recipe = TINY.with_changes({"variants": late, "lost_samples": 0.3, "rounds": 1})
    made = distil(ENV, Run("late", tmp_path), recipe=recipe, env_kwargs=SHORT, quiet=True)
    assert made.steps == 8 * 40
    policy = load_policy(str(made.policy), gym.make(ENV))
    lossy = evaluate(Lossy(policy, 0.5, 0), ENV, seeds=range(3), env_kwargs=SHORT)
    again = evaluate(Lossy(policy, 0.5, 0), ENV, seeds=range(3), env_kwargs=SHORT)
    whole = evaluate(policy, ENV, seeds=range(3), env_kwargs=SHORT)
    assert lossy.columns["return"].tolist() == again.columns["return"].tolist()
    assert lossy.columns["return"].tolist() != whole.columns["return"].tolist()


def test_recipes() -> None:
    assert load_recipe(ENV).teacher == "lqr"
    assert load_recipe(ENV, "unknown-e").env_kwargs["randomize"]
    assert load_recipe("rodgym/FinThrust-v0") == Recipe()
    with pytest.raises(RecipeError, match=r"recipe 'unknown-x': .* has no entry"):
        load_recipe(ENV, "unknown-x")
    for changes, message in (
        ({"frame": 3}, "'frame' is not in a recipe"),
        ({"frames": 0}, "frames = 0 is not allowed: it must be a whole number from 1 to 1000"),
        ({"net": "lstm"}, "net = 'lstm' is not allowed: it must be one of mlp, gru"),
        ({"hidden": [16, "a"]}, "hidden = .* sizes"),
        ({"guided": [2.0]}, "guided = .* shares from 0 to 1"),
        ({"learning_rate": [1e-3]}, "two rates"),
        ({"lost_samples": 1.0}, "lost_samples = 1.0 is not allowed"),
        ({"variants": []}, "variants = "),
        ({"fine_tune": 3}, "fine_tune = 3 is not allowed: it must be a dictionary"),
        ({"fine_tune": {"gama": 0.9}}, "'gama' is not in fine_tune: it has steps, "),
        ({"fine_tune": {"gamma": 2}}, "gamma = 2 is not allowed: it must be a number from 0 to 1"),
        ({"fine_tune": {"batch_size": 8193}}, "batch_size = 8193 .* from 2 to 8192"),
    ):
        with pytest.raises(RecipeError, match=message):
            Recipe().with_changes(changes)


def test_the_program_refuses_what_cannot_be(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for words, message in (
        (["--recipe", "nobody"], "recipe 'nobody'"),
        (["--set", "frams=3"], "'frams' is not in a recipe"),
        (["--resume"], "no distillation of this name can be resumed"),
        (["--teacher", "nobody"], "'nobody' is neither a file nor one of"),
    ):
        assert main(["distil", *words]) == 2
        assert message in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_ppo_begins_as_the_student_and_keeps_the_best_stage(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from rodgym.distil import fine_tune

    monkeypatch.setattr(fine_tune, "VALIDATION_SEEDS", range(10_000, 10_004))
    run = Run("student", tmp_path)
    recipe = TINY.with_changes({"fine_tune": {"gamma": 0.98}})
    made = distil(ENV, run, recipe=recipe, env_kwargs=SHORT, quiet=True)
    words = ["distil", "--fine-tune", "ppo", "--from", str(made.policy), "--steps", "17000"]
    assert main([*words, "--runs", str(tmp_path), "--name", "next"]) == 0
    assert "fine-tuned for 24,576 steps" in capsys.readouterr().out
    policy = load_policy(str(tmp_path / "next-ppo"), gym.make(ENV, **SHORT))
    card = read_card(tmp_path / "next-ppo/policy.zip")
    assert card["student"]["teacher"] == "lqr" and card["env_kwargs"] == SHORT
    # How PPO goes on stands in the recipe of the student.
    assert card["recipe"]["gamma"] == card["student"]["recipe"]["fine_tune"]["gamma"] == 0.98
    rows = np.loadtxt(tmp_path / "next-ppo/learning_curve.csv", delimiter=",", skiprows=1)
    student = evaluate(str(made.policy), ENV, fine_tune.VALIDATION_SEEDS, env_kwargs=SHORT).mean(
        "return"
    )
    tuned = evaluate(policy, ENV, fine_tune.VALIDATION_SEEDS, env_kwargs=SHORT).mean("return")
    # Stage 0 is the student; the critic learns alone at first, then the actor does.
    assert rows[0, 0] == 0 and rows[0, 3] == pytest.approx(student, abs=1e-4)
    assert len(set(rows[:, 3])) > 1 and tuned == pytest.approx(rows[:, 3].max(), abs=1e-4)
    assert main([*words, "--runs", str(tmp_path), "--name", "next"]) == 2
    assert "choose another --name" in capsys.readouterr().err
    for words, message in (
        (["--steps", "5"], "--from and --steps are for --fine-tune"),
        (["--fine-tune", "ppo", "--from", "zoo:x", "--name", "z"], "no trained policy called 'x'"),
        (["--fine-tune", "ppo", "--from", "lqr", "--name", "z"], "'lqr' is neither a file"),
    ):
        assert main(["distil", *words, "--runs", str(tmp_path)]) == 2
        assert message in capsys.readouterr().err
