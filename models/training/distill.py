"""Lessons: training samples together with what a trained detector, the teacher, says of them."""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torch.utils.data import Dataset

import pointpillars as pp
from data import DetectorDataset, Sample
from deploy import fold

SURE = 0.2
BOX_WEIGHTS = (1.0, 1.0, 9.0, 1.0, 1.0, 6.0, 1.0)  # height is what a small network loses first


class Teacher:
    """A trained detector that comments samples."""

    def __init__(self, model: pp.PointPillars) -> None:
        self.model = copy.deepcopy(model).eval()
        fold(self.model.blocks)
        fold(self.model.ups)

    @torch.no_grad()
    def comment(self, sample: Sample) -> Sample:
        """Every anchor's probability, and boxes and directions where the teacher is `SURE`."""
        inputs = (torch.from_numpy(sample[k]) for k in ("pillars", "coords", "numbers"))
        with torch.autocast("cpu", torch.bfloat16):
            outputs = self.model(*inputs, 1, tuple(sample["grid"].tolist()))
        logits, deltas, directions = (o[0].float() for o in outputs)
        soft = logits.sigmoid()
        sure = (soft.reshape(-1) > SURE).nonzero()[:, 0]
        return {
            "soft": soft.half().numpy(),
            "sure": sure.numpy(),
            "sure_delta": deltas.reshape(-1, 7)[sure].numpy(),
            "sure_direction": directions.reshape(-1, 2)[sure].numpy(),
        }


class Lessons(Dataset):
    """One augmented sample of each frame with the teacher's comment, made once and kept in a folder:
    all stages share them, and a small network's step costs less than the teacher's."""

    def __init__(self, dataset: DetectorDataset, teacher: Teacher, folder: Path) -> None:
        self.dataset, self.teacher, self.folder = dataset, teacher, folder
        folder.mkdir(parents=True, exist_ok=True)

    def __len__(self) -> int:
        return len(self.dataset)

    def look_again(self) -> None:
        """Finds the frames that were written since."""
        self.dataset.look_again()

    def __getitem__(self, item: tuple[int, int]) -> Sample:
        index, _ = item
        frame = self.dataset.frames[index]
        path = self.folder / f"{frame}.npz"
        if path.exists():
            with np.load(path) as stored:
                return dict(stored)
        sample = self.dataset[index, int(frame)]
        sample |= self.teacher.comment(sample)
        partial = path.with_suffix(".partial.npz")
        np.savez(partial, **sample)
        partial.replace(path)
        return sample

    @staticmethod
    def collate(samples: list[Sample]) -> dict[str, Tensor]:
        joined = DetectorDataset.collate(samples)
        anchors = samples[0]["labels"].size
        sure = [s["sure"] + i * anchors for i, s in enumerate(samples)]
        joined["sure"] = torch.from_numpy(np.concatenate(sure))
        joined["soft"] = torch.from_numpy(np.stack([s["soft"] for s in samples])).float()
        for key in ("sure_delta", "sure_direction"):
            joined[key] = torch.from_numpy(np.concatenate([s[key] for s in samples]))
        return joined


def loss(outputs: tuple[Tensor, ...], batch: dict[str, Tensor]) -> dict[str, Tensor]:
    """The labels' loss and the distance from the teacher: quality focal loss over all anchors,
    boxes and directions where the teacher is sure, weighted with how sure."""
    parts = pp.loss(outputs, batch, BOX_WEIGHTS)
    logits, deltas, directions = (o.float() for o in outputs)
    soft = batch["soft"]
    weight = soft.reshape(-1)[batch["sure"]]
    total = weight.sum().clamp(min=1)
    cross_entropy = F.binary_cross_entropy_with_logits(logits, soft, reduction="none")
    classes = ((logits.sigmoid() - soft) ** 2 * cross_entropy).sum() / total
    error = deltas.reshape(-1, 7)[batch["sure"]] - batch["sure_delta"]
    error = torch.cat((error[:, :6], error[:, 6:].sin()), 1)
    boxes = F.smooth_l1_loss(error, torch.zeros_like(error), reduction="none", beta=1 / 9)
    boxes = (boxes * boxes.new_tensor(BOX_WEIGHTS) * weight[:, None]).sum() / total
    said = batch["sure_direction"].softmax(1)
    direction = -(said * directions.reshape(-1, 2)[batch["sure"]].log_softmax(1)).sum(1)
    direction = (direction * weight).sum() / total
    imitation = {"teacher_classes": classes, "teacher_boxes": 2 * boxes, "teacher_direction": 0.2 * direction}
    return parts | imitation
