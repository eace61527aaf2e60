"""The local policy as it is shipped: gate, experts and critic in one safetensors file, evaluated without torch."""

import json
import math
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.policy.observation import GOAL_SIZE, ObservationConfig
from vuca_nav.types import FloatArray
from vuca_nav.weights import checked, present, read_weights

FORMAT = "vuca-policy-1"
WEIGHTS_FOLDER = Path(__file__).parent / "weights"
ACTION_SIZE = 3
LAYERS = 3
ACTIVATIONS = ("relu", "elu")

Single = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Gate:
    """Who decides on the experts' shares: the trained gate, or for analyses something simpler."""

    uniform: bool = False
    """Every expert has the same share."""
    without: int | None = None
    """This expert has none; the others' shares add up to 1 again."""


LEARNED_GATE, UNIFORM_GATE = Gate(), Gate(uniform=True)


@dataclass(frozen=True, slots=True)
class PolicyWeights:
    """What a weights file holds, checked."""

    path: Path
    observation: ObservationConfig
    activation: str
    """Of the hidden layers of experts and critic; the gate's are ReLU."""
    metadata: dict[str, str]
    """As it is in the file: training command, seed, steps, ..."""
    mean: Single
    scale: Single
    """(x,) the networks see ``(observation - mean) * scale``."""
    weights: tuple[Single, ...]
    """Three times (E, outputs, inputs)."""
    biases: tuple[Single, ...]
    """Three times (E, outputs)."""
    gate_weights: tuple[Single, ...]
    """(outputs, inputs), two or three times; none where E is 1."""
    gate_biases: tuple[Single, ...]
    critic_weights: tuple[Single, ...]
    """(outputs, inputs), three times."""
    critic_biases: tuple[Single, ...]

    @property
    def experts(self) -> int:
        """E."""
        return len(self.weights[0])


def load_weights(path: Path) -> PolicyWeights:
    """Read a policy.

    Raises:
        BadWeights: If the file is missing, is not safetensors, is of another format, lacks a tensor or has one too
            many, or one of another shape or type or with a number that is not finite in single precision.
    """
    if not path.is_file():
        raise BadWeights(f"no policy weights at {path}; make them with: vuca train all")
    tensors, metadata = read_weights(path)
    if metadata.get("format") != FORMAT:
        raise BadWeights(f"{path}: format is {metadata.get('format')!r}, expected {FORMAT!r}")
    activation = metadata.get("activation")
    if activation not in ACTIVATIONS:
        raise BadWeights(f"{path}: activation is {activation!r}, expected one of {', '.join(ACTIVATIONS)}")
    observation = _observation_config(path, metadata)
    x = observation.size
    first = present(path, tensors, "weight_0")
    if first.ndim != 3 or 0 in first.shape:
        raise BadWeights(f"{path}: tensor 'weight_0' has shape {first.shape}, expected (experts, hidden units, {x})")
    experts = first.shape[0]
    shapes: dict[str, tuple[int, ...]] = {"mean": (x,), "scale": (x,)}
    shapes |= _layer_shapes(path, tensors, "", x, ACTION_SIZE, LAYERS, (experts,))
    shapes |= _layer_shapes(path, tensors, "critic_", x, 1, LAYERS)
    gate_layers = 0
    if experts > 1:
        gate_layers = 3 if "gate_weight_2" in tensors else 2
        shapes |= _layer_shapes(path, tensors, "gate_", x, experts, gate_layers)
    odd = sorted(set(tensors) - set(shapes))
    if odd:
        raise BadWeights(f"{path}: tensor {odd[0]!r} does not belong there (expected: {', '.join(sorted(shapes))})")
    good = {name: checked(path, tensors, name, shape) for name, shape in shapes.items()}

    def layers(name: str, count: int) -> tuple[Single, ...]:
        return tuple(good[f"{name}_{k}"] for k in range(count))

    return PolicyWeights(
        path=path,
        observation=observation,
        activation=activation,
        metadata=metadata,
        mean=good["mean"],
        scale=good["scale"],
        weights=layers("weight", LAYERS),
        biases=layers("bias", LAYERS),
        gate_weights=layers("gate_weight", gate_layers),
        gate_biases=layers("gate_bias", gate_layers),
        critic_weights=layers("critic_weight", LAYERS),
        critic_biases=layers("critic_bias", LAYERS),
    )


def _observation_config(path: Path, metadata: dict[str, str]) -> ObservationConfig:
    names = {entry.name for entry in fields(ObservationConfig)}
    try:
        content = json.loads(metadata.get("observation", ""))
        if not isinstance(content, dict) or set(content) != names:
            raise BadWeights(f"{path}: observation is {content!r}, expected the fields {', '.join(sorted(names))}")
        return ObservationConfig(**content)
    except (ValueError, TypeError, BadArgument) as error:
        raise BadWeights(f"{path}: its observation is not one: {error}") from error


def _layer_shapes(
    path: Path,
    tensors: dict[str, np.ndarray],
    prefix: str,
    inputs: int,
    outputs: int,
    layers: int,
    stack: tuple[int, ...] = (),
) -> dict[str, tuple[int, ...]]:
    """What the tensors of a network must be like, given how many units the hidden layers' biases have."""
    shapes: dict[str, tuple[int, ...]] = {}
    size = inputs
    for k in range(layers):
        before, size = size, outputs
        if k < layers - 1:
            bias = present(path, tensors, f"{prefix}bias_{k}")
            size = bias.shape[-1] if bias.ndim else 0
            if size == 0:
                raise BadWeights(f"{path}: tensor '{prefix}bias_{k}' is empty, expected a hidden layer")
        shapes[f"{prefix}weight_{k}"], shapes[f"{prefix}bias_{k}"] = (*stack, size, before), (*stack, size)
    return shapes


@dataclass(slots=True)
class PolicyNetwork:
    """Actor and critic of one weights file.

    Fused layers are ``W = sum_n a_n W_n`` and biases likewise (Section III-B). ``sum_n a_n (W_n x + b_n)`` is the
    same and touches every weight once, where fusing first would write a matrix and read it again.
    """

    weights: PolicyWeights
    gate: Gate = LEARNED_GATE
    shares: FloatArray = field(init=False)
    """(E,) the experts' shares of the last action; they add up to 1."""
    _actor: tuple = field(init=False)
    _critic: tuple = field(init=False)

    def __post_init__(self) -> None:
        """Raises BadArgument if there is no such expert to leave out."""
        w, experts = self.weights, self.weights.experts
        if self.gate.without is not None and not (0 <= self.gate.without < experts and experts > 1):
            raise BadArgument(
                f"cannot leave out expert {self.gate.without}: {w.path.name} has {experts}, "
                + (f"numbered 0 to {experts - 1}" if experts > 1 else "which it needs")
            )
        self.shares = np.full(experts, 1.0 / experts)
        kept = np.ones(experts, np.bool_)
        if self.gate.without is not None:
            kept[self.gate.without] = False
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
        self._critic = (
            w.mean,
            w.scale,
            *(np.ascontiguousarray(weight.T) for weight in w.critic_weights),
            *w.critic_biases,
            elu,
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

    def values(self, observation: Single, goals: Single) -> FloatArray:
        """The critic's value of an observation with other goals in O_g's place.

        Args:
            observation: (x,)
            goals: (m, 3) as ``goal_features`` gives them.

        Returns:
            (m,)
        """
        out = np.empty(len(goals))
        at = self.weights.observation.goal_slice.start
        _values(observation, goals, out, at, *self._critic)
        return out


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


@njit(cache=True, nogil=True)
def _values(observation, goals, out, at, mean, scale, w0, w1, w2, b0, b1, b2, elu):
    # The goals' part of the first layer is all that differs between rows.
    common = b0.copy()
    for i in range(len(observation)):
        if i < at or i >= at + GOAL_SIZE:
            xi = (observation[i] - mean[i]) * scale[i]
            for j in range(len(common)):
                common[j] += w0[i, j] * xi
    h0, h1, h2 = np.empty_like(b0), np.empty_like(b1), np.empty_like(b2)
    for row in range(len(goals)):
        h0[:] = common
        for k in range(GOAL_SIZE):
            xi = (goals[row, k] - mean[at + k]) * scale[at + k]
            for j in range(len(h0)):
                h0[j] += w0[at + k, j] * xi
        _activate(h0, elu)
        _layer(h0, w1, b1, h1)
        _activate(h1, elu)
        _layer(h1, w2, b2, h2)
        out[row] = h2[0]
