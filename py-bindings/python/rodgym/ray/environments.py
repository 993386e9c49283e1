"""Our environments in Ray's registry, where RLlib looks for them."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import ray
from gymnasium.vector import AutoresetMode

import rodgym
from rodgym import _checks as checks
from rodgym._registration import REMOTE
from rodgym.errors import ParameterError


def register() -> None:
    """Registers every environment id of rodgym with Ray, for workers on any machine.

    Registrations belong to a connection: after another `ray.init`, register again. In RLlib:

    ```python
    PPOConfig().environment("rodgym/PendulumSwingUp-v0", env_config={"width": 0.0081}).env_runners(
        num_envs_per_env_runner=64, gym_env_vectorize_mode=gym.VectorizeMode.VECTOR_ENTRY_POINT
    )
    ```

    Keys of `env_config` are those of `make`.
    """
    try:
        from ray.tune.registry import register_env
    except ImportError as error:
        raise ImportError(
            f'{error.name} is missing: pip install "rodgym[ray]"', name=error.name
        ) from error
    for env_id in rodgym.ENVIRONMENTS:
        register_env(env_id, partial(make, env_id))


def make(env_id: str, config: Mapping[str, Any]) -> Any:
    """What Ray's workers make: one environment, or a native batch.

    Arguments:
        env_id: id such as `"rodgym/PendulumSwingUp-v0"`.
        config: keywords of the environment, and

            * `num_envs`: RLlib adds it in mode `VECTOR_ENTRY_POINT`; then the result is one batch
              of so many environments, without it a single environment;
            * `num_threads` of a batch: if left out, the CPUs of the actor that makes it;
            * `server`, and with it `keys`, `server_key`, `timeout`, `recover`: environments of a
              server instead (see `rodgym.remote`).

    Raises:
        ParameterError: a wrong keyword, or an `autoreset_mode` that RLlib cannot sample with.
    """
    keywords = dict(config)
    num_envs = keywords.pop("num_envs", None)
    if "server" in keywords:
        keywords["env_id"], env_id = env_id, REMOTE
    if num_envs is None:
        return gym.make(env_id, **keywords)
    mode = keywords.get("autoreset_mode", AutoresetMode.NEXT_STEP)
    if checks.autoreset_mode(mode) is not AutoresetMode.NEXT_STEP:
        raise ParameterError(
            f"autoreset_mode = {mode!r} is not allowed: RLlib takes the step after an episode's "
            f"end for its reset, which is {AutoresetMode.NEXT_STEP.value!r}"
        )
    if env_id != REMOTE:
        keywords.setdefault("num_threads", worker_cpus())
    return OwnSeeds(gym.make_vec(env_id, num_envs=num_envs, **keywords))


class OwnSeeds(gym.vector.VectorWrapper):
    """Gives batches with neighbouring seeds nothing in common.

    RLlib seeds env runner w with `seed + w`, and a batch seeded with s gives environment i the seed
    s + i: two runners of 64 would play 63 of their episodes twice.
    """

    transparent = True

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As the environment's, an integer seed spread by NumPy's `SeedSequence`."""
        seed = checks.batch_seeds(seed, self.num_envs)
        if isinstance(seed, int):
            words = np.random.SeedSequence(seed).generate_state(self.num_envs, np.uint64)
            seed = (words >> np.uint64(1)).tolist()
        inner: Any = self.env
        result: tuple[Any, dict[str, Any]] = inner.reset(seed=seed, options=options)
        return result


def worker_cpus() -> int | None:
    """CPUs, at least 1, that Ray gave to the task or actor that asks; None outside of any."""
    if not ray.is_initialized():
        return None
    context = ray.get_runtime_context()
    if context.worker.mode != ray.WORKER_MODE:
        return None
    return max(1, int(context.get_assigned_resources().get("CPU", 1)))
