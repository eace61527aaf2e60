"""The actors and critics as torch modules: the fused one of Zhang et al., Section III-B, and that of Long et al."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, cast

import torch
from torch import Tensor, nn

from train.navigation.mirror import ACTION_SIGNS
from vuca_nav.checks import check_counts, check_fields
from vuca_nav.policy.drl_network import CONVOLUTIONS, HIDDEN, SCALARS, convolved_size
from vuca_nav.policy.observation import ObservationConfig

ACTION_SIZE = 3
"""Size of an action: shares of the body's limits of v_x, v_y and w_z."""
Activation = Literal["relu", "elu"]
Architecture = Literal["fused", "convolutional"]
_ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {"relu": torch.relu, "elu": nn.functional.elu}
_LEAST_LOG_STD, _MOST_LOG_STD = -3.0, 0.0


@dataclass(frozen=True, slots=True)
class NetworkConfig:
    """Sizes of the networks; the paper prints none."""

    experts: int = 1
    """Number of networks whose weights are fused; 1 needs no gate."""
    hidden: int = 128
    """Units of both hidden layers of every expert."""
    gate: int = 64
    """Hidden units of the gate."""
    critic: int = 128
    """Units of both hidden layers of the critic."""
    activation: Activation = "relu"
    initial_std: float = 0.37
    """Standard deviation of every action at first."""
    architecture: Architecture = "fused"
    """``fused``: Zhang et al.'s. ``convolutional``: that of Long et al., whose sizes are its own; it reads an
    observation of kind ``frames``."""

    def __post_init__(self) -> None:
        """Raise BadArgument for a value that is out of its range."""
        check_counts(self, "experts", "hidden", "gate", "critic")
        least, most = math.exp(_LEAST_LOG_STD), math.exp(_MOST_LOG_STD)
        check_fields(self, f"{least:.2f} to {most:g}", lambda std: least <= std <= most, "initial_std")


class FusedLinear(nn.Module):
    """A layer whose weights and biases are, for every row of a batch, a weighted sum of those of the experts.

    ``(sum_n a_n W_n) x + sum_n a_n b_n = sum_n a_n (W_n x + b_n)``: the right side needs no weight matrix a row, only
    one product of the batch with the experts' matrices stacked.
    """

    def __init__(self, experts: int, inputs: int, outputs: int, gain: float, generator: torch.Generator):
        super().__init__()
        self.weight = nn.Parameter(torch.empty(experts, outputs, inputs))
        self.bias = nn.Parameter(torch.zeros(experts, outputs))
        for weight in self.weight.data:
            nn.init.orthogonal_(weight, gain, generator)

    def forward(self, x: Tensor, shares: Tensor) -> Tensor:
        """Map inputs (n, inputs) to outputs (n, outputs), for shares (n, experts)."""
        experts, outputs, inputs = self.weight.shape
        y = torch.addmm(self.bias.view(-1), x, self.weight.view(-1, inputs).t())  # (n, experts * outputs)
        if experts == 1:
            return y
        return torch.bmm(shares.unsqueeze(1), y.view(-1, experts, outputs)).squeeze(1)


class Actor(nn.Module, ABC):
    """A policy: mean and standard deviation of an action for an observation.

    Args:
        inputs: Size of an observation.
    """

    action_names: Sequence[str]
    """Name of each action."""
    action_signs: Sequence[float]
    """Sign of each action under exchange of left and right."""
    log_std: nn.Parameter
    """Logarithm of each action's standard deviation, (k,)."""

    def __init__(self, inputs: int):
        super().__init__()
        self.inputs = inputs

    @abstractmethod
    def act(self, observation: Tensor) -> Tensor:
        """Mean of the action, (n, k), for observations (n, inputs)."""

    def shares(self, action: Tensor) -> Tensor:
        """Shares of the body's limits (n, 3) in [-1, 1] that an action (n, k) asks for."""
        return action.clamp(-1.0, 1.0)

    def std(self) -> Tensor:
        """Standard deviation of each action, (k,)."""
        return self.log_std.clamp(_LEAST_LOG_STD, _MOST_LOG_STD).exp()


class FusedActor(Actor):
    """Mean and standard deviation of an action, by networks whose weights a gate fuses.

    Args:
        inputs: Size of an observation.
        config: Sizes of the networks.
        generator: Source of the first weights.
    """

    action_names, action_signs = ("v_x", "v_y", "w_z"), ACTION_SIGNS

    def __init__(self, inputs: int, config: NetworkConfig, generator: torch.Generator):
        super().__init__(inputs)
        sizes = (inputs, config.hidden, config.hidden, ACTION_SIZE)
        gains = (math.sqrt(2.0), math.sqrt(2.0), 0.01)
        layers = [FusedLinear(config.experts, a, b, gain, generator) for a, b, gain in zip(sizes, sizes[1:], gains)]
        self.layers = cast("Sequence[FusedLinear]", nn.ModuleList(layers))
        self.gate_layers = None
        if config.experts > 1:
            first = _linear(inputs, config.gate, math.sqrt(2.0), generator)
            self.gate_layers = nn.Sequential(first, nn.ReLU(), _linear(config.gate, config.experts, 0.01, generator))
        self.log_std = _log_std(len(self.action_names), config.initial_std)
        self._activation = _ACTIVATIONS[config.activation]

    def gate(self, observation: Tensor) -> Tensor:
        """Shares (n, experts) that add up to 1, for observations (n, inputs)."""
        if self.gate_layers is None:
            return observation.new_ones(len(observation), 1)
        return self.gate_layers(observation).softmax(-1)

    def mean(self, observation: Tensor, shares: Tensor) -> Tensor:
        """Mean of the action, (n, 3) within [-1, 1]."""
        x = self._activation(self.layers[0](observation, shares))
        x = self._activation(self.layers[1](x, shares))
        return torch.tanh(self.layers[2](x, shares))

    def act(self, observation: Tensor) -> Tensor:
        """Mean of the action with the shares of the actor's own gate, (n, 3)."""
        return self.mean(observation, self.gate(observation))

    def forward(self, observation: Tensor, shares: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation, each (n, 3); ``shares`` are the gate's, or those that overrule it."""
        mean = self.mean(observation, shares)
        return mean, self.std().expand_as(mean)


class ConvolutionalActor(Actor):
    """Forward speed and turn rate by the network of Long et al.: sigmoid and tanh of a trunk's two outputs.

    Args:
        observation: The observation, of kind ``frames``.
        initial_std: Standard deviation of both actions at first.
        generator: Source of the first weights.
    """

    action_names, action_signs = ("v_x", "w_z"), (1.0, -1.0)

    def __init__(self, observation: ObservationConfig, initial_std: float, generator: torch.Generator):
        super().__init__(observation.size)
        self.trunk = ConvolutionalTrunk(observation, len(self.action_names), 0.01, generator)
        self.log_std = _log_std(len(self.action_names), initial_std)

    def act(self, observation: Tensor) -> Tensor:
        """Mean of the action: v in [0, 1] and w in [-1, 1], shares of the body's limits, (n, 2)."""
        out = self.trunk(observation)
        return torch.stack((torch.sigmoid(out[:, 0]), torch.tanh(out[:, 1])), 1)

    def shares(self, action: Tensor) -> Tensor:
        """Shares of the body's limits (n, 3): never backward, never sideways."""
        v, w = action[:, 0].clamp(0.0, 1.0), action[:, 1].clamp(-1.0, 1.0)
        return torch.stack((v, torch.zeros_like(v), w), 1)

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation, each (n, 2)."""
        mean = self.act(observation)
        return mean, self.std().expand_as(mean)


class ConvolutionalTrunk(nn.Module):
    """Two convolutions over the frames, a layer, a layer that also reads goal and speed, and the outputs.

    Args:
        observation: The observation, of kind ``frames``.
        outputs: Number of outputs.
        gain: Gain of the last layer's first weights.
        generator: Source of the first weights.
    """

    def __init__(self, observation: ObservationConfig, outputs: int, gain: float, generator: torch.Generator):
        super().__init__()
        channels = observation.history + 1
        self._frames = channels, observation.sectors
        convolutions = []
        for out, kernel in CONVOLUTIONS:
            layer = nn.Conv1d(channels, out, kernel, stride=2, padding=1)
            nn.init.orthogonal_(layer.weight, math.sqrt(2.0), generator)
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]
            convolutions += [layer, nn.ReLU()]
            channels = out
        self.convolutions = nn.Sequential(*convolutions)
        self.hidden = _linear(convolved_size(observation.sectors), HIDDEN[0], math.sqrt(2.0), generator)
        self.joined = _linear(HIDDEN[0] + SCALARS, HIDDEN[1], math.sqrt(2.0), generator)
        self.out = _linear(HIDDEN[1], outputs, gain, generator)

    @property
    def convolution_layers(self) -> list[nn.Conv1d]:
        """The convolutions in their order."""
        return [layer for layer in self.convolutions if isinstance(layer, nn.Conv1d)]

    @property
    def layers(self) -> tuple[nn.Linear, nn.Linear, nn.Linear]:
        """The layers after them."""
        return self.hidden, self.joined, self.out

    def forward(self, observation: Tensor) -> Tensor:
        """Map observations (n, size) to outputs (n, outputs)."""
        count = self._frames[0] * self._frames[1]
        scans, scalars = observation[:, :count].reshape(-1, *self._frames), observation[:, count:]
        x = torch.relu(self.hidden(self.convolutions(scans).flatten(1)))
        x = torch.relu(self.joined(torch.cat((x, scalars), 1)))
        return self.out(x)


def make_actor(observation: ObservationConfig, config: NetworkConfig, generator: torch.Generator) -> Actor:
    """Make an actor of a configuration."""
    if config.architecture == "convolutional":
        return ConvolutionalActor(observation, config.initial_std, generator)
    return FusedActor(observation.size, config, generator)


def make_critic_of(observation: ObservationConfig, config: NetworkConfig, generator: torch.Generator) -> nn.Module:
    """Make the critic of a configuration, with no weights in common with the actor."""
    if config.architecture == "convolutional":
        return ConvolutionalTrunk(observation, 1, 1.0, generator)
    return make_critic(observation.size, config, generator)


def make_critic(inputs: int, config: NetworkConfig, generator: torch.Generator) -> nn.Sequential:
    """Make a critic from observations (n, inputs) to values (n, 1) of the reward as it is scaled in training."""
    activation = nn.ReLU if config.activation == "relu" else nn.ELU
    return nn.Sequential(
        _linear(inputs, config.critic, math.sqrt(2.0), generator), activation(),
        _linear(config.critic, config.critic, math.sqrt(2.0), generator), activation(),
        _linear(config.critic, 1, 1.0, generator),
    )  # fmt: skip


def _log_std(actions: int, std: float) -> nn.Parameter:
    return nn.Parameter(torch.full((actions,), math.log(std)))


def _linear(inputs: int, outputs: int, gain: float, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain, generator)
    nn.init.zeros_(layer.bias)
    return layer
