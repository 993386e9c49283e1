"""One evaluator for every policy: learned, classical or yours.

```python
>>> import rodgym.evaluation
>>> result = rodgym.evaluation.evaluate("lqr", "rodgym/PendulumSwingUp-v0", seeds=range(3))
>>> result.columns["upright"].mean()
1.0

```
"""

from rodgym.evaluation.bands import band_keywords, bands
from rodgym.evaluation.episodes import Evaluation, evaluate
from rodgym.evaluation.policies import Policy, PolicyError, controller_names, load_policy
from rodgym.evaluation.record import Record, record
from rodgym.evaluation.score import Column
from rodgym.evaluation.table import comparison_table

__all__ = [
    "Column",
    "Evaluation",
    "Policy",
    "PolicyError",
    "Record",
    "band_keywords",
    "bands",
    "comparison_table",
    "controller_names",
    "evaluate",
    "load_policy",
    "record",
]
