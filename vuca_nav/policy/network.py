"""Gate and experts of a local policy (Zhang et al., Section III-B), evaluated without torch; and that of Long et al."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np

from vuca_nav.errors import BadArgument
from vuca_nav.kernel_cache import njit
from vuca_nav.policy.drl_network import ConvolutionalLayers, act_by_convolutions, arrange
from vuca_nav.policy.layers import activate, inputs_first, layer
from vuca_nav.policy.weights_file import PolicyWeights, Single
from vuca_nav.types import FloatArray


@dataclass(frozen=True, slots=True)
class Gate:
    """Source of the experts' shares: the trained gate, or a simpler rule for analyses."""

    uniform: bool = False
    """Whether every expert has the same share."""
    without: int | None = None
    """Number from 1 of an expert that has no share; the others' shares add up to 1 again."""


LEARNED_GATE, UNIFORM_GATE = Gate(), Gate(uniform=True)


class Actor(NamedTuple):
    """A policy for the kernel: x inputs, E experts of three layers, a gate of three layers."""

    mean: np.ndarray
    """(x,) mean that is subtracted from the observation."""
    scale: np.ndarray
    """(x,) factor that the difference is multiplied by."""
    weights: tuple[np.ndarray, np.ndarray, np.ndarray]
    """(E, inputs, outputs) of each layer. They are transposed: the kernels add up columns, which vectorises without
    reordering a sum."""
    biases: tuple[np.ndarray, np.ndarray, np.ndarray]
    """(E, outputs) of each layer."""
    gate_weights: tuple[np.ndarray, np.ndarray, np.ndarray]
    """(inputs, outputs) of each layer of the gate."""
    gate_biases: tuple[np.ndarray, np.ndarray, np.ndarray]
    """(outputs,) of each layer of the gate."""
    elu: bool
    """Whether the experts' layers are followed by ELU, else by ReLU. The gate's are followed by ReLU."""
    gated: bool
    """Whether shares come from the gate, else from ``shares`` as it stands."""
    kept: np.ndarray
    """(E,) bool, experts that may have a share."""
    shares: np.ndarray
    """(E,) shares of the last action; written to."""


class Network(Protocol):
    """The actor of one weights file."""

    weights: PolicyWeights
    gate: Gate
    shares: FloatArray
    """(E,) the experts' shares of the last action; they add up to 1."""

    def act(self, observation: Single, action: FloatArray) -> bool:
        """Compute the mean action for an observation.

        Args:
            observation: (x,) numbers.
            action: (3,) in [-1, 1], written to; left alone if any number is not finite.

        Returns:
            Whether observation and action are finite.
        """
        ...


def make_network(weights: PolicyWeights, gate: Gate = LEARNED_GATE) -> Network:
    """Make the actor of a weights file.

    Raises:
        BadArgument: If there is no such expert to leave out.
    """
    if weights.convolutions:
        _check_expert(weights, gate)
        return ConvolutionalNetwork(weights, gate)
    return PolicyNetwork(weights, gate)


def _check_expert(weights: PolicyWeights, gate: Gate) -> None:
    """Raise BadArgument if there is no such expert to leave out."""
    experts = weights.experts
    if gate.without is not None and not (1 <= gate.without <= experts and experts > 1):
        raise BadArgument(
            f"cannot leave out expert {gate.without}: {weights.path.name} has {experts}, "
            + (f"numbered 1 to {experts}" if experts > 1 else "which it needs")
        )


@dataclass(slots=True)
class ConvolutionalNetwork:
    """The actor of Long et al."""

    weights: PolicyWeights
    gate: Gate = LEARNED_GATE
    shares: FloatArray = field(init=False)
    """(1,) the share of the only network."""
    _layers: ConvolutionalLayers = field(init=False)

    def __post_init__(self) -> None:
        """Arrange the weights for the kernel."""
        w = self.weights
        layers = [(weight[0], bias[0]) for weight, bias in zip(w.weights, w.biases)]
        self.shares = np.ones(1)
        self._layers = arrange((w.mean, w.scale), w.observation.sectors, list(w.convolutions), layers)

    def act(self, observation: Single, action: FloatArray) -> bool:
        """Compute the mean action for an observation, as ``Network`` says: forward speed and turn rate."""
        return act_by_convolutions(observation, action, self._layers)


@dataclass(slots=True)
class PolicyNetwork:
    """The fused actor of one weights file.

    Fused layers are ``W = sum_n a_n W_n`` and biases likewise (Section III-B). ``sum_n a_n (W_n x + b_n)`` is the
    same and touches every weight once, where fusing first would write a matrix and read it again.
    """

    weights: PolicyWeights
    gate: Gate = LEARNED_GATE
    shares: FloatArray = field(init=False)
    """(E,) the experts' shares of the last action; they add up to 1."""
    _actor: Actor = field(init=False)

    def __post_init__(self) -> None:
        """Arrange the weights for the kernel.

        Raises:
            BadArgument: If there is no such expert to leave out.
        """
        w, experts = self.weights, self.weights.experts
        _check_expert(w, self.gate)
        self.shares = np.full(experts, 1.0 / experts)
        kept = np.ones(experts, np.bool_)
        if self.gate.without is not None:
            kept[self.gate.without - 1] = False
            self.shares = kept / kept.sum()
        gate = list(zip(w.gate_weights, w.gate_biases))
        if len(gate) == 2:  # one kernel for both depths: a layer that changes nothing
            units = len(gate[0][1])
            gate.insert(1, (np.eye(units, dtype=np.float32), np.zeros(units, np.float32)))
        if not gate:
            gate = [(np.zeros((1, size), np.float32), np.zeros(1, np.float32)) for size in (len(w.mean), 1, 1)]
        (w0, w1, w2), (b0, b1, b2) = w.weights, w.biases
        (gate_w0, gate_b0), (gate_w1, gate_b1), (gate_w2, gate_b2) = gate
        self._actor = Actor(
            w.mean,
            w.scale,
            (inputs_first(w0), inputs_first(w1), inputs_first(w2)),
            (b0, b1, b2),
            (inputs_first(gate_w0), inputs_first(gate_w1), inputs_first(gate_w2)),
            (gate_b0, gate_b1, gate_b2),
            w.activation == "elu",
            experts > 1 and not self.gate.uniform,
            kept,
            self.shares,
        )

    def act(self, observation: Single, action: FloatArray) -> bool:
        """Compute the mean action for an observation.

        Args:
            observation: (x,) numbers.
            action: (3,) in [-1, 1], written to; left alone if any number is not finite.

        Returns:
            Whether observation and action are finite.
        """
        return _act(observation, action, self._actor)


@njit(cache=True, nogil=True)
def _act(observation, action, actor):
    weights, biases, shares = actor.weights, actor.biases, actor.shares
    x = np.empty(len(observation), np.float32)
    for i in range(len(observation)):
        if not math.isfinite(observation[i]):
            return False
        x[i] = (observation[i] - actor.mean[i]) * actor.scale[i]
    if actor.gated:
        g0 = layer(x, actor.gate_weights[0], actor.gate_biases[0])
        activate(g0, False)
        g1 = layer(g0, actor.gate_weights[1], actor.gate_biases[1])
        activate(g1, False)
        g2 = layer(g1, actor.gate_weights[2], actor.gate_biases[2])
        _softmax(g2, actor.kept, shares)
    h0 = _fused_layer(x, weights[0], biases[0], shares)
    activate(h0, actor.elu)
    h1 = _fused_layer(h0, weights[1], biases[1], shares)
    activate(h1, actor.elu)
    h2 = _fused_layer(h1, weights[2], biases[2], shares)
    for i in range(len(h2)):
        if not math.isfinite(h2[i]):
            return False
    for i in range(len(h2)):
        action[i] = math.tanh(h2[i])
    return True


@njit(cache=True, nogil=True)
def _softmax(logits, kept, shares):
    """Compute the shares of the experts that are kept from the gate's logits."""
    greatest = -np.inf
    for k in range(len(logits)):
        if kept[k]:
            greatest = max(greatest, float(logits[k]))
    total = 0.0
    for k in range(len(logits)):
        shares[k] = math.exp(logits[k] - greatest) if kept[k] else 0.0
        total += shares[k]
    for k in range(len(logits)):
        shares[k] /= total


@njit(cache=True, nogil=True)
def _fused_layer(x, weights, bias, shares):
    """Fused layer ``sum_n a_n (W_n x + b_n)``, (outputs,)."""
    out = np.zeros(bias.shape[1], np.float32)
    for n in range(len(shares)):
        share = np.float32(shares[n])
        if share == 0.0:
            continue
        for j in range(len(out)):
            out[j] += share * bias[n, j]
        for i in range(len(x)):
            scaled = share * x[i]
            if scaled != 0.0:  # half of what ReLU leaves
                for j in range(len(out)):
                    out[j] += weights[n, i, j] * scaled
    return out
