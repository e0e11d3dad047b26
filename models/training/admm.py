"""Pruning of filters as a problem of cardinality, solved by ADMM (Zhang et al., ECCV 2018).

    minimise f(W) so that of each layer l at most k_l filters are not zero

is split into W, which training moves, and Z, which obeys the constraint, bound by W = Z with the
scaled dual variable U. In turns

    W  a few steps of training on f(W) + rho/2 ||W - Z + U||^2,
    Z  the projection of W + U: the k_l largest filters of each layer stay, the others are zero,
    U  U + W - Z.

A filter that is normalised has no length of its own: its scale is that of the normalisation. So a
filter's W is that one number, measured in the metric of the loss: the scale times `weight`, such
that W^2 is the Fisher information in the whole filter (Molchanov et al., CVPR 2019).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import torch
from torch import Tensor, nn


def project(w: Tensor, keep: int) -> Tensor:
    """The nearest of the vectors that have at most `keep` entries that are not zero."""
    z = torch.zeros_like(w)
    largest = w.abs().topk(keep).indices
    z[largest] = w[largest]
    return z


def importance(
    normalisations: dict[str, nn.Module], losses: Iterable[Callable[[], Tensor]]
) -> dict[str, Tensor]:
    """Fisher information, square root, in the scale and shift of each filter.

    That is the mean over batches of the squared derivative of the loss by the filter's share of
    the output, which is as well the first-order change of the loss when the filter goes.
    """
    sums = {name: torch.zeros_like(bn.weight) for name, bn in normalisations.items()}
    count = 0
    for loss in losses:
        parameters = [p for bn in normalisations.values() for p in (bn.weight, bn.bias)]
        by = iter(torch.autograd.grad(loss(), parameters))
        for name, bn in normalisations.items():
            sums[name] += (bn.weight * next(by) + bn.bias * next(by)).detach() ** 2
        count += 1
    return {name: (total / max(count, 1)).sqrt() for name, total in sums.items()}


@dataclass
class Cardinality:
    """One layer's constraint: at most `keep` of the filters behind a normalisation."""

    normalisation: nn.Module
    keep: int
    weight: Tensor  # of a unit of scale, in the metric of the loss
    z: Tensor = field(init=False)
    u: Tensor = field(init=False)

    def __post_init__(self) -> None:
        self.u = torch.zeros_like(self.w)
        self.z = project(self.w, self.keep)

    @property
    def w(self) -> Tensor:
        return self.weight * self.normalisation.weight.detach()

    @property
    def kept(self) -> Tensor:
        """Indices of the filters that Z keeps."""
        return self.z.nonzero()[:, 0]


class Admm:
    """The three updates, over all layers."""

    def __init__(self, normalisations: dict[str, nn.Module], important: dict[str, Tensor], keep: dict[str, int]) -> None:
        self.layers = {}
        for name, bn in normalisations.items():
            scale = bn.weight.detach().abs().clamp(min=1e-6)
            weight = (important[name] / scale).clamp(min=1e-6 * float((important[name] / scale).max()))
            self.layers[name] = Cardinality(bn, keep[name], weight)

    @torch.no_grad()
    def pull(self, rho: float) -> None:
        """The quadratic term's part of the W-step, after an optimiser's step on f: taken implicitly,
        as decoupled weight decay is, since an optimiser that normalises its steps would not feel
        rho. The shift of a filter that is to go follows its scale."""
        for layer in self.layers.values():
            scale, shift = layer.normalisation.weight, layer.normalisation.bias
            scale.add_(rho * (layer.z - layer.u) / layer.weight).div_(1 + rho)
            shift[layer.z == 0] /= 1 + rho

    @torch.no_grad()
    def update(self) -> None:
        """The Z-step and the U-step."""
        for layer in self.layers.values():
            layer.z = project(layer.w + layer.u, layer.keep)
            layer.u += layer.w - layer.z

    def residual(self) -> float:
        """How far W is from the constraint: ||W - Z|| over ||W||, Z the nearest."""
        off = sum(float(((layer.w - project(layer.w, layer.keep)) ** 2).sum()) for layer in self.layers.values())
        return (off / sum(float((layer.w**2).sum()) for layer in self.layers.values())) ** 0.5

    def kept(self) -> dict[str, Tensor]:
        return {name: layer.kept for name, layer in self.layers.items()}
