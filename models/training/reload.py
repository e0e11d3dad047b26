"""Brings a deployed file back to training.

A file in `models/` has no batch normalisation: it is folded into the weights. `load_onnx` puts
the weights into a network whose normalisations are neutral, which computes the same;
`measure_normalisation` then gives the normalisations the statistics of training data and leaves
what the network computes as it is.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import numpy_helper
from torch import Tensor, nn

NORMALISATIONS = nn.modules.batchnorm._BatchNorm
WRAPPER = "model."  # of a detector's names in its file
PILLAR_FEATURES = "pillar_features"
AUXILIARY = "segmentation."  # trained with, not deployed: stays as it is


def normalisation_after(model: nn.Module) -> dict[nn.Module, nn.Module]:
    """The normalisation that follows each layer that has one."""
    after = {}
    for module in model.modules():
        children = list(module.children())
        after |= {a: b for a, b in zip(children, children[1:]) if isinstance(b, NORMALISATIONS)}
    return after


def stored_weights(path: Path) -> dict[str, Tensor]:
    """The weights in a file by their names in the network; a detector's point features as
    `features.linear.weight` and `features.linear.bias`."""
    file = onnx.load(path)
    weights = {}
    for tensor in file.graph.initializer:
        value = torch.from_numpy(numpy_helper.to_array(tensor).astype(np.float32))
        name = tensor.name.removesuffix(".fp16").removeprefix(WRAPPER)
        if name == "features.shift":
            weights["features.linear.bias"] = value
        elif name.startswith("onnx::MatMul"):  # [9 and the padding's, channels]
            weights["features.linear.weight"] = value[:9].T
        else:
            weights[name] = value
    for entry in file.metadata_props:
        if entry.key == PILLAR_FEATURES:
            table = tomllib.loads(entry.value)
            weights["features.linear.weight"] = torch.tensor(table["weight"])
            weights["features.linear.bias"] = torch.tensor(table["shift"])
    return weights


@torch.no_grad()
def load_onnx(model: nn.Module, path: Path) -> None:
    """Puts a file's weights into a fresh network of its shape, with neutral normalisations, so that
    in evaluation mode it computes what the file does. A head that isn't deployed stays as it is.

    A filter before a normalisation keeps its fresh length, so that the optimiser's steps are what
    they would be in a new run; the normalisation makes up for it.
    """
    weights, after = stored_weights(path), normalisation_after(model)

    def taken(name: str, like: Tensor) -> Tensor:
        value = weights.pop(name, None)
        if value is None or value.shape != like.shape:
            raise SystemExit(f"{path} has no {name} of shape {list(like.shape)}; it is of another network")
        return value

    for name, layer in model.named_modules():
        plain = isinstance(getattr(layer, "weight", None), Tensor) and not isinstance(layer, NORMALISATIONS)
        if name.startswith(AUXILIARY) or not plain:
            continue
        weight, shift = layer.weight.clone(), layer.bias
        layer.weight.copy_(taken(f"{name}.weight", weight))
        if normalisation := after.get(layer):
            stretch = lengthen(layer, filters(layer, weight).norm(dim=1))
            normalisation.reset_running_stats()
            normalisation.weight.copy_((1 + normalisation.eps) ** 0.5 / stretch)
            shift = normalisation.bias
        shift.copy_(taken(f"{name}.bias", shift))
    if weights:
        raise SystemExit(f"{path} has {next(iter(weights))}, which the network lacks; it is of another network")


def filters(layer: nn.Module, weight: Tensor) -> Tensor:
    """A layer's weight, one row an output channel."""
    return (weight.transpose(0, 1) if isinstance(layer, nn.ConvTranspose2d) else weight).flatten(1)


def lengthen(layer: nn.Module, lengths: Tensor) -> Tensor:
    """Makes each filter so long, in place; by what factor. One that is as good as zero stays."""
    now = filters(layer, layer.weight).norm(dim=1)
    stretch = torch.where(now > 1e-3 * lengths, lengths / now, 1.0)
    rows = layer.weight.transpose(0, 1) if isinstance(layer, nn.ConvTranspose2d) else layer.weight
    rows *= stretch.view(-1, *[1] * (rows.dim() - 1))
    return stretch


@torch.no_grad()
def measure_normalisation(model: nn.Module, batches: Iterable, forward: Callable) -> None:
    """Gives all normalisations that `forward(model, batch)` runs through the statistics of
    `batches`, in evaluation mode; what the network computes stays the same."""
    sums: dict[nn.Module, Tensor] = {}

    def add(normalisation: nn.Module, inputs: tuple[Tensor]) -> None:
        values = inputs[0].double().transpose(0, 1).flatten(1)
        count = values.new_full((len(values),), values.shape[1])
        sums[normalisation] = sums.get(normalisation, 0) + torch.stack((count, values.sum(1), (values**2).sum(1)))

    training = model.training
    model.eval()
    found = [module for module in model.modules() if isinstance(module, NORMALISATIONS)]
    hooks = [normalisation.register_forward_pre_hook(add) for normalisation in found]
    for batch in batches:
        forward(model, batch)
    for hook in hooks:
        hook.remove()
    for normalisation, (count, total, squares) in sums.items():
        mean = total / count
        variance = (squares / count - mean**2).clamp(min=0)
        scale = normalisation.weight / (normalisation.running_var + normalisation.eps).sqrt()
        normalisation.bias += scale * (mean - normalisation.running_mean)
        normalisation.weight.copy_(scale * (variance + normalisation.eps).sqrt())
        normalisation.running_mean.copy_(mean)
        normalisation.running_var.copy_(variance)
    model.train(training)
