"""The claims of docs/controllers.md hold: a short version of `make controllers`, ten seeds each."""

from pathlib import Path

import controllers
import pytest

SEEDS = 10
#: Plans take a second and a half an episode: a few claims, two seeds each.
PLANS = ("7 mm, from hanging", "15 mm, from hanging", "9 mm, from any angle", "0.02 N m")
FEW = 2


def some(claims):
    """All that are quick, and a few of those that are not."""
    return [c for c in claims if c.policy != "mpc" or any(c.what.endswith(end) for end in PLANS)]


@pytest.mark.parametrize("claim", some(controllers.CLAIMS), ids=lambda claim: claim.what)
def test_a_claim_holds(claim):
    seeds = FEW if claim.policy == "mpc" else SEEDS
    holds, row = controllers.verdict(claim, claim.check(seeds))
    assert holds, row


def test_every_number_of_the_summary_is_in_the_measured_table():
    """The table of docs/baselines.md against the rows of docs/controllers.md."""
    docs = Path(__file__).parents[2] / "docs"
    measured = {}
    for line in (docs / "controllers.md").read_text(encoding="utf-8").splitlines():
        if line.startswith("| `l") and " of 100" in line:
            what, _, upright, *_ = [cell.strip() for cell in line.strip("|").split("|")]
            measured[what] = upright.removesuffix(" of 100")
    lines = (docs / "baselines.md").read_text(encoding="utf-8").splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("| | 5 mm |"))
    widths = [cell.strip() for cell in lines[head].strip("|").split("|")][1:]
    seen = 0
    for line in lines[head + 2 : head + 10]:
        name, *cells = [cell.strip() for cell in line.strip("|").split("|")]
        law, what = name.split(", ", 1)
        what = what.replace("half of", "50% of")
        for width, cell in zip(widths, cells, strict=True):
            if cell:
                assert measured[f"{law}, {width}, {what}"] == cell, (name, width)
                seen += 1
    assert seen == 39


def test_a_claim_that_does_not_hold_is_seen():
    """No controller does this: the table's marks are not always kind."""
    claim = controllers.Claim("nothing", "zero", controllers.SWING_UP, 95)
    holds, row = controllers.verdict(claim, claim.check(4))
    assert not holds and "**missed**" in row and "0 of 4" in row


def test_the_page_tells_every_claim_and_time():
    rows = [f"| {claim.what} |" for claim in controllers.CLAIMS]
    text = controllers.page(rows, controllers.predict_times(repeats=20), seeds=4)
    assert all(claim.what in text for claim in controllers.CLAIMS)
    assert text.count(" us |") == 8
