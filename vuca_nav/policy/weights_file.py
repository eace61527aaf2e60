"""The local policy as it is shipped: gate, experts and critic in one safetensors file, read and checked.

An observation of kind ``frames`` goes with the network of Long et al., any other with the fused one.
"""

import os
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vuca_nav.data_files import parse_json, shown
from vuca_nav.errors import BadArgument, BadWeights
from vuca_nav.policy.drl_network import CONVOLUTIONS, OUTPUTS, convolved_size, network_shapes
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.safetensors_file import checked_all, present, read_weights

FORMAT = "vuca-policy-1"
WEIGHTS_FOLDER = Path(__file__).parent / "weights"
ACTION_SIZE = 3
LAYERS = 3
ACTIVATIONS = ("relu", "elu")
MOST_EXPERTS = 64
"""Greatest number of experts; the paper has four. The gate and the telemetry take some time for each."""

Single = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class PolicyWeights:
    """Checked content of a weights file."""

    path: Path
    observation: ObservationConfig
    activation: str
    """Activation of the hidden layers of experts and critic; the gate's is ReLU."""
    metadata: dict[str, str]
    """Metadata of the file: training command, seed, steps, ..."""
    mean: Single
    scale: Single
    """(x,) scale: the networks' input is ``(observation - mean) * scale``."""
    weights: tuple[Single, ...]
    """Three arrays (E, outputs, inputs)."""
    biases: tuple[Single, ...]
    """Three arrays (E, outputs)."""
    gate_weights: tuple[Single, ...]
    """Two or three matrices (outputs, inputs); none where E is 1."""
    gate_biases: tuple[Single, ...]
    critic_weights: tuple[Single, ...]
    """Three matrices (outputs, inputs)."""
    critic_biases: tuple[Single, ...]
    convolutions: tuple[tuple[Single, Single], ...] = ()
    """Weight (channels, inputs, width) and bias of each convolution before the first layer; none for fused networks."""
    critic_convolutions: tuple[tuple[Single, Single], ...] = ()

    @property
    def experts(self) -> int:
        """Number E of experts."""
        return len(self.weights[0])


def load_weights(path: Path) -> PolicyWeights:
    """Read a policy.

    Raises:
        BadWeights: If the file is missing, is not safetensors, is of another format, lacks a tensor or has one too
            many, or one of another shape or type or with a number that is not finite in single precision.
    """
    if not os.path.exists(path):
        raise BadWeights(f"no policy weights at {path}; make them with: vuca train all")
    tensors, metadata = read_weights(path)
    if metadata.get("format") != FORMAT:
        raise BadWeights(f"{path}: format is {shown(repr(metadata.get('format')))}, expected {FORMAT!r}")
    activation = metadata.get("activation")
    if activation not in ACTIVATIONS:
        raise BadWeights(f"{path}: activation is {shown(repr(activation))}, expected one of {', '.join(ACTIVATIONS)}")
    observation = observation_config(path, metadata)
    if observation.kind == "frames":
        return _convolutional(path, observation, activation, tensors, metadata)
    x = observation.size
    first = present(path, tensors, "weight_0")
    if first.ndim != 3 or 0 in first.shape:
        raise BadWeights(f"{path}: tensor 'weight_0' has shape {first.shape}, expected (experts, hidden units, {x})")
    experts = first.shape[0]
    if experts > MOST_EXPERTS:
        raise BadWeights(f"{path}: tensor 'weight_0' has {experts} experts, at most {MOST_EXPERTS} are read")
    shapes: dict[str, tuple[int, ...]] = {"mean": (x,), "scale": (x,)}
    shapes |= layer_shapes(path, tensors, "", x, ACTION_SIZE, LAYERS, (experts,))
    shapes |= layer_shapes(path, tensors, "critic_", x, 1, LAYERS)
    gate_layers = 0
    if experts > 1:
        gate_layers = 3 if "gate_weight_2" in tensors else 2
        shapes |= layer_shapes(path, tensors, "gate_", x, experts, gate_layers)
    good = checked_all(path, tensors, shapes)

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


def _convolutional(
    path: Path, observation: ObservationConfig, activation: str, tensors: dict[str, np.ndarray],
    metadata: dict[str, str],
) -> PolicyWeights:  # fmt: skip
    """Check the tensors of a network that convolves frames; raises as ``load_weights``."""
    x, frames, sectors = observation.size, observation.history + 1, observation.sectors
    if convolved_size(sectors) < 1:
        raise BadWeights(f"{path}: {sectors} sectors are too few for two convolutions")
    if activation != "relu":
        raise BadWeights(f"{path}: activation is {activation!r}, expected 'relu' with an observation of kind 'frames'")
    shapes: dict[str, tuple[int, ...]] = {"mean": (x,), "scale": (x,)}
    shapes |= network_shapes(frames, sectors, OUTPUTS, (1,))
    shapes |= {f"critic_{name}": shape for name, shape in network_shapes(frames, sectors, 1).items()}
    good = checked_all(path, tensors, shapes)

    def pairs(prefix: str) -> tuple[tuple[Single, Single], ...]:
        return tuple((good[f"{prefix}weight_{k}"], good[f"{prefix}bias_{k}"]) for k in range(len(CONVOLUTIONS)))

    def layers(name: str) -> tuple[Single, ...]:
        return tuple(good[f"{name}_{k}"] for k in range(LAYERS))

    return PolicyWeights(
        path, observation, activation, metadata, good["mean"], good["scale"], layers("weight"), layers("bias"), (), (),
        layers("critic_weight"), layers("critic_bias"), pairs("conv_"), pairs("critic_conv_"),
    )  # fmt: skip


def observation_config(path: Path, metadata: dict[str, str]) -> ObservationConfig:
    """Configuration of the observation that the network in a file takes.

    Raises:
        BadWeights: If the file does not say.
    """
    types: dict[str, tuple[type, ...]] = {
        entry.name: {int: (int,), float: (int, float)}.get(entry.type, (str,))  # type: ignore[call-overload]
        for entry in fields(ObservationConfig)
    }
    source = f"{path}: its observation is not one"
    content = parse_json(metadata.get("observation", ""), source, BadWeights)
    if not isinstance(content, dict) or set(content) != set(types):
        raise BadWeights(f"{path}: observation is {shown(content)}, expected the fields {', '.join(sorted(types))}")
    for name, value in content.items():
        if not isinstance(value, types[name]) or isinstance(value, bool):
            raise BadWeights(f"{source}: {name} is {shown(repr(value))}, expected {types[name][-1].__name__}")
    try:
        return ObservationConfig(**content)
    except (OverflowError, BadArgument) as error:
        raise BadWeights(f"{source}: {shown(error, 200)}") from error


def layer_shapes(
    path: Path,
    tensors: dict[str, np.ndarray],
    prefix: str,
    inputs: int,
    outputs: int,
    layers: int,
    stack: tuple[int, ...] = (),
) -> dict[str, tuple[int, ...]]:
    """Shapes that the tensors of a network must have, given the number of units of the hidden layers' biases.

    Raises:
        BadWeights: If a hidden layer's bias is missing or empty.
    """
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
