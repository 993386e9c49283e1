"""Runs the cases that a table still lacks.

The table on disk grows by one line a finished case, so a study that was killed goes on where it
stopped; at the end its lines are put in the study's order. So the table is the same bytes whatever
was interrupted and wherever the cases ran.
"""

from __future__ import annotations

import csv
import multiprocessing
from collections.abc import Callable, Generator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import closing
from pathlib import Path
from typing import Any

from rodgym.study.case import Row, policy_files, run_case
from rodgym.study.spec import Case, Study, StudyError, case_id

Rows = Generator[tuple[int, Row], None, None]
#: Takes numbered cases and gives back numbered rows, each once, in any order.
Backend = Callable[[list[tuple[int, Case]]], Rows]


def local(workers: int = 1) -> Backend:
    """Cases one after the other, or in `workers` processes."""

    def one_by_one(cases: list[tuple[int, Case]]) -> Rows:
        for number, case in cases:
            yield number, run_case(case)

    def in_processes(cases: list[tuple[int, Case]]) -> Rows:
        # Fresh interpreters: a forked one would inherit threads that it does not have.
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(workers, context)
        try:
            futures = {pool.submit(run_case, case): number for number, case in cases}
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            # Ctrl-C must not wait for a thousand cases.
            pool.shutdown(wait=True, cancel_futures=True)

    return one_by_one if workers == 1 else in_processes


def run_study(
    study: Study,
    table: Path,
    backend: Backend | None = None,
    on_row: Callable[[int, int], None] | None = None,
) -> list[dict[str, str]]:
    """Completes a study's table, `table` (CSV), and returns its rows as text.

    Columns: `id` of the case, its keys, the scores in SI units (empty where none is defined).

    Arguments:
        study: what to run.
        table: file that may hold rows of an earlier, unfinished run of the same study.
        backend: where cases run; one after the other in this process if left out.
        on_row: called with (rows there are, cases) at the start and after every row.

    Raises:
        StudyError: the file holds something else than rows of this study.
        PolicyError: a policy that is neither a name nor a file.
    """
    cases = list(study.cases())
    return complete(cases, cases, table, backend, on_row)


def complete(
    cases: Sequence[Case],
    shown: Sequence[Mapping[str, Any]],
    table: Path,
    backend: Backend | None = None,
    on_row: Callable[[int, int], None] | None = None,
) -> list[dict[str, str]]:
    """Completes the table of any cases; `shown[i]` are the columns that stand before the scores of
    `cases[i]`. For the rest see `run_study`.
    """
    files = {policy: policy_files(policy) for policy in dict.fromkeys(c["policy"] for c in cases)}
    ids = [case_id(case, files[case["policy"]]) for case in cases]
    if len(set(ids)) < len(ids):
        raise StudyError("a value is swept twice: two cases are the same")
    done = _read(table, set(ids))
    missing = [(i, case) for i, case in enumerate(cases) if ids[i] not in done]
    if on_row:
        on_row(len(done), len(cases))
    if missing:
        table.parent.mkdir(parents=True, exist_ok=True)
        with (
            table.open("a", newline="", encoding="utf-8") as stream,
            closing((backend or local())(missing)) as finished,
        ):
            writer = csv.writer(stream, lineterminator="\n")
            fresh = stream.tell() == 0
            for number, scores in finished:
                row = {"id": ids[number], **_text(shown[number]), **_text(scores)}
                if fresh:
                    writer.writerow(row)
                    fresh = False
                writer.writerow(row.values())
                # A killed study loses the cases that were running, never one that was finished.
                stream.flush()
                done[ids[number]] = row
                if on_row:
                    on_row(len(done), len(cases))
    rows = [done[i] for i in ids]
    _write(table, rows)
    return rows


def _text(values: Mapping[str, Any]) -> dict[str, str]:
    """Every digit of a number that matters; nothing for NaN."""

    def one(value: Any) -> str:
        if isinstance(value, float):
            return "" if value != value else f"{value:.12g}"
        return str(value)

    return {key: one(value) for key, value in values.items()}


def _read(table: Path, known: set[str]) -> dict[str, dict[str, str]]:
    """Finished rows by id; a last line that was cut off by a kill is dropped."""
    if not table.exists() or table.stat().st_size == 0:
        return {}
    text = table.read_text(encoding="utf-8")
    whole = text[: text.rfind("\n") + 1]
    lines = list(csv.reader(whole.splitlines()))
    if not lines or lines[0][:1] != ["id"]:
        raise StudyError(
            f"{table} is not the table of a study; move it away or choose another name"
        )
    header, *body = lines
    rows = {line[0]: dict(zip(header, line, strict=False)) for line in body}
    strangers = rows.keys() - known
    if strangers:
        raise StudyError(
            f"{table} holds {len(strangers)} cases of another study (or of this one before it was "
            "changed); move it away or choose another name"
        )
    if any(len(line) != len(header) for line in body):
        raise StudyError(f"{table} is damaged: a row has not as many columns as its header")
    if whole != text:
        _write(table, list(rows.values()), header)
    return rows


def _write(table: Path, rows: list[dict[str, str]], header: list[str] | None = None) -> None:
    """Replaces the table in one piece."""
    if not rows and header is None:
        return
    part = table.with_suffix(".part")
    with part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header or rows[0])
        writer.writerows(row.values() for row in rows)
    part.replace(table)
