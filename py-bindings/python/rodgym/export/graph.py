"""A network as an ONNX graph, written node by node.

Inputs `observation` (n, d) and `state` (n, s), outputs `action` (n, a) and `next_state` (n, s). The
operators are few and old, so that small runtimes know them.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from onnx import ModelProto, TensorProto, checker, helper, numpy_helper
from torch import nn

from rodgym.distil.student import Student
from rodgym.evaluation.policy import PolicyError

#: Version of the operators, and of the file's format; both of 2022 and widely known.
OPSET = 17
IR_VERSION = 8
#: Operators of activations.
OPERATORS = {nn.Tanh: "Tanh", nn.ReLU: "Relu", nn.ELU: "Elu", nn.Sigmoid: "Sigmoid"}


class Graph:
    """Nodes and constants, named as they come."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, values: Any) -> str:
        """A constant's name."""
        name = f"constant_{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(values), name))
        return name

    def __call__(self, operator: str, *inputs: str, outputs: int = 1, **attributes: Any) -> Any:
        """Adds a node; returns the name of its output, or a list of names."""
        names = [f"{operator.lower()}_{len(self.nodes)}_{i}" for i in range(outputs)]
        self.nodes.append(helper.make_node(operator, list(inputs), names, **attributes))
        return names[0] if outputs == 1 else names

    def split(self, name: str, sizes: list[int]) -> list[str]:
        """Columns apart; sizes of zero have no columns, and no name."""
        kept = [size for size in sizes if size]
        if len(kept) == 1:
            parts = iter([name])
        else:
            at = self.constant(np.array(kept, np.int64))
            parts = iter(self("Split", name, at, outputs=len(kept), axis=1))
        return [next(parts) if size else "" for size in sizes]

    def join(self, *names: str) -> str:
        """Columns beside one another; those without a name are left out."""
        kept = [name for name in names if name]
        return kept[0] if len(kept) == 1 else str(self("Concat", *kept, axis=1))

    def linear(self, name: str, weight: Any, bias: Any) -> str:
        """A linear layer: inputs W' + b, for torch's weights."""
        weight, bias = self.constant(weight.detach().numpy()), self.constant(bias.detach().numpy())
        return str(self("Gemm", name, weight, bias, transB=1))

    def gru(self, cell: nn.GRU, inputs: str, hidden: str) -> str:
        """One step of torch's GRU: the next hidden row."""
        size = cell.hidden_size
        own = self.linear(inputs, cell.weight_ih_l0, cell.bias_ih_l0)
        past = self.linear(hidden, cell.weight_hh_l0, cell.bias_hh_l0)
        own_r, own_z, own_n = self.split(own, [size] * 3)
        past_r, past_z, past_n = self.split(past, [size] * 3)
        reset = self("Sigmoid", self("Add", own_r, past_r))
        update = self("Sigmoid", self("Add", own_z, past_z))
        new = self("Tanh", self("Add", own_n, self("Mul", reset, past_n)))
        # (1 - z) n + z h
        return str(self("Add", new, self("Mul", update, self("Sub", hidden, new))))


def model_of(student: Student) -> ModelProto:
    """The ONNX model.

    Raises:
        PolicyError: a layer that has no operator here.
    """
    shape, graph = student.shape, Graph()
    memory, last = graph.split("state", [shape.memory, shape.action])
    # A lost sample (NaN anywhere in a row) is shown as zeros.
    gone = graph("Cast", graph("IsNaN", "observation"), to=TensorProto.FLOAT)
    gone = graph("Cast", graph("ReduceMax", gone, axes=[1], keepdims=1), to=TensorProto.BOOL)
    seen = graph("Where", gone, graph.constant(np.float32(0)), "observation")
    frame = graph.join(seen, last if shape.own_actions else "")
    window = graph.join(memory, frame) if student.cell is None else frame
    repeats = shape.frames if student.cell is None else 1
    mean, scale = (np.tile(part.numpy(), repeats) for part in (student.mean, student.scale))
    inputs = graph("Div", graph("Sub", window, graph.constant(mean)), graph.constant(scale))
    if student.cell is None:
        _, after = graph.split(window, [shape.frame, shape.memory])
    else:
        inputs = after = graph.gru(student.cell, inputs, memory)
    for layer in student.head:
        if isinstance(layer, nn.Linear):
            inputs = graph.linear(inputs, layer.weight, layer.bias)
        elif type(layer) in OPERATORS:
            inputs = graph(OPERATORS[type(layer)], inputs)
        else:
            raise PolicyError(f"a layer {type(layer).__name__} cannot be exported")
    low, high = graph.constant(student.low.numpy()), graph.constant(student.high.numpy())
    action = graph("Min", graph("Max", inputs, low), high)
    graph.nodes.append(helper.make_node("Identity", [action], ["action"]))
    graph.nodes.append(helper.make_node("Identity", [graph.join(after, action)], ["next_state"]))

    def rows(name: str, size: int) -> Any:
        return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["n", size])

    made = helper.make_graph(
        graph.nodes,
        "policy",
        [rows("observation", shape.observation), rows("state", shape.state)],
        [rows("action", shape.action), rows("next_state", shape.state)],
        graph.constants,
    )
    versions = [helper.make_opsetid("", OPSET)]
    model = helper.make_model(
        made, opset_imports=versions, ir_version=IR_VERSION, producer_name="rodgym"
    )
    checker.check_model(model, full_check=True)
    return model
