"""The recipes and the trained policies that come with rodgym."""

from pathlib import Path

import gymnasium as gym
import pytest
from conftest import PENDULUMS
from rodgym import machines
from rodgym.cli import main
from rodgym.evaluation import evaluate
from rodgym.evaluation.policies import read_card
from rodgym.training.recipe import ZOO, RecipeError, load_recipe, zoo_policy

POLICIES = sorted(ZOO.glob("*.zip"))
#: Mean return of each policy on the seeds 200 to 239.
RETURNS = {
    "FinEfficiency-v0": 93.37,
    "FinSwim-v0": 206.83,
    "FinThrust-v0": 33.24,
    "PendulumBalance-v0": 999.999,
    "PendulumSwingUp-v0": 481.23,
    "PendulumSwingUpBase-v0": 470.9,
    "PendulumSwingUpBase-v0.sighted": 479.98,
    "PendulumSwingUpBase-v0.unknown-e": 471.6,
    "PendulumSwingUpBase-v0.unknown-e-by-policy": 479.95,
}
#: The least share of the classical controller's return on the same seeds.
MARGINS = {
    # Of its own teacher, the gait, which has no better one in this task.
    "FinEfficiency-v0": 1.02,
    # Of the best gait; its teacher, the best sinusoid, has 0.994 of that.
    "FinSwim-v0": 0.995,
    "FinThrust-v0": 1.2,
    "PendulumBalance-v0": 0.999,
    "PendulumSwingUp-v0": 1.01,
    "PendulumSwingUpBase-v0": 0.99,
    "PendulumSwingUpBase-v0.sighted": 1.01,
    "PendulumSwingUpBase-v0.unknown-e": 0.99,
    "PendulumSwingUpBase-v0.unknown-e-by-policy": 1.01,
}


@pytest.mark.parametrize("path", POLICIES, ids=lambda path: path.stem)
def test_a_trained_policy_does_its_task_on_seeds_that_chose_nothing(path: Path) -> None:
    card = read_card(path)
    env_id, env_kwargs = card["env"], card["env_kwargs"]
    name = path.stem.partition(".")[2]
    assert zoo_policy(env_id, name) == path
    source = f"zoo:{name}" if name else "zoo"
    result = evaluate(source, env_id, seeds=range(200, 240), env_kwargs=env_kwargs)
    for column in result.described:
        if column.success:
            assert result.mean(column.name) >= 0.9
    # What was measured when it was shipped; a network's sums may differ in their last bits.
    assert result.mean("return") == pytest.approx(RETURNS[path.stem], rel=0.005)
    # The classical controller that sees as much; of a fin it is the best gait.
    spec = machines.spec_of(gym.make(env_id, **env_kwargs))
    (usual,) = machines.of(spec).controllers(spec)
    classical = evaluate(usual, env_id, seeds=range(200, 240), env_kwargs=env_kwargs).mean("return")
    assert result.mean("return") > MARGINS[path.stem] * classical


@pytest.mark.parametrize("env_id", PENDULUMS)
def test_every_pendulum_has_a_recipe(env_id: str) -> None:
    recipe = load_recipe(env_id)
    assert recipe.algorithm == "PPO"
    # A batch that does not divide the rollout would leave a rest that is learnt from less.
    rollout = recipe.n_envs * recipe.hyperparams["n_steps"]
    assert rollout % recipe.hyperparams["batch_size"] == 0


@pytest.mark.parametrize("env_id", ["PendulumSwingUp", "PendulumBalance", "FinThrust"])
def test_sac_has_recipes_that_train(
    env_id: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments = ["--env", env_id, "--algorithm", "sac", "--steps", "320", "--name", "sac"]
    assert main(["train", *arguments, "--set", "learning_starts=160"]) == 0
    assert "no recipe" not in capsys.readouterr().err
    card = read_card(tmp_path / "runs/sac/policy.zip")
    assert card["algorithm"] == "SAC" and card["recipe"]["gradient_steps"] == 8
    result = evaluate(str(tmp_path / "runs/sac"), card["env"], seeds=range(2))
    assert result.mean("length") > 0


def test_a_linear_schedule_falls_to_zero() -> None:
    recipe = load_recipe(PENDULUMS[0]).with_changes({"learning_rate": "lin_0.002"})
    rate = recipe.keywords()["learning_rate"]
    assert [rate(1.0), rate(0.5), rate(0.0)] == [0.002, 0.001, 0.0]


def test_changes_reach_their_place_and_leave_the_original() -> None:
    recipe = load_recipe(PENDULUMS[0])
    changed = recipe.with_changes({"n_envs": 8, "gamma": 0.9})
    assert (changed.n_envs, changed.hyperparams["gamma"]) == (8, 0.9)
    assert recipe == load_recipe(PENDULUMS[0]) != changed


def test_a_file_without_the_entry_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "mine.yml"
    file.write_text("other/Env-v0: {n_envs: 4}\n")
    with pytest.raises(RecipeError, match="no entry for rodgym/PendulumSwingUp-v0"):
        load_recipe("rodgym/PendulumSwingUp-v0", file=file)
