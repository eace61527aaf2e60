"""Gate and experts of a local policy (Section III-B), evaluated without torch."""

import math
from dataclasses import dataclass, field

import numpy as np
from numba import njit

from vuca_nav.errors import BadArgument
from vuca_nav.policy.weights_file import PolicyWeights, Single
from vuca_nav.types import FloatArray


@dataclass(frozen=True, slots=True)
class Gate:
    """Who decides on the experts' shares: the trained gate, or for analyses something simpler."""

    uniform: bool = False
    """Every expert has the same share."""
    without: int | None = None
    """This expert has none, by its number from 1 on; the others' shares add up to 1 again."""


LEARNED_GATE, UNIFORM_GATE = Gate(), Gate(uniform=True)


@dataclass(slots=True)
class PolicyNetwork:
    """The actor of one weights file.

    Fused layers are ``W = sum_n a_n W_n`` and biases likewise (Section III-B). ``sum_n a_n (W_n x + b_n)`` is the
    same and touches every weight once, where fusing first would write a matrix and read it again.
    """

    weights: PolicyWeights
    gate: Gate = LEARNED_GATE
    shares: FloatArray = field(init=False)
    """(E,) the experts' shares of the last action; they add up to 1."""
    _actor: tuple = field(init=False)

    def __post_init__(self) -> None:
        """Raises BadArgument if there is no such expert to leave out."""
        w, experts = self.weights, self.weights.experts
        if self.gate.without is not None and not (1 <= self.gate.without <= experts and experts > 1):
            raise BadArgument(
                f"cannot leave out expert {self.gate.without}: {w.path.name} has {experts}, "
                + (f"numbered 1 to {experts}" if experts > 1 else "which it needs")
            )
        self.shares = np.full(experts, 1.0 / experts)
        kept = np.ones(experts, np.bool_)
        if self.gate.without is not None:
            kept[self.gate.without - 1] = False
            self.shares = kept / kept.sum()
        elu = w.activation == "elu"
        # Transposed: the kernels add up columns, which vectorises without reordering a sum.
        gate = list(zip(w.gate_weights, w.gate_biases))
        if len(gate) == 2:  # one kernel for both depths: a layer that changes nothing
            units = len(gate[0][1])
            gate.insert(1, (np.eye(units, dtype=np.float32), np.zeros(units, np.float32)))
        if not gate:
            gate = [(np.zeros((1, size), np.float32), np.zeros(1, np.float32)) for size in (len(w.mean), 1, 1)]
        self._actor = (
            w.mean,
            w.scale,
            *(np.ascontiguousarray(weight.transpose(0, 2, 1)) for weight in w.weights),
            *w.biases,
            *(np.ascontiguousarray(weight.T) for weight, _ in gate),
            *(bias for _, bias in gate),
            elu,
            experts > 1 and not self.gate.uniform,
            kept,
            self.shares,
            *(np.empty(size, np.float32) for size in (len(w.mean), *(bias.shape[-1] for bias in w.biases))),
            *(np.empty(len(bias), np.float32) for _, bias in gate),
        )

    def act(self, observation: Single, action: FloatArray) -> bool:
        """The mean action for an observation.

        Args:
            observation: (x,)
            action: (3,) in [-1, 1], written to; left alone if something is not finite.

        Returns:
            Whether all that goes in and comes out is finite.
        """
        return _act(observation, action, *self._actor)


@njit(cache=True, nogil=True)
def _act(
    observation, action, mean, scale, w0, w1, w2, b0, b1, b2, gw0, gw1, gw2, gb0, gb1, gb2, elu, gated, kept, shares,
    x, h0, h1, h2, g0, g1, g2,
):  # fmt: skip
    for i in range(len(observation)):
        if not math.isfinite(observation[i]):
            return False
        x[i] = (observation[i] - mean[i]) * scale[i]
    if gated:
        _layer(x, gw0, gb0, g0)
        _activate(g0, False)
        _layer(g0, gw1, gb1, g1)
        _activate(g1, False)
        _layer(g1, gw2, gb2, g2)
        _softmax(g2, kept, shares)
    _fused_layer(x, w0, b0, shares, h0)
    _activate(h0, elu)
    _fused_layer(h0, w1, b1, shares, h1)
    _activate(h1, elu)
    _fused_layer(h1, w2, b2, shares, h2)
    for i in range(len(h2)):
        if not math.isfinite(h2[i]):
            return False
    for i in range(len(h2)):
        action[i] = math.tanh(h2[i])
    return True


@njit(cache=True, nogil=True)
def _softmax(logits, kept, shares):
    """Among those that are kept."""
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
def _fused_layer(x, weights, bias, shares, out):
    """``sum_n a_n (W_n x + b_n)``."""
    out[:] = 0.0
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


@njit(cache=True, nogil=True)
def _layer(x, weights, bias, out):
    out[:] = bias
    for i in range(len(x)):
        xi = x[i]
        if xi != 0.0:
            for j in range(len(out)):
                out[j] += weights[i, j] * xi


@njit(cache=True, nogil=True)
def _activate(values, elu):
    if elu:
        for i in range(len(values)):
            if values[i] < 0.0:
                values[i] = math.expm1(values[i])
    else:
        for i in range(len(values)):
            values[i] = max(values[i], np.float32(0.0))
