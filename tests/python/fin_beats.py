"""How exact a beating fin is: thrust and power of a period against steps of 0.1 ms.

The beat begins gently: a pitch that starts with a rate of its own strikes the fin, and what rings
on in the fifth period is that blow and not the beat.
"""

from __future__ import annotations

import numpy as np
import rodgym

#: Amplitude [rad] and frequency [Hz] of the beat; its fifth period is looked at.
AMPLITUDE, FREQUENCY, PERIOD = np.radians(10.0), 1.5, 5
#: Periods until the amplitude is whole.
RAMP = 2
FINE = 1e-4


def beat(**fin: object) -> dict[str, np.ndarray]:
    """Time [s], thrust [N] and power [W] at every physics step of the first periods."""
    machine = rodgym.sim.Fin(**fin)
    steps = int(np.ceil(PERIOD / FREQUENCY / machine.physics_dt)) + 1
    time = machine.physics_dt * np.arange(1, steps + 1)
    phase = FREQUENCY * time
    amplitude = AMPLITUDE * 0.5 * (1.0 - np.cos(np.pi * np.minimum(phase / RAMP, 1.0)))
    loads = machine.follow(amplitude * np.sin(2 * np.pi * phase))
    return {"time": time, "thrust": loads["thrust"], "power": loads["power"]}


def errors(coarse: dict[str, np.ndarray], fine: dict[str, np.ndarray]) -> tuple[float, float]:
    """Root mean square of the difference over that of the whole, for thrust and for power."""
    time = coarse["time"] * FREQUENCY
    period = (time > PERIOD - 1) & (time <= PERIOD)

    def error(name: str) -> float:
        exact = np.interp(coarse["time"][period], fine["time"], fine[name])
        return float(np.linalg.norm(coarse[name][period] - exact) / np.linalg.norm(exact))

    return error("thrust"), error("power")
