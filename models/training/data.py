"""Reads the folders that `covista dataset` writes: KITTI objects and TuSimple lane marks.

    image_2/000000.png  velodyne/000000.bin  calib/000000.txt  label_2/000000.txt
    lanes/000000.json  scenes/000000.json, written last: a frame that has it is complete

A sample is a function of the folder, the frame and a seed, so that training repeats itself.
Types that no class trains on (pedestrians, DontCare) are passed over.
Decoded images and the boxes' point counts are kept in `cache/`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch import Tensor
from torch.utils.data import Dataset, Sampler

import augment
import lanes
import pointpillars as pp

CLASS_OF_TYPE = {"Car": 0, "Van": 1, "Truck": 1}
MIN_POINTS = 5
STRIP_M = 39.68
Sample = dict[str, np.ndarray]


def cached(path: Path, make: Callable[[], np.ndarray]) -> np.ndarray:
    """The array in `path`, made and stored there the first time."""
    if path.exists():
        return np.load(path)
    array = make()
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_suffix(".partial.npy")
    np.save(partial, array)
    partial.replace(path)
    return array


def read_image(root: Path, frame: str) -> np.ndarray:
    """The camera image resized to the lane network's input, uint8 [288, 800, 3]."""

    def make() -> np.ndarray:
        picture = Image.open(root / "image_2" / f"{frame}.png").convert("RGB")
        if picture.size != (lanes.IMAGE_WIDTH_PX, lanes.IMAGE_HEIGHT_PX):
            size = f"{lanes.IMAGE_WIDTH_PX}x{lanes.IMAGE_HEIGHT_PX}"
            raise SystemExit(f"{picture.width}x{picture.height} pixels in frame {frame} of {root}; the network takes {size}")
        image = np.array(picture)
        return lanes.resize(torch.from_numpy(image)).numpy()

    return cached(root / "cache" / f"{frame}.image.npy", make)


def complete_frames(root: Path) -> list[str]:
    """The frames of the folder, also while it is being written."""
    frames = sorted(path.stem for path in (root / "scenes").glob("*.json"))
    if not frames:
        raise SystemExit(f"{root} holds no finished frame; write some with `covista dataset --out {root} --frames 100`")
    return frames


def read_marks(root: Path, frame: str) -> np.ndarray:
    """Marks [28, 4] in pixels at the row anchors, left to right, NaN where absent."""
    label = json.loads((root / "lanes" / f"{frame}.json").read_text())
    rows = {v: i for i, v in enumerate(label["h_samples"])}
    at_anchors = [rows[v] for v in lanes.ROW_ANCHORS_PX.tolist()]
    us = np.array(label["lanes"], np.float32)[:, at_anchors].T
    inside = (us >= 0) & (us < lanes.IMAGE_WIDTH_PX)
    return np.where(inside, us, np.nan).astype(np.float32)


def read_points(root: Path, frame: str) -> np.ndarray:
    """The LIDAR points [N, 4]: x, y, z in metres and reflectance."""
    return np.fromfile(root / "velodyne" / f"{frame}.bin", np.float32).reshape(-1, 4)


def read_calibration(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """The transform from LIDAR to rectified camera [4, 4], and the projection P2 [3, 4]."""
    calib = {}
    for line in path.read_text().splitlines():
        name, _, values = line.partition(":")
        calib[name] = np.array(values.split(), float)
    camera_from_lidar, rectify = np.eye(4), np.eye(4)
    camera_from_lidar[:3] = calib["Tr_velo_to_cam"].reshape(3, 4)
    rectify[:3, :3] = calib["R0_rect"].reshape(3, 3)
    return rectify @ camera_from_lidar, calib["P2"].reshape(3, 4)


def to_lidar(words: list[str], camera_from_lidar: np.ndarray) -> np.ndarray:
    """The box [7] in the LIDAR frame of a line of label_2: x, y, z, l, w, h, yaw."""
    lidar_from_camera = np.linalg.inv(camera_from_lidar)
    height, width, length, x, y, z, rotation_y = (float(v) for v in words[8:15])
    center = lidar_from_camera @ (x, y - height / 2, z, 1)
    heading = lidar_from_camera[:3, :3] @ (math.cos(rotation_y), 0, -math.sin(rotation_y))
    yaw = math.atan2(heading[1], heading[0])
    return np.array((*center[:3], length, width, height, yaw))


def read_objects(root: Path, frame: str) -> np.ndarray:
    """The boxes [M, 9] in the LIDAR frame: x, y, z, l, w, h, yaw, class, LIDAR points inside."""

    def make() -> np.ndarray:
        camera_from_lidar, _ = read_calibration(root / "calib" / f"{frame}.txt")
        points = read_points(root, frame)
        objects = []
        for line in (root / "label_2" / f"{frame}.txt").read_text().splitlines():
            words = line.split()
            if words[0] in CLASS_OF_TYPE:
                box = to_lidar(words, camera_from_lidar)
                objects.append((*box, CLASS_OF_TYPE[words[0]], count_inside(points, box)))
        return np.array(objects, np.float32).reshape(-1, 9)

    return cached(root / "cache" / f"{frame}.objects.npy", make)


def count_inside(points: np.ndarray, box: np.ndarray, margin_m: float = 0.1) -> int:
    """Points in the box grown by the margin, without the ground below it."""
    near = points[(np.abs(points[:, 0] - box[0]) < box[3]) & (np.abs(points[:, 1] - box[1]) < box[3])]
    c, s = math.cos(box[6]), math.sin(box[6])
    offset = near[:, :3] - box[:3]
    local = np.stack((offset @ (c, s, 0), offset @ (-s, c, 0), offset[:, 2]), 1)
    inside = (np.abs(local) <= box[3:6] / 2 + margin_m).all(1)
    return int((inside & (local[:, 2] > 0.15 - box[5] / 2)).sum())


class LaneDataset(Dataset):
    """Images and marks; augmented when training, `elsewhere` of them as another camera sees them."""

    def __init__(self, root: Path, augmented: bool, elsewhere: float = 0.6) -> None:
        self.root, self.augmented, self.elsewhere = root, augmented, elsewhere
        self.frames = complete_frames(root)

    def __len__(self) -> int:
        return len(self.frames)

    def look_again(self) -> None:
        """Finds the frames that were written since."""
        self.frames = complete_frames(self.root)

    def __getitem__(self, item: tuple[int, int]) -> Sample:
        index, seed = item
        image, marks = read_image(self.root, self.frames[index]), read_marks(self.root, self.frames[index])
        if self.augmented:
            image, marks = augment.road(image, marks, np.random.default_rng(seed), self.elsewhere)
        return {
            "image": image,
            "marks": marks,
            "segmentation": lanes.segmentation_target(marks),
        }

    @staticmethod
    def collate(samples: list[Sample]) -> dict[str, Tensor]:
        return {k: torch.from_numpy(np.stack([s[k] for s in samples])) for k in samples[0]}


class DetectorDataset(Dataset):
    """Pillars and anchor targets; augmented, and of a window of the range, when training."""

    def __init__(self, root: Path, augmented: bool, detector: pp.Detector) -> None:
        self.root, self.augmented, self.detector = root, augmented, detector
        self.frames = complete_frames(root)

    def __len__(self) -> int:
        return len(self.frames)

    def look_again(self) -> None:
        """Finds the frames that were written since."""
        self.frames = complete_frames(self.root)

    def __getitem__(self, item: tuple[int, int]) -> Sample:
        index, seed = item
        frame, detector = self.frames[index], self.detector
        points, objects = read_points(self.root, frame), read_objects(self.root, frame)
        if self.augmented:
            rng = np.random.default_rng(seed)
            detector = window(detector, rng)
            points, objects = augment.scene(points, objects, detector.range_m, rng)
        objects = objects[in_range(objects, detector)]
        if self.augmented:  # points were lost
            objects[:, 8] = [count_inside(points, box) for box in objects[:, :7]]
        pillars = pp.voxelize(points, detector)
        cared = objects[:, 8] >= MIN_POINTS
        targets = pp.assign_targets(objects[:, :7], objects[:, 7].astype(int), cared, detector)
        return {
            "pillars": pillars.points,
            "coords": pillars.coords,
            "numbers": pillars.numbers,
            "grid": np.array(detector.grid),
            **targets,
        }

    @staticmethod
    def collate(samples: list[Sample]) -> dict[str, Tensor]:
        """One batch of samples whose grids are alike."""
        grid = samples[0]["grid"]
        joined = {
            "grid": [grid],
            "coords": [s["coords"] + i * grid.prod() for i, s in enumerate(samples)],
            "anchor": [s["anchor"] + i * s["labels"].size for i, s in enumerate(samples)],
            "labels": [s["labels"][None] for s in samples],
        }
        for key in ("pillars", "numbers", "delta", "direction"):
            joined[key] = [s[key] for s in samples]
        return {k: torch.from_numpy(np.concatenate(v)) for k, v in joined.items()}


def window(detector: pp.Detector, rng: np.random.Generator) -> pp.Detector:
    """The same detector over a strip of its range, up to 39.68 m wide: mostly about the middle."""
    x0, y0, z0, x1, y1, z1 = detector.range_m
    spare_m = max(y1 - y0 - STRIP_M, 0)
    low = y0 + (rng.triangular(0, spare_m / 2, spare_m) if spare_m else 0)
    high = low + min(y1 - y0, STRIP_M)
    return replace(detector, range_m=(x0, low, z0, x1, high, z1))


def in_range(boxes: np.ndarray, detector: pp.Detector) -> np.ndarray:
    """Whether the centre of each box [M, 7+] lies in the detector's range."""
    low, high = np.array(detector.range_m[:2]), np.array(detector.range_m[3:5])
    return ((boxes[:, :2] >= low) & (boxes[:, :2] < high)).all(1)


class Batches(Sampler[list[tuple[int, int]]]):
    """Endless batches of (index, seed): batch k depends on the seed, k and the data alone.

    Data that is still being written is looked at again every so often; a new epoch begins where it grew.
    """

    LOOK_AGAIN = 512  # samples

    def __init__(self, dataset: LaneDataset | DetectorDataset, batch: int, seed: int, first_step: int) -> None:
        self.dataset, self.batch, self.seed, self.first_step = dataset, batch, seed, first_step

    def __iter__(self) -> Iterator[list[tuple[int, int]]]:
        position = self.first_step * self.batch
        epoch, order = -1, np.zeros(0, int)
        while True:
            items = []
            for _ in range(self.batch):
                if position % self.LOOK_AGAIN == 0:
                    self.dataset.look_again()
                length = len(self.dataset)
                if position // length != epoch or length != len(order):
                    epoch = position // length
                    order = np.random.default_rng((self.seed, epoch)).permutation(length)
                items.append((int(order[position % length]), self.seed * 2**32 + position))
                position += 1
            yield items
