"""The report as evidence: who plays, what is paid, how it was made, pictures that can be read."""

import json
from pathlib import Path

import numpy as np
import pytest
import rodgym
from rodgym.evaluation import band_keywords, evaluate, record

stable_baselines3 = pytest.importorskip("stable_baselines3")

from learners import learn  # noqa: E402
from rodgym.cli import main  # noqa: E402
from rodgym.sb3 import make_vec_env  # noqa: E402

ENV = "rodgym/PendulumSwingUp-v0"
#: Arguments of a comparison whose pictures are soon drawn.
SHORT = ["--env-arg", "max_episode_steps=40"]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


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
        "rate weight</dt><dd>0.9174 s^2/rad^2",
        "most torque</dt><dd>0.03569 N m",
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


def test_a_comparison_in_a_band_plays_that_band(capsys):
    """The policies stay those of the environment as it is named."""
    arguments = ["compare", "--policy", "lqr", "--controller", "zero", "--seeds", "3", *SHORT]
    assert main([*arguments, "--band", "starts", "--name", "starts"]) == 0
    shown = capsys.readouterr().out
    keywords = band_keywords("starts", ENV, {"max_episode_steps": 40})
    expected = evaluate("lqr", ENV, range(3), env_kwargs=keywords).mean("return")
    assert f"{expected:.1f}" in next(x for x in shown.splitlines() if x.startswith("LQR"))
    facts = json.loads(Path("runs/starts/run.json").read_text())
    assert facts["band"] == "starts"
    assert facts["env_kwargs"] == json.loads(json.dumps(keywords))


def test_a_comparison_shows_how_much_may_go_wrong(monkeypatch, capsys):
    """One row a policy, however many designs it has; the numbers of `rodgym robustness`."""
    from rodgym import robustness
    from rodgym.robustness import Candidate

    def some(candidates, **how):
        return measure(candidates, seeds=2, quantities=["actuator_gain"], points=3, **how)

    measure = robustness.measure
    monkeypatch.setattr(robustness, "measure", some)
    drawn = ["--env-arg", "randomize={'width': (0.0065, 0.0075)}"]
    arguments = ["--policy", "lqr", "--controller", "zero", "--seeds", "1", *drawn, *SHORT]
    assert main(["compare", *arguments, "--robustness", "--name", "borne"]) == 0
    keywords = {"randomize": {"width": (0.0065, 0.0075)}, "max_episode_steps": 40}
    candidates = [
        Candidate("LQR", "lqr", ENV, keywords),
        Candidate("zero", "zero", ENV, keywords),
    ]
    expected = some(candidates)
    assert expected.table() in capsys.readouterr().out
    assert {"robustness.png", "robustness.csv", "robustness-values.csv"} <= {
        path.name for path in Path("runs/borne").iterdir()
    }
    assert "told of nothing else" in Path("runs/borne/report.html").read_text()
