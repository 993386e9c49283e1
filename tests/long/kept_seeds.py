"""A claim on seeds that nobody looked at: `make kept-seeds`.

Plays the trained policy of FinThrust and the best sinusoid on the seeds that
tests/data/kept_seeds.json keeps for this, and writes the ratio of their returns there. A range is
played once: later calls show what was found.
"""

from __future__ import annotations

import json
from pathlib import Path

from rodgym.evaluation import evaluate, statistics
from rodgym.evaluation.pooled import scores
from rodgym.runs import provenance

FILE = Path(__file__).parents[1] / "data" / "kept_seeds.json"
ENV = "rodgym/FinThrust-v0"


def main() -> None:
    kept = json.loads(FILE.read_text(encoding="utf-8"))
    entry = kept[ENV]
    if entry["found"] is None:
        seeds = range(*entry["seeds"])
        agent, sine = (scores([evaluate(p, ENV, seeds)]) for p in ("zoo", "gait-sine"))
        about = statistics.ratio(agent, sine)
        facts = provenance()
        entry["found"] = {
            "date": facts["date"],
            "commit": facts["commit"],
            "zoo": round(float(agent.mean()), 2),
            "gait-sine": round(float(sine.mean()), 2),
            "ratio": [round(x, 4) for x in (about.value, about.low, about.high)],
        }
        FILE.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(entry, indent=1))


if __name__ == "__main__":
    main()
