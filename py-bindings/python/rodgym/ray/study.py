"""A study's cases as Ray tasks.

A case is a pure function, so Ray may run it wherever a CPU is free, and again when its worker dies:
only the driver writes the table, one line for each case.
"""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from itertools import islice
from pathlib import Path
from typing import Any

import ray
from ray.exceptions import RayError, RayTaskError

import rodgym
from rodgym.evaluation.saved import STATISTICS
from rodgym.ray.cluster import WORKER_ENV, cluster
from rodgym.study.case import Row, policy_files, run_case
from rodgym.study.engine import Backend
from rodgym.study.spec import Case, StudyError

#: What Ray's tools and `ps` call a running case.
TASK = "rodgym-case"

#: How often a case is run again after its worker or machine died: a case that kills its worker
#: every time must not go on for ever.
RETRIES = 5


def backend(address: str = "local", workers: int | None = None) -> Backend:
    """Runs a study's cases on a Ray cluster, one CPU each.

    Arguments:
        address: see `rodgym.ray.cluster`.
        workers: cases at a time; `None`: as many as the cluster has CPUs, which may grow meanwhile.
    """

    def run(cases: list[tuple[int, Case]]) -> Generator[tuple[int, Row], None, None]:
        with cluster(address, workers):
            yield from _rows(cases, workers)

    return run


def _rows(
    cases: list[tuple[int, Case]], workers: int | None
) -> Generator[tuple[int, Row], None, None]:
    task = ray.remote(_run).options(
        name=TASK, num_cpus=1, max_retries=RETRIES, runtime_env={"env_vars": WORKER_ENV}
    )
    # Other machines do not have the files of this one.
    files = {policy: policy_files(policy) for policy in {case["policy"] for _, case in cases}}
    contents: dict[str, Any] = {
        policy: ray.put({name_of(file): file.read_bytes() for file in own})
        for policy, own in files.items()
    }
    waiting = iter(cases)
    running: dict[Any, tuple[int, Case]] = {}
    try:
        while True:
            # A few more than fit, so that no worker waits for us and a cluster that can grow does.
            limit = workers or 2 * max(1, int(ray.cluster_resources().get("CPU", 1)))
            for number, case in islice(waiting, max(0, limit - len(running))):
                reference = task.remote(case, contents[case["policy"]], rodgym.__version__)
                running[reference] = number, case
            if not running:
                return
            (reference,), _ = ray.wait(list(running))
            number, case = running.pop(reference)
            yield number, _result(reference, case)
    finally:
        # The study was stopped; the cluster may go on.
        for reference in running:
            ray.cancel(reference)


def name_of(file: Path) -> str:
    """What a policy's file is called on a worker, where the policy itself comes first."""
    return file.name if file.name == STATISTICS else f"policy{file.suffix}"


def _result(reference: Any, case: Case) -> Row:
    """The row of a finished task, or its error as it would be without Ray."""
    try:
        row: Row = ray.get(reference)
        return row
    except RayTaskError as error:
        raise error.cause from error
    except RayError as error:
        raise StudyError(
            f"a case was given up after {RETRIES + 1} lost workers: {case}: {error} "
            "Finished cases are kept: the same command goes on with the others"
        ) from error


def _run(case: Case, files: dict[str, bytes], version: str) -> Row:
    """One case on a worker; `files` are its policy's by name, if it has any."""
    if rodgym.__version__ != version:
        raise StudyError(
            f"a worker has rodgym {rodgym.__version__}, but the study was started by {version}: "
            "install the same version on all machines"
        )
    if not files:
        return run_case(case)
    with tempfile.TemporaryDirectory(prefix="rodgym-") as folder:
        for name, content in files.items():
            (Path(folder) / name).write_bytes(content)
        return run_case({**case, "policy": str(Path(folder) / next(iter(files)))})
