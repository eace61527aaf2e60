"""The fused actor (Zhang et al., Section III-B) and the critic as torch modules."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, cast

import torch
from torch import Tensor, nn

from vuca_nav.checks import check_counts, check_fields

ACTION_SIZE = 3
"""Size of an action: shares of the body's limits of v_x, v_y and w_z."""
Activation = Literal["relu", "elu"]
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


class FusedActor(nn.Module):
    """Mean and standard deviation of an action for an observation.

    Args:
        inputs: Size of an observation.
        config: Sizes of the networks.
        generator: Source of the first weights.
    """

    def __init__(self, inputs: int, config: NetworkConfig, generator: torch.Generator):
        super().__init__()
        sizes = (inputs, config.hidden, config.hidden, ACTION_SIZE)
        gains = (math.sqrt(2.0), math.sqrt(2.0), 0.01)
        layers = [FusedLinear(config.experts, a, b, gain, generator) for a, b, gain in zip(sizes, sizes[1:], gains)]
        self.layers = cast("Sequence[FusedLinear]", nn.ModuleList(layers))
        self.gate_layers = None
        if config.experts > 1:
            first = _linear(inputs, config.gate, math.sqrt(2.0), generator)
            self.gate_layers = nn.Sequential(first, nn.ReLU(), _linear(config.gate, config.experts, 0.01, generator))
        self.log_std = nn.Parameter(torch.full((ACTION_SIZE,), math.log(config.initial_std)))
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

    def std(self) -> Tensor:
        """Standard deviation of each action, (3,)."""
        return self.log_std.clamp(_LEAST_LOG_STD, _MOST_LOG_STD).exp()

    def forward(self, observation: Tensor, shares: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation, each (n, 3); ``shares`` are the gate's, or those that overrule it."""
        mean = self.mean(observation, shares)
        return mean, self.std().expand_as(mean)


def make_critic(inputs: int, config: NetworkConfig, generator: torch.Generator) -> nn.Sequential:
    """Make a critic from observations (n, inputs) to values (n, 1) of the reward as it is scaled in training."""
    activation = nn.ReLU if config.activation == "relu" else nn.ELU
    return nn.Sequential(
        _linear(inputs, config.critic, math.sqrt(2.0), generator), activation(),
        _linear(config.critic, config.critic, math.sqrt(2.0), generator), activation(),
        _linear(config.critic, 1, 1.0, generator),
    )  # fmt: skip


def _linear(inputs: int, outputs: int, gain: float, generator: torch.Generator) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain, generator)
    nn.init.zeros_(layer.bias)
    return layer
