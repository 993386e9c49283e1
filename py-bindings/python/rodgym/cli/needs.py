"""What a command needs beside the package itself, asked before it works."""

from __future__ import annotations

from pathlib import Path

from rodgym.cli.arguments import UsageError
from rodgym.extras import missing

#: Plots, animations and pages of a comparison.
REPORT = ("matplotlib", "jinja2", "PIL")
#: A training and the recipe it reads.
TRAINING = ("stable_baselines3", "yaml")


def need(*modules: str) -> None:
    """Ends the command where one of these modules is not installed.

    Raises:
        UsageError: the sentence says which, and the extra that brings them all.
    """
    if said := missing(modules):
        raise UsageError(said)


def of_policy(*sources: str) -> tuple[str, ...]:
    """What policies need: ONNX files their runtime, other trained ones Stable-Baselines3."""
    from rodgym.zoo import is_zoo

    trained = [source for source in sources if is_zoo(source) or Path(source).exists()]
    exported = [source for source in trained if source.endswith(".onnx")]
    return (
        *(("onnxruntime",) if exported else ()),
        *(("stable_baselines3",) if len(trained) > len(exported) else ()),
    )


def of_algorithm(name: str | None) -> tuple[str, ...]:
    """What an algorithm needs beside a training: some are in another package."""
    from rodgym.zoo.algorithms import AlgorithmError, package_of

    try:
        return () if name is None else (package_of(name),)
    except AlgorithmError:
        return ()  # It is refused where it is asked for.


def of_env(env_id: str | None) -> tuple[str, ...]:
    """What an environment needs: one of a server the network."""
    from rodgym._registration import REMOTE

    return ("zmq", "msgpack") if env_id == REMOTE else ()


def of_data(table: str | None, dataset: str | None) -> tuple[str, ...]:
    """What a table of steps and a data set need."""
    return (*(("pyarrow",) if table == "parquet" else ()), *(("minari", "h5py") if dataset else ()))
