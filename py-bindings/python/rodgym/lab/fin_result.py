"""What a fit of a fin has found, and the file that holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rodgym.lab.result import Holdout, Interval, Level

if TYPE_CHECKING:
    from rodgym.lab.fin_model import FinModel
    from rodgym.lab.gauss_newton import Estimate
    from rodgym.lab.tracks import Array


@dataclass(frozen=True)
class FinFit:
    """Parameters of a fin, and how far they can be trusted."""

    #: The model with the most nodes, and where its fit ended.
    model: FinModel
    estimate: Estimate
    #: Values and 95 % intervals: of a continuous fin, or of one of `known` nodes.
    parameters: dict[str, Interval]
    #: Of the logarithms of these parameters.
    covariance: Array
    known: Mapping[str, Any]
    not_identifiable: dict[str, str]
    #: Scale, tilt [rad] and place of the pivot [m] of the camera, the clamp's angle [rad] and the
    #: clock of the first recording [s].
    camera: dict[str, Interval]
    #: Gain and bias [N, N m] of each cell.
    cells: dict[str, Interval]
    #: Fits with more and more nodes; the first has those of the given geometry.
    levels: list[Level]
    #: Root mean squares of each recording [m] (thesis Fig. 3.9).
    errors: list[float]
    #: The thesis' cost (3.1) [m].
    cost: float
    #: How alike neighbouring residuals are, -1 to 1, of `film` and loads; of noise alone about 0.
    alike: Mapping[str, float]
    holdout: Holdout
    notes: list[str] = field(default_factory=list)
    #: Gain and cut-off [Hz] of the servo, where its commands were recorded.
    servo: Mapping[str, Interval] = field(default_factory=dict)

    @property
    def sigma(self) -> float:
        """What is left over of places [m]."""
        return self.estimate.sigma

    @property
    def left(self) -> dict[str, float]:
        """What is left over of loads [N, N m]."""
        return dict(zip(self.model.loads, self.estimate.sigmas[1:], strict=True))

    @property
    def fixed(self) -> dict[str, float]:
        """Physical parameters that were not free."""
        from rodgym.sim import Fin

        values = Fin(**self.model.known).parameters
        return {k: v for k, v in values.items() if k not in self.parameters and "hull" not in k}

    def predictions(self) -> list[dict[str, Array]]:
        """What the model says of each recording: `film` (frames, markers, 2), and loads by name."""
        return self.model.parted(self.model.predict(self.estimate.x, differences=False)[0])

    @property
    def twin(self) -> Level:
        """The model with the nodes of the given geometry, as an environment has it."""
        return self.levels[0]

    @property
    def identified(self) -> dict[str, Interval]:
        """The parameters that the recordings tell."""
        return {k: v for k, v in self.parameters.items() if k not in self.not_identifiable}

    def as_dict(self) -> dict[str, Any]:
        """What `rod.yml` holds."""
        # (An environment swims, also where the fin was measured in air.)
        known = {k: v for k, v in self.known.items() if (k, v) != ("hydrodynamics", "air")}
        known |= {name: interval.value for name, interval in self.servo.items()}
        return {
            "machine": "fin",
            "parameters": {name: i._asdict() for name, i in self.identified.items()},
            "known": known,
            "not_identifiable": list(self.not_identifiable),
            "advice": dict(self.not_identifiable),
            # (No number of nodes: an environment has those of its geometry.)
            "equivalent": {
                "nodes": None,
                "parameters": {name: self.twin.parameters[name] for name in self.identified},
            },
            "covariance_of_logarithms": {
                "names": list(self.parameters),
                "matrix": self.covariance.tolist(),
            },
            "camera": {name: i._asdict() for name, i in self.camera.items()},
            "cells": {name: i._asdict() for name, i in self.cells.items()},
            "servo": {name: i._asdict() for name, i in self.servo.items()},
            "holdout": self.holdout.as_dict(),
            "residual_mm": 1e3 * self.sigma,
            "residual_loads": self.left,
            "nodes": [
                {"nodes": level.nodes, "residual_mm": 1e3 * level.sigma, **level.parameters}
                for level in self.levels
            ],
            "notes": list(self.notes),
        }

    def write(self, path: Path) -> None:
        """Writes `rod.yml`."""
        import yaml

        text = yaml.safe_dump(self.as_dict(), sort_keys=False, allow_unicode=True)
        path.write_text(text, encoding="utf-8")
