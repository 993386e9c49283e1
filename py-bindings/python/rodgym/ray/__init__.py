"""Environments and studies on a Ray cluster.

```python
rodgym.ray.register()                                   # every environment id, for RLlib
study = rodgym.study.read("attraction")
rodgym.study.run_study(study, table, rodgym.ray.backend("auto"))   # rodgym study ... --ray auto
```

Needs `pip install "rodgym[ray]"`; RLlib itself comes with `rodgym[rllib]`. See docs/ray.md.
"""

from __future__ import annotations

try:
    import ray  # noqa: F401
except ImportError as error:
    raise ImportError('rodgym.ray needs Ray: pip install "rodgym[ray]"', name="ray") from error

from rodgym.ray.cluster import WORKER_ENV, cluster
from rodgym.ray.environments import make, register
from rodgym.ray.policy import ModulePolicy
from rodgym.ray.study import backend

__all__ = ["WORKER_ENV", "ModulePolicy", "backend", "cluster", "make", "register"]
