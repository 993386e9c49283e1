"""How much may be other than a policy was made for before it fails.

Learners and controllers alike are played while one quantity at a time leaves its nominal value:
the rod, its sensors, its motor, a push. A score is the share of episodes that succeed, over 21
values of the quantity. (The convention is that of the RealAIGym leaderboards: Wiebe et al. 2025,
arXiv:2503.15290.)

```python
>>> from rodgym import robustness
>>> result = robustness.measure(["lqr"], seeds=2, quantities=["actuator_gain"], points=3)
>>> result.score("lqr", "actuator_gain")
1.0

```
"""

from rodgym.robustness.candidate import Candidate, usual_env
from rodgym.robustness.measure import measure
from rodgym.robustness.result import Robustness

__all__ = ["Candidate", "Robustness", "measure", "usual_env"]
