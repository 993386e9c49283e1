"""What a measurement of robustness found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rodgym import machines
from rodgym.machines import Quantity
from rodgym.runs import write_csv

Floats = NDArray[np.float64]

#: Share of its nominal return that an episode must reach where no score says whether it succeeded.
ENOUGH = 0.8
#: Share of episodes that must succeed where a policy is said to hold.
HOLDS = 0.9


@dataclass(frozen=True)
class Robustness:
    """``success[i, j, k]`` is the share of the episodes that policy i brought to success at value k
    of quantity j; ``returns`` has a further axis, one number an episode. ``column`` is the score
    that says so; None: the returns do.
    """

    policies: tuple[str, ...]
    quantities: tuple[Quantity, ...]
    seeds: range
    success: Floats
    returns: Floats
    column: str | None

    def values(self, quantity: str) -> list[float]:
        """The values that a quantity was given."""
        return self.quantities[self._quantity(quantity)].values(self.success.shape[2])

    def score(self, policy: str, quantity: str) -> float:
        """Share of successful episodes over all values of a quantity."""
        return float(self.success[self._policy(policy), self._quantity(quantity)].mean())

    def mean(self, policy: str) -> float:
        """Mean of the scores of all quantities."""
        return float(self.success[self._policy(policy)].mean())

    def holds(self, policy: str, quantity: str) -> tuple[float, float] | None:
        """From where to where, about the nominal value and without a gap, at least 90 % of the
        episodes succeed; None where they do not even there.
        """
        shares = self.success[self._policy(policy), self._quantity(quantity)]
        values = self.values(quantity)
        low = high = values.index(self.quantities[self._quantity(quantity)].nominal)
        if shares[low] < HOLDS:
            return None
        while low > 0 and shares[low - 1] >= HOLDS:
            low -= 1
        while high + 1 < len(values) and shares[high + 1] >= HOLDS:
            high += 1
        return values[low], values[high]

    def nominal_return(self, policy: str, quantity: str) -> float:
        """Mean return where the quantity has its nominal value."""
        j = self._quantity(quantity)
        k = self.values(quantity).index(self.quantities[j].nominal)
        return float(self.returns[self._policy(policy), j, k].mean())

    def rows(self) -> list[list[object]]:
        """One row a policy and quantity: score, from and to where it holds, nominal return."""
        table: list[list[object]] = []
        for policy in self.policies:
            for quantity in self.quantities:
                held = self.holds(policy, quantity.name) or ("", "")
                nominal = self.nominal_return(policy, quantity.name)
                score = self.score(policy, quantity.name)
                table.append([policy, quantity.name, f"{score:.6g}", *held, f"{nominal:.6g}"])
            table.append([policy, "mean", f"{self.mean(policy):.6g}", "", "", ""])
        return table

    def write_csv(self, path: Path | str) -> None:
        """Writes `rows` with a header."""
        header = ["policy", "quantity", "score", "holds_from", "holds_to", "nominal_return"]
        write_csv(Path(path), header, self.rows())

    def table(self) -> str:
        """The scores in percent for the terminal: a row a quantity, a column a policy."""
        named = [q.label for q in self.quantities]
        rows = [["success [%]", *self.policies]]
        for quantity, label in zip(self.quantities, named, strict=True):
            scores = (100 * self.score(policy, quantity.name) for policy in self.policies)
            rows.append([label, *(f"{score:.0f}" for score in scores)])
        means = [f"{100 * self.mean(policy):.0f}" for policy in self.policies]
        widths = [
            max(len(row[i]) for row in [*rows, ["mean", *means]])
            for i in range(1 + len(self.policies))
        ]

        def line(row: Sequence[str]) -> str:
            cells = [text.rjust(width) for text, width in zip(row[1:], widths[1:], strict=True)]
            return "  ".join([row[0].ljust(widths[0]), *cells])

        rule = "-" * (sum(widths) + 2 * len(self.policies))
        lines = [line(row) for row in rows]
        return "\n".join([lines[0], rule, *lines[1:], rule, line(["mean", *means])])

    def _policy(self, name: str) -> int:
        return self.policies.index(name)

    def _quantity(self, name: str) -> int:
        return [quantity.name for quantity in self.quantities].index(name)


def success_column(spec: Mapping[str, Any]) -> str | None:
    """The score that says, by 1 or 0, whether an episode of this task succeeded."""
    columns = machines.of(spec).columns_of(spec["task"])
    return next((column.name for column in columns if column.success), None)


def success_of(returns: Floats, nominal: Sequence[int]) -> Floats:
    """Shares of success (p, q, k) of returns (p, q, k, episodes): at least `ENOUGH` of what the
    same seed returns at the nominal value, whose place `nominal` has for each quantity.
    """
    places = np.asarray(nominal)
    # (p, q, 1, episodes): each quantity has a nominal value of its own.
    reference = returns[:, np.arange(len(places)), places][:, :, np.newaxis]
    enough = (reference > 0) & (returns >= ENOUGH * reference)
    return np.asarray(enough.mean(axis=-1), np.float64)
