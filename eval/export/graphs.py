"""The networks as ONNX graphs, straight from their weights: no torch, no tracing.

A batch of any size N; a robot asks for N = 1. Layers of several experts are fused in the graph as the paper has it,
``W = sum_n a_n W_n`` and biases likewise (Zhang et al., Section III-B), for each observation of the batch by its own
shares.
"""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from vuca_nav.deploy.contract import Contract
from vuca_nav.exploration.critic import MOST_LOGIT, CriticWeights
from vuca_nav.policy.drl_network import PADDING, STRIDE
from vuca_nav.policy.network import Gate
from vuca_nav.policy.weights_file import PolicyWeights
from vuca_nav.types import BodySpec

OPSET = 17
"""ONNX operator set: of 2022, which ONNX Runtime 1.12, TensorRT 8.6 and OpenVINO 2023 read."""
IR_VERSION = 8
"""The file format that belongs to it."""
_NEVER = -1e30
"""Logit of an expert that is left out."""


class _Graph:
    """A graph in the making: nodes one after the other, constants by value."""

    def __init__(self) -> None:
        self.nodes: list[Any] = []
        self.constants: list[Any] = []

    def constant(self, value: Any, dtype: Any = np.float32) -> str:
        """Add a constant, and return its name."""
        name = f"c{len(self.constants)}"
        self.constants.append(numpy_helper.from_array(np.ascontiguousarray(value, dtype), name))
        return name

    def shape(self, *sizes: int) -> str:
        """Add a shape or axes, and return its name."""
        return self.constant(sizes, np.int64)

    def add(self, operator: str, *inputs: str, output: str = "", **attributes: Any) -> str:
        """Add a node, and return the name of its output."""
        name = output or f"v{len(self.nodes)}"
        self.nodes.append(helper.make_node(operator, list(inputs), [name], **attributes))
        return name

    def linear(self, x: str, weight: np.ndarray, bias: np.ndarray) -> str:
        """Layer ``W x + b`` of (N, inputs); ``weight`` is (outputs, inputs)."""
        return self.add("Gemm", x, self.constant(weight), self.constant(bias), transB=1)

    def model(
        self, name: str, inputs: dict[str, int], outputs: dict[str, int], about: dict[str, Any]
    ) -> bytes:  # fmt: skip
        """The file of the graph.

        Args:
            name: Name of the graph.
            inputs: Number of columns of each input.
            outputs: Number of columns of each output.
            about: Metadata, as JSON holds it.
        """
        ends = (
            [helper.make_tensor_value_info(key, TensorProto.FLOAT, ["N", columns]) for key, columns in each.items()]
            for each in (inputs, outputs)
        )
        graph = helper.make_graph(self.nodes, name, *ends, initializer=self.constants)
        model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", OPSET)], producer_name="vuca-nav")
        model.ir_version = IR_VERSION
        helper.set_model_props(model, {f"vuca.{key}": json.dumps(value) for key, value in about.items()})
        onnx.checker.check_model(model, full_check=True)
        return model.SerializeToString(deterministic=True)


def policy_graph(weights: PolicyWeights, gate: Gate, body: BodySpec, contract: Contract) -> bytes:
    """The actor with its gate.

    Args:
        weights: Its weights.
        gate: Source of the experts' shares.
        body: The body, whose limits turn actions into commands.
        contract: The graph's contract, for its metadata.
    """
    graph = _Graph()
    centred = graph.add("Sub", "observation", graph.constant(weights.mean))
    x = graph.add("Mul", centred, graph.constant(weights.scale))
    if weights.convolutions:
        _convolutional(graph, weights, x)
    else:
        _fused(graph, weights, gate, x)
    forward = graph.constant([body.max_v_x, body.max_v_y, body.max_w_z])
    backward = graph.constant([-body.min_v_x, body.max_v_y, body.max_w_z])
    is_back = graph.add("Less", "action", graph.constant(0.0))
    limits = graph.add("Where", is_back, backward, forward)
    graph.add("Mul", "action", limits, output="command")
    outputs = {"action": 3, "command": 3, "shares": weights.experts}
    return graph.model("policy", {"observation": len(weights.mean)}, outputs, {"contract": contract})


def critic_graph(critic: CriticWeights, contract: Contract) -> bytes:
    """The critic: V^h of observations, each with its candidate as the goal.

    Args:
        critic: Its weights.
        contract: The graph's contract, for its metadata.
    """
    graph, last = _Graph(), len(critic.weights) - 1
    x = "observation"
    for k, (weight, bias) in enumerate(zip(critic.weights, critic.biases)):
        x = graph.linear(x, weight, bias)
        if k < last:
            x = graph.add("Elu" if critic.activation == "elu" else "Relu", x)
    if critic.is_chance:
        x = graph.add("Clip", x, graph.constant(-MOST_LOGIT), graph.constant(MOST_LOGIT))
        graph.add("Sigmoid", x, output="value")
    else:
        graph.add("Identity", x, output="value")
    inputs = {"observation": critic.observation.size}
    return graph.model("critic", inputs, {"value": 1}, {"contract": contract})


def _fused(graph: _Graph, weights: PolicyWeights, gate: Gate, x: str) -> None:
    """The gate, and the layers fused by its shares."""
    _shares(graph, weights, gate, x)
    for k, (weight, bias) in enumerate(zip(weights.weights, weights.biases)):
        if weights.experts == 1:
            x = graph.linear(x, weight[0], bias[0])
        else:
            _, outputs, inputs = weight.shape
            rows = graph.add("MatMul", "shares", graph.constant(weight.reshape(len(weight), -1)))
            fused_weight = graph.add("Reshape", rows, graph.shape(-1, outputs, inputs))  # (N, outputs, inputs)
            fused_bias = graph.add("MatMul", "shares", graph.constant(bias))  # (N, outputs)
            column = graph.add("Unsqueeze", x, graph.shape(2))
            product = graph.add("Squeeze", graph.add("MatMul", fused_weight, column), graph.shape(2))
            x = graph.add("Add", product, fused_bias)
        if k < len(weights.weights) - 1:
            x = graph.add("Elu" if weights.activation == "elu" else "Relu", x)
    graph.add("Tanh", x, output="action")


def _shares(graph: _Graph, weights: PolicyWeights, gate: Gate, x: str) -> None:
    """The experts' shares, (N, E)."""
    kept = np.ones(weights.experts, bool)
    if gate.without is not None:
        kept[gate.without - 1] = False
    if weights.experts == 1 or gate.uniform:
        first = graph.add("Slice", x, graph.shape(0), graph.shape(1), graph.shape(1))  # (N, 1), for N
        zeros = graph.add("Mul", first, graph.constant(0.0))
        graph.add("Add", zeros, graph.constant(kept / kept.sum()), output="shares")
        return
    layers: Sequence[tuple[np.ndarray, np.ndarray]] = list(zip(weights.gate_weights, weights.gate_biases))
    for k, (weight, bias) in enumerate(layers):
        x = graph.linear(x, weight, bias)
        if k < len(layers) - 1:
            x = graph.add("Relu", x)
    if not kept.all():
        x = graph.add("Add", x, graph.constant(np.where(kept, 0.0, _NEVER)))
    graph.add("Softmax", x, output="shares", axis=1)


def _convolutional(graph: _Graph, weights: PolicyWeights, x: str) -> None:
    """The network of Long et al."""
    frames, sectors = weights.observation.history + 1, weights.observation.sectors
    count = frames * sectors
    scan = graph.add("Slice", x, graph.shape(0), graph.shape(count), graph.shape(1))
    rest = graph.add("Slice", x, graph.shape(count), graph.shape(len(weights.mean)), graph.shape(1))
    x = graph.add("Reshape", scan, graph.shape(-1, frames, sectors))
    for weight, bias in weights.convolutions:
        x = graph.add(
            "Conv", x, graph.constant(weight), graph.constant(bias), strides=[STRIDE], pads=[PADDING, PADDING]
        )
        x = graph.add("Relu", x)
    (first, second, last), (bias, bias_1, bias_2) = weights.weights, weights.biases
    x = graph.add("Relu", graph.linear(graph.add("Flatten", x, axis=1), first[0], bias[0]))
    x = graph.add("Concat", x, rest, axis=1)
    out = graph.linear(graph.add("Relu", graph.linear(x, second[0], bias_1[0])), last[0], bias_2[0])
    v = graph.add("Sigmoid", graph.add("Slice", out, graph.shape(0), graph.shape(1), graph.shape(1)))
    w = graph.add("Tanh", graph.add("Slice", out, graph.shape(1), graph.shape(2), graph.shape(1)))
    none = graph.add("Mul", v, graph.constant(0.0))
    graph.add("Concat", v, none, w, output="action", axis=1)
    graph.add("Add", none, graph.constant([1.0]), output="shares")
