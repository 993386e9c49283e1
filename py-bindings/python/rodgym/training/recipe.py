"""Training recipes, in the format of rl-baselines3-zoo.

The recipes and the trained policies that come with rodgym live in ``rodgym/zoo`` (in the repository
``baselines/zoo`` points there).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from rodgym._literal import literal
from rodgym.training.expressions import RecipeError, expression, named_keywords, torch_class
from rodgym.training.recipe_file import entries
from rodgym.zoo import ZOO, zoo_policy
from rodgym.zoo.algorithms import OFF_POLICY, AlgorithmError, canonical, zoo_name

__all__ = ["ZOO", "Recipe", "RecipeError", "has_recipe", "load_recipe", "zoo_policy"]

#: Observations that a policy may see at once.
MAX_FRAMES = 1000
#: Keys whose text is a mapping written as Python.
MAPPINGS = ("policy_kwargs", "replay_buffer_kwargs", "monitor_kwargs", "env_kwargs")
#: Keywords that ``normalize`` may give to `VecNormalize`.
NORMALIZE = ("norm_obs", "norm_reward", "clip_obs", "clip_reward", "gamma", "epsilon")
#: Whole numbers that YAML may hold as floats (``!!float 1e6``).
WHOLE = (
    "n_timesteps", "n_envs", "frame_stack", "n_steps", "batch_size", "n_epochs", "buffer_size",
    "learning_starts", "gradient_steps",
)  # fmt: skip
#: Wrappers of ours: what an agent sees behind the first is known to evaluations, and behind the
#: second it sees what it would see without.
OWN_ACTIONS = ("rodgym.training.OwnActions", "rodgym.training.own_actions.OwnActions")
STAGGERED = ("rodgym.training.Staggered", "rodgym.training.staggered.Staggered")
#: Keys of rl-baselines3-zoo that are known and not taken, with the reason.
NOT_TAKEN = {
    "replay_buffer_class": "only the usual store of old steps is used (hindsight needs goals)",
    "rollout_buffer_class": "only the usual store of a rollout is used",
    "rollout_buffer_kwargs": "only the usual store of a rollout is used",
    "vec_env_class": "the native batch is the vectorised environment",
    "eval_env_kwargs": "validation plays the environment that is learnt in",
    "action_noise": "write noise_type and noise_std",
    "own_actions": "write vec_env_wrapper: rodgym.training.OwnActions",
}


@dataclass(frozen=True)
class Recipe:
    """How to train. Values stand here as in the file; `keywords` and others make objects of them.

    Parameters
    ----------
    algorithm: class of Stable-Baselines3 or sb3-contrib
    n_timesteps: environment steps in all
    n_envs: environments in the batch
    policy: policy class of the algorithm
    frame_stack: observations that the policy sees at once
    normalize: whether `VecNormalize` is used, or its keywords
    env_wrapper: Gymnasium wrappers around each environment, by dotted names; such environments are
        stepped one by one in Python
    vec_env_wrapper: wrappers of Stable-Baselines3 around the batch, by dotted names
    callback: callbacks of Stable-Baselines3, by dotted names
    env_kwargs: keywords of the environment
    monitor_kwargs: keywords of `Monitor`
    hyperparams: further keywords of the algorithm; ``lin_0.001`` falls linearly to zero
    """

    algorithm: str = "PPO"
    n_timesteps: int = 1_000_000
    n_envs: int = 1
    policy: str = "MlpPolicy"
    frame_stack: int = 1
    normalize: Any = False
    env_wrapper: Any = None
    vec_env_wrapper: Any = None
    callback: Any = None
    env_kwargs: Mapping[str, Any] = field(default_factory=dict)
    monitor_kwargs: Mapping[str, Any] = field(default_factory=dict)
    hyperparams: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        try:
            self._set(algorithm=canonical(self.algorithm))
        except AlgorithmError as error:
            raise RecipeError(str(error)) from None
        for name in ("n_timesteps", "n_envs", "frame_stack"):
            value = whole(getattr(self, name))
            if not isinstance(value, int) or isinstance(value, bool) or value < 1:
                raise RecipeError(f"{name} = {value!r} must be a whole number of at least 1")
            self._set(**{name: value})
        if self.frame_stack > MAX_FRAMES:
            raise RecipeError(f"frame_stack = {self.frame_stack} must be at most {MAX_FRAMES}")
        if not isinstance(self.policy, str):
            raise RecipeError(f"policy = {self.policy!r} must be a name")
        for name in ("env_kwargs", "monitor_kwargs"):
            self._set(**{name: mapping(name, getattr(self, name))})
        for name in ("env_wrapper", "vec_env_wrapper", "callback"):
            list(named_keywords(name, getattr(self, name)))
        for name in self.hyperparams:
            if name in NOT_TAKEN:
                raise RecipeError(f"{name!r} is not taken: {NOT_TAKEN[name]}")
        self.normalize_keywords()

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def with_changes(self, changes: Mapping[str, Any]) -> Recipe:
        """Returns this recipe with some values changed; unknown names are hyperparameters."""
        own = {key: value for key, value in changes.items() if key in OWN}
        rest = {key: value for key, value in changes.items() if key not in OWN}
        return replace(self, **own, hyperparams={**self.hyperparams, **rest})

    def keywords(self) -> dict[str, Any]:
        """Hyperparameters as the algorithm takes them: schedules and classes made from text.

        (``noise_type`` and ``noise_std`` are left to `environments.action_noise`, which knows how
        many actions there are.)
        """
        given = {k: v for k, v in self.hyperparams.items() if k not in ("noise_type", "noise_std")}
        result = {
            key: mapping(key, value) if key in MAPPINGS else schedule(key, value)
            for key, value in given.items()
        }
        for key in set(WHOLE) & set(result):
            result[key] = whole(result[key])
        if isinstance(result.get("train_freq"), list):
            result["train_freq"] = tuple(result["train_freq"])
        kwargs = result.get("policy_kwargs")
        if isinstance(kwargs, dict):
            for key in ("activation_fn", "optimizer_class"):
                if isinstance(kwargs.get(key), str):
                    kwargs[key] = torch_class(kwargs[key])
        return result

    def normalize_keywords(self) -> dict[str, Any] | None:
        """Keywords of `VecNormalize`; None where nothing is normalised.

        Rewards are discounted as the algorithm discounts, unless a gamma is given.
        """
        given = self.normalize
        if given is None or given is False:
            return None
        keywords = {} if given is True else mapping("normalize", given)
        for name, value in keywords.items():
            if name not in NORMALIZE:
                raise RecipeError(f"normalize: {name!r} is not one of {', '.join(NORMALIZE)}")
            flag = name.startswith("norm_")
            number = isinstance(value, int | float) and not isinstance(value, bool) and value > 0
            if not (isinstance(value, bool) if flag else number):
                allowed = "true or false" if flag else "a number above 0"
                raise RecipeError(f"normalize: {name} = {value!r} must be {allowed}")
        gamma = self.hyperparams.get("gamma")
        return {**({} if gamma is None else {"gamma": schedule("gamma", gamma)}), **keywords}

    @property
    def own_actions(self) -> bool:
        """Whether the agent sees, beside each observation, the action that led to it."""
        names = [name for name, _ in named_keywords("vec_env_wrapper", self.vec_env_wrapper)]
        return any(name in OWN_ACTIONS for name in names)

    def wrappers(self) -> list[str]:
        """Names of the wrappers around the environments that only this recipe knows."""
        keys = ("env_wrapper", "vec_env_wrapper")
        names = [name for key in keys for name, _ in named_keywords(key, getattr(self, key))]
        return [name for name in names if name not in (*OWN_ACTIONS, *STAGGERED)]

    def entry(self) -> dict[str, Any]:
        """All of it but the algorithm, as an entry that rl-baselines3-zoo reads.

        What is as it would be without the key is left out.
        """
        kept = {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if f.name in OWN and f.name != "algorithm"
        }
        usual = {"frame_stack": 1, "normalize": False}
        entry = {k: v for k, v in kept.items() if v not in (None, {}) and v != usual.get(k)}
        return {**entry, **self.hyperparams}

    def as_dict(self) -> dict[str, Any]:
        """All of it by name."""
        return {"algorithm": self.algorithm, **self.entry()}

    def write(self, path: Path, env_id: str) -> None:
        """Writes a file of recipes with this one, which rl-baselines3-zoo reads too."""
        import yaml

        text = yaml.safe_dump({env_id: _plain(self.entry())}, sort_keys=False)
        head = f"# {self.algorithm}, in the format of rl-baselines3-zoo\n"
        path.write_text(head + text, encoding="utf-8")


OWN = tuple(f.name for f in fields(Recipe) if f.name != "hyperparams")


def _plain(value: Any) -> Any:
    """Mappings and lists as YAML's safe kinds."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def whole(value: Any) -> Any:
    """``1e6`` as a whole number, also as text; everything else as it is."""
    if isinstance(value, str):
        value = literal(value)
    return int(value) if isinstance(value, float) and value.is_integer() else value


def mapping(name: str, value: Any) -> dict[str, Any]:
    """A mapping, also one that is written as Python: ``dict(net_arch=[64, 64])``.

    Raises
    ------
    RecipeError: anything else
    """
    if isinstance(value, str):
        value = expression(name, value)
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise RecipeError(f"{name} = {value!r} is not allowed: it must be a mapping")
    return dict(value)


def schedule(name: str, value: Any) -> Any:
    """Makes ``lin_0.001`` a schedule over the remaining share of training; other values stay.

    (But ``1e-3`` is a number, although YAML takes it for text.)
    """
    if not isinstance(value, str):
        return value
    if not value.startswith("lin_"):
        try:
            return literal(value)
        except ValueError as error:
            raise RecipeError(f"{name}: {error}") from error
    try:
        initial = float(value.removeprefix("lin_"))
    except ValueError:
        raise RecipeError(f"{name} = {value!r} must be lin_ and a number") from None

    def falling(remaining: float) -> float:
        return initial * remaining

    return falling


def load_recipe(env_id: str, algorithm: str = "PPO", file: Path | None = None) -> Recipe:
    """The recipe of an environment, from ``file`` or from the zoo, or else `plain_recipe`.

    A file holds entries by environment (``default`` stands for all), as those of
    rl-baselines3-zoo, or one entry alone, as the ``config.yml`` that it writes.

    Raises
    ------
    RecipeError: no such file, no entry in the file given, or a value that is not allowed
    """
    algorithm = Recipe(algorithm).algorithm
    if file is None and not has_recipe(env_id, algorithm):
        return plain_recipe(algorithm)
    path = file or _zoo_file(algorithm)
    found = entries(path)
    entry = found.get(env_id, found.get("default"))
    if "n_timesteps" in found:
        entry = found
    if not isinstance(entry, dict):
        raise RecipeError(f"{path} has no entry for {env_id}; it has {', '.join(map(str, found))}")
    return Recipe(algorithm).with_changes(entry)


def has_recipe(env_id: str, algorithm: str) -> bool:
    """Whether the zoo has one."""
    path = _zoo_file(algorithm)
    return path.is_file() and not {env_id, "default"}.isdisjoint(entries(path))


def plain_recipe(algorithm: str) -> Recipe:
    """The defaults of the library, tried on none of our tasks.

    An algorithm that learns from old steps learns as often as environments step, as with one
    environment.
    """
    if algorithm in OFF_POLICY:
        return Recipe(algorithm, 200_000, n_envs=8, hyperparams={"gradient_steps": -1})
    policy = "MlpLstmPolicy" if algorithm == "RecurrentPPO" else "MlpPolicy"
    return Recipe(algorithm, n_envs=64, policy=policy)


def _zoo_file(algorithm: str) -> Path:
    return ZOO / f"{zoo_name(algorithm)}.yml"
