"""A score is the policy's own: what its training put before it is put before it again, or it is
refused by name; and what a controller was designed for stands beside its scores.
"""

import csv
import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import rodgym
from gymnasium.wrappers import NormalizeObservation, RescaleAction, RescaleObservation
from rodgym.baselines import Gait, Lqr
from rodgym.errors import ParameterError, UnknownEnvError
from rodgym.evaluation import PolicyError, evaluate, load_policy, record

stable_baselines3 = pytest.importorskip("stable_baselines3")

from rodgym.cli import main  # noqa: E402
from rodgym.sb3 import make_vec_env  # noqa: E402
from stable_baselines3 import A2C, DDPG, PPO, SAC, TD3  # noqa: E402
from stable_baselines3.common.evaluation import evaluate_policy  # noqa: E402
from stable_baselines3.common.vec_env import (  # noqa: E402
    DummyVecEnv,
    VecFrameStack,
    VecNormalize,
)

ENV = "rodgym/PendulumSwingUp-v0"
BALANCE = "rodgym/PendulumBalance-v0"
BASE = "rodgym/PendulumSwingUpBase-v0"
#: Rods of which a design for 7 mm holds two in three.
DRAWN = {"randomize": {"width": (0.006, 0.010)}}
SEEDS = range(8)
#: Arguments of a comparison whose pictures are soon drawn.
SHORT = ["--env-arg", "max_episode_steps=40"]
#: A bound of a space, in the type of the space: Gymnasium warns of others.
TWO = np.float32(2.0)


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def learn(venv, algorithm=PPO, steps=256, **keywords):
    """A model after a few steps: its statistics and its last observation are there."""
    if algorithm is PPO:
        keywords = {"n_steps": 32, "batch_size": 64, "n_epochs": 1, **keywords}
    return algorithm("MlpPolicy", venv, seed=0, device="cpu", **keywords).learn(steps)


def judged_by_sb3(model, venv, seed=0):
    """Returns of one episode an environment, by Stable-Baselines3's own evaluation."""
    venv.training = False
    venv.seed(seed)
    returns, _ = evaluate_policy(
        model, venv, n_eval_episodes=venv.num_envs, return_episode_rewards=True, warn=False
    )
    return sorted(returns)


# ----- normalisation, stacked frames


def test_a_model_behind_vecnormalize_scores_as_sb3_scores_it():
    venv = VecNormalize(make_vec_env(ENV, 8, 0))
    model = learn(venv)
    own = evaluate(model, ENV, SEEDS)
    assert sorted(own.columns["return"]) == pytest.approx(judged_by_sb3(model, venv), rel=1e-5)
    # Raw observations, which it never saw, give another score.
    raw = evaluate(model.policy, ENV, SEEDS)
    assert abs(raw.mean("return") - own.mean("return")) > 1e-3


@pytest.mark.parametrize("normalized_first", [True, False])
def test_frames_and_statistics_are_applied_in_the_order_of_the_training(normalized_first, tmp_path):
    venv = make_vec_env(ENV, 4, 0)
    if normalized_first:
        statistics = VecNormalize(venv)
        venv = VecFrameStack(statistics, 3)
    else:
        venv = statistics = VecNormalize(VecFrameStack(venv, 3))
    model = learn(venv)
    statistics.training = False
    theirs = judged_by_sb3(model, venv)
    assert sorted(evaluate(model, ENV, range(4)).columns["return"]) == pytest.approx(
        theirs, rel=1e-5
    )
    # The same from its file.
    model.save(tmp_path / "stacked.zip")
    statistics.save(tmp_path / "vecnormalize.pkl")
    saved = evaluate(str(tmp_path / "stacked.zip"), ENV, range(4))
    assert sorted(saved.columns["return"]) == pytest.approx(theirs, rel=1e-5)


def test_a_file_of_sb3_alone_finds_its_statistics_or_is_refused(tmp_path):
    venv = VecNormalize(make_vec_env(ENV, 8, 0))
    model = learn(venv)
    mine = evaluate(model, ENV, SEEDS).columns["return"]
    file = tmp_path / "elsewhere" / "plain.zip"
    file.parent.mkdir()
    model.save(file)
    with pytest.raises(PolicyError, match=r"normalised observations.*put vecnormalize.pkl beside"):
        evaluate(str(file), ENV, SEEDS)
    venv.save(tmp_path / "kept.pkl")
    for given in (str(tmp_path / "kept.pkl"), venv):
        assert evaluate(str(file), ENV, SEEDS, normalize=given).columns["return"] == pytest.approx(
            mine, rel=1e-6
        )
    # As rl_zoo3 lays it down, and beside it.
    for place in (file.with_suffix("") / "vecnormalize.pkl", file.parent / "vecnormalize.pkl"):
        place.parent.mkdir(exist_ok=True)
        venv.save(place)
        assert evaluate(str(file), ENV, SEEDS).columns["return"] == pytest.approx(mine, rel=1e-6)
        place.unlink()
    # Whoever knows better says so.
    assert evaluate(str(file), ENV, SEEDS, normalize=False).mean("return") != pytest.approx(
        mine.mean()
    )
    with pytest.raises(PolicyError, match=r"normalize = 'nowhere.pkl' is not allowed: No such"):
        evaluate(str(file), ENV, SEEDS, normalize="nowhere.pkl")
    (tmp_path / "no.pkl").write_bytes(b"nothing")
    with pytest.raises(PolicyError, match=r"no.pkl holds no VecNormalize"):
        evaluate(str(file), ENV, SEEDS, normalize=tmp_path / "no.pkl")
    # A loaded model knows as little as its file.
    with pytest.raises(PolicyError, match="PPO was trained on normalised observations"):
        record(PPO.load(file), ENV, 0)


@pytest.mark.parametrize("algorithm", [PPO, A2C, SAC, TD3, DDPG])
def test_every_file_of_sb3_is_read_without_our_card(algorithm, tmp_path):
    model = algorithm("MlpPolicy", make_vec_env(ENV, 2, 0), seed=0)
    file = tmp_path / "plain.zip"
    model.save(file)
    assert rodgym.evaluation.policies.read_card(file) == {"algorithm": algorithm.__name__}
    ours = evaluate(str(file), ENV, range(2))
    assert ours.columns["return"] == pytest.approx(evaluate(model, ENV, range(2)).columns["return"])


def test_the_program_plays_a_file_of_sb3_alone(capsys):
    venv = VecNormalize(make_vec_env(BASE, 4, 0))
    learn(venv).save("plain.zip")
    venv.save("kept.pkl")
    assert main(["evaluate", "plain.zip", "--seeds", "1"]) == 2
    assert "plain.zip does not say where it was trained: give --env ID" in capsys.readouterr().err
    there = ["--env", BASE, "--normalize", "kept.pkl", *SHORT]
    assert main(["evaluate", "plain.zip", "--seeds", "2", *there]) == 0
    assert main(["compare", "--policy", "plain.zip", "--seeds", "1", *there]) == 0
    assert main(["render", "plain.zip", "strip.png", "--stills", "2", *there]) == 0
    shown = capsys.readouterr().out
    assert "PPO" in shown and "LQG" in shown
    assert main(["evaluate", "plain.zip", "--seeds", "1", "--env", BASE]) == 2
    assert "--normalize FILE" in capsys.readouterr().err


# ----- other tasks, other parameters, other spaces


def test_a_policy_of_another_task_is_refused(tmp_path):
    with pytest.raises(PolicyError, match="trained for the task 'swing_up' of a pendulum"):
        evaluate(str(rodgym.zoo.zoo_policy(ENV)), BALANCE, SEEDS)
    model = learn(make_vec_env(ENV, 2, 0))
    for play in (evaluate, record):
        with pytest.raises(PolicyError, match=r"PPO does not fit.*task of rodgym/PendulumBalance"):
            play(model, BALANCE, range(1) if play is evaluate else 0)
    with pytest.raises(PolicyError, match="sees 18 numbers; this environment shows 3"):
        evaluate(model, BASE, SEEDS)


def test_other_parameters_are_marked(capsys):
    same = evaluate("zoo", ENV, SEEDS)
    other = evaluate("zoo", ENV, SEEDS, env_kwargs={"width": 0.0081})
    assert same.design == ""
    assert other.design == "trained: width=0.007"
    model = learn(make_vec_env(ENV, 2, 0, width=0.008))
    assert evaluate(model, ENV, SEEDS).design == "trained: width=0.008"
    arguments = ["--env", ENV, "--env-arg", "width=0.0081", "--seeds", "2", *SHORT]
    assert main(["compare", "--policy", "zoo", *arguments, "--name", "marked"]) == 0
    shown = capsys.readouterr().out
    assert "trained: width=0.007" in shown
    assert "trained: what was otherwise in its training than it is here" in shown
    assert "trained: width=0.007" in Path("runs/marked/report.html").read_text()


def test_a_model_trained_behind_a_wrapper_is_refused_where_it_is_missing():
    class Louder(gym.ObservationWrapper):
        def observation(self, observation):
            return np.clip(1.1 * observation, -20, 20).astype(np.float32)

    def behind(wrap):
        return DummyVecEnv([lambda: wrap(gym.make(ENV))] * 2)

    model = learn(behind(Louder), steps=64)
    with pytest.raises(PolicyError, match="PPO was trained behind Louder"):
        evaluate(model, ENV, SEEDS)
    model = learn(behind(lambda env: RescaleAction(env, -TWO, TWO)), steps=64)
    model.save("rescaled.zip")
    for policy in (model, "rescaled.zip"):
        with pytest.raises(PolicyError, match=r"acts in Box\(-2.*such as RescaleAction"):
            evaluate(policy, ENV, SEEDS)
    model = learn(behind(lambda env: RescaleObservation(env, 0 * TWO, TWO)), steps=64)
    model.save("rescaled.zip")
    with pytest.raises(PolicyError, match="PPO was trained behind RescaleObservation"):
        evaluate(model, ENV, SEEDS)
    for wrap in (lambda env: RescaleObservation(env, 0 * TWO, TWO), NormalizeObservation):
        learn(behind(wrap), steps=64).save("other.zip")
        with pytest.raises(PolicyError, match="a wrapper such as NormalizeObservation"):
            evaluate("other.zip", ENV, SEEDS)


# ----- controllers behind wrappers


@pytest.mark.parametrize(
    ("name", "wrap"),
    [
        ("NormalizeObservation", NormalizeObservation),
        ("RescaleObservation", lambda env: RescaleObservation(env, -TWO, TWO)),
        ("RescaleAction", lambda env: RescaleAction(env, -TWO, TWO)),
    ],
)
def test_controllers_refuse_wrappers_that_change_their_numbers(name, wrap):
    vector = getattr(gym.wrappers.vector, name)
    bounds = {"RescaleObservation": (-TWO, TWO), "RescaleAction": (-TWO, TWO)}.get(name, ())
    for env in (
        wrap(gym.make(ENV)),
        vector(gym.make_vec(ENV, num_envs=2), *bounds),
        DummyVecEnv([lambda: wrap(gym.make(ENV))]),
    ):
        with pytest.raises(ParameterError, match=f"behind {name} is not allowed"):
            Lqr.for_env(env)
        with pytest.raises(ParameterError, match=f"behind {name} is not allowed"):
            rodgym.baselines.make("lqr-hybrid", env)


def test_controllers_refuse_what_sb3_puts_between():
    with pytest.raises(ParameterError, match="behind VecNormalize is not allowed"):
        Lqr.for_env(VecNormalize(make_vec_env(ENV, 2)))
    with pytest.raises(ParameterError, match="behind VecFrameStack is not allowed"):
        Lqr.for_env(VecFrameStack(make_vec_env(ENV, 2), 3))
    # Rewards are nobody's observation.
    rewards = VecNormalize(make_vec_env(ENV, 2), norm_obs=False)
    assert Lqr.for_env(rewards).design["width"] == 0.007


# ----- environments and policies of one's own

MINE = '''
import gymnasium as gym
import numpy as np
import rodgym

TWO = np.float32(2.0)

class Low(gym.RewardWrapper):
    """Pays for hanging."""
    def reward(self, reward):
        return 1.0 - reward

class Quiet(gym.Wrapper):
    """Pays for a little torque; neither observations nor actions change."""
    def step(self, action):
        observation, _, terminated, truncated, info = self.env.step(action)
        return observation, -float(info["torque"]) ** 2, terminated, truncated, info

class Mirror(gym.Wrapper):
    """Shows the rod in a mirror, and does not say so."""
    def step(self, action):
        observation, *rest = self.env.step(action)
        return -observation, *rest
    def reset(self, *, seed=None, options=None):
        observation, info = self.env.reset(seed=seed, options=options)
        return -observation, info

def low(**keywords):
    return Low(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

def quiet(**keywords):
    return Quiet(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

def mirror(**keywords):
    return Mirror(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

def rescaled(**keywords):
    return gym.wrappers.RescaleAction(gym.make("rodgym/PendulumSwingUp-v0", **keywords), -TWO, TWO)

def running(**keywords):
    return gym.wrappers.NormalizeObservation(gym.make("rodgym/PendulumSwingUp-v0", **keywords))

for name in ("low", "quiet", "mirror", "rescaled", "running"):
    gym.registry.pop(f"Mine/{name.title()}-v0", None)  # Another test of this process had it.
    gym.register(f"Mine/{name.title()}-v0", entry_point=globals()[name], max_episode_steps=None)

class Full:
    """All the torque there is."""
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        assert observation.ndim == 2
        return np.ones((len(observation), 1), np.float32), state

class Designed(Full):
    def __init__(self, env):
        assert env.action_space.shape[-1] == 1
'''


@pytest.fixture
def mine(tmp_path, request):
    """A module of the user's, under a name of this test: a module is imported once."""
    name = "mine_" + request.node.name.split("[")[0][-20:]
    (tmp_path / f"{name}.py").write_text(MINE)
    return name


def test_an_environment_of_ones_own_is_scored_by_its_own_reward(mine, capsys):
    theirs = evaluate("lqr", ENV, SEEDS).columns["return"]
    own = evaluate("lqr", f"{mine}.py:Mine/Low-v0", SEEDS)
    assert own.columns["return"] == pytest.approx(500 - theirs)
    assert own.columns["upright"].tolist() == [1.0] * len(SEEDS)
    quiet = evaluate("lqr", f"{mine}:Mine/Quiet-v0", SEEDS)
    effort = quiet.columns["effort"]
    assert quiet.columns["return"] == pytest.approx(-500 * effort**2)
    one = record("lqr", f"{mine}.py:Mine/Low-v0", 3)
    assert one.rewards.sum() == pytest.approx(own.columns["return"][3])
    drawn = evaluate("lqr", f"{mine}.py:Mine/Low-v0", SEEDS, env_kwargs=DRAWN)
    assert drawn.design == "each" and len(set(drawn.parameters["width"])) == len(SEEDS)

    there = ["--env", f"{mine}.py:Mine/Low-v0", "--seeds", "2", *SHORT]
    assert main(["evaluate", "lqr", *there]) == 0
    assert main(["compare", "--policy", f"{mine}.py:Full,zoo", *there]) == 0
    shown = capsys.readouterr().out
    assert "Full" in shown and "\nzoo" in shown and "trained: rodgym/PendulumSwingUp-v0" in shown
    assert main(["render", f"{mine}:Full", "strip.png", "--stills", "2", *there[:2], *SHORT]) == 0
    with pytest.raises(SystemExit):
        main(["evaluate", "lqr", "--env", f"{mine}.py:Mine/Other-v0"])
    assert "registers no environment 'Mine/Other-v0'" in capsys.readouterr().err


def test_an_environment_that_nobody_registered_is_named():
    for play in (lambda env: evaluate("zero", env, range(1)), lambda env: record("zero", env)):
        for env in ("Mine/Nowhere-v0", "rodgym/PendulumSwingUp-v7"):
            with pytest.raises(UnknownEnvError, match=f"no environment '{env}'"):
                play(env)


def test_what_an_own_environment_does_to_the_numbers_is_noticed(mine):
    with pytest.raises(ParameterError, match="behind RescaleAction"):
        evaluate("lqr", f"{mine}.py:Mine/Rescaled-v0", SEEDS)
    with pytest.raises(ParameterError, match="observations behind Mirror are not allowed"):
        evaluate("lqr", f"{mine}.py:Mine/Mirror-v0", SEEDS)
    with pytest.raises(ParameterError, match="observations behind Mirror are not allowed"):
        record("lqr", f"{mine}.py:Mine/Mirror-v0", 0)
    with pytest.raises(ParameterError, match=r"NormalizeObservation.*its statistics run on"):
        evaluate("zero", f"{mine}.py:Mine/Running-v0", SEEDS)
    with pytest.raises(PolicyError, match="such as RescaleAction"):
        evaluate("zoo", f"{mine}.py:Mine/Rescaled-v0", SEEDS)


def test_a_model_plays_in_the_wrapped_environment_that_it_was_trained_in(mine):
    rodgym._own.module_of(f"{mine}.py")
    venv = DummyVecEnv([lambda: gym.make("Mine/Rescaled-v0") for _ in range(4)])
    model = learn(venv, steps=64)
    result = evaluate(model, "Mine/Rescaled-v0", range(4))
    assert result.design == ""
    venv = make_monitored("Mine/Rescaled-v0", 4)
    assert sorted(result.columns["return"]) == pytest.approx(judged_by_sb3(model, venv), rel=1e-5)


def make_monitored(env_id, count):
    from stable_baselines3.common.env_util import make_vec_env as theirs

    return theirs(env_id, count)


def test_a_class_of_ones_own_plays(mine, capsys):
    env = gym.make(ENV)
    for name in ("Full", "Designed"):
        policy = load_policy(f"{mine}.py:{name}", env)
        assert type(policy).__name__ == name
    assert evaluate(f"{mine}.py:Designed", ENV, range(2)).mean("effort") == pytest.approx(0.05)
    for text, said in (
        (f"{mine}.py:Fuller", "has no 'Fuller'"),
        ("nowhere.py:Full", "no file 'nowhere.py'"),
        ("nowhere:Full", "no module 'nowhere'"),
        (f"{mine}.py:low", "has no predict"),
    ):
        assert main(["evaluate", text, "--seeds", "1"]) == 2
        assert said in capsys.readouterr().err


def test_a_policy_sees_rows_wherever_it_plays():
    class Rows:
        def predict(self, observation, state=None, episode_start=None, deterministic=False):
            shapes.append(observation.shape)
            assert episode_start.shape == (len(observation),)
            return np.zeros((len(observation), 1)), state

    shapes: list[tuple[int, ...]] = []
    evaluate(Rows(), ENV, range(3), env_kwargs={"max_episode_steps": 2})
    record(Rows(), ENV, 0, env_kwargs={"max_episode_steps": 2})
    assert shapes == [(3, 18)] * 2 + [(1, 18)] * 2


# ----- designs


def test_the_lqr_of_drawn_widths_has_a_row_for_each_design(capsys):
    """Designed for 7 mm it holds two rods in three; the comparison once showed only that."""
    nominal = evaluate("lqr", ENV, range(100), env_kwargs=DRAWN, design="nominal")
    each = evaluate("lqr", ENV, range(100), env_kwargs=DRAWN)
    nine = evaluate("lqr", ENV, range(100), env_kwargs=DRAWN, design={"width": 0.009})
    assert (nominal.design, each.design, nine.design) == ("nominal", "each", "width=0.009")
    assert nominal.mean("return") == pytest.approx(350, abs=15)
    assert nominal.mean("upright") == pytest.approx(0.66, abs=0.05)
    assert each.mean("return") == pytest.approx(468, abs=3) and each.mean("upright") == 1.0
    assert nine.mean("return") == pytest.approx(469, abs=3)
    # The same episodes for all.
    assert np.array_equal(nominal.parameters["width"], each.parameters["width"])

    text = "randomize={'width': (0.006, 0.010)}"
    assert main(["evaluate", "lqr", "--env-arg", text, "--seeds", "20", "--name", "drawn"]) == 0
    shown = capsys.readouterr().out
    assert "LQR (each)" in shown and "LQR (nominal)" in shown and "privileged" in shown
    with Path("runs/drawn/scores.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    assert [row["design"] for row in rows] == ["each"] * 20 + ["nominal"] * 20
    assert [float(row["width"]) for row in rows[:20]] == pytest.approx(
        each.parameters["width"][:20]
    )
    assert [row["return"] for row in rows[:20]] == [row[3] for row in each.rows()[:20]]
    assert [row["return"] for row in rows[20:]] == [row[3] for row in nominal.rows()[:20]]
    assert json.loads(Path("runs/drawn/run.json").read_text())["designs"] == ["each", "nominal"]

    arguments = ["--env-arg", text, "--seeds", "2", "--name", "compared", *SHORT]
    assert main(["compare", "--policy", "zoo", "--design", "width=0.009", *arguments]) == 0
    assert "width=0.009" in capsys.readouterr().out
    assert "width=0.009" in Path("runs/compared/report.html").read_text()


def test_each_design_is_the_one_for_that_rod_alone():
    """To the bit: the rod of every episode, its controller designed for it, played alone."""
    each = evaluate("lqr", ENV, range(4), env_kwargs=DRAWN)
    one = record("lqr", ENV, 2, env_kwargs=DRAWN, design="each")
    assert one.rewards.sum() == pytest.approx(each.columns["return"][2], rel=1e-12)
    for i, width in enumerate(each.parameters["width"]):
        alone = evaluate("lqr", ENV, [i], env_kwargs=DRAWN, design={"width": float(width)})
        assert alone.columns["return"][0] == each.columns["return"][i]
        law = Lqr.for_env(gym.make(ENV, width=float(width)))
        known = evaluate(law, ENV, [i], env_kwargs=DRAWN)
        assert known.columns["return"][0] == each.columns["return"][i]
        assert known.design == f"width={width:.6g}"


def test_a_design_names_what_it_is_and_what_is_not_allowed():
    law = Lqr.for_env(gym.make(ENV, **DRAWN))
    assert repr(law).startswith("Lqr(width=0.007, length=0.3, density=1500")
    assert law.design["youngs_modulus"] == 1e7
    with pytest.raises(ParameterError, match="design = 'every' is not allowed: it must be 'nomin"):
        evaluate("lqr", ENV, SEEDS, design="every")
    with pytest.raises(ParameterError, match="designed already"):
        evaluate(law, ENV, SEEDS, design="each")
    with pytest.raises(ParameterError, match="'zoo' is none"):
        evaluate("zoo", ENV, SEEDS, design="each")
    with pytest.raises(ParameterError, match="width = 2"):
        evaluate("lqr", ENV, SEEDS, design={"width": 2.0})
    with pytest.raises(TypeError, match="unexpected keyword argument 'wide'"):
        evaluate("lqr", ENV, SEEDS, design={"wide": 2.0})
    assert evaluate("lqr", ENV, SEEDS).design == "nominal"
    # An object for other observations than those here.
    with pytest.raises(ParameterError, match="needs observations of 18 numbers"):
        evaluate(law, BASE, SEEDS)


def test_a_gait_is_found_on_fins_as_they_are_drawn():
    """The default of FinThrust draws Young's modulus, and the search plays what is drawn."""
    env = "rodgym/FinThrust-v0"
    result = evaluate("gait-sine", env, range(1))
    assert result.design == "drawn"
    assert "youngs_modulus=['log_uniform', 30000.0, 3000000.0]" in repr(
        Gait.for_env(gym.make(env), "sine")
    )
    assert result.header.count("youngs_modulus") == 1


def test_a_study_gives_the_numbers_of_an_evaluation():
    from rodgym.study.case import run_case

    for design in ("each", "nominal"):
        case = {"env": ENV, "seeds": 6, "policy": "lqr", "env.randomize": DRAWN["randomize"]}
        row = run_case({**case, "design": design})
        whole = evaluate("lqr", ENV, range(6), env_kwargs=DRAWN, design=design)
        assert row["return"] == whole.mean("return")
        assert row["sway"] == whole.mean("sway")
    assert run_case(case)["return"] == evaluate("lqr", ENV, range(6), env_kwargs=DRAWN).mean(
        "return"
    )


def test_a_study_of_a_normalised_policy_takes_its_statistics_along():
    from rodgym.study.case import policy_files, run_case
    from rodgym.study.spec import case_id

    venv = VecNormalize(make_vec_env(ENV, 4, 0))
    learn(venv).save("plain.zip")
    venv.save("vecnormalize.pkl")
    case = {"env": ENV, "seeds": 4, "policy": "plain.zip"}
    assert run_case(case)["return"] == pytest.approx(
        evaluate("plain.zip", ENV, range(4)).mean("return"), rel=1e-9
    )
    files = policy_files("plain.zip")
    assert [file.name for file in files] == ["plain.zip", "vecnormalize.pkl"]
    before = case_id(case, files)
    Path("vecnormalize.pkl").write_bytes(b"others")
    assert case_id(case, files) != before


def test_results_are_written_where_a_text_says(tmp_path):
    result = evaluate("zero", ENV, range(2))
    result.write_csv("name.csv")
    assert Path("name.csv").read_text().startswith("policy,design,seed,return,")


# ----- every step


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_every_step_is_written_to_the_bit(kind, capsys):
    arguments = ["--env", BALANCE, "--seeds", "3", "--trajectories", kind, "--name", "all"]
    if kind == "parquet":
        parquet = pytest.importorskip("pyarrow.parquet")
    assert main(["evaluate", "zero", *arguments]) == 0
    path = Path(f"runs/all/trajectories.{kind}")
    assert str(path) in capsys.readouterr().out
    if kind == "csv":
        with path.open() as stream:
            rows = list(csv.DictReader(stream))
    else:
        table = parquet.read_table(path).to_pylist()
        rows = [{k: "" if v is None else v for k, v in row.items()} for row in table]
    for seed in range(3):
        env = gym.make(BALANCE)
        observation, _ = env.reset(seed=seed)
        mine = [row for row in rows if int(row["seed"]) == seed]
        for step, row in enumerate(mine):
            seen = [np.float32(row[f"observation_{k}"]) for k in range(18)]
            assert np.array_equal(seen, observation)
            last = step == len(mine) - 1
            assert (row["reward"] == "") == (row["action_0"] == "") == last
            assert int(row["terminated"]) == last and int(row["truncated"]) == 0
            if last:
                break
            observation, reward, terminated, truncated, info = env.step([0.0])
            assert float(row["reward"]) == reward and float(row["tip_height"]) == info["tip_height"]
            assert terminated == (step == len(mine) - 2) and not truncated


def test_episodes_become_a_data_set_of_minari(tmp_path, monkeypatch, capsys):
    minari = pytest.importorskip("minari")
    pytest.importorskip("h5py")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "data"))
    arguments = ["--seeds", "5:8", "--env-arg", "width=0.008", *SHORT]
    assert main(["evaluate", "lqr", *arguments, "--minari", "pendulum/lqr-v0"]) == 0
    assert "data set: " in capsys.readouterr().out
    data = minari.load_dataset("pendulum/lqr-v0")
    assert data.total_episodes == 3 and data.total_steps == 120
    kwargs = {"width": 0.008, "max_episode_steps": 40}
    scores = evaluate("lqr", ENV, range(5, 8), env_kwargs=kwargs).columns["return"]
    env = data.recover_environment()
    for i, episode in enumerate(data.iterate_episodes()):
        assert episode.rewards.sum() == pytest.approx(scores[i], rel=1e-12)
        observation, info = env.reset(seed=5 + i)
        assert info["parameters"]["width"] == 0.008
        for step, action in enumerate(episode.actions):
            assert np.array_equal(observation, episode.observations[step])
            observation, reward, _, truncated, _ = env.step(action)
            assert reward == episode.rewards[step]
        assert np.array_equal(observation, episode.observations[-1])
        assert truncated and episode.truncations[-1] and not episode.terminations.any()
    # Nothing is overwritten.
    assert main(["evaluate", "lqr", *arguments, "--minari", "pendulum/lqr-v0"]) == 2
    assert "dataset_id = 'pendulum/lqr-v0' is not allowed" in capsys.readouterr().err


def test_steps_that_were_not_kept_cannot_be_written():
    result = evaluate("zero", ENV, range(1), env_kwargs={"max_episode_steps": 2})
    with pytest.raises(ParameterError, match=r"trajectories=True\) keeps them"):
        result.write_trajectories("steps.csv")
    kept = evaluate("zero", ENV, range(1), env_kwargs={"max_episode_steps": 2}, trajectories=True)
    with pytest.raises(ParameterError, match=r"must end in \.csv or \.parquet"):
        kept.write_trajectories("steps.txt")
    kept.write_trajectories("steps.csv")
    assert len(Path("steps.csv").read_text().splitlines()) == 4


def test_best_known_returns_stand_in_the_table_where_they_are_known(tmp_path, monkeypatch, capsys):
    from rodgym.evaluation import best_known, comparison_table

    kept = [{"id": ENV, "config": {"width": 0.008}, "return": 489.25, "source": "a test"}]
    monkeypatch.setattr(best_known, "FILE", tmp_path / "best_known.json")
    assert evaluate("zero", ENV, range(1), env_kwargs={"width": 0.008}).best_known is None
    best_known.FILE.write_text(json.dumps(kept))
    there = evaluate("zero", ENV, range(1), env_kwargs={"width": 0.008})
    assert there.best_known == 489.25
    assert "best known return here: 489.2" in comparison_table([there])
    assert evaluate("zero", ENV, range(1)).best_known is None


# ----- the report as evidence


def test_a_verdict_counts_the_episodes_of_each_policy():
    """Several trainings in one row have several times as many; the LQR stood "12 of 36" times."""
    from rodgym import machines
    from rodgym.evaluation import comparison_table
    from rodgym.evaluation.pooled import pooled

    lqr = evaluate("lqr", ENV, range(2), name="LQR")
    twice = pooled([lqr, lqr], "twice")
    said = machines.of({"machine": "pendulum"}).verdict([twice, lqr])
    assert "twice stands at the end of 4 of 4 episodes" in said
    assert "LQR stands at the end of 2 of 2 episodes" in said
    assert "mean of 2 episodes, seeds 0 to 1," in comparison_table([twice, lqr])


def test_a_report_says_who_plays_what_is_paid_and_how_it_was_made():
    text = "randomize={'width': (0.006, 0.010)}"
    learner = learn(make_vec_env(ENV, 2, 0), gamma=0.97)
    learner.save("mine.zip")
    arguments = ["--seeds", "2", "--env-arg", text, *SHORT, "--name", "told"]
    assert main(["compare", "--policy", "mine.zip", "--controller", "lqr", *arguments]) == 0
    page = Path("runs/told/report.html").read_text()
    for said in (
        "designed for</dt><dd>the width of every episode",
        "designed for</dt><dd>width = 0.007 m, length = 0.3 m",
        "limits</dt><dd>torque_limit = 0.05 N m, control_dt = 0.01 s",
        "gamma</dt><dd>0.97",
        'gae_lambda</dt><dd class="default">0.95',
        "<code>effort</code></td><td>-0.02 a^2</td>",
        "moment.png",
        "privileged",
    ):
        assert said in page, said
    facts = json.loads(Path("runs/told/run.json").read_text())
    assert facts["commit"] is None or len(facts["commit"].rstrip("+")) == 40
    assert "white-space: pre-wrap" in page


@pytest.mark.parametrize("env_id", list(rodgym.ENVIRONMENTS))
def test_every_reward_in_a_report_has_the_terms_of_the_core(env_id):
    from rodgym.report.reward import reward_of

    spec = rodgym._native.Batch(env_id, 1).spec
    told = reward_of(spec)
    assert told is not None and [term for term, _, _ in told.terms] == spec["reward_terms"]


def test_policies_keep_their_colours_in_a_gif(tmp_path):
    from PIL import Image, ImageColor
    from rodgym.report.gif import write_gif
    from rodgym.report.style import COLOURS

    # A wide sky of shades, as the pictures of a fin have.
    sky = np.zeros((60, 90, 3), np.uint8)
    sky[..., 2] = np.arange(60)[:, None] * 4
    pictures = []
    for shift in range(3):
        picture = Image.fromarray(np.roll(sky, shift, 0))
        for i, colour in enumerate(COLOURS):
            picture.paste(colour, (10 * i, 0, 10 * i + 3, 3))
        pictures.append(picture)
    write_gif(tmp_path / "x.gif", pictures, 0.04)
    with Image.open(tmp_path / "x.gif") as gif:
        for frame in range(3):
            gif.seek(frame)
            shown = gif.convert("RGB")
            for i, colour in enumerate(COLOURS):
                assert shown.getpixel((10 * i + 1, 1)) == ImageColor.getrgb(colour)


def test_stills_are_close_together_where_much_moves(capsys):
    from PIL import Image
    from rodgym.report import animation

    episode = record("lqr", ENV, 0, frame_rate=25.0)
    chosen = animation.moments(episode, 7)
    assert chosen[0] == 0 and chosen[-1] == len(episode.frames) - 1
    assert chosen == sorted(chosen)
    # The rod stands after half a second of five.
    assert sum(k * episode.frame_dt <= 0.8 for k in chosen) >= 5
    assert animation.at_times(episode, [0.0, 0.21, 99.0]) == [0, 5, len(episode.frames) - 1]
    assert main(["render", "lqr", "strip.png", "--at", "0,0.2,0.4", *SHORT]) == 0
    with Image.open("strip.png") as strip:
        assert strip.width == 3 * animation.STILL + 2 * animation.GAP
    with pytest.raises(SystemExit):
        main(["render", "lqr", "strip.png", "--at", "0,-1"])
    assert "is not a list of at most 100 times" in capsys.readouterr().err


def test_a_film_is_as_long_as_its_episode():
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg")
    assert main(["render", "zero", "film.mp4", *SHORT]) == 0
    frames, seconds = imageio_ffmpeg.count_frames_and_secs("film.mp4")
    assert frames == 11 and seconds == pytest.approx(0.44, abs=0.05)
