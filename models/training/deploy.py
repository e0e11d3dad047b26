"""Turns a trained network into what is deployed, and writes what PyTorch makes of a fixed input.

Batch normalisation is folded into the weights, which are then rounded to fp16: the file stores
exactly what PyTorch computed the reference with.
"""

from __future__ import annotations

import copy
import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

import lanes
import pointpillars as pp

SAMPLES = 400


@torch.no_grad()
def deployed(model: nn.Module) -> nn.Module:
    """A copy of a trained model, folded and rounded, for inference in fp32."""
    model = fold(copy.deepcopy(model).eval())
    for weight in model.parameters():
        if not torch.isfinite(weight.half()).all():
            raise ValueError("a weight does not fit in fp16")
        if weight.numel() > 1:
            weight.copy_(weight.half().float())
    return model.eval()


def fold(module: nn.Module) -> nn.Module:
    """Folds each normalisation into the convolution before it, in place."""
    before: tuple[str, nn.Module] | None = None
    for name, child in module.named_children():
        if isinstance(child, pp.PillarFeatures):
            setattr(module, name, child.folded())
        elif isinstance(child, nn.BatchNorm2d):
            convolution, transposed = before[1], isinstance(before[1], nn.ConvTranspose2d)
            setattr(module, before[0], fuse_conv_bn_eval(convolution, child, transposed))
            setattr(module, name, nn.Identity())
        else:
            fold(child)
        before = (name, child)
    return module


def road_picture() -> np.ndarray:
    """A picture, uint8 [375, 1242, 3], that needs no file: four lines to a vanishing point and
    grain. The tests in Rust draw the same."""
    v, u = np.mgrid[: lanes.IMAGE_HEIGHT_PX, : lanes.IMAGE_WIDTH_PX]
    below = v - 173
    grain = (u * 7919 + v * 104729) % 31
    gray = np.where(below > 0, 90, 170) + grain
    for side in (-9, -3, 3, 9):  # quarters of the rows below the horizon
        on_line = np.abs(4 * (u - 609) - side * below) * 16 <= 4 * below
        gray = np.where((below > 0) & on_line, 225, gray)
    return np.repeat(gray[..., None], 3, 2).astype(np.uint8)


@torch.no_grad()
def lane_reference(model: nn.Module) -> dict[str, object]:
    """Sampled logits and the decoded marks of [`road_picture`]."""
    small = lanes.resample(torch.from_numpy(road_picture()))
    cells = model(lanes.normalise(small[None]))
    marks = lanes.decode(cells)[0].T
    return {
        "cells": samples(cells),
        "marks_px": [[None if torch.isnan(u) else round(float(u), 4) for u in mark] for mark in marks],
    }


@torch.no_grad()
def canvas(points: np.ndarray, detector: pp.Detector, features: pp.FoldedPillarFeatures) -> Tensor:
    """What the exported detector takes, [1, C, ny, nx], of a sweep [N, 4]."""
    pillars = pp.voxelize(points, detector)
    described = features(torch.from_numpy(pillars.points), torch.from_numpy(pillars.numbers))
    return pp.scatter(described, torch.from_numpy(pillars.coords), detector.grid)


@torch.no_grad()
def detector_reference(detector: pp.Detector, model: nn.Module, sweep: Path) -> dict[str, object]:
    """Sampled outputs and the boxes, of a score of at least 0.3, of a sweep."""
    from evaluate import boxes_of  # which needs ONNX Runtime

    points = np.fromfile(sweep, np.float32).reshape(-1, 4)
    outputs = model.maps(canvas(points, detector, model.features))
    anchors = pp.anchor_boxes(detector).reshape(-1, 7)
    found = boxes_of(*(o.numpy() for o in outputs), anchors)
    sure = found.scores >= 0.3
    rows = np.column_stack((found.boxes, found.scores, found.classes))[sure]
    names = ("class_logits", "box_deltas", "direction_logits")
    return {
        "outputs": {name: samples(output) for name, output in zip(names, outputs)},
        "boxes": [[round(float(x), 5) for x in row] for row in rows],
    }


def samples(output: Tensor) -> dict[str, object]:
    """Values of the flattened output at its largest entries and at evenly spaced ones, and its
    standard deviation."""
    flat = output.reshape(-1)
    even = torch.linspace(0, len(flat) - 1, SAMPLES // 2).long()
    at = torch.cat((flat.topk(SAMPLES // 2).indices, even))
    return {"at": at.tolist(), "values": flat[at].tolist(), "deviation": float(flat.std())}


def write_reference(network: str, model: nn.Module, path: Path) -> None:
    """Writes what the tests in Rust compare with, from `sweep.bin` beside it for a detector."""
    if network == "lanes":
        reference = lane_reference(model)
    else:
        reference = detector_reference(pp.DETECTORS[network], model, path.with_name("sweep.bin"))
    path.write_text(json.dumps(reference))
