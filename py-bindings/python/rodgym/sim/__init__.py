"""The bare machines, for people who want the physics: no motor limit, sensors, task or control
step.

```python
>>> import rodgym
>>> rod = rodgym.sim.Pendulum(width=0.007)
>>> rod.set_angles([1.57] * 6)
>>> rod.step(torque=0.0, n=2000)
>>> round(rod.time, 6)
1.0

```
"""

from rodgym.derivatives import Jacobian
from rodgym.sim.fin import Fin
from rodgym.sim.pendulum import Linear, Pendulum
from rodgym.sim.simulation import Simulation

__all__ = ["Fin", "Jacobian", "Linear", "Pendulum", "Simulation"]
