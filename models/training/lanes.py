"""UFLD lane network: a row-anchor classifier on a half-width ResNet-18, and its loss.

The 1242x375 image is resized to 800x288. For each of the road's four marks and each of 28 image
rows the network picks one of 100 cells across the image, or "none". Cell i covers
[i, i + 1) * 12.42 px, so that a mark's position is (E[i] + 0.5) * 12.42 px.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

IMAGE_WIDTH_PX, IMAGE_HEIGHT_PX = 1242, 375
INPUT_WIDTH_PX, INPUT_HEIGHT_PX = 800, 288
ROW_ANCHORS_PX = np.arange(100, 371, 10)
ROWS = len(ROW_ANCHORS_PX)
CELLS = 100
NONE = CELLS
MARKS = 4
CELL_PX = IMAGE_WIDTH_PX / CELLS
MEAN = (0.485, 0.456, 0.406)
STD = (0.229, 0.224, 0.225)
WIDTHS, HIDDEN = (32, 64, 128, 256), 512
PAPER_WIDTHS, PAPER_HIDDEN = (64, 128, 256, 512), 2048  # 38 M parameters, for timing
BELL_CELLS = 0.8
WINDOW_CELLS = 4
SEEN_FROM = 0.4


def resample(image: Tensor) -> Tensor:
    """uint8 [H, W, 3] to float [288, 800, 3]: bilinear, pixel centres aligned, no antialias."""
    chw = image.permute(2, 0, 1)[None].float()
    small = F.interpolate(chw, (INPUT_HEIGHT_PX, INPUT_WIDTH_PX), mode="bilinear")
    return small[0].permute(1, 2, 0)


def resize(image: Tensor) -> Tensor:
    """The same to bytes, which training keeps in its cache; Rust doesn't round."""
    return resample(image).round().to(torch.uint8)


def normalise(images: Tensor) -> Tensor:
    """uint8 [B, 288, 800, 3] to float32 [B, 3, 288, 800], channels last in memory."""
    width = images.shape[2]  # whole rows at once, which is several times faster than three values
    scale = 1 / (255 * torch.tensor(STD * width, device=images.device))
    mean = 255 * torch.tensor(MEAN * width, device=images.device)
    rows = (images.flatten(2) - mean) * scale
    return rows.view(images.shape).permute(0, 3, 1, 2)


class BasicBlock(nn.Module):
    """Two 3x3 convolutions, `inner` channels between them, and the identity (or its 1x1 projection)."""

    def __init__(self, inputs: int, inner: int, outputs: int, stride: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, inner, 3, stride, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(inner)
        self.conv2 = nn.Conv2d(inner, outputs, 3, 1, 1, bias=False)
        self.bn2 = nn.BatchNorm2d(outputs)
        self.shortcut = nn.Identity()
        if stride != 1 or inputs != outputs:
            self.shortcut = nn.Sequential(
                nn.Conv2d(inputs, outputs, 1, stride, bias=False), nn.BatchNorm2d(outputs)
            )

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.bn1(self.conv1(x)))
        return F.relu(self.bn2(self.conv2(y)) + self.shortcut(x))


class Ufld(nn.Module):
    """Image [B, 3, 288, 800] to logits [B, 101, 28, 4]; in training also segmentation logits (if
    `auxiliary`) and the classifier's input.

    `inner` are the widths inside the blocks of a pruned network, two blocks a stage; those between
    the blocks are bound together by the identities.
    """

    def __init__(
        self, widths: tuple[int, ...] = WIDTHS, hidden: int = HIDDEN, inner: tuple[int, ...] | None = None
    ) -> None:
        super().__init__()
        inner = inner or tuple(width for width in widths for _ in range(2))
        first = widths[0]
        self.stem = nn.Sequential(
            nn.Conv2d(3, first, 7, 2, 3, bias=False),
            nn.BatchNorm2d(first),
            nn.ReLU(),
            nn.MaxPool2d(3, 2, 1),
        )
        self.layers = nn.ModuleList()
        inputs = first
        for i, width in enumerate(widths):
            stride = 1 if i == 0 else 2
            self.layers.append(
                nn.Sequential(
                    BasicBlock(inputs, inner[2 * i], width, stride),
                    BasicBlock(width, inner[2 * i + 1], width, 1),
                )
            )
            inputs = width
        self.pool = nn.Conv2d(widths[-1], 8, 1)
        features = 8 * (INPUT_HEIGHT_PX // 32) * (INPUT_WIDTH_PX // 32)
        self.classifier = nn.Sequential(
            nn.Linear(features, hidden),
            nn.ReLU(),
            nn.Linear(hidden, (CELLS + 1) * ROWS * MARKS),
        )
        self.segmentation = SegmentationHead(widths)
        self.auxiliary = True
        self.frozen: list[nn.Module] = []
        self.frozen_stages = 0
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, nonlinearity="relu")

    def forward(self, image: Tensor) -> Tensor | tuple[Tensor, Tensor, Tensor]:
        x, stages = self.low(image), []
        for layer in self.layers[self.frozen_stages :]:
            x = layer(x)
            stages.append(x)
        # Flattened from a channels-first tensor whatever the memory format, as ONNX does.
        flat = self.pool(x).contiguous().flatten(1)
        cells = self.classify(flat)
        if self.training:
            return cells, self.segmentation(stages[-3:]) if self.auxiliary else None, flat
        return cells

    def low(self, image: Tensor) -> Tensor:
        """The stem; where it is frozen, with the stages that are, two images at a time, which caches can hold."""
        if not self.frozen:
            return self.stem(image)
        with torch.no_grad():
            return torch.cat([self.frozen[0](part.bfloat16()) for part in image.split(2)])

    def classify(self, flat: Tensor) -> Tensor:
        return self.classifier(flat).view(-1, CELLS + 1, ROWS, MARKS)


class SegmentationHead(nn.Module):
    """Auxiliary head, used in training only: which mark covers each pixel at stride 8."""

    def __init__(self, widths: tuple[int, ...], width: int = 32) -> None:
        super().__init__()
        self.reduce = nn.ModuleList(nn.Conv2d(w, width, 1) for w in widths[1:])
        self.fuse = nn.Sequential(
            nn.Conv2d(3 * width, width, 3, padding=1, bias=False),
            nn.BatchNorm2d(width),
            nn.ReLU(),
            nn.Conv2d(width, MARKS + 1, 1),
        )

    def forward(self, stages: list[Tensor]) -> Tensor:
        size = stages[0].shape[-2:]
        maps = [F.interpolate(r(s), size, mode="nearest") for r, s in zip(self.reduce, stages)]
        return self.fuse(torch.cat(maps, 1))


def expected_cell(cells: Tensor) -> Tensor:
    """Logits [B, 101, 28, 4] to the expected cell index [B, 28, 4], over the 100 real cells."""
    index = torch.arange(CELLS, device=cells.device, dtype=cells.dtype).view(1, -1, 1, 1)
    return (cells[:, :CELLS].softmax(1) * index).sum(1)


def decode(cells: Tensor) -> Tensor:
    """Logits [B, 101, 28, 4] to u in pixels [B, 28, 4], NaN where the mark is absent.

    A mark exists if in its surest row its cells together are likelier than "none". It is seen where
    it is at least `SEEN_FROM` times as likely as there: in doubt whether a mark exists at all its rows
    are in doubt together. Its place is the expectation over the cells about the likeliest one.
    """
    places = cells[:, :CELLS]
    likely = (places.logsumexp(1) - cells[:, NONE]).sigmoid()
    surest = likely.amax(1, keepdim=True)
    seen = (surest > 0.5) & (likely > SEEN_FROM * surest)
    index = torch.arange(CELLS, device=cells.device).view(1, -1, 1, 1)
    beside = (index - places.argmax(1, keepdim=True)).abs() > WINDOW_CELLS
    probability = places.masked_fill(beside, -torch.inf).softmax(1)
    pixels = ((probability * index).sum(1) + 0.5) * CELL_PX
    return pixels.masked_fill(~seen, torch.nan)


def segmentation_target(marks_px: np.ndarray) -> np.ndarray:
    """Marks [28, 4] in pixels (NaN absent) to the class of each pixel at stride 8, [36, 100]."""
    height, width = INPUT_HEIGHT_PX // 8, INPUT_WIDTH_PX // 8
    rows_px = (np.arange(height) + 0.5) * IMAGE_HEIGHT_PX / height
    target = np.zeros((height, width), np.int64)
    columns = np.arange(width)
    for mark in range(MARKS):
        seen = np.isfinite(marks_px[:, mark])
        if seen.sum() < 2:
            continue
        anchors, us = ROW_ANCHORS_PX[seen], marks_px[seen, mark]
        inside = (rows_px >= anchors[0]) & (rows_px <= anchors[-1])
        column = np.interp(rows_px, anchors, us) * width / IMAGE_WIDTH_PX - 0.5
        near = (np.abs(columns[None] - column[:, None]) <= 1.0) & inside[:, None]
        target[near] = mark + 1
    return target


def loss(outputs: tuple[Tensor, Tensor | None, Tensor], batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """The parts of the loss, weighted: the classifier's and the segmentation head's, if it is run."""
    cells, segmentation, _ = outputs
    if segmentation is None:
        return mark_loss(cells.float(), batch["marks"])
    weights = torch.tensor([0.4] + [1.0] * MARKS, device=cells.device)
    aux = F.cross_entropy(segmentation.float(), batch["segmentation"], weights)
    return mark_loss(cells.float(), batch["marks"]) | {"segmentation": 3 * aux}


def mark_loss(cells: Tensor, marks: Tensor) -> dict[str, Tensor]:
    """The parts for logits [B, 101, 28, 4] and marks [B, 28, 4] in pixels, NaN where absent.

    The cross entropy of the 101 classes is that of "none" and, where a mark is seen, that of its
    cells; their target is a narrow bell about the mark, so that neighbours learn together and the
    expectation is the mark's position.
    """
    position = marks / CELL_PX - 0.5
    seen = torch.isfinite(position)
    some = cells[:, :CELLS].logsumexp(1)
    presence = F.binary_cross_entropy_with_logits(some - cells[:, NONE], seen.float())

    # From here on the marks that are seen: [N, 100] and [N].
    log_p = (cells[:, :CELLS] - some[:, None]).permute(0, 2, 3, 1)[seen]
    index = torch.arange(CELLS, device=cells.device, dtype=cells.dtype)
    bell = torch.softmax(-0.5 * ((index - position[seen][:, None]) / BELL_CELLS) ** 2, 1)
    place = -(bell * log_p).sum(1).mean() if seen.any() else presence * 0

    expected = expected_cell(cells)
    position = torch.where(seen, position, expected.detach())
    expectation = F.smooth_l1_loss(expected[seen], position[seen]) if seen.any() else presence * 0
    bend_error = second_difference(expected) - second_difference(position)
    triple = seen[:, :-2] & seen[:, 1:-1] & seen[:, 2:]
    shape = bend_error[triple].abs().mean() if triple.any() else presence * 0
    similarity = (cells[:, :, 1:] - cells[:, :, :-1]).abs().mean()
    return {
        "presence": 4 * presence,
        "place": place,
        "expectation": 0.3 * expectation,
        "shape": 0.2 * shape,
        "similarity": 0.05 * similarity,
    }


def inner_of(weights: dict[str, Tensor]) -> tuple[int, ...]:
    """The widths inside the blocks of a network with these weights."""
    names = (f"layers.{i}.{j}.conv1.weight" for i in range(len(WIDTHS)) for j in range(2))
    return tuple(len(weights[name]) for name in names)


def freeze_low(model: Ufld, average: Ufld, stages: int = 1) -> None:
    """Gives the stem and the first stages their average weights for good; with one stage that is two
    thirds of the work."""
    from deploy import fold  # which imports this module

    model.stem.load_state_dict(average.stem.state_dict())
    model.layers[:stages].load_state_dict(average.layers[:stages].state_dict())
    low = nn.Sequential(model.stem, *model.layers[:stages]).requires_grad_(False).eval()
    low = fold(copy.deepcopy(low)).bfloat16().to(memory_format=torch.channels_last)
    model.frozen, model.frozen_stages = [low], stages  # in a list, so that it is no part of the state


class Rehearsal:
    """The classifier's latest inputs and their marks.

    A step of the classifier alone costs a hundredth of one of the whole network for each sample,
    and most of the weights are its: it learns from every sample several times more.
    """

    SAMPLES, BATCH, ROUNDS = 4096, 64, 1

    def __init__(self) -> None:
        self.inputs: list[Tensor] = []
        self.marks: list[Tensor] = []

    def add(self, flat: Tensor, marks: Tensor) -> None:
        self.inputs = [*self.inputs, *flat.detach().bfloat16()][-self.SAMPLES :]
        self.marks = [*self.marks, *marks][-self.SAMPLES :]

    def losses(self, model: Ufld, seed: int) -> Iterator[Tensor]:
        """The loss of each round, on samples drawn from the latest."""
        rng = np.random.default_rng(seed)
        enough = len(self.marks) >= self.SAMPLES // 8
        for _ in range(self.ROUNDS if enough else 0):
            drawn = rng.integers(0, len(self.marks), self.BATCH)
            flat = torch.stack([self.inputs[i] for i in drawn])
            with torch.autocast(flat.device.type, torch.bfloat16):
                cells = model.classify(flat)
            yield sum(mark_loss(cells.float(), torch.stack([self.marks[i] for i in drawn])).values())


def imitation(cells: Tensor, taught: Tensor) -> Tensor:
    """How far the 101 probabilities of logits [B, 101, 28, 4] are from the teacher's: cross entropy
    less its least."""
    return F.kl_div(cells.log_softmax(1), taught.log_softmax(1), log_target=True, reduction="none").sum(1).mean()


def second_difference(x: Tensor) -> Tensor:
    """[B, 28, 4] to [B, 26, 4], along the row anchors."""
    return x[:, 2:] - 2 * x[:, 1:-1] + x[:, :-2]
