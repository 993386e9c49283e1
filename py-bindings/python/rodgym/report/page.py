"""The report: one HTML file with everything in it, to be opened, mailed or kept."""

from __future__ import annotations

import base64
import html
import json
import math
from importlib import resources
from pathlib import Path
from string import Template

from rodgym.evaluation import Column, Evaluation
from rodgym.evaluation.table import cell
from rodgym.report import gaits
from rodgym.report.compare import Comparison
from rodgym.report.style import COLOURS
from rodgym.runs import Run

MIME = {".png": "image/png", ".gif": "image/gif"}


def write_page(run: Run, comparison: Comparison) -> Path:
    """Writes ``report.html`` from the files that the comparison has left in the run's folder."""
    names = [e.policy for e in comparison.evaluations]
    fin = "pitch" in comparison.records[0].metrics
    seed = comparison.records[0].seed
    sections = [
        _picture(
            run,
            "animation.gif",
            "The same episode, side by side",
            f"Seed {seed}, in real time: the same {'fin' if fin else 'rod'}, the same start.",
        ),
        _scores(comparison),
        _picture(
            run,
            "scores.png",
            "Every episode",
            "A dot is one episode, a bar the mean; the same seeds for all.",
        ),
        _picture(run, "gaits.png", "How they beat", gaits.TEXT.format(seed=seed)) if fin else "",
        _learning(run, comparison),
        _picture(
            run,
            "episode.png",
            "Inside one episode",
            f"Seed {seed}: each edge's angle from "
            + (
                "downstream, dark at the nose and light at the tail, and what the policy did, in "
                "the first seconds."
                if fin
                else "hanging down, dark at the base and light at the tip, and what the policy did."
            ),
        ),
        _how(run, comparison),
    ]
    template = Template(
        resources.files("rodgym.report").joinpath("page.html").read_text(encoding="utf-8")
    )
    text = template.substitute(
        title=html.escape(together(names)),
        env_id=html.escape(comparison.env_id),
        date=html.escape(str(run.facts["date"])),
        verdict=html.escape(verdict(comparison.evaluations)),
        sections="\n".join(section for section in sections if section),
    )
    path = run.file("report.html")
    path.write_text(text, encoding="utf-8")
    return path


def together(names: list[str]) -> str:
    """One; one and two; one, two and three."""
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last


def verdict(evaluations: tuple[Evaluation, ...]) -> str:
    """The result in words, from the numbers."""
    count = len(evaluations[0].seeds)
    if "upright" in evaluations[0].columns:
        parts = []
        for e in evaluations:
            up = int(e.columns["upright"].sum())
            when = e.mean("time_to_upright")
            took = "" if math.isnan(when) else f", up after {when:.1f} s on average"
            parts.append(f"{e.policy} stands at the end of {up} of {count} episodes{took}")
        return "; ".join(parts) + "."
    parts = [f"{e.policy} earns {e.mean('return'):.2f}" for e in evaluations]
    return f"Mean return over {count} episodes: " + ", ".join(parts) + "."


def _section(title: str, body: str) -> str:
    return f"<section>\n<h2>{html.escape(title)}</h2>\n{body}\n</section>"


def _picture(run: Run, file: str, title: str, text: str) -> str:
    path = run.file(file)
    data = base64.b64encode(path.read_bytes()).decode("ascii")
    source = f"data:{MIME[path.suffix]};base64,{data}"
    image = f'<img src="{source}" alt="{html.escape(title)}">'
    return _section(title, f"<p>{html.escape(text)}</p>\n{image}")


def _dot(index: int) -> str:
    return f'<span class="dot" style="background:{COLOURS[index % len(COLOURS)]}"></span>'


def _best(column: Column, values: list[float]) -> float:
    """The best of the values as shown, or NaN where there is no better."""
    shown = [round(column.scale * v, column.digits) for v in values if not math.isnan(v)]
    if not column.better or len(set(shown)) < 2:
        return math.nan
    return max(shown) if column.better == "high" else min(shown)


def _scores(comparison: Comparison) -> str:
    evaluations = comparison.evaluations
    described = evaluations[0].described
    head = "".join(
        f'<th title="{html.escape(c.doc)}">{html.escape(c.title)}'
        f"<small>{html.escape(c.unit) or '&nbsp;'}</small></th>"
        for c in described
    )
    best = {c.name: _best(c, [e.mean(c.name) for e in evaluations]) for c in described}
    rows = []
    for i, evaluation in enumerate(evaluations):
        cells = []
        for column in described:
            value = evaluation.mean(column.name)
            is_best = round(column.scale * value, column.digits) == best[column.name]
            mark = ' class="best"' if is_best else ""
            cells.append(f"<td{mark}>{cell(column, value)}</td>")
        rows.append(f"<tr><td>{_dot(i)}{html.escape(evaluation.policy)}</td>{''.join(cells)}</tr>")
    seeds = evaluations[0].seeds
    terms = "".join(
        f"<dt>{html.escape(c.title)}</dt><dd>{html.escape(c.doc)}</dd>" for c in described
    )
    body = (
        f"<p>Means over {len(seeds)} episodes, seeds {seeds[0]} to {seeds[-1]}, the same for all. "
        "The best is bold.</p>\n"
        f'<div class="scroll"><table><thead><tr><th>policy</th>{head}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>\n<dl>{terms}</dl>"
    )
    return _section("Scores", body)


def _learning(run: Run, comparison: Comparison) -> str:
    training = comparison.training
    if training is None:
        return ""
    ended = " Ctrl-C ended it early; what was learnt was kept." if training.interrupted else ""
    text = (
        f"{training.recipe.algorithm} of Stable-Baselines3 learnt from {training.steps:,} steps of "
        f"{training.recipe.n_envs} environments in {training.seconds:.0f} s, validation included."
        f"{ended} As it learns it plays 32 validation seeds that the table above does not use; its "
        "best stage there is the one that is kept."
    )
    return _picture(run, "learning_curve.png", "Learning", text)


def _how(run: Run, comparison: Comparison) -> str:
    facts = run.facts
    rows = {
        "environment": comparison.env_id,
        "keywords": json.dumps(dict(comparison.env_kwargs))
        if comparison.env_kwargs
        else "defaults",
        "machine": str(facts["machine"]),
        "versions": ", ".join(f"{k} {v}" for k, v in facts["versions"].items()),
    }
    if comparison.training is not None:
        rows["training seed"] = str(comparison.training.seed)
        rows["recipe"] = json.dumps(comparison.training.recipe.as_dict())
    terms = "".join(f"<dt>{k}</dt><dd>{html.escape(v)}</dd>" for k, v in rows.items())
    files = ", ".join(
        f"<code>{html.escape(p.name)}</code>" for p in sorted(run.path.iterdir()) if p.is_file()
    )
    again = (
        f"rodgym evaluate {run.file('policy.zip').as_posix()} --seeds 100:200"
        if comparison.training is not None
        else ""
    )
    body = f"<p>The command that made this page:</p><pre>{html.escape(str(facts['command']))}</pre>"
    if again:
        body += f"<p>The trained agent on other seeds:</p><pre>{html.escape(again)}</pre>"
    body += f'<dl>{terms}</dl><p class="note">Beside this page: {files}.</p>'
    return _section("How it was made", body)
