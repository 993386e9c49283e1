"""An RLlib policy for our evaluator."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


class ModulePolicy:
    """An RLModule of RLlib's new API stack with the `predict` that all policies of rodgym have.

    Acts on observations as the environment gives them: a module that was trained behind connectors
    of your own (filters, stacked frames) needs them in front of this one too.

    Arguments:
        module: `algorithm.get_module()`, or `RLModule.from_checkpoint(path)`.
    """

    def __init__(self, module: Any) -> None:
        self.module = module
        self.space = module.action_space

    def predict(
        self,
        observation: NDArray[np.float32],
        state: Any = None,
        episode_start: Any = None,
        deterministic: bool = False,
    ) -> tuple[NDArray[np.float32], None]:
        """Actions (n, a) for observations (n, d), or (a,) for (d,), clipped to the action space."""
        import torch

        forward, name = (
            (self.module.forward_inference, "get_inference_action_dist_cls")
            if deterministic
            else (self.module.forward_exploration, "get_exploration_action_dist_cls")
        )
        with torch.no_grad():
            outputs = forward({"obs": torch.as_tensor(np.atleast_2d(observation))})
            actions = getattr(self.module, name)().from_logits(outputs["action_dist_inputs"])
            if deterministic:
                actions = actions.to_deterministic()
            action = actions.sample().numpy()
        action = np.clip(action, self.space.low, self.space.high)
        return (action if observation.ndim == 2 else action[0]), None
