"""Actor and critic as torch modules, their mirror symmetry, and the export of the actor."""

import json
from pathlib import Path

import numpy as np
import torch
from safetensors.numpy import save
from torch import Tensor, nn

from robots.locomotion.config import QuadrupedConfig
from robots.locomotion.kernels import ACTION_SIZE, OBSERVATION_SIZE
from robots.locomotion.network import CLIP, FORMAT, gait_contract
from train.locomotion.kernels import CRITIC_SIZE
from vuca_nav.files import write_whole

_SWAPPED_LEGS = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
_LEAST_LOG_STD, _MOST_LOG_STD = -3.0, 0.0
_LEG_SIGNS = [-1.0, 1.0, 1.0] * 4


def action_mirror() -> tuple[list[int], list[float]]:
    """Exchange left and right of an action: ``mirrored = signs * action[order]``."""
    return _SWAPPED_LEGS, _LEG_SIGNS


def observation_mirror() -> tuple[list[int], list[float]]:
    """Exchange left and right of an observation: gyro, up, command, angles, speeds, action, clock, velocity."""
    order, signs = list(range(9)), [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, 1.0, -1.0, -1.0]
    for start in (9, 21, 33):
        order += [start + j for j in _SWAPPED_LEGS]
        signs += _LEG_SIGNS
    # The other diagonal is half a stride later: sine and cosine change sign.
    return [*order, 45, 46, 47, 48], [*signs, -1.0, -1.0, 1.0, -1.0]


def privileged_mirror() -> tuple[list[int], list[float]]:
    """Exchange left and right of the critic's further inputs: velocity 3, height, contacts 4, slow error 3."""
    order, signs = observation_mirror()
    n = OBSERVATION_SIZE
    extra = [n, n + 1, n + 2, n + 3, n + 5, n + 4, n + 7, n + 6, n + 8, n + 9, n + 10]
    return [*order, *extra], [*signs, 1.0, -1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0]


class Normaliser(nn.Module):
    """Running mean and deviation of symmetric inputs, frozen by not updating them."""

    def __init__(self, size: int, mirror: tuple[list[int], list[float]]):
        super().__init__()
        self.mean: Tensor
        self.variance: Tensor
        self.count: Tensor
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.tensor(1e-4))
        self._order, self._signs = torch.tensor(mirror[0]), torch.tensor(mirror[1])

    def update(self, x: Tensor) -> None:
        """Take in a batch (n, size) and its mirror image (Chan's parallel variance)."""
        x = torch.cat((x, x[:, self._order] * self._signs))
        total = self.count + len(x)
        delta = x.mean(0) - self.mean
        m2 = self.variance * self.count + x.var(0, correction=0) * len(x) + delta**2 * self.count * len(x) / total
        self.mean += delta * len(x) / total
        self.variance.copy_(m2 / total)
        self.count.copy_(total)

    def scale(self) -> Tensor:
        """Factor on a centred input."""
        return (self.variance + 1e-4).rsqrt()

    def forward(self, x: Tensor) -> Tensor:
        """Normalise and clip."""
        return ((x - self.mean) * self.scale()).clamp(-CLIP, CLIP)


class Perceptron(nn.Sequential):
    """Two hidden layers with ELU; the generator draws the first weights."""

    def __init__(self, sizes: tuple[int, int, int], gain: float, generator: torch.Generator):
        inputs, hidden, outputs = sizes
        layers = [nn.Linear(inputs, hidden), nn.Linear(hidden, hidden), nn.Linear(hidden, outputs)]
        for layer, g in zip(layers, (1.41, 1.41, gain)):
            nn.init.orthogonal_(layer.weight, g, generator=generator)
            nn.init.zeros_(layer.bias)
        super().__init__(layers[0], nn.ELU(), layers[1], nn.ELU(), layers[2])

    @classmethod
    def critic(cls, generator: torch.Generator, hidden: int) -> "Perceptron":
        """Make a critic from normalised inputs (n, CRITIC_SIZE) to values (n, 1)."""
        return cls((CRITIC_SIZE, hidden, 1), 1.0, generator)


class ActorNetwork(nn.Module):
    """Mean and standard deviation of an action for a normalised observation."""

    def __init__(self, generator: torch.Generator, hidden: int, initial_std: float):
        super().__init__()
        self.layers = Perceptron((OBSERVATION_SIZE, hidden, ACTION_SIZE), 0.01, generator)
        self.log_std = nn.Parameter(torch.full((ACTION_SIZE,), float(np.log(initial_std))))

    def std(self) -> Tensor:
        """Standard deviation of each action, (ACTION_SIZE,)."""
        return self.log_std.clamp(_LEAST_LOG_STD, _MOST_LOG_STD).exp()

    def forward(self, observation: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and standard deviation, each (n, ACTION_SIZE), for observations (n, OBSERVATION_SIZE)."""
        mean = self.layers(observation)
        return mean, self.std().expand_as(mean)


def export(
    path: Path, robot: QuadrupedConfig, network: ActorNetwork, normaliser: Normaliser, notes: dict[str, str]
) -> None:
    """Write the actor as robots.locomotion.network reads it."""
    tensors = {"mean": normaliser.mean, "scale": normaliser.scale()}
    linear = [layer for layer in network.layers if isinstance(layer, nn.Linear)]
    for k, layer in enumerate(linear):
        tensors[f"weight_{k}"], tensors[f"bias_{k}"] = layer.weight, layer.bias
    arrays = {key: np.ascontiguousarray(t.detach().numpy(), np.float32) for key, t in tensors.items()}
    metadata = {"format": FORMAT, "robot": robot.spec.name, "gait": gait_contract(robot), **notes}
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, save(arrays, metadata))
    write_whole(path.with_suffix(".json"), json.dumps(metadata, indent=2) + "\n")
