"""Load cells: recordings, linear calibration and filters."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy import signal

from rodgym._checks import refused
from rodgym.lab.clocks import Clock
from rodgym.lab.errors import CellError, FramesError, HeaderError, UnitsError
from rodgym.lab.readers.plain import SECONDS, column
from rodgym.lab.readers.source import read_text
from rodgym.lab.tracks import Array

#: Units of a bench's signals, and how many of the base unit (V, N, N m, rad) one is.
UNITS = {
    "v": 1.0, "mv": 1e-3, "n": 1.0, "mn": 1e-3, "nm": 1.0, "mnm": 1e-3, "rad": 1.0,
    "deg": float(np.pi / 180),
}  # fmt: skip
#: Times that differ from even ones by more than this share of a step are not even.
EVEN = 0.01
#: The thesis' stop bands [Hz]: oscillations of its test bed (3.4.2).
THESIS_BANDS = ((6.0, 8.0), (50.0, 60.0))
#: Fewest points of a calibration.
POINTS = 3


@dataclass(frozen=True)
class Signals:
    """Signals of one clock.

    Parameters
    ----------
    times: [s], rising
    values: by name, in V, N, N m or rad
    units: by name: `v`, `n`, `nm`, `rad`, or empty where nobody has said
    notes: what was done on the way
    """

    times: Array
    values: Mapping[str, Array]
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Samples a second.

        Raises
        ------
        FramesError: the samples are not evenly spaced
        """
        steps = np.diff(self.times)
        if np.abs(steps - np.median(steps)).max() > EVEN * np.median(steps):
            late = int(np.argmax(np.abs(steps - np.median(steps))))
            raise FramesError(
                f"samples are not evenly spaced (at {self.times[late]:.4f} s): use `resampled`"
            )
        return float(1 / np.mean(steps))

    def resampled(self, rate: float) -> Signals:
        """At even times, linearly between samples."""
        times = np.arange(self.times[0], self.times[-1] + 1e-12, 1 / rate)
        values = {name: np.interp(times, self.times, v) for name, v in self.values.items()}
        return replace(self, times=times, values=values)

    def filtered(self, how: Array | Callable[[Array], Array], what: str = "filtered") -> Signals:
        """Every signal filtered without a shift in time.

        Parameters
        ----------
        how: second-order sections, such as of `scipy.signal.iirfilter(..., output="sos")`, which
            run forwards and backwards; or any function of a signal
        """
        if not callable(how):
            sections = np.asarray(how, np.float64)
            if sections.ndim != 2 or sections.shape[1] != 6:
                raise refused("filter", sections.shape, "sections (n, 6), or a function")

            def run(values: Array) -> Array:
                return np.asarray(signal.sosfiltfilt(sections, values))

            return self.filtered(run, what)
        values = {name: np.asarray(how(v), np.float64) for name, v in self.values.items()}
        return replace(self, values=values, notes=(*self.notes, what))

    def without_bands(
        self, bands: Sequence[tuple[float, float]] = THESIS_BANDS, order: int = 2
    ) -> Signals:
        """Without frequencies in these bands [Hz] (Butterworth; the thesis' bands by default).

        Raises
        ------
        ParameterError: a band that does not lie between 0 and half the samples a second
        """
        half, sections = self.rate / 2, []
        for low, high in bands:
            if not 0 < low < high < half:
                raise refused("bands", (low, high), f"0 < low < high < {half:g} Hz, half the rate")
            sections.append(
                signal.iirfilter(order, (low, high), btype="bandstop", fs=2 * half, output="sos")
            )
        told = ", ".join(f"{low:g} to {high:g}" for low, high in bands)
        return self.filtered(np.vstack(sections), f"without {told} Hz")

    def moved(self, clock: Clock) -> Signals:
        """With the times of another clock."""
        return replace(self, times=clock.offset + clock.rate * self.times)


@dataclass(frozen=True)
class Line:
    """A linear calibration: newtons = gain * volts + offset.

    Parameters
    ----------
    gain, offset: [N/V], [N]
    deviations: of both
    residual: what is left over [N], a standard deviation
    """

    gain: float
    offset: float
    deviations: tuple[float, float]
    residual: float

    def newtons(self, volts: Array) -> Array:
        """Forces of these voltages."""
        return self.gain * volts + self.offset


def read_cells(path: Path | str) -> Signals:
    """Reads CSV with a column `time` and signals, such as `time [s],left [mV],right [mV]`.

    Raises
    ------
    HeaderError, UnitsError, CellError, FramesError: what is wrong, and where
    """
    text = read_text(Path(path))
    names = [column(cell) for cell in text.rows[0]]
    if not names or names[0].name != "time":
        raise HeaderError(f"{text.name}: the first column is {text.rows[0][0]!r}, not time")
    if len(names) < 2 or len({n.name for n in names}) < len(names):
        raise HeaderError(f"{text.name}: there must be signals beside the time, each named once")
    if names[0].unit not in ("", *SECONDS):
        raise UnitsError(
            f"{text.name}: time is in {names[0].unit!r}; there are {', '.join(SECONDS)}"
        )
    for name in names[1:]:
        if name.unit not in ("", *UNITS):
            known = "V, mV, N, mN, Nm, mNm, rad, deg"
            raise UnitsError(f"{text.name}: {name.name} is in {name.unit!r}; there are {known}")
    table = text.numbers(1, [name.name for name in names])
    missing = np.argwhere(np.isnan(table))
    if len(missing):
        row, which = missing[0]
        raise CellError(f"{text.name}, line {text.lines[row + 1]}: {names[which].name} is empty")
    times = table[:, 0] * SECONDS[names[0].unit or "s"]
    if len(times) < 2 or (np.diff(times) <= 0).any():
        raise FramesError(f"{text.name}: times must rise from line to line")
    values = {n.name: table[:, i] * UNITS.get(n.unit, 1.0) for i, n in enumerate(names[1:], 1)}
    units = {n.name: n.unit.removeprefix("m").replace("deg", "rad") for n in names[1:]}
    return Signals(times, values, units)


def calibrate_cell(volts: Sequence[float] | Array, newtons: Sequence[float] | Array) -> Line:
    """A linear fit of known forces to voltages (thesis 3.3.1).

    Raises
    ------
    ParameterError: fewer than three points, or one voltage only
    """
    x, y = np.asarray(volts, np.float64), np.asarray(newtons, np.float64)
    if x.shape != y.shape or x.ndim != 1 or len(x) < POINTS:
        raise refused("volts", x.shape, f"as many as newtons, at least {POINTS}")
    if not (np.isfinite(x).all() and np.isfinite(y).all()) or np.ptp(x) == 0:
        raise refused("volts", x.tolist(), "finite numbers, not all the same")
    design = np.column_stack([x, np.ones(len(x))])
    (gain, offset), *_ = np.linalg.lstsq(design, y, rcond=None)
    left = y - design @ [gain, offset]
    variance = float(left @ left) / max(len(x) - 2, 1)
    spread = np.sqrt(np.diag(variance * np.linalg.inv(design.T @ design)))
    return Line(
        float(gain), float(offset), (float(spread[0]), float(spread[1])), float(np.sqrt(variance))
    )


def thrust_and_torque(left: Array, right: Array, arm: float) -> tuple[Array, Array]:
    """Sum of two cells, and their difference times half the distance between them (thesis 3.3.1).

    Parameters
    ----------
    left, right: [N]
    arm: distance of the cells [m]

    Returns
    -------
    Thrust [N] and torque [N m]; with a side force the difference holds its torque, too.
    """
    return left + right, 0.5 * arm * (right - left)
