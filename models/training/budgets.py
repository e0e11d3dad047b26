"""How many filters each layer of a detector may keep: sensitivity scan and greedy allocation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import torch
from torch import Tensor, nn

import pointpillars as pp

SHARES = (0.125, 0.25, 0.5, 0.75)
UNIT = 16  # what vector units like
PILLAR_UNIT = 8
VALUE_IN_MACS = 100  # moving one value takes as long as so many multiply-accumulates
HEAD_CHANNELS = pp.PER_CELL * (1 + 7 + 2)


@dataclass(frozen=True)
class Place:
    """A layer among the others: what feeds it, on how many cells it works, how many of its
    inputs' cells one output reads."""

    name: str
    inputs: tuple[str, ...]
    cells: int
    taps: int


def places(detector: pp.Detector) -> list[Place]:
    """The layers in the order of the computation, the pillars' features and the heads among them."""
    cells = detector.grid[0] * detector.grid[1]
    found, before, ups = [Place("features", (), cells, 0)], "features", []
    output = cells // pp.STRIDE**2
    for i, block in enumerate(detector.widths.blocks):
        cells //= 4
        for j in range(len(block)):
            found.append(Place(f"blocks.{i}.{3 * j}", (before,), cells, 9))
            before = found[-1].name
        ups.append(Place(f"ups.{i}.0", (before,), output, 1))
    heads = Place("heads", tuple(up.name for up in ups), output, 1)
    return [*found, *ups, heads]


def widths_by_name(widths: pp.Widths) -> dict[str, int]:
    named = {"features": widths.pillar}
    named |= {f"blocks.{i}.{3 * j}": w for i, block in enumerate(widths.blocks) for j, w in enumerate(block)}
    return named | {f"ups.{i}.0": w for i, w in enumerate(widths.ups)}


def widths_from_names(named: dict[str, int], like: pp.Widths) -> pp.Widths:
    blocks = tuple(
        tuple(named[f"blocks.{i}.{3 * j}"] for j in range(len(block))) for i, block in enumerate(like.blocks)
    )
    return pp.Widths(named["features"], blocks, tuple(named[f"ups.{i}.0"] for i in range(len(like.ups))))


def cost(detector: pp.Detector, widths: dict[str, int]) -> tuple[float, float]:
    """Multiply-accumulates of a frame, and the same with the values that are written and read."""
    widths, macs, values = widths | {"heads": HEAD_CHANNELS}, 0, 0
    for place in places(detector):
        inputs = sum(widths[name] for name in place.inputs)
        macs += place.cells * place.taps * inputs * widths[place.name]
        values += place.cells * (widths[place.name] + (inputs if place.taps else 0))
    return macs, macs + VALUE_IN_MACS * values


def multiply_accumulates(detector: pp.Detector) -> float:
    return cost(detector, widths_by_name(detector.widths))[0]


@torch.no_grad()
def sensitivity(
    normalisations: dict[str, nn.Module], important: dict[str, Tensor], loss: Callable[[], float]
) -> dict[str, list[float]]:
    """The loss when one layer keeps only the most important `SHARES` of its filters, or all."""
    scan, whole = {}, loss()
    for name, bn in normalisations.items():
        order = important[name].argsort(descending=True)
        before = bn.weight.clone(), bn.bias.clone()
        losses = []
        for share in SHARES:
            gone = order[round(share * len(order)) :]
            bn.weight[gone] = bn.bias[gone] = 0
            losses.append(loss())
            bn.weight.copy_(before[0])
            bn.bias.copy_(before[1])
        scan[name] = [*losses, whole]
    return scan


def allocate(detector: pp.Detector, scan: dict[str, list[float]], target: float) -> pp.Widths:
    """Widths of a detector of at most `target` multiply-accumulates."""
    named = narrowed(widths_by_name(detector.widths), scan, partial(cost, detector), target)
    return widths_from_names(named, detector.widths)


def narrowed(
    full: dict[str, int],
    scan: dict[str, list[float]],
    cost: Callable[[dict[str, int]], tuple[float, float]],
    target: float,
) -> dict[str, int]:
    """Widths of at most `target` multiply-accumulates: what costs least loss for the time that it
    saves goes first, a unit of filters at a time."""
    curves = {name: np.maximum.accumulate(losses[::-1])[::-1] for name, losses in scan.items()}

    def lost(name: str, width: int) -> float:
        return float(np.interp(width / full[name], (0, *SHARES, 1), (2 * curves[name][0], *curves[name])))

    widths = dict(full)
    while cost(widths)[0] > target:
        now = cost(widths)[1]
        choices = []
        for name, width in widths.items():
            unit = PILLAR_UNIT if name == "features" else UNIT
            less = (width - 1) // unit * unit
            if less > 0:
                saved = now - cost(widths | {name: less})[1]
                choices.append(((lost(name, less) - lost(name, width) + 1e-6) / saved, name, less))
        if not choices:
            raise SystemExit(f"no network of {target / 1e9:.2f} GMAC has {UNIT} filters in each layer; ask for more")
        _, name, less = min(choices)
        widths[name] = less
    return widths


def shrunken(model: pp.PointPillars, detector: pp.Detector, kept: dict[str, Tensor]) -> pp.PointPillars:
    """The network without the filters that aren't `kept`: they and what listened to them are gone."""
    named = {name: len(index) for name, index in kept.items()}
    small = pp.PointPillars(replace(detector, widths=widths_from_names(named, detector.widths)))
    old, new = model.state_dict(), {}
    for place in places(detector)[:-1]:
        layer, bn = modules_of(place.name)
        weight = old[f"{layer}.weight"]
        outputs, inputs = (1, 0) if place.name.startswith("ups") else (0, 1)
        weight = weight.index_select(outputs, kept[place.name])
        for source in place.inputs:
            weight = weight.index_select(inputs, kept[source])
        new[f"{layer}.weight"] = weight
        for part in ("weight", "bias", "running_mean", "running_var"):
            new[f"{bn}.{part}"] = old[f"{bn}.{part}"][kept[place.name]]
        new[f"{bn}.num_batches_tracked"] = old[f"{bn}.num_batches_tracked"]
    starts = np.cumsum([0, *detector.widths.ups[:-1]])
    heard = torch.cat([kept[f"ups.{i}.0"] + int(start) for i, start in enumerate(starts)])
    for head in ("classes", "boxes", "directions"):
        new[f"{head}.weight"] = old[f"{head}.weight"].index_select(1, heard)
        new[f"{head}.bias"] = old[f"{head}.bias"]
    small.load_state_dict(new)
    return small


def modules_of(name: str) -> tuple[str, str]:
    """A layer's module and its normalisation's, by their names."""
    if name == "features":
        return "features.linear", "features.bn"
    parent, index = name.rsplit(".", 1)
    return name, f"{parent}.{int(index) + 1}"


def normalisations_of(model: pp.PointPillars) -> dict[str, nn.Module]:
    """The normalisation behind each layer, by the layer's name."""
    state = pp.widths_of(model.state_dict())
    return {name: model.get_submodule(modules_of(name)[1]) for name in widths_by_name(state)}
