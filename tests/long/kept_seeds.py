"""A claim on seeds that nobody looked at: `make kept-seeds`.

Trains PPO's recipe of FinThrust on seeds of its own, plays the agents and the best sinusoid on the
seeds that tests/data/kept_seeds.json keeps for this, and writes the ratio of their returns there.
A range is played once: later calls show what was found.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rodgym.evaluation import evaluate, statistics
from rodgym.evaluation.pooled import scores
from rodgym.runs import Run
from rodgym.training import load_recipe, train_seeds

FILE = Path(__file__).parents[1] / "data" / "kept_seeds.json"
ENV = "rodgym/FinThrust-v0"
#: Training seeds: not those with which the recipe was looked for.
TRAININGS = range(20, 30)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trainings", type=int, default=len(TRAININGS))
    args = parser.parse_args()
    kept = json.loads(FILE.read_text(encoding="utf-8"))
    entry = kept[ENV]
    if entry["found"] is None:
        run = Run("benchmark-finthrust")
        trainings = train_seeds(ENV, run, TRAININGS[: args.trainings], recipe=load_recipe(ENV))
        if trainings[-1].interrupted:
            raise SystemExit("interrupted; called again, it goes on")
        seeds = range(*entry["seeds"])
        agents = scores([evaluate(str(t.policy), ENV, seeds) for t in trainings])
        sine = scores([evaluate("gait-sine", ENV, seeds)])
        about = statistics.ratio(agents, sine)
        entry["found"] = {
            "date": run.facts["date"],
            "commit": run.facts["commit"],
            "trainings": [t.seed for t in trainings],
            "agents": round(float(agents.mean()), 2),
            "each": [round(float(one.mean()), 2) for one in agents],
            "gait-sine": round(float(sine.mean()), 2),
            "ratio": [round(x, 4) for x in (about.value, about.low, about.high)],
        }
        FILE.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    print(json.dumps(entry, indent=1))


if __name__ == "__main__":
    main()
