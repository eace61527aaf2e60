"""V^h (Zhang et al., Section III-C): the chance of reaching a place unharmed, or a policy's own value of it."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vuca_nav.data_files import shown
from vuca_nav.errors import BadWeights
from vuca_nav.exploration.heuristic import Critic
from vuca_nav.geometry import inverse, transform_points
from vuca_nav.kernel_cache import njit
from vuca_nav.perception.percept import Percept
from vuca_nav.policy.layers import activate, inputs_first, layer
from vuca_nav.policy.observation import ObservationConfig, PerceptObserver, goal_features
from vuca_nav.policy.weights_file import LAYERS, PolicyWeights, Single, layer_shapes, observation_config
from vuca_nav.safetensors_file import checked_all, read_weights
from vuca_nav.types import BodySpec, FloatArray, LidarSpec, Pose2

FORMAT = "vuca-safety-1"
SHIPPED = Path(__file__).parent / "weights" / "critic.safetensors"
MOST_LOGIT = 50.0
"""Logits are clipped here, against overflow."""


@dataclass(frozen=True, slots=True)
class CriticWeights:
    """Checked network of a critic: it gives the logit of a chance, or the value that a policy was trained with."""

    path: Path
    observation: ObservationConfig
    metadata: dict[str, str]
    """Metadata of the file: training command, seed, ..."""
    weights: tuple[Single, ...]
    """Three matrices (outputs, inputs)."""
    biases: tuple[Single, ...]
    activation: str = "relu"
    """Activation of the hidden layers, ``"relu"`` or ``"elu"``."""
    is_chance: bool = True
    """Whether the output is the logit of a chance; else it is V^h itself."""


def value_network(policy: PolicyWeights) -> CriticWeights:
    """The critic that a policy was trained with: the paper's V^h (Section III-C), in the unit of its scaled rewards.

    The observation's mean and scale become part of the first layer.

    Args:
        policy: Result of ``load_weights``.
    """
    (first, *weights), (bias, *biases) = policy.critic_weights, policy.critic_biases
    scaled = np.asarray(first * policy.scale, np.float32)
    shifted = layer(-policy.mean, inputs_first(scaled), bias)  # in a fixed order, as all sums of the loop
    return CriticWeights(
        policy.path,
        policy.observation,
        policy.metadata,
        (scaled, *weights),
        (shifted, *biases),
        policy.activation,
        is_chance=False,
    )


def load_critic(path: Path) -> CriticWeights:
    """Read a critic.

    Raises:
        BadWeights: If the file is missing, is not safetensors, is of another format, lacks a tensor or has one too
            many, or one of another shape or type or with a number that is not finite in single precision.
    """
    if not os.path.exists(path):
        raise BadWeights(f"no weights of a critic at {path}; make them with: vuca train critic")
    tensors, metadata = read_weights(path)
    if metadata.get("format") != FORMAT:
        raise BadWeights(f"{path}: format is {shown(repr(metadata.get('format')))}, expected {FORMAT!r}")
    observation = observation_config(path, metadata)
    shapes = layer_shapes(path, tensors, "", observation.size, 1, LAYERS)
    good = checked_all(path, tensors, shapes)
    weights, biases = (tuple(good[f"{name}_{k}"] for k in range(LAYERS)) for name in ("weight", "bias"))
    return CriticWeights(path, observation, metadata, weights, biases)


class Layers(NamedTuple):
    """The network for the kernel."""

    weights: tuple[Single, ...]
    """Three matrices (inputs, outputs)."""
    biases: tuple[Single, ...]


class CriticNetwork:
    """The network of a critic's weights.

    Args:
        weights: Result of ``load_critic`` or of ``value_network``.
    """

    def __init__(self, weights: CriticWeights):
        self.weights = weights
        self._goal = weights.observation.goal_slice
        self._layers = Layers(tuple(map(inputs_first, weights.weights)), weights.biases)
        self._is_elu, self._is_chance = weights.activation == "elu", weights.is_chance

    def rate(self, observation: Single, goals: Single) -> FloatArray:
        """V^h (n,) of goals.

        Args:
            observation: (x,) numbers, whose goal does not matter.
            goals: (n, 3) as ``goal_features`` gives them.
        """
        values = np.empty(len(goals))
        _rate(observation, goals, self._goal.start, self._layers, self._is_elu, values)
        if self._is_chance:
            _chances_of_logits(values)
        return values


class LearnedCritic(Critic):
    """Rates points by a trained critic that sees the percept with each point as its goal, in one batch (Section III-C).

    The paper takes the value that the policy was trained with (``value_network``). That pays for every metre towards
    the goal, so that it mostly measures distance, which D^h is there for; the critic of ``load_critic`` was trained
    only for whether a moving obstacle is met (``train.critic``).

    Args:
        body: The robot's body.
        lidar: The body's lidar.
        weights: Result of ``load_critic`` or of ``value_network``.
        rate: Rate of the ticks [Hz]; by default the lidar's.

    Raises:
        BadArgument: If the critic's observation does not go with the lidar.
    """

    def __init__(self, body: BodySpec, lidar: LidarSpec, weights: CriticWeights, rate: float | None = None):
        self.network = CriticNetwork(weights)
        self._observer = PerceptObserver(weights.observation, body, lidar, rate)

    def values(self, points_in_map: FloatArray, percept: Percept, map_from_base: Pose2) -> FloatArray:
        """V^h (n,) of points (n, 2) [m]; all 1 while the percept is not valid."""
        if not percept.is_valid:
            return np.ones(len(points_in_map))
        observation = self._observer.observe(percept, (0.0, 0.0))
        return self.network.rate(observation, goal_features(transform_points(inverse(map_from_base), points_in_map)))


@njit(cache=True, nogil=True)
def _rate(observation, goals, at, layers, is_elu, out):
    """Rate goals (n, 3), which stand in the observation from index ``at`` on."""
    (first, second, last), (bias, bias_1, bias_2) = layers.weights, layers.biases
    # The goals' part of the first layer is all that differs between points.
    x = observation.copy()
    x[at : at + goals.shape[1]] = 0.0
    common = layer(x, first, bias)
    for n in range(len(goals)):
        hidden = layer(goals[n], first[at : at + goals.shape[1]], common)
        activate(hidden, is_elu)
        hidden = layer(hidden, second, bias_1)
        activate(hidden, is_elu)
        out[n] = float(layer(hidden, last, bias_2)[0])


@njit(cache=True, nogil=True)
def _chances_of_logits(values):
    for n in range(len(values)):
        values[n] = 1.0 / (1.0 + math.exp(-min(max(values[n], -MOST_LOGIT), MOST_LOGIT)))
