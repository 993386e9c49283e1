"""Recipes are those of rl-baselines3-zoo: what it reads and writes is read and written here, text
is never run, and what is not taken is refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

import torch
import yaml
from conftest import SWING_UP
from rodgym.training.environments import action_noise, around, env_wrapper
from rodgym.training.expressions import expression
from rodgym.training.hyperparams import check_hyperparams
from rodgym.training.recipe import ZOO, Recipe, RecipeError, load_recipe
from rodgym.zoo.algorithms import ALGORITHMS, algorithm_class, canonical, zoo_name

#: Written as people of rl-baselines3-zoo write: every kind of value that its recipes have.
THEIRS = f"""
{SWING_UP}: &mine
  normalize: "dict(norm_obs=True, norm_reward=False)"
  n_envs: 8
  n_timesteps: !!float 1e6
  policy: 'MlpPolicy'
  n_steps: 32
  batch_size: 64
  gamma: 0.95
  learning_rate: lin_2.5e-4
  clip_range: lin_0.2
  ent_coef: 0.0
  use_sde: True
  frame_stack: 2
  env_wrapper:
    - gymnasium.wrappers.ClipAction
    - gymnasium.wrappers.RescaleAction:
        min_action: -0.5
        max_action: 0.5
  policy_kwargs: "dict(log_std_init=-2,
                       ortho_init=False,
                       activation_fn=nn.ReLU,
                       net_arch=dict(pi=[256, 256], vf=[256, 256])
                       )"
rodgym/PendulumBalance-v0:
  <<: *mine
  learning_rate: !!float 3e-5
"""


@pytest.fixture
def theirs(tmp_path: Path) -> Path:
    path = tmp_path / "ppo.yml"
    path.write_text(THEIRS)
    return path


def test_a_recipe_of_the_zoo_means_here_what_it_means_there(theirs: Path) -> None:
    recipe = load_recipe(SWING_UP, "ppo", theirs)
    assert (recipe.algorithm, recipe.n_timesteps, recipe.n_envs) == ("PPO", 1_000_000, 8)
    assert recipe.normalize_keywords() == {"gamma": 0.95, "norm_obs": True, "norm_reward": False}
    keywords = recipe.keywords()
    assert keywords["learning_rate"](0.5) == 1.25e-4 and keywords["clip_range"](1.0) == 0.2
    assert keywords["policy_kwargs"] == {
        "log_std_init": -2,
        "ortho_init": False,
        "activation_fn": torch.nn.ReLU,
        "net_arch": {"pi": [256, 256], "vf": [256, 256]},
    }
    check_hyperparams(recipe, algorithm_class("PPO"))
    balance = load_recipe("rodgym/PendulumBalance-v0", "PPO", theirs)
    assert balance.keywords()["learning_rate"] == 3e-5
    assert Recipe("SAC").n_envs == 1


@pytest.mark.parametrize("env_id", [SWING_UP, "rodgym/PendulumBalance-v0"])
def test_what_is_written_reads_back_and_is_what_the_zoo_takes(
    env_id: str, theirs: Path, tmp_path: Path
) -> None:
    recipe = load_recipe(env_id, "PPO", theirs)
    recipe.write(tmp_path / "again.yml", env_id)
    assert load_recipe(env_id, "PPO", tmp_path / "again.yml") == recipe
    # The zoo gives all that it does not know to the algorithm.
    entry = yaml.safe_load((tmp_path / "again.yml").read_text())[env_id]
    assert entry == {**yaml.safe_load(THEIRS)[env_id], "n_timesteps": 1_000_000}


@pytest.mark.parametrize(
    "file",
    [file for name in ALGORITHMS if (file := ZOO / f"{zoo_name(name)}.yml").is_file()],
    ids=lambda file: file.stem,
)
def test_our_recipes_are_recipes_of_the_zoo(file: Path) -> None:
    """As `ExperimentManager` reads them: it evaluates text; the algorithm gets the rest."""
    import stable_baselines3

    taken_by_the_zoo = {
        "n_timesteps", "n_envs", "policy", "frame_stack", "normalize", "env_wrapper",
        "vec_env_wrapper", "callback", "env_kwargs", "monitor_kwargs", "noise_type", "noise_std",
    }  # fmt: skip
    import inspect

    algorithm = getattr(stable_baselines3, canonical(file.stem))
    known = inspect.signature(algorithm).parameters
    for env_id, entry in yaml.safe_load(file.read_text()).items():
        for key, value in entry.items():
            assert key in taken_by_the_zoo or key in known, (env_id, key)
            if isinstance(value, str) and key == "policy_kwargs":
                assert eval(value, {"nn": torch.nn}) == expression(key, value)
            elif isinstance(value, str) and key in ("learning_rate", "clip_range"):
                assert value.startswith("lin_")
            elif isinstance(value, dict):
                # The zoo does not look for names in mappings.
                assert not any(isinstance(item, str) for item in value.values())


def test_what_the_zoo_saved_is_read(tmp_path: Path) -> None:
    """Its ``config.yml`` holds one entry alone, as an ordered dictionary with tuples."""
    from collections import OrderedDict

    saved = OrderedDict(n_timesteps=2e4, policy="MlpPolicy", train_freq=(1, "episode"), tau=0.02)
    path = tmp_path / "config.yml"
    path.write_text(yaml.dump(saved))
    recipe = load_recipe(SWING_UP, "SAC", path)
    assert recipe.n_timesteps == 20_000 and recipe.keywords()["train_freq"] == (1, "episode")


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("__import__('os').system('touch hacked')", "is not allowed"),
        ("dict(net_arch=open('x'))", "is not allowed"),
        ("dict(**{'a': 1})", "is not allowed"),
        ("[x for x in ().__class__.__bases__]", "is not allowed"),
        ("dict(activation_fn=nn.Module.__subclasses__)", "no class of torch"),
        ("dict(activation_fn=nn.functional)", "no class of torch"),
        ("dict(activation_fn=os.system)", "no class of torch"),
        ("dict(net_arch=[64", "is no expression"),
        ("64", "must be a mapping"),
        ("(" * 5000, "policy_kwargs"),
    ],
)
def test_text_is_parsed_and_never_run(text: str, named: str, tmp_path: Path) -> None:
    recipe = Recipe("PPO").with_changes({"policy_kwargs": text})
    with pytest.raises(RecipeError, match=named):
        recipe.keywords()


def test_yaml_that_would_make_objects_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.yml"
    path.write_text("x: !!python/object/apply:os.system ['touch hacked']")
    with pytest.raises(RecipeError, match="is not YAML"):
        load_recipe(SWING_UP, "PPO", path)
    (tmp_path / "bad.py").write_text("hyperparams = {}")
    with pytest.raises(RecipeError, match="is a program"):
        load_recipe(SWING_UP, "PPO", tmp_path / "bad.py")


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"replay_buffer_class": "HerReplayBuffer"}, "'replay_buffer_class' is not taken"),
        ({"vec_env_class": "subproc"}, "'vec_env_class' is not taken"),
        ({"env_wrapper": 3}, "env_wrapper = 3"),
        ({"env_wrapper": [{"a.B": {}, "c.D": {}}]}, "one dotted name"),
        ({"callback": [{"a.B": 3}]}, "keywords of a.B = 3"),
        ({"normalize": "yes"}, "normalize"),
        ({"normalize": {"speed": 1}}, "'speed' is not one of norm_obs"),
        ({"normalize": {"norm_obs": 1}}, "norm_obs = 1 must be true or false"),
        ({"normalize": {"clip_obs": -1}}, "clip_obs = -1 must be a number above 0"),
        ({"n_timesteps": "many"}, "n_timesteps = 'many'"),
        ({"n_timesteps": 1.5}, "n_timesteps = 1.5"),
        ({"env_kwargs": "dict(width=f())"}, "'f\\(\\)' is not allowed"),
        ({"policy": 3}, "policy = 3"),
    ],
)
def test_what_is_not_taken_is_refused_by_name(changes: dict, named: str) -> None:
    with pytest.raises(RecipeError, match=named):
        Recipe("PPO").with_changes(changes)


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("DQN", "'DQN' is not taken: it needs discrete actions"),
        ("her", "it needs environments with goals"),
        ("PPO2", "'PPO2' is not one of PPO, SAC"),
    ],
)
def test_algorithms_that_are_not_taken_are_refused_by_name(name: str, named: str) -> None:
    with pytest.raises(RecipeError, match=named):
        load_recipe(SWING_UP, name)


def test_algorithms_are_found_in_both_packages_and_in_any_spelling() -> None:
    for name in ALGORITHMS:
        assert algorithm_class(name.lower()).__name__ == name
    assert canonical("ppo_lstm") == "RecurrentPPO"


@pytest.mark.parametrize("name", ["subprocess.Popen", "os.system", "os", "nowhere.Wrapper", "x"])
def test_only_wrappers_and_callbacks_can_be_named(name: str) -> None:
    recipe = Recipe("PPO").with_changes(
        {"env_wrapper": name, "vec_env_wrapper": [{name: {"args": "touch hacked"}}]}
    )
    with pytest.raises(RecipeError, match="env_wrapper"):
        env_wrapper(recipe)
    with pytest.raises(RecipeError, match="vec_env_wrapper"):
        around(None, recipe)  # type: ignore[arg-type]


def test_noise_is_made_from_its_type_and_deviation() -> None:
    import gymnasium as gym

    space = gym.make(SWING_UP).action_space
    recipe = Recipe("TD3").with_changes({"noise_type": "normal", "noise_std": "0.1"})
    assert "sigma=[0.1]" in str(action_noise(recipe, space)["action_noise"])
    assert action_noise(Recipe("TD3"), space) == {}
    with pytest.raises(RecipeError, match="'pink' is not one of normal"):
        action_noise(recipe.with_changes({"noise_type": "pink"}), space)
    with pytest.raises(RecipeError, match="noise_std = None"):
        action_noise(Recipe("TD3").with_changes({"noise_type": "normal"}), space)


def test_an_environment_of_a_server_has_the_recipe_of_the_one_that_it_plays(capsys):
    from rodgym.cli.app import build_parser
    from rodgym.cli.commands.train import recipe_of
    from rodgym.training import load_recipe

    words = ["train", "--env", "rodgym/Remote-v0", "--env-arg", "server=tcp://127.0.0.1:5555"]
    for env_id in ("rodgym/PendulumSwingUp-v0", "rodgym/FinThrust-v0"):
        args = build_parser().parse_args([*words, "--env-arg", f"env_id={env_id}"])
        assert recipe_of(args) == load_recipe(env_id)
        assert capsys.readouterr().err == ""
