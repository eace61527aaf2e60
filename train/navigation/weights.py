"""Policies as files: safetensors as ``vuca_nav.policy`` reads them, and as the next stage starts from them."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors.numpy import save
from torch import Tensor, nn

from train.navigation.networks import Actor, ConvolutionalActor, ConvolutionalTrunk, FusedActor, NetworkConfig
from vuca_nav.errors import BadArgument
from vuca_nav.files import write_whole
from vuca_nav.policy.observation import ObservationConfig
from vuca_nav.policy.weights_file import FORMAT, PolicyWeights, load_weights


def export(
    path: Path, name: str, actor: Actor, critic: nn.Module, network: NetworkConfig,
    observation: ObservationConfig, decision_rate: float, notes: dict[str, str],
) -> None:  # fmt: skip
    """Write a policy; the file is there whole or not at all.

    Args:
        path: The ``.safetensors`` file.
        name: Name of the policy.
        actor: Its experts and its gate, or its convolutions and layers.
        critic: Values of the observation.
        network: Sizes of the networks.
        observation: The observation that it reads.
        decision_rate: Actions a second it was trained at [Hz].
        notes: Description of the training.
    """
    tensors = _tensors_of(actor, critic)
    tensors["mean"], tensors["scale"] = torch.zeros(observation.size), torch.ones(observation.size)
    arrays = {key: np.ascontiguousarray(tensor.detach().numpy(), np.float32) for key, tensor in tensors.items()}
    metadata = {
        "format": FORMAT, "name": name, "observation": json.dumps(asdict(observation)),
        "activation": network.activation, "decision_rate": str(decision_rate), **notes,
    }  # fmt: skip
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, sorted_header(save(arrays, metadata)))


def _tensors_of(actor: Actor, critic: nn.Module) -> dict[str, Tensor]:
    """The tensors of a weights file by name; those of a single network's layers have a dimension of 1 before theirs."""
    tensors: dict[str, Tensor] = {}
    if isinstance(actor, ConvolutionalActor):
        for prefix, trunk in (("", actor.trunk), ("critic_", critic)):
            assert isinstance(trunk, ConvolutionalTrunk)
            for name, layers in (("conv_", trunk.convolution_layers), ("", trunk.layers)):
                for k, layer in enumerate(layers):
                    assert layer.bias is not None
                    tensors[f"{prefix}{name}weight_{k}"], tensors[f"{prefix}{name}bias_{k}"] = layer.weight, layer.bias
        for k in range(len(actor.trunk.layers)):
            for name in (f"weight_{k}", f"bias_{k}"):
                tensors[name] = tensors[name][None]
        return tensors
    assert isinstance(actor, FusedActor)
    for k, layer in enumerate(actor.layers):
        tensors[f"weight_{k}"], tensors[f"bias_{k}"] = layer.weight, layer.bias
    for prefix, module in (("gate_", actor.gate_layers), ("critic_", critic)):
        linear = [] if module is None else [layer for layer in module.modules() if isinstance(layer, nn.Linear)]
        for k, layer in enumerate(linear):
            tensors[f"{prefix}weight_{k}"], tensors[f"{prefix}bias_{k}"] = layer.weight, layer.bias
    return tensors


def sorted_header(data: bytes) -> bytes:
    """Sort the metadata of safetensors, which it writes in any order: the same weights become the same bytes."""
    end = 8 + int.from_bytes(data[:8], "little")
    header = json.dumps(json.loads(data[8:end]), sort_keys=True, separators=(",", ":")).encode()
    header += b" " * (-len(header) % 8)
    return len(header).to_bytes(8, "little") + header + data[end:]


def start_from(
    actor: Actor, critic: nn.Module, sources: Sequence[PolicyWeights], noise: float, generator: torch.Generator
) -> None:
    """Let every expert start as a trained network, and the critic as the first one's.

    Args:
        actor: An actor with as many experts as there are sources, or one with convolutions.
        critic: A critic of the same sizes as the first source's.
        sources: Policies of one network, one for each expert.
        noise: Standard deviation of the noise added to copies, as a share of each matrix's own: without it they would
            stay twins.
        generator: Source of the noise.
    """
    if isinstance(actor, ConvolutionalActor):
        assert isinstance(critic, ConvolutionalTrunk)
        (source,) = sources
        layers = [(weight[0], bias[0]) for weight, bias in zip(source.weights, source.biases)]
        _fill(actor.trunk, (*source.convolutions, *layers))
        _fill(critic, (*source.critic_convolutions, *zip(source.critic_weights, source.critic_biases)))
        return
    assert isinstance(actor, FusedActor)
    seen: set[Path] = set()
    with torch.no_grad():
        for n, source in enumerate(sources):
            weights, biases = _plain(source, source.weights, source.biases)
            spread = noise if source.path in seen else 0.0
            seen.add(source.path)
            for layer, weight, bias in zip(actor.layers, weights, biases):
                layer.weight[n] = weight[0] + spread * weight.std() * torch.randn(weight[0].shape, generator=generator)
                layer.bias[n] = bias[0]
        linear = [layer for layer in critic.modules() if isinstance(layer, nn.Linear)]
        weights, biases = _plain(sources[0], sources[0].critic_weights, sources[0].critic_biases)
        for layer, weight, bias in zip(linear, weights, biases):
            layer.weight.copy_(weight)
            layer.bias.copy_(bias)


def _fill(trunk: ConvolutionalTrunk, arrays: Sequence[tuple[NDArray[np.float32], NDArray[np.float32]]]) -> None:
    """Copy weight and bias of each layer of a trunk."""
    with torch.no_grad():
        for layer, (weight, bias) in zip((*trunk.convolution_layers, *trunk.layers), arrays, strict=True):
            layer.weight.copy_(torch.from_numpy(weight))
            layer.bias.copy_(torch.from_numpy(bias))  # type: ignore[union-attr]


def find_sources(paths: Sequence[Path], network: NetworkConfig, observation: ObservationConfig) -> list[PolicyWeights]:
    """Find the policies that experts start as.

    Args:
        paths: A file for each expert.
        network: Sizes of the network that starts.
        observation: The observation that it will read.

    Raises:
        BadWeights: If a file is missing or broken.
        BadArgument: If a policy is of other sizes, reads another observation, or there is not one for each expert.
    """
    if len(paths) != network.experts:
        raise BadArgument(f"{len(paths)} policies to start from, but {network.experts} experts")
    sources = [load_weights(path) for path in paths]
    for source in sources:
        if source.observation != observation:
            raise BadArgument(f"{source.path} looks at {source.observation}, but this policy at {observation}")
        if source.convolutions:
            continue
        sizes = (source.experts, *(len(bias[0]) for bias in source.biases[:2]))
        critic = tuple(len(bias) for bias in source.critic_biases[:2])
        if sizes != (1, network.hidden, network.hidden) or critic != (network.critic, network.critic):
            raise BadArgument(
                f"{source.path} is {sizes[0]} x {sizes[1:]} with a critic of {critic}, expected 1 x "
                f"{(network.hidden,) * 2} and {(network.critic,) * 2}"
            )
    return sources


def actor_of(source: PolicyWeights) -> FusedActor:
    """Make a torch module of a shipped policy's actor, for batches.

    Raises:
        BadArgument: If it convolves frames.
    """
    if source.convolutions:
        raise BadArgument(f"{source.path.name} is a network of convolutions; one with a gate or a single expert goes")
    hidden, gate = source.biases[0].shape[1], len(source.gate_biases[0]) if source.gate_biases else 1
    network = NetworkConfig(experts=source.experts, hidden=hidden, gate=gate, activation=source.activation)  # type: ignore[arg-type]
    actor = FusedActor(source.observation.size, network, torch.Generator())
    with torch.no_grad():
        weights, biases = _plain(source, source.weights, source.biases)
        for layer, weight, bias in zip(actor.layers, weights, biases):
            layer.weight.copy_(weight)
            layer.bias.copy_(bias)
        if actor.gate_layers is not None:
            linear = [layer for layer in actor.gate_layers if isinstance(layer, nn.Linear)]
            weights, biases = _plain(source, source.gate_weights, source.gate_biases)
            for layer, weight, bias in zip(linear, weights, biases, strict=True):
                layer.weight.copy_(weight)
                layer.bias.copy_(bias)
    return actor


def _plain(
    source: PolicyWeights, weights: Sequence[NDArray[np.float32]], biases: Sequence[NDArray[np.float32]]
) -> tuple[list[Tensor], list[Tensor]]:
    """Layers of a network whose observations are neither shifted nor scaled."""
    first = weights[0] * source.scale
    bias = biases[0] - first @ source.mean
    return [torch.tensor(w) for w in (first, *weights[1:])], [torch.tensor(b) for b in (bias, *biases[1:])]
