"""PointPillars detectors: settings, pillars, network, anchors, targets, loss, decoding.

Everything is in the LIDAR frame (x forward, y left, z up). A box is
[x, y, z, l, w, h, yaw] with its centre in metres; class 0 is a car, class 1 a truck.
"""

from __future__ import annotations

import functools
import math
import tomllib
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

PILLAR_M = 0.16
STRIDE = 2
MEAN_ROUNDER = 1.5 * 2.0 ** (52 - 36)  # rounds to 2^-36 m: sums of a pillar's points are exact
HASH_FACTORS = (0x9E3779B1, 0x85EBCA77, 0xC2B2AE3D, 0x27D4EB2F)
CLASSES = ("car", "truck")
BOX_WEIGHTS = (1.0, 1.0, 3.0, 1.0, 1.0, 2.0, 1.0)  # the overlap in 3D fails by height first


@dataclass(frozen=True)
class Widths:
    """Output channels of every layer but the heads."""

    pillar: int
    blocks: tuple[tuple[int, ...], ...]
    ups: tuple[int, ...]


@dataclass(frozen=True)
class Detector:
    """Range, pillars and channels: all in which two detectors differ."""

    id: str
    description: str
    range_m: tuple[float, float, float, float, float, float]
    max_pillars: int
    max_points: int
    widths: Widths

    @property
    def grid(self) -> tuple[int, int]:
        """Pillars along y and x."""
        (x0, y0, _, x1, y1, _) = self.range_m
        return round((y1 - y0) / PILLAR_M), round((x1 - x0) / PILLAR_M)

    @property
    def map(self) -> tuple[int, int]:
        """Cells of the network's output along y and x."""
        ny, nx = self.grid
        return ny // STRIDE, nx // STRIDE


def uniform(pillar: int, *blocks: int, up: int) -> Widths:
    """The published design: one width a block."""
    return Widths(pillar, tuple((width,) * count for width, count in zip(blocks, (4, 6, 6))), (up,) * len(blocks))


FREEWAY = Detector(
    "pointpillars",
    "PointPillars over a freeway range at half the usual channels: cars and trucks all around.",
    (-69.12, -12.8, -3.0, 69.12, 12.8, 1.0),
    max_pillars=20000, max_points=32, widths=uniform(32, 32, 64, 128, up=64),
)  # fmt: skip
KITTI = Detector(
    "pointpillars-kitti",
    "PointPillars of the published shape over KITTI's range: cars and trucks ahead.",
    (0.0, -39.68, -3.0, 69.12, 39.68, 1.0),
    max_pillars=12000, max_points=100, widths=uniform(64, 64, 128, 256, up=128),
)  # fmt: skip
DETECTORS = {detector.id: detector for detector in (FREEWAY, KITTI)}


@dataclass(frozen=True)
class AnchorClass:
    """The anchor of one class, laid at yaw 0 and pi/2 in every cell of the map."""

    size_m: tuple[float, float, float]
    center_z_m: float
    positive_iou: float
    negative_iou: float


ANCHORS = (
    AnchorClass((4.1, 1.7, 1.55), -0.95, 0.55, 0.40),
    AnchorClass((6.5, 2.2, 2.6), -0.45, 0.55, 0.40),
)
ANCHOR_YAWS = (0.0, math.pi / 2)
PER_CELL = len(ANCHORS) * len(ANCHOR_YAWS)


@dataclass(frozen=True)
class Pillars:
    """The points of all pillars: `points` [N, 9], `coords` [P] as iy * nx + ix, `numbers` [P]."""

    points: np.ndarray
    coords: np.ndarray
    numbers: np.ndarray


def scrambled(value: np.ndarray) -> np.ndarray:
    """Brings the upper bits of uint32 down to all others."""
    value = value ^ (value >> np.uint32(15))
    value = value * np.uint32(0x2C1B3C6D)
    return value ^ (value >> np.uint32(12))


def point_hashes(points: np.ndarray) -> np.ndarray:
    """A hash, uint32 [N], of the bits of points [N, 4], float32."""
    bits = np.ascontiguousarray(points, np.float32).view(np.uint32)
    x, y, z, reflectance = (bits * np.array(HASH_FACTORS, np.uint32)).T
    return scrambled(x ^ y ^ z ^ reflectance)


def voxelize(points: np.ndarray, detector: Detector) -> Pillars:
    """Points [N, 4] (x, y, z, reflectance) to pillars, in the order of the cells.

    The order of the points makes no difference. A pillar's points come in the order of a hash of
    their bits, at most `max_points`; of more than `max_pillars` those with the least hash of their
    cell stay. Rust gives the same bytes.
    """
    ny, nx = detector.grid
    low, high = np.array(detector.range_m[:3], np.float32), np.array(detector.range_m[3:], np.float32)
    points = points[np.all((points[:, :3] >= low) & (points[:, :3] < high), axis=1)]
    cell = ((points[:, :2] - low[:2]) / np.float32(PILLAR_M)).astype(np.int64)
    cell = np.minimum(cell, (nx - 1, ny - 1))
    key = cell[:, 1] * nx + cell[:, 0]
    place = key.astype(np.uint64) << np.uint64(32) | point_hashes(points)
    order = np.argsort(place)
    if np.any(np.diff(place[order]) == 0):  # as good as never
        bits = np.ascontiguousarray(points).view(np.uint32)
        order = np.lexsort((*bits.T[::-1], place))
    points, cell, key = points[order], cell[order], key[order]
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    counts = np.diff(starts, append=len(key))
    kept = np.arange(len(starts))
    if len(starts) > detector.max_pillars:
        cell_hashes = scrambled(key[starts].astype(np.uint32) * np.uint32(HASH_FACTORS[0]))
        kept = np.sort(np.argpartition(cell_hashes, detector.max_pillars)[: detector.max_pillars])
    pillar_of_start = np.full(len(starts), -1)
    pillar_of_start[kept] = np.arange(len(kept))
    rank = np.arange(len(key)) - np.repeat(starts, counts)
    pillar = np.repeat(pillar_of_start, counts)
    taken = (rank < detector.max_points) & (pillar >= 0)
    points, cell, pillar = points[taken], cell[taken], pillar[taken]

    numbers = np.minimum(counts[kept], detector.max_points)
    rounded = (points[:, :3].astype(np.float64) + MEAN_ROUNDER) - MEAN_ROUNDER
    sums = np.stack([np.bincount(pillar, rounded[:, i], len(kept)) for i in range(3)], 1)
    mean = (sums / numbers[:, None]).astype(np.float32)
    center = (cell.astype(np.float32) + np.float32(0.5)) * np.float32(PILLAR_M) + low[:2]
    offsets = (points[:, :3] - mean[pillar], points[:, :2] - center)
    return Pillars(np.concatenate((points, *offsets), 1), key[starts[kept]], numbers)


class PillarFeatures(nn.Module):
    """Points [N, 9] and their numbers [P] to features [P, channels]: each point through Linear, BN
    and ReLU, then the maximum over a pillar's points."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.linear = nn.Linear(9, channels, bias=False)
        self.bn = nn.BatchNorm1d(channels, eps=1e-3)

    def forward(self, points: Tensor, numbers: Tensor) -> Tensor:
        points = F.relu(self.bn(self.linear(points).float()))
        return torch.segment_reduce(points, "max", lengths=numbers)

    def folded(self) -> FoldedPillarFeatures:
        """The same for inference: BN is folded into the weights; shift and ReLU, which keep the
        order, follow the maximum."""
        scale = self.bn.weight * torch.rsqrt(self.bn.running_var + self.bn.eps)
        return FoldedPillarFeatures(self.linear.weight * scale[:, None], self.bn.bias - self.bn.running_mean * scale)


class FoldedPillarFeatures(nn.Module):
    """What [`PillarFeatures`] computes once it is trained: `weight` [channels, 9], `shift` [channels].

    An exported detector has them as TOML in its metadata; the 2D network begins at the canvas.
    """

    def __init__(self, weight: Tensor, shift: Tensor) -> None:
        super().__init__()
        self.weight, self.shift = nn.Parameter(weight), nn.Parameter(shift)

    def forward(self, points: Tensor, numbers: Tensor) -> Tensor:
        highest = torch.segment_reduce(F.linear(points, self.weight), "max", lengths=numbers)
        return F.relu(highest + self.shift)

    def to_toml(self) -> str:
        """The numbers in decimals that give every bit of them back."""
        return f"weight = {self.weight.tolist()}\nshift = {self.shift.tolist()}\n"

    @classmethod
    def from_toml(cls, text: str) -> FoldedPillarFeatures:
        table = tomllib.loads(text)
        return cls(torch.tensor(table["weight"]), torch.tensor(table["shift"]))


def scatter(features: Tensor, coords: Tensor, grid: tuple[int, int], batch: int = 1) -> Tensor:
    """Features [P, C] of pillars to the canvas [batch, C, ny, nx], 0 where there is no pillar."""
    ny, nx = grid
    canvas = features.new_zeros(batch * ny * nx, features.shape[1])
    canvas = canvas.index_put((coords,), features)
    return canvas.view(batch, ny, nx, -1).permute(0, 3, 1, 2)


def conv_block(inputs: int, widths: tuple[int, ...]) -> nn.Sequential:
    """3x3 convolutions of these widths, the first of stride 2, each with BN and ReLU."""
    parts: list[nn.Module] = []
    for i, (before, width) in enumerate(zip((inputs, *widths), widths)):
        conv = nn.Conv2d(before, width, 3, 2 if i == 0 else 1, 1, bias=False)
        parts += [conv, nn.BatchNorm2d(width, eps=1e-3), nn.ReLU()]
    return nn.Sequential(*parts)


def up_block(inputs: int, outputs: int, factor: int) -> nn.Sequential:
    """Upsampling by `factor` with a transposed convolution, BN and ReLU."""
    conv = nn.ConvTranspose2d(inputs, outputs, factor, factor, bias=False)
    return nn.Sequential(conv, nn.BatchNorm2d(outputs, eps=1e-3), nn.ReLU())


class PointPillars(nn.Module):
    """Points [N, 9] of pillars, their coords [P] and numbers [P] to class, box and direction maps
    [B, map y, map x, anchor, ...]."""

    def __init__(self, detector: Detector) -> None:
        super().__init__()
        widths = detector.widths
        lasts = [block[-1] for block in widths.blocks]
        self.grid = detector.grid
        self.features = PillarFeatures(widths.pillar)
        self.blocks = nn.ModuleList(map(conv_block, (widths.pillar, *lasts), widths.blocks))
        self.ups = nn.ModuleList(map(up_block, lasts, widths.ups, (1, 2, 4)))
        self.classes = nn.Conv2d(sum(widths.ups), PER_CELL, 1)
        self.boxes = nn.Conv2d(sum(widths.ups), PER_CELL * 7, 1)
        self.directions = nn.Conv2d(sum(widths.ups), PER_CELL * 2, 1)
        nn.init.constant_(self.classes.bias, -math.log((1 - 0.01) / 0.01))
        nn.init.normal_(self.boxes.weight, std=1e-3)

    def forward(
        self,
        points: Tensor,
        coords: Tensor,
        numbers: Tensor,
        batch: int = 1,
        grid: tuple[int, int] | None = None,
    ) -> tuple[Tensor, ...]:
        """`grid` is that of a window, where it isn't the detector's; `coords` of frame b in a batch
        are shifted by b times its cells."""
        canvas = scatter(self.features(points, numbers), coords, grid or self.grid, batch)
        classes, boxes, directions = (head.permute(0, 2, 3, 1) for head in self.maps(canvas))
        shape = classes.shape
        return classes, boxes.reshape(*shape, 7), directions.reshape(*shape, 2)

    def maps(self, canvas: Tensor) -> tuple[Tensor, ...]:
        """The canvas to maps of 4, 4 * 7 and 4 * 2 channels, channels first."""
        x = self.neck(canvas)
        return self.classes(x), self.boxes(x), self.directions(x)

    def neck(self, canvas: Tensor) -> Tensor:
        """The canvas to what the heads read."""
        x, maps = canvas, []
        for block, up in zip(self.blocks, self.ups):
            x = block(x)
            maps.append(up(x))
        return torch.cat(maps, 1)


def widths_of(weights: dict[str, Tensor]) -> Widths:
    """The widths of the network that these weights, of training, are of."""

    def layers(prefix: str, axis: int) -> tuple[int, ...]:
        return tuple(v.shape[axis] for k, v in weights.items() if k.startswith(prefix) and v.dim() == 4)

    blocks = tuple(layers(f"blocks.{i}.", 0) for i in range(3))
    return Widths(len(weights["features.linear.weight"]), blocks, layers("ups.", 1))


@torch.no_grad()
def widen(weights: dict[str, Tensor], model: PointPillars) -> dict[str, Tensor]:
    """The weights of a narrower network among those of `model`, which then computes the same.

    The channels that are new keep their random weights; what the old ones and the heads take from
    them begins at zero.
    """
    wide = model.state_dict()
    up, maps = model.ups[0][0].out_channels, len(model.ups)
    narrow_up = weights["classes.weight"].shape[1] // maps
    heard = torch.cat([torch.arange(narrow_up) + m * up for m in range(maps)])
    for name, value in wide.items():
        old = weights[name]
        if value.dim() < 2:  # a statistic, scale or bias of each channel, or the count of batches
            value.reshape(-1)[: old.numel()] = old.reshape(-1)
            continue
        if name.startswith("ups") and value.dim() == 4:  # transposed: [inputs, outputs, ...]
            value, old = value.transpose(0, 1), old.transpose(0, 1)
        inputs = heard if name.split(".")[0] in ("classes", "boxes", "directions") else torch.arange(old.shape[1])
        value[: len(old)] = 0
        value[: len(old), inputs] = old
    return wide


def cell_centers(detector: Detector) -> tuple[np.ndarray, np.ndarray]:
    """x and y of the map's cells, in metres."""
    step = PILLAR_M * STRIDE
    map_y, map_x = detector.map
    return (
        (detector.range_m[0] + (np.arange(map_x) + 0.5) * step).astype(np.float32),
        (detector.range_m[1] + (np.arange(map_y) + 0.5) * step).astype(np.float32),
    )


@functools.lru_cache(maxsize=4)
def anchor_boxes(detector: Detector, anchors: tuple[AnchorClass, ...] = ANCHORS) -> np.ndarray:
    """The anchors as boxes [map y, map x, 4, 7]: car at 0 and pi/2, truck at 0 and pi/2."""
    x, y = cell_centers(detector)
    boxes = np.zeros((len(y), len(x), PER_CELL, 7), np.float32)
    boxes[..., 0], boxes[..., 1] = x[None, :, None], y[:, None, None]
    for a in range(PER_CELL):
        anchor = anchors[a // len(ANCHOR_YAWS)]
        boxes[:, :, a, 2:] = (anchor.center_z_m, *anchor.size_m, ANCHOR_YAWS[a % len(ANCHOR_YAWS)])
    return boxes


def overlap(centers: np.ndarray, length: float, center: float, other: float) -> np.ndarray:
    """Overlap of intervals of `length` at `centers` with one of `other` at `center`."""
    high = np.minimum(centers + length / 2, center + other / 2)
    low = np.maximum(centers - length / 2, center - other / 2)
    return np.maximum(high - low, 0)


def assign_targets(
    boxes: np.ndarray, classes: np.ndarray, cared: np.ndarray, detector: Detector
) -> dict[str, np.ndarray]:
    """Anchors to ground truth [M, 7] by the IoU of their nearest axis-aligned footprints.

    Returns `labels` [map y, map x, 4] (1 object, 0 background, -1 ignored), and for the positive
    anchors, in order, their `anchor` index, `delta` [K, 7] and `direction` [K].
    """
    xs, ys = cell_centers(detector)
    labels = np.zeros((len(ys), len(xs), PER_CELL), np.int8)
    matched = np.full(labels.shape, -1)
    for c, anchor in enumerate(ANCHORS):
        slots = slice(2 * c, 2 * c + 2)
        best = np.zeros(labels[..., slots].shape, np.float32)
        ignored = np.zeros(best.shape, bool)
        forced: list[tuple[np.ndarray, int]] = []
        for i in np.flatnonzero(classes == c):
            x, y, _, length, width, _, yaw = boxes[i]
            if abs(math.sin(yaw)) > abs(math.cos(yaw)):
                length, width = width, length
            iou = np.empty(best.shape, np.float32)
            l, w, _ = anchor.size_m
            for k, (dx, dy) in enumerate(((l, w), (w, l))):
                both = overlap(ys, dy, y, width)[:, None] * overlap(xs, dx, x, length)[None]
                iou[..., k] = both / (l * w + length * width - both)
            if not cared[i]:
                ignored |= iou >= anchor.negative_iou
                continue
            better = iou > best
            best[better] = iou[better]
            matched[..., slots][better] = i
            if iou.max() > 0:
                forced.append((iou >= iou.max() - 1e-6, i))
        label = np.where(best >= anchor.positive_iou, 1, np.where(best >= anchor.negative_iou, -1, 0))
        label[ignored & (label == 0)] = -1
        for mask, i in forced:
            label[mask] = 1
            matched[..., slots][mask] = i
        labels[..., slots] = label
    positive = np.flatnonzero(labels.reshape(-1) == 1)
    truth = boxes[matched.reshape(-1)[positive]].reshape(-1, 7)
    delta = encode(truth, anchor_boxes(detector).reshape(-1, 7)[positive])
    direction = (np.cos(truth[:, 6]) < 0).astype(np.int64)
    return {"labels": labels, "anchor": positive, "delta": delta, "direction": direction}


def encode(boxes: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """Boxes [K, 7] as SECOND's deltas from anchors [K, 7]."""
    diagonal = np.hypot(anchors[:, 3:4], anchors[:, 4:5])
    center = boxes[:, :3] - anchors[:, :3]
    scale = np.concatenate((diagonal, diagonal, anchors[:, 5:6]), 1)
    size = np.log(boxes[:, 3:6] / anchors[:, 3:6])
    return np.concatenate((center / scale, size, boxes[:, 6:] - anchors[:, 6:]), 1).astype(np.float32)


def decode(deltas: np.ndarray, directions: np.ndarray, anchors: np.ndarray) -> np.ndarray:
    """Deltas [K, 7], direction logits [K, 2] and anchors [K, 7] to boxes [K, 7]."""
    diagonal = np.hypot(anchors[:, 3:4], anchors[:, 4:5])
    scale = np.concatenate((diagonal, diagonal, anchors[:, 5:6]), 1)
    center = anchors[:, :3] + deltas[:, :3] * scale
    size = anchors[:, 3:6] * np.exp(deltas[:, 3:6])
    yaw = (anchors[:, 6] + deltas[:, 6] + math.pi / 2) % math.pi - math.pi / 2
    yaw += math.pi * (directions[:, 1] > directions[:, 0])
    return np.concatenate((center, size, yaw[:, None]), 1)


def loss(
    outputs: tuple[Tensor, ...], batch: dict[str, Tensor], box_weights: tuple[float, ...] = BOX_WEIGHTS
) -> dict[str, Tensor]:
    """The parts of the loss, weighted: focal, smooth L1 with the sine of the yaw error, direction."""
    logits, deltas, directions = (o.float() for o in outputs)
    labels, anchor = batch["labels"], batch["anchor"]
    number = max(len(anchor), 1)
    target = (labels == 1).float()
    cross_entropy = F.binary_cross_entropy_with_logits(logits, target, reduction="none")
    p = logits.sigmoid()
    focal = torch.where(target > 0, 0.25 * (1 - p) ** 2, 0.75 * p**2)
    classes = (focal * cross_entropy * (labels >= 0)).sum() / number

    delta = deltas.reshape(-1, 7)[anchor]
    error = delta - batch["delta"]
    error = torch.cat((error[:, :6], error[:, 6:].sin()), 1)
    boxes = F.smooth_l1_loss(error, torch.zeros_like(error), reduction="none", beta=1 / 9)
    boxes = (boxes * boxes.new_tensor(box_weights)).sum() / number
    logits = directions.reshape(-1, 2)[anchor]
    direction = F.cross_entropy(logits, batch["direction"], reduction="sum") / number
    return {"classes": classes, "boxes": 2 * boxes, "direction": 0.2 * direction}
