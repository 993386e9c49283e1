"""Promise: pictures need no display, show the state and are the same for the same episode; windows
open and close cleanly; wrappers that show or keep pictures work as on any environment."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import gymnasium as gym
import numpy as np
import numpy.typing as npt
import pytest
import rodgym
from gymnasium.wrappers import AddRenderObservation, HumanRendering, RenderCollection

#: Every environment, with width and height of its picture.
SIZES = {"pendulum": (480, 480), "fin": (800, 450)}
USUAL_SIZE = {env_id: SIZES[entry.machine] for env_id, entry in rodgym.ENVIRONMENTS.items()}
SWING_UP = "rodgym/PendulumSwingUp-v0"


def film(env: gym.Env[Any, Any], steps: int, seed: int = 0) -> list[npt.NDArray[np.uint8]]:
    """Pictures of an episode of random actions that depend on the seed only."""
    env.reset(seed=seed)
    env.action_space.seed(seed)
    frames = [env.render()]
    for _ in range(steps):
        env.step(env.action_space.sample())
        frames.append(env.render())
    return frames  # type: ignore[return-value]


@pytest.mark.parametrize("env_id", USUAL_SIZE)
def test_a_picture_has_the_usual_size_and_shows_motion(env_id: str) -> None:
    with gym.make(env_id, render_mode="rgb_array") as env:
        frames = film(env, 20)
    width, height = USUAL_SIZE[env_id]
    for frame in frames:
        assert frame.shape == (height, width, 3)
        assert frame.dtype == np.uint8 and frame.flags.c_contiguous
        assert len(np.unique(frame @ np.array([65536, 256, 1]))) > 50, "there is something to see"
    assert all((a != b).any() for a, b in pairwise(frames))


@pytest.mark.parametrize("env_id", USUAL_SIZE)
def test_the_same_episode_gives_the_same_pictures(env_id: str) -> None:
    one, other = (film(gym.make(env_id, render_mode="rgb_array"), 8) for _ in range(2))
    assert all((a == b).all() for a, b in zip(one, other, strict=True))


def test_looking_does_not_change_the_episode() -> None:
    seen, unseen = gym.make(SWING_UP, render_mode="rgb_array"), gym.make(SWING_UP)
    assert (seen.reset(seed=3)[0] == unseen.reset(seed=3)[0]).all()
    for k in range(30):
        action = np.array([np.sin(k)], dtype=np.float32)
        seen.render()
        assert (seen.step(action)[0] == unseen.step(action)[0]).all()


def test_pictures_start_afresh_with_each_episode() -> None:
    with gym.make(SWING_UP, render_mode="rgb_array") as env:
        first, again = film(env, 10), film(env, 10)
    assert all((a == b).all() for a, b in zip(first, again, strict=True))


def test_no_display_and_no_window_library_is_needed() -> None:
    program = (
        "import sys, gymnasium as gym\n"
        f"env = gym.make('rodgym:{SWING_UP}', render_mode='rgb_array')\n"
        "env.reset(seed=0)\n"
        "assert env.render().any()\n"
        "missing = {'pygame', 'PIL', 'matplotlib', 'OpenGL'} & set(sys.modules)\n"
        "assert not missing, missing\n"
    )
    # No DISPLAY, no WAYLAND_DISPLAY: nothing at all but what finds Python itself.
    subprocess.run(
        [sys.executable, "-c", program], check=True, env={"PYTHONPATH": ":".join(sys.path)}
    )


@pytest.mark.parametrize("size", [(64, 64), (320, 200), (101, 33)])
def test_a_picture_has_the_size_that_was_asked_for(size: tuple[int, int]) -> None:
    with gym.make(SWING_UP, render_mode="rgb_array", render_size=size) as env:
        env.reset(seed=0)
        frame = env.render()
    assert isinstance(frame, np.ndarray) and frame.shape == (size[1], size[0], 3)


def test_a_size_that_cannot_be_drawn_is_refused_by_name() -> None:
    with pytest.raises(rodgym.RodgymError, match=r"\(4, 480\) .* 16 to 8192"):
        gym.make(SWING_UP, render_mode="rgb_array", render_size=(4, 480))
    env = gym.make(SWING_UP).unwrapped
    env.reset(seed=0)
    with pytest.raises(rodgym.RodgymError, match=r"width = 4 .* 16 to 8192"):
        env.frame(4, 480)


def test_a_figure_is_an_svg_document_of_the_same_picture() -> None:
    env = gym.make(SWING_UP, render_size=(320, 200)).unwrapped
    env.reset(seed=0)
    start = env.svg()
    root = ElementTree.fromstring(start)
    assert root.tag.endswith("svg") and root.get("viewBox") == "0 0 320 200"
    assert len(root) > 20
    env.step(np.ones(1, dtype=np.float32))
    assert env.svg() != start
    assert ElementTree.fromstring(env.svg(width=640)).get("viewBox") == "0 0 640 200"


def test_frames_a_second_are_those_of_real_time() -> None:
    env = gym.make(SWING_UP, control_dt=0.02, physics_dt=2e-4)
    assert env.metadata["render_fps"] == 50
    assert gym.make(SWING_UP).metadata["render_fps"] == 100


def test_wrappers_collect_pictures_and_learn_from_them() -> None:
    collection = RenderCollection(gym.make(SWING_UP, render_mode="rgb_array"))
    collection.reset(seed=0)
    for _ in range(4):
        collection.step(np.zeros(1, dtype=np.float32))
    assert len(collection.render()) == 5
    pixels = AddRenderObservation(
        gym.make(SWING_UP, render_mode="rgb_array", render_size=(64, 64)), render_only=True
    )
    observation, _ = pixels.reset(seed=0)
    assert pixels.observation_space.contains(observation) and observation.shape == (64, 64, 3)


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
def test_render_without_a_mode_warns(make: Any) -> None:
    env = make(SWING_UP).unwrapped
    env.reset(seed=0)
    with pytest.warns(UserWarning, match="without a render_mode"):
        assert env.render() is None


def test_video_of_an_episode(tmp_path: Path) -> None:
    pytest.importorskip("moviepy")
    env = gym.make(SWING_UP, render_mode="rgb_array", render_size=(64, 64), max_episode_steps=5)
    video = gym.wrappers.RecordVideo(env, str(tmp_path))
    video.reset(seed=0)
    for _ in range(5):
        video.step(np.zeros(1, dtype=np.float32))
    video.close()
    assert list(tmp_path.glob("*.mp4"))


class TestWindow:
    """The window of mode "human", on SDL's video driver that has no screen."""

    pygame = pytest.importorskip("pygame")

    @pytest.fixture(autouse=True)
    def _no_screen(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")

    def test_it_opens_with_the_episode_shows_it_and_closes(self) -> None:
        env = gym.make(SWING_UP, render_mode="human")
        assert not self.pygame.display.get_init()
        env.reset(seed=0)
        surface = self.pygame.display.get_surface()
        assert surface.get_size() == (480, 480)
        still = self.pygame.surfarray.array3d(surface).swapaxes(0, 1).copy()
        with gym.make(SWING_UP, render_mode="rgb_array") as other:
            other.reset(seed=0)
            assert (other.render() == still).all()
        env.step(np.ones(1, dtype=np.float32))
        assert (self.pygame.surfarray.array3d(surface).swapaxes(0, 1) != still).any()
        shown = self.pygame.surfarray.array3d(surface).swapaxes(0, 1)
        assert (shown == env.unwrapped.frame()).all()
        assert env.render() is None
        env.close()
        assert not self.pygame.display.get_init()
        env.close()

    def test_closing_the_window_interrupts_as_a_key_would(self) -> None:
        env = gym.make(SWING_UP, render_mode="human")
        env.reset(seed=0)
        self.pygame.event.post(self.pygame.event.Event(self.pygame.QUIT))
        with pytest.raises(KeyboardInterrupt):
            env.step(np.zeros(1, dtype=np.float32))
        env.close()
        assert not self.pygame.display.get_init()

    def test_a_controller_can_be_watched(self, monkeypatch: pytest.MonkeyPatch) -> None:
        from rodgym import rendering
        from rodgym.evaluation import record

        shown: list[tuple[int, ...]] = []
        show = rendering.Window.show
        monkeypatch.setattr(
            rendering.Window, "show", lambda w, f: (shown.append(f.shape), show(w, f))
        )
        human = {"render_mode": "human", "render_size": (200, 100)}
        episode = record("lqr", SWING_UP, env_kwargs=human, max_seconds=0.1)
        assert shown == [(100, 200, 3)] * (1 + len(episode.rewards)) and len(shown) == 11
        assert not self.pygame.display.get_init()

    def test_gymnasiums_own_window_shows_our_pictures(self) -> None:
        env = HumanRendering(gym.make(SWING_UP, render_mode="rgb_array"))
        env.reset(seed=0)
        env.step(np.zeros(1, dtype=np.float32))
        assert self.pygame.display.get_surface().get_size() == (480, 480)
        env.close()


def test_a_batch_shows_each_environment_as_it_would_be_shown_alone() -> None:
    batch = gym.make_vec(SWING_UP, num_envs=3, render_mode="rgb_array", render_size=(160, 160))
    alone = [gym.make(SWING_UP, render_mode="rgb_array", render_size=(160, 160)) for _ in range(3)]
    batch.reset(seed=5)
    for i, env in enumerate(alone):
        env.reset(seed=5 + i)
    for k in range(6):
        pictures = batch.render()
        assert pictures is not None and len(pictures) == 3
        for picture, env in zip(pictures, alone, strict=True):
            assert (picture == env.render()).all()
        actions = np.sin(k + np.arange(3, dtype=np.float32))[:, None]
        batch.step(actions)
        for action, env in zip(actions, alone, strict=True):
            env.step(action)


def test_stable_baselines_gets_one_image_an_environment() -> None:
    pytest.importorskip("stable_baselines3")
    import rodgym.sb3

    venv = rodgym.sb3.make_vec_env(SWING_UP, n_envs=2, render_mode="rgb_array")
    venv.reset()
    images = venv.get_images()
    assert [image.shape for image in images] == [(480, 480, 3)] * 2
    tiled = venv.render()
    assert tiled is not None and tiled.shape[2] == 3 and tiled.size >= 2 * images[0].size


def test_notebooks_show_environments_batches_and_episodes() -> None:
    from rodgym.evaluation import record

    env = gym.make(SWING_UP)
    env.reset(seed=0)
    shown = ElementTree.fromstring(env.unwrapped._repr_html_())
    assert shown.tag.endswith("svg")
    envs = gym.make_vec(SWING_UP, num_envs=6)
    envs.reset(seed=0)
    assert envs._repr_html_().count("<svg") == 4 and "6 environments" in envs._repr_html_()
    episode = record("lqr", SWING_UP, frame_rate=10.0, max_seconds=0.5)
    assert "data:image/gif;base64,R0lGOD" in episode._repr_html_()
    assert "<img" not in record("lqr", SWING_UP, max_seconds=0.1)._repr_html_()
