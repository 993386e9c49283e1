"""Promise: what the pages about the network show runs, and the tests that they name exist."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from conftest import SWING_UP
from remote_helpers import need_server, serving

need_server()

from rodgym.vector import RodVectorEnv  # noqa: E402

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"


def test_the_client_in_the_protocol_document_steps_an_environment():
    code = (DOCS / "protocol.md").read_text().split("```python\n")[1].split("```")[0]
    with serving() as server:
        names = {"server": server.address}
        exec(code, names)
        names["socket"].close(linger=0)
    env = RodVectorEnv(SWING_UP, 2)
    env.reset(seed=3)
    for _ in range(10):
        observation, reward, *_ = env.step(np.array([[0.5], [-0.5]]))
    assert names["observation"] == tuple(observation.ravel().tolist())
    assert names["reward"] == tuple(reward.tolist())


@pytest.mark.parametrize("page", ["remote-proofs.md", "records/faults.md"])
def test_every_test_that_a_page_of_faults_names_exists(page):
    rows = re.findall(r"^\|.*\| (`.*`) \|$", (DOCS / page).read_text(), re.MULTILINE)
    named = [name for row in rows for name in re.findall(r"`(\w+)`", row)]
    sources = [*ROOT.glob("tests/python/test_*.py")]
    for folder in ("env-server/src", "env-server/tests", "baselines/tests"):
        sources += (ROOT / folder).glob("**/*.rs")
    text = "\n".join(path.read_text() for path in sources)
    missing = [name for name in named if not re.search(rf"\b(def|fn) {name}\b", text)]
    assert len(named) > 40 and not missing
