"""How a student is taught: YAML beside the recipes of trainings, `rodgym/zoo/distil.yml`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rodgym.distil.checked import Checked, RecipeError, number, whole
from rodgym.distil.student import ACTIVATIONS, NETS
from rodgym.distil.tuning import Tuning
from rodgym.zoo import ZOO

#: The recipes that come with rodgym.
FILE = ZOO / "distil.yml"
#: Sizes that counts may have.
COUNTS: dict[str, int] = {
    "frames": 1000, "units": 4096, "rounds": 10_000, "rods": 1 << 20, "keep": 10_000,
    "batches": 1_000_000, "batch_size": 1 << 20,
}  # fmt: skip


@dataclass(frozen=True)
class Recipe(Checked):
    """Teacher, student, and the rounds between them.

    Parameters
    ----------
    teacher: controller, `zoo`, or a policy's file; it acts on everything that there is to see
    net, frames, own_actions, hidden, activation, units: the student, see `Shape`
    rounds: each plays one episode a rod and learns from the last `keep` rounds
    rods: episodes of a round
    guided: share of the rods that the teacher drives, round by round; none after the last of these
    keep: rounds whose lessons are kept
    batches, batch_size: minibatches of a round and their size: windows of an mlp, episodes of a
        gru; None: what suits the net, see `lessons`
    learning_rate: (first, last): of Adam, falling by the same factor from round to round
    lost_samples: each rod loses its own share of the samples, drawn from 0 to this
    variants: keywords of the environment that the rods of a round are divided over, such as
        delays: `[{actuator_delay: 0}, {actuator_delay: 0.01}]`
    env_kwargs: keywords of the environment, unless others are given
    sight: keywords of the teacher's environment; None: everything, without noise
    fine_tune: how PPO goes on from the student, see `Tuning`
    """

    teacher: str = "lqr"
    net: str = "mlp"
    frames: int = 24
    own_actions: bool = True
    hidden: tuple[int, ...] = (256, 256)
    activation: str = "Tanh"
    units: int = 128
    rounds: int = 12
    rods: int = 128
    guided: tuple[float, ...] = (1.0, 0.3, 0.3, 0.3)
    keep: int = 12
    batches: int | None = None
    batch_size: int | None = None
    learning_rate: tuple[float, ...] = (1e-3, 1e-4)
    lost_samples: float = 0.0
    variants: tuple[Mapping[str, Any], ...] = ({},)
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    sight: Mapping[str, Any] | None = None
    fine_tune: Tuning = field(default_factory=Tuning)

    def __post_init__(self) -> None:
        for name, most in COUNTS.items():
            value = getattr(self, name)
            left_out = value is None and name in ("batches", "batch_size")
            fits = left_out or (whole(value) and 1 <= value <= most)
            self._check(name, fits, f"a whole number from 1 to {most}")
        self._check("teacher", isinstance(self.teacher, str), "a controller's name or a file")
        self._check("net", self.net in NETS, f"one of {', '.join(NETS)}")
        self._check(
            "activation", self.activation in ACTIVATIONS, f"one of {', '.join(ACTIVATIONS)}"
        )
        self._check("own_actions", isinstance(self.own_actions, bool), "true or false")
        self._list("hidden", lambda x: whole(x) and 1 <= x <= 4096, "sizes from 1 to 4096")
        self._list("guided", lambda x: number(x) and 0 <= x <= 1, "shares from 0 to 1")
        self._list("learning_rate", lambda x: number(x) and 0 < x <= 1, "two rates, up to 1")
        self._check("learning_rate", len(self.learning_rate) == 2, "two rates: first and last")
        lost = self.lost_samples
        self._check("lost_samples", number(lost) and 0 <= lost < 1, "a share from 0 to below 1")
        self._list("variants", lambda x: isinstance(x, Mapping), "keywords of the environment")
        count = len(self.variants)
        self._check("variants", 1 <= count <= self.rods, f"1 to {self.rods} (rods) dictionaries")
        self._check("env_kwargs", isinstance(self.env_kwargs, Mapping), "a dictionary")
        self._check(
            "sight", self.sight is None or isinstance(self.sight, Mapping), "a dictionary, or null"
        )
        if not isinstance(self.fine_tune, Tuning):
            self._check("fine_tune", isinstance(self.fine_tune, Mapping), "a dictionary")
            object.__setattr__(self, "fine_tune", Tuning().with_changes(self.fine_tune))

    @property
    def lessons(self) -> tuple[int, int]:
        """Minibatches of a round, and their size."""
        count, size = (600, 1024) if self.net == "mlp" else (60, 16)
        return self.batches or count, self.batch_size or size


def load_recipe(env_id: str, source: str | None = None) -> Recipe:
    """The recipe of an environment.

    Arguments:
        source: a name that one of rodgym's recipes for this environment has, such as `unknown-e`;
            or a file, with an entry for this environment or `default`. None: rodgym's usual one,
            or where there is none, the defaults of `Recipe`.

    Raises:
        RecipeError: no such recipe, or a value that is not allowed.
    """
    path = Path(source) if source and Path(source).is_file() else FILE
    entries = _entries(path)
    key = f"{env_id}:{source}" if source and path is FILE else env_id
    entry = entries.get(key, entries.get("default"))
    if entry is None and source is None:
        return Recipe()
    if not isinstance(entry, dict):
        names = ", ".join(name for name in entries if isinstance(entries[name], dict))
        raise RecipeError(f"recipe {source!r}: {path} has no entry for {key}; it has {names}")
    return Recipe().with_changes(entry)


def _entries(path: Path) -> dict[str, Any]:
    import yaml

    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise RecipeError(f"{path} cannot be read: {error}") from error
    if not isinstance(entries, dict):
        raise RecipeError(f"{path} holds no entries 'ENV_ID: {{...}}'")
    return entries
