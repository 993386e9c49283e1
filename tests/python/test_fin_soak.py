"""Promise: random commands bring no NaN, no solver failure and no growth of memory to any fin.

Short; `make soak-fin` takes a million steps of each (docs/fin-soak.md).
"""

from __future__ import annotations

import pytest
from conftest import FINS
from fin_soak import CUTOFFS, STATUS, soak


@pytest.mark.skipif(not STATUS.exists(), reason="the size of a process is read from Linux' /proc")
@pytest.mark.parametrize("cutoff", CUTOFFS)
@pytest.mark.parametrize("env_id", FINS)
def test_random_commands_never_break_a_fin(env_id, cutoff):
    # Longer than an episode, so that parameters are drawn anew.
    tally = soak(env_id, steps=260 * 256, num_envs=256, seed=1, command_cutoff=cutoff)
    assert tally.steps == 260 * 256 and tally.episodes == 256
    assert (tally.failures, tally.not_finite, tally.out_of_bounds) == (0, 0, 0)
    assert tally.growth < 4e6
