"""Arguments that several subcommands share, and how their text is read."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rodgym._literal import literal
from rodgym.evaluation.bands import BANDS
from rodgym.evaluation.conditions import CHOSEN
from rodgym.extras import missing

DEFAULT_ENV = "rodgym/PendulumSwingUp-v0"
MAX_SEEDS = 100_000


class UsageError(Exception):
    """Wrong input of the user: its text is shown as it is, exit code 2."""


def env_id(text: str) -> str:
    """An environment's id; the namespace may be left out, and so may the version.

    One of the user's own stands behind the module that registers it: ``mine.py:My/Env-v0``.
    """
    import gymnasium as gym

    from rodgym._registration import ENVIRONMENTS, REMOTE

    known = sorted((*ENVIRONMENTS, REMOTE))
    for candidate in (text, f"rodgym/{text}", f"rodgym/{text}-v0"):
        if candidate in known:
            return candidate
    module, _, name = text.rpartition(":")
    if module:
        from rodgym._own import module_of
        from rodgym.errors import ParameterError

        try:
            module_of(module)
        except ParameterError as error:
            raise argparse.ArgumentTypeError(str(error)) from error
        if name in gym.registry:
            return text
        raise argparse.ArgumentTypeError(f"{module} registers no environment {name!r}")
    raise argparse.ArgumentTypeError(
        f"there is no environment {text!r}; there are {', '.join(known)}"
    )


def key_value(text: str) -> tuple[str, Any]:
    """Reads ``width=0.0081`` or ``randomize={'width': (0.006, 0.009)}``, see `literal`."""
    key, equals, value = text.partition("=")
    if not equals or not key.isidentifier():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=VALUE")
    try:
        return key, literal(value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{key}: {error}") from error


#: Arguments of environments that are the program's to choose.
_OURS = (*CHOSEN, "num_threads", "render_mode")


def env_arg(text: str) -> tuple[str, Any]:
    """A keyword of the environment and its value."""
    name, value = key_value(text)
    if name in _OURS:
        raise argparse.ArgumentTypeError(f"{name} is chosen by this command")
    whole = isinstance(value, int) and not isinstance(value, bool)
    if name == "max_episode_steps" and not (whole and value >= 1):
        # Episodes without an end would never be scored.
        raise argparse.ArgumentTypeError(f"{text!r}: it must be a whole number of at least 1")
    return name, value


def env_keywords(env: str, given: Mapping[str, Any] | Sequence[tuple[str, Any]]) -> dict[str, Any]:
    """Keywords of the environment, by name.

    Raises:
        UsageError: an environment on a server without what it needs to be found.
    """
    from rodgym._registration import REMOTE

    keywords = dict(given)
    missing = [name for name in ("server", "env_id") if name not in keywords]
    if env == REMOTE and missing:
        raise UsageError(
            f"{REMOTE} stands for any environment of a server: give --env-arg "
            "server=tcp://HOST:5555 --env-arg env_id=ID (docs/remote.md)"
        )
    return keywords


def rod_file(path: str) -> list[tuple[str, Any]]:
    """The keywords that a fitted rod gives an environment."""
    if said := missing(["yaml"]):
        raise argparse.ArgumentTypeError(said)
    from rodgym.lab import RecordingError
    from rodgym.lab.twin import keywords

    try:
        return list(keywords(path).items())
    except RecordingError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


class Rod(argparse.Action):
    """Puts a rod's keywords before those of ``--env-arg``, whatever the order on the line."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        namespace.env_arg = [*values, *namespace.env_arg]


def seed(text: str) -> int:
    """A seed of the learning libraries."""
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number < 2**32:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 0 to 2^32 - 1")
    return number


def seeds(text: str) -> range:
    """``100`` is the seeds 0..99; ``200:300`` is 200..299."""
    first, colon, last = text.rpartition(":")
    try:
        result = range(int(first) if colon else 0, int(last))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither a number of seeds nor FIRST:END"
        ) from None
    if result.start < 0 or not 1 <= len(result) <= MAX_SEEDS:
        raise argparse.ArgumentTypeError(
            f"{text!r} names {len(result)} seeds from {result.start}; "
            f"allowed are 1 to {MAX_SEEDS} seeds, none negative"
        )
    return result


def positive(text: str) -> int:
    """A whole number of at least 1; ``1e6`` and ``1_000_000`` are read too."""
    try:
        number = float(text)
    except ValueError:
        number = float("nan")
    if not number >= 1 or not number.is_integer():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number of at least 1")
    return int(number)


def at_most(most: int) -> Callable[[str], int]:
    """A reader of whole numbers from 1 to ``most``."""

    def read(text: str) -> int:
        if (number := positive(text)) > most:
            raise argparse.ArgumentTypeError(f"{text!r} is more than {most}")
        return number

    return read


def add_env(parser: argparse.ArgumentParser, default: str | None = DEFAULT_ENV) -> None:
    """``--env`` and ``--env-arg``."""
    shown = f"default {default}" if default else "default: the one that the policy was trained on"
    parser.add_argument(
        "--env", type=env_id, default=default, metavar="ID", help=f"environment ({shown})"
    )
    parser.add_argument(
        "--env-arg",
        type=env_arg,
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="keyword of the environment, such as width=0.0081 or "
        "\"randomize={'width': (0.006, 0.009)}\"; may be repeated",
    )
    parser.add_argument(
        "--rod",
        type=rod_file,
        action=Rod,
        metavar="FILE",
        help="rod.yml of 'rodgym fit': the environment gets that rod, and episodes draw it from "
        "the fitted intervals; --env-arg overrides it",
    )


def design(text: str) -> Any:
    """``nominal``, ``each``, ``drawn``, or a keyword and its value."""
    from rodgym.evaluation.design import WORDS

    if text in WORDS:
        return text
    if "=" not in text:
        words = ", ".join(WORDS)
        raise argparse.ArgumentTypeError(f"{text!r} is neither NAME=VALUE nor one of {words}")
    return key_value(text)


def add_designs(parser: argparse.ArgumentParser) -> None:
    """``--design``."""
    parser.add_argument(
        "--design",
        type=design,
        action="append",
        default=[],
        metavar="nominal|each|NAME=VALUE",
        help="the parameters that controllers are designed for: nominal, those of each episode, or "
        "these values; may be repeated (default: nominal; each and nominal, where episodes draw "
        "parameters)",
    )


def designs(given: Sequence[Any]) -> list[Any]:
    """What ``--design`` asks for: every word is a design, all values together are one."""
    words = [one for one in given if isinstance(one, str)]
    values = dict(one for one in given if not isinstance(one, str))
    return list(dict.fromkeys(words)) + ([values] if values else [])


def statistics(text: str) -> Any:
    """A file of statistics; ``none``: no normalisation."""
    return False if text == "none" else text


def add_normalize(parser: argparse.ArgumentParser) -> None:
    """``--normalize``."""
    parser.add_argument(
        "--normalize",
        type=statistics,
        metavar="FILE|none",
        help="statistics of VecNormalize from the policy's training, or none (default: "
        "vecnormalize.pkl beside the policy, if it is there)",
    )


def add_seeds(parser: argparse.ArgumentParser) -> None:
    """``--seeds``."""
    parser.add_argument(
        "--seeds",
        type=seeds,
        default=range(100),
        metavar="N|FIRST:END",
        help="episodes to play: one per seed (default 100: the seeds 0 to 99)",
    )


def add_band(parser: argparse.ArgumentParser) -> None:
    """``--band``: conditions of a standard evaluation."""
    parser.add_argument(
        "--band",
        choices=BANDS,
        default=BANDS[0],
        help="conditions to play under: nominal (default); starts: from any angle, while turning; "
        "rods: with machines near the nominal one, drawn each episode (docs/robustness.md)",
    )


def add_trajectories(parser: argparse.ArgumentParser) -> None:
    """``--trajectories``."""
    parser.add_argument(
        "--trajectories",
        choices=("csv", "parquet"),
        help="also write every step of every episode: observation, action, reward",
    )


def add_force(parser: argparse.ArgumentParser) -> None:
    """``--force``."""
    parser.add_argument("--force", action="store_true", help="replace an earlier run of this name")


def add_run(
    parser: argparse.ArgumentParser,
    default: str | None = None,
    words: str = "default: after the command and the environment",
) -> None:
    """``--name`` and ``--runs``: where results land; `words` say what a name left out becomes."""
    shown = f"default {default}" if default else words
    parser.add_argument("--name", default=default, help=f"name of the run ({shown})")
    parser.add_argument(
        "--runs", default="runs", metavar="DIR", help="folder of all runs (default runs)"
    )
