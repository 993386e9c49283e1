"""An exported policy that plays: ONNX Runtime in place of the library that trained it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import onnxruntime

from rodgym.evaluation.policy import AnyEnv, PolicyError
from rodgym.evaluation.stepped import Rows, Stepped, check_sizes


class OnnxPolicy(Stepped):
    """An ONNX file with its sidecar's card."""

    def __init__(self, path: Path, card: Mapping[str, Any]) -> None:
        options = onnxruntime.SessionOptions()
        # The networks are small: a second thread costs more in waiting than it gains.
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        try:
            self.session = onnxruntime.InferenceSession(
                str(path), options, providers=["CPUExecutionProvider"]
            )
            self.observation, state = (self.session.get_inputs()[i].shape[1] for i in range(2))
            self.action = self.session.get_outputs()[0].shape[1]
        except Exception as error:
            raise PolicyError(f"{path} holds no policy: {error}") from error
        super().__init__(self._run, self.observation, state)
        self.card = dict(card)

    def _run(self, observation: Rows, state: Rows) -> tuple[Rows, Rows]:
        action, after = self.session.run(
            ["action", "next_state"], {"observation": observation, "state": state}
        )
        return action, after


def load(path: Path, card: Mapping[str, Any], env: AnyEnv) -> OnnxPolicy:
    """The policy of an exported file, for `env`.

    Raises:
        PolicyError: a damaged file, or a policy for other observations or actions.
    """
    policy = OnnxPolicy(path, card)
    check_sizes(path, card, env, policy.observation, policy.action)
    return policy
