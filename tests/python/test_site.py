"""Promise: the documentation is whole: every page is in the navigation, every link leads somewhere,
every code block runs, and what is written from the code is up to date.

`make docs` builds the site itself, which needs packages of its own.
"""

from __future__ import annotations

import csv
import re
import shlex
import sys
import unicodedata
from pathlib import Path

import pages
import pytest
import rodgym
from rodgym.cli.app import build_parser
from rodgym.evaluation import evaluate

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.rglob("*.md"))
CONFIG = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
NOT_RUN = "<!-- not run: "
FENCE = re.compile(r"^( *)```(\w*)[^\n]*\n(.*?)^\1```", re.MULTILINE | re.DOTALL)

#: A file of the reader's with a policy and an environment.
MINE = """\
import gymnasium as gym
class Policy: ...
class Bang: ...
for name in ("Mine/SwingUp-v0", "Mine/Spin-v0"):
    gym.registry.pop(name, None)  # A page's own code may have it already.
    gym.register(name, entry_point="rodgym.envs:PendulumEnv")
"""
#: A fit's file, for commands that read one.
ROD = """\
not_identifiable: {}
known: {width: 0.007, length: 0.3, density: 1500.0}
parameters: {youngs_modulus: {value: 8.3e+6, low: 8.2e+6, high: 8.4e+6}}
equivalent: {nodes: 7, parameters: {youngs_modulus: 9.9e+6}}
"""


def name(page: Path) -> str:
    return str(page.relative_to(DOCS))


def blocks(page: Path, language: str) -> list[str]:
    """Code blocks of a language that are not marked as not run."""
    text = page.read_text(encoding="utf-8")

    def runs(block: re.Match[str]) -> bool:
        before = text[: block.start()].rstrip().rpartition("\n")[2]
        return block[2] == language and NOT_RUN not in before

    return [
        re.sub(rf"^{block[1]}", "", block[3], flags=re.MULTILINE)
        for block in FENCE.finditer(text)
        if runs(block)
    ]


def slugs(text: str) -> set[str]:
    """Ids of the headings, as the site makes them."""
    text = FENCE.sub("", text)
    found: set[str] = set()
    for title in re.findall(r"^#{1,6} (.*)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", title).replace("`", "")
        plain = unicodedata.normalize("NFKD", plain).encode("ascii", "ignore").decode()
        slug = re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())
        number = 1
        while slug in found:
            slug, number = f"{slug.rpartition('_')[0] or slug}_{number}", number + 1
        found.add(slug)
    return found


def links(text: str) -> list[str]:
    return re.findall(r"\]\(([^)\s]+)\)", FENCE.sub("", text))


def test_every_page_is_in_the_navigation_once():
    listed = re.findall(r"([\w/-]+\.md)$", CONFIG.split("\nnav:\n")[1], re.MULTILINE)
    assert sorted(listed) == sorted(map(name, PAGES)), "mkdocs.yml: nav"


@pytest.mark.parametrize("page", [*PAGES, DOCS / "llms.txt"], ids=name)
def test_every_link_leads_to_a_file_of_the_site_and_to_a_part_that_is_there(page):
    for link in links(page.read_text(encoding="utf-8")):
        if "://" in link or link.startswith(("mailto:", "../rust/")):
            continue
        file, _, part = link.partition("#")
        target = (page.parent / file).resolve() if file else page
        assert target.is_relative_to(DOCS) and target.is_file(), f"{link} leads out of docs/"
        if part:
            assert part in slugs(target.read_text(encoding="utf-8")), link


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "python")], ids=name)
def test_python_blocks_run_in_order(page, tmp_path, monkeypatch):
    """Those with `>>>` are doctests, see test_docs.py."""
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch, "set_num_threads", lambda number: None)
    monkeypatch.chdir(tmp_path)
    names = {"__name__": "page"}
    for block in blocks(page, "python"):
        if ">>> " not in block:
            exec(compile(block, str(page), "exec"), names)


def commands(page: Path) -> list[str]:
    """Lines of shell blocks, without comments; continued lines joined."""
    shell = "\n".join(blocks(page, "bash")).replace("\\\n", " ")
    return [line.partition(" #")[0].strip() for line in shell.splitlines()]


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p, "bash")], ids=name)
def test_every_command_is_one_that_the_program_takes(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    # Files of the reader's that commands name: a module with policies, the fit of a film.
    (tmp_path / "mine.py").write_text(MINE)
    monkeypatch.delitem(sys.modules, "mine", raising=False)  # That of another page.
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "rod.yml").write_text(ROD)
    parser = build_parser()
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for command in commands(page):
        words = shlex.split(command)
        if words[:1] == ["rodgym"]:
            assert parser.parse_args(words[1:]).command == words[1], command
        if words[:1] == ["make"]:
            assert re.search(rf"^{words[1]}:", makefile, re.MULTILINE), command


def test_the_pages_that_follow_from_the_code_are_up_to_date():
    for path, text in pages.written().items():
        assert path.read_text(encoding="utf-8") == text, f"{name(path)}: run python docs/pages.py"
    written = {path.stem for path in pages.written() if path.parent == pages.ENVIRONMENTS}
    assert written == {page.stem for page in (DOCS / "environments").glob("*.md")} - {"index"}


def test_a_score_of_the_environments_pages_is_what_the_evaluator_finds():
    with pages.SCORES.open(encoding="utf-8") as file:
        rows = {(row["id"], row["policy"]): row for row in csv.DictReader(file)}
    assert {env_id for env_id, _ in rows} == set(rodgym.ENVIRONMENTS)
    swing_up = "rodgym/PendulumSwingUp-v0"
    found = evaluate("lqr", swing_up, seeds=range(100)).mean("return")
    assert rows[swing_up, "lqr"]["return"] == f"{found:.1f}"


def test_a_record_is_not_repeated_in_a_docstring():
    """What was tried belongs in docs/records; a docstring says what a thing is."""
    assert "20 generations" not in (rodgym.envs.FinEnv.__doc__ or "")


def test_every_word_of_ours_is_in_the_glossary():
    glossary = (DOCS / "glossary.md").read_text(encoding="utf-8")
    for word in ("node", "edge", "lane", "block", "sway", "upright", "stage", "plant", "band"):
        assert re.search(rf"^\| [^|]*\b{word}\b", glossary, re.MULTILINE), word


def test_the_citation_names_this_version():
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f'version: "{rodgym.__version__}"' in citation
    assert f"{{{rodgym.__version__}}}" in (DOCS / "cite.md").read_text(encoding="utf-8")
