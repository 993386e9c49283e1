"""What comes with rodgym: recipes of trainings, by algorithm, and trained policies, by
environment.
"""

from __future__ import annotations

from pathlib import Path

ZOO = Path(__file__).parent


def is_zoo(source: str) -> bool:
    """Whether a policy's name means one that comes with rodgym: `zoo`, or `zoo:NAME`."""
    return source.partition(":")[0] == "zoo"


def zoo_policy(env_id: str, name: str = "") -> Path | None:
    """File of the trained policy for an environment that comes with rodgym, if there is one.

    `name` asks for another than the usual one, such as `unknown-e`.
    """
    path = ZOO / f"{env_id.rpartition('/')[2]}{name and f'.{name}'}.zip"
    return path if path.is_file() else None
