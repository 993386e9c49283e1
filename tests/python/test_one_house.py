"""Promise: nobody guesses which machine it holds. What an environment is stands in its spec, and
what a machine is called, in its description: no source decides by a piece of an id, by a keyword or
a metric that is there, by an observation's length, or by a machine's name outside of that machine.

The words are the core's own, so that those of the next machine are watched too.
"""

from __future__ import annotations

import ast
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from rodgym import _native

ROOT = Path(__file__).parents[2]
SPECS = [_native.Batch(row["id"], 1).spec for row in _native.catalog()]
MACHINES = {spec["machine"] for spec in SPECS}
#: Keywords and metrics: what tells one machine from another by being there.
FEATURES = {name for spec in SPECS for name in (*spec["config"], *spec["metrics"])}
#: `Pendulum`, `Swing`, `Up`, `Base`, ... of the ids.
PIECES = {
    piece
    for spec in SPECS
    for piece in re.findall("[A-Z][a-z]+", spec["id"].partition("/")[2].partition("-")[0])
}
#: Where a machine may be called by its name: its own folder, and tables of machines.
OWN = re.compile(
    rf"py-bindings/python/rodgym/machines/|env-core/src/({'|'.join(MACHINES)})/"
    r"|render/src/lib\.rs"
)
TESTS = re.compile(r"(^|/)(tests|examples|benches)/")


def of_an_id(text: str) -> bool:
    """Whether a string is an id, or a piece of one."""
    words = text.strip("/")
    return bool(re.match("rodgym/", text)) or any(words.startswith(piece) for piece in PIECES)


def python(path: str, text: str) -> Iterator[tuple[int, str]]:
    """Lines of a Python source that decide by a guess."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            words = {s.value for s in sides if isinstance(s, ast.Constant)}
            strings = {word for word in words if isinstance(word, str)}
            named = ast.unparse(node)
            if isinstance(node.ops[0], ast.In | ast.NotIn):
                first = node.left.value if isinstance(node.left, ast.Constant) else None
                # A message or a table of a test may be asked what it says; a spec may not.
                asked = ast.unparse(node.comparators[0])
                told = TESTS.search(path) and re.search(r"out|err|table|text|page|lines", asked)
                if isinstance(first, str) and not told and (first in FEATURES or of_an_id(first)):
                    yield node.lineno, named
            elif strings & MACHINES and not OWN.match(path) and not TESTS.search(path):
                yield node.lineno, named
            elif any(isinstance(word, int) for word in words) and not TESTS.search(path):
                if re.search(r"observation.*(shape|size)|len\(.*observation", named):
                    yield node.lineno, named
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            words = [a.value for a in node.args if isinstance(a, ast.Constant)]
            if node.func.attr in ("startswith", "endswith", "find", "count", "index"):
                if any(isinstance(word, str) and of_an_id(word) for word in words):
                    yield node.lineno, ast.unparse(node)


def rust(path: str, text: str) -> Iterator[tuple[int, str]]:
    """Lines of a Rust source that decide by a guess."""
    pieces, features, machines = ("|".join(sorted(w)) for w in (PIECES, FEATURES, MACHINES))
    guesses = [
        rf'\.(contains|starts_with|ends_with|find)\("/?(rodgym/|{pieces})',
        rf'\.contains_key\("({features})"\)',
    ]
    if not OWN.match(path) and not TESTS.search(path):
        guesses.append(rf'[!=]= *"({machines})"|"({machines})" *(=>|\|)')
    if not TESTS.search(path):
        guesses.append(r"(match|if) .*observation[a-z_.()]*(len|size)\(\) *([!=]= *\d|\{)")
    for number, line in enumerate(text.splitlines(), 1):
        if not line.lstrip().startswith("//") and any(re.search(g, line) for g in guesses):
            yield number, line.strip()


CHECKS = {".py": python, ".rs": rust}


def sources() -> list[str]:
    """Every source that is kept, or would be."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.py", "*.rs"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    return [name for name in listed.stdout.splitlines() if (ROOT / name).is_file()]


def test_no_source_guesses_its_machine():
    names = sources()
    assert len(names) > 100 and {Path(name).suffix for name in names} == set(CHECKS)
    guesses = [
        f"{name}:{number}: {what}"
        for name in names
        for number, what in CHECKS[Path(name).suffix](name, (ROOT / name).read_text("utf-8"))
    ]
    assert not guesses, "\n".join(["ask the spec:", *guesses])


#: What the checks must find, with @ for a quotation mark: else they would find it here.
BAD = {
    ".py": [
        "if @Fin@ in env_id: pass",
        "if @/Fin@ in env_id: pass",
        "ids = [name for name in ids if @Pendulum@ not in name]",
        "fin = @geometry@ in config",
        "rest = 1.6 if @pitch@ in metrics else 0.0",
        "if env_id.startswith(@rodgym/Fin@): pass",
        "law = @lqg@ if env_id.endswith(@SwingUpBase-v0@) else @lqr@",
        "if spec[@machine@] == @fin@: pass",
        "if len(spec[@observation@][@names@]) == 18: pass",
        "if env.observation_space.shape[0] == 3: pass",
    ],
    ".rs": [
        "if id.contains(@Pendulum@) {}",
        "if id.starts_with(@rodgym/Fin@) {}",
        "if kwargs.contains_key(@geometry@) {}",
        "let wide = machine == @fin@;",
        "    @pendulum@ => pendulums(),",
        "if spec.observation.size() == 18 {}",
        "match spec.observation.size() {",
    ],
}
GOOD = {
    ".py": [
        "about = machines.of(spec)",
        "if @randomise@ in words or name.startswith(@_@): pass",
        "env = gym.make(@rodgym/FinSwim-v0@, geometry={})",
        "pitch = run.metrics[@pitch@]",
    ],
    ".rs": ["let range = reader.range(@demand@, (0.02, 0.15))?;", "// machine == @fin@ no more"],
}


@pytest.mark.parametrize(
    ("suffix", "line", "found"),
    [
        (suffix, line.replace("@", '"'), found)
        for lines, found in ((BAD, 1), (GOOD, 0))
        for suffix in CHECKS
        for line in lines[suffix]
    ],
)
def test_the_check_finds_a_guess_and_nothing_else(suffix, line, found):
    assert len(list(CHECKS[suffix](f"somewhere/else{suffix}", line))) == found
