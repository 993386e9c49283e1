"""What a fit has found, and the file that holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from rodgym.lab.film import Film
    from rodgym.lab.gauss_newton import Estimate
    from rodgym.lab.tracks import Array


class Interval(NamedTuple):
    """A value and the interval that holds it in 95 of 100 fits."""

    value: float
    low: float
    high: float


class Level(NamedTuple):
    """The best parameters of a model of so many nodes, and what it is off by [m]."""

    nodes: int
    parameters: dict[str, float]
    sigma: float


class Holdout(NamedTuple):
    """The last frames, foretold from the others: deviations [m]."""

    frames: int
    #: Of the frames that were fitted.
    fitted: float
    #: Of those that were foretold.
    foretold: float
    #: Of those, had the parameters stayed where the fit started.
    before: float
    #: What was to be expected of those, from the noise and from how well the first ones tell.
    expected: float

    @property
    def good(self) -> bool:
        """Whether the model foretells as well as was to be expected."""
        return self.foretold < 1.3 * self.expected

    @property
    def passed(self) -> bool:
        """Whether it foretells as well as was to be expected, and better than the start did."""
        return self.good and self.foretold < 0.95 * self.before

    @property
    def useless(self) -> bool:
        """Whether it foretells much worse than was to be expected, no better than the start did."""
        return not self.good and self.foretold >= 0.95 * self.before

    @property
    def words(self) -> str:
        """The check in a sentence."""
        last = f"the last {self.frames} frames, not fitted, are foretold to"
        verdict = "passed" if self.passed else "not passed"
        return (
            f"{last} {1e3 * self.foretold:.3f} mm (expected {1e3 * self.expected:.3f} mm, "
            f"{1e3 * self.before:.3f} mm with the start's parameters): {verdict}"
        )

    def as_dict(self) -> dict[str, Any]:
        """What `rod.yml` holds of it."""
        return {
            "frames": self.frames,
            "fitted_mm": 1e3 * self.fitted,
            "foretold_mm": 1e3 * self.foretold,
            "start_mm": 1e3 * self.before,
            "expected_mm": 1e3 * self.expected,
            "passed": self.passed,
        }


@dataclass(frozen=True)
class Fit:
    """Parameters of a rod from a film, and how far they can be trusted."""

    #: The model of the whole film with the most nodes, and where its fit ended.
    film: Film
    estimate: Estimate
    #: Values and 95 % intervals: of a continuous rod, or of one of `known` nodes.
    parameters: dict[str, Interval]
    #: Of the logarithms of these parameters.
    covariance: Array
    #: Scale, tilt [rad] and place of the base [m] of the camera.
    camera: dict[str, Interval]
    #: What the user has said, and all values that were not free.
    known: Mapping[str, float]
    fixed: Mapping[str, float]
    #: Parameters that the film does not tell, with what to measure.
    not_identifiable: dict[str, str]
    #: Ratios and products of those that it does tell.
    together: dict[str, Interval]
    levels: list[Level]
    #: The model with the nodes of an environment; None where the rod itself has known nodes.
    twin: Level | None
    holdout: Holdout
    #: Deviation within short pieces [m], and that of the whole over it.
    noise: float
    misfit: float
    notes: list[str]

    @property
    def identified(self) -> dict[str, Interval]:
        """The parameters that the film tells."""
        return {k: v for k, v in self.parameters.items() if k not in self.not_identifiable}

    def as_dict(self) -> dict[str, Any]:
        """What `rod.yml` holds: plain numbers, words, lists and dictionaries."""
        twin = self.twin or self.levels[-1]
        return {
            "machine": "pendulum",
            "parameters": {name: i._asdict() for name, i in self.identified.items()},
            "known": dict(self.known),
            "not_identifiable": list(self.not_identifiable),
            "advice": dict(self.not_identifiable),
            "together": {name: i._asdict() for name, i in self.together.items()},
            "equivalent": {
                "nodes": twin.nodes,
                "parameters": {name: twin.parameters[name] for name in self.identified},
            },
            "covariance_of_logarithms": {
                "names": list(self.parameters),
                "matrix": self.covariance.tolist(),
            },
            "camera": {name: i._asdict() for name, i in self.camera.items()},
            "holdout": self.holdout.as_dict(),
            "residual_mm": 1e3 * self.estimate.sigma,
            "misfit": self.misfit,
            "nodes": [
                {"nodes": level.nodes, "residual_mm": 1e3 * level.sigma, **level.parameters}
                for level in [*([self.twin] if self.twin else []), *self.levels]
            ],
            "notes": list(self.notes),
        }

    def write(self, path: Path) -> None:
        """Writes `rod.yml`."""
        import yaml

        text = yaml.safe_dump(self.as_dict(), sort_keys=False, allow_unicode=True)
        path.write_text(text, encoding="utf-8")
