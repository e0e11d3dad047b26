"""Measures an exported network on held-out frames: `python evaluate.py NETWORK --data DIR --model FILE`.

The figures are those of the ONNX file itself, run by ONNX Runtime on what the sensors measured.
Ground truth enters the scoring alone. Vehicles with fewer than 5 LIDAR points neither count as
missed nor their detections as false.
"""

from __future__ import annotations

import argparse
import json
import math
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from tqdm import tqdm

import lanes
import pointpillars as pp
from data import MIN_POINTS, complete_frames, in_range, read_image, read_marks, read_objects, read_points
from deploy import canvas

PILLAR_FEATURES = "pillar_features"
SCORE_THRESHOLD = 0.4
NMS_IOU = 0.1
LANE_TOLERANCE_PX = 20
LANE_FOUND_FROM = 0.85
LANES_TOO_MANY = 2
DISTANCE_BINS_M = ((0, 20), (20, 40), (40, 70))
IOUS = (0.5, 0.7)


def open_model(path: Path, threads: int = 1) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    return onnxruntime.InferenceSession(path, options, ["CPUExecutionProvider"])


def anchors_of(detector: pp.Detector, model: Path) -> np.ndarray:
    """The anchors [K, 7] of a detector: its card's, or today's where it has no card yet."""
    anchors, card = pp.ANCHORS, model.with_suffix(".toml")
    if card.exists():
        entries = tomllib.loads(card.read_text())["anchors"]
        sizes = [(tuple(entry["size_m"]), entry["center_z_m"]) for entry in entries]
        anchors = tuple(replace(a, size_m=size, center_z_m=z) for a, (size, z) in zip(anchors, sizes))
    return pp.anchor_boxes(detector, anchors).reshape(-1, 7)


def evaluate_lanes(root: Path, model: Path, limit: int) -> dict[str, float]:
    """TuSimple's figures, of freeways and streets too, and those of single points."""
    session = open_model(model)
    found, truth, frames = [], [], complete_frames(root)[:limit]
    for frame in tqdm(frames, desc="lanes", mininterval=5):
        image = lanes.normalise(torch.from_numpy(read_image(root, frame))[None]).contiguous()
        (cells,) = session.run(None, {"image": image.numpy()})
        found.append(lanes.decode(torch.from_numpy(cells))[0].numpy())
        truth.append(read_marks(root, frame))
    freeway = np.array([is_freeway(root, frame) for frame in frames])
    u, v = np.stack(found), np.stack(truth)
    here, there = np.isfinite(u), np.isfinite(v)
    both = here & there
    error = np.abs(u - v)
    close = both & (error <= LANE_TOLERANCE_PX)
    own_error = error[both]
    return {
        **tusimple(u, v),
        "accuracy_tusimple_freeway_percent": tusimple(u[freeway], v[freeway])["accuracy_tusimple_percent"],
        "accuracy_tusimple_street_percent": tusimple(u[~freeway], v[~freeway])["accuracy_tusimple_percent"],
        "unpainted_frames_with_a_mark_percent": 100 * float((here.sum(1) >= 2).any(1)[~there.any((1, 2))].mean()),
        "anchors_right_percent": 100 * float((close | (~here & ~there)).mean()),
        "recall_20px_percent": 100 * float(close.sum() / there.sum()),
        "precision_20px_percent": 100 * float(close.sum() / max(here.sum(), 1)),
        "median_error_px": float(np.median(own_error)),
        "p95_error_px": float(np.percentile(own_error, 95)),
        "frames": len(u),
    }


def is_freeway(root: Path, frame: str) -> bool:
    """Whether both inner marks are painted; on the generator's streets at most one is."""
    marks = json.loads((root / "scenes" / f"{frame}.json").read_text())["marks_m"]
    return bool(marks[1] and marks[2])


def tusimple(found: np.ndarray, truth: np.ndarray) -> dict[str, float]:
    """TuSimple's figures of marks [N, 28, 4] in pixels (NaN absent), means over the frames that have marks.

    A point is right within 20 px across its mark, or absent in both. Each true mark counts its part
    of right rows with the best mark found, and is found at 85 %. Paper: right points of seen ones.
    """
    accuracies, ufld, false_positives, false_negatives, right, seen = [], [], [], [], 0, 0
    for us, vs in zip(found, truth):
        marks, best = present_marks(us), []
        for true_mark in present_marks(vs):
            there = np.isfinite(true_mark)
            slope = np.polyfit(lanes.ROW_ANCHORS_PX[there], true_mark[there], 1)[0]
            tolerance = LANE_TOLERANCE_PX * math.hypot(1, slope)
            hits = [np.abs(np.where(np.isfinite(m), m, -100) - np.where(there, true_mark, -100)) < tolerance for m in marks]
            best.append(max((h.mean() for h in hits), default=0))
            right += max((int((h & there).sum()) for h in hits), default=0)
            seen += int(there.sum())
        if not best:
            continue
        matched = sum(part >= LANE_FOUND_FROM for part in best)
        too_many = len(marks) > len(best) + LANES_TOO_MANY
        accuracies.append(np.mean(best))
        ufld.append(0 if too_many else np.mean(best))
        false_positives.append(0 if too_many or not marks else 1 - matched / len(marks))
        false_negatives.append(1 if too_many else 1 - matched / len(best))
    figures = {"accuracy_tusimple": accuracies, "accuracy_ufld": ufld}
    figures |= {"false_positive": false_positives, "false_negative": false_negatives}
    means = {f"{name}_percent": 100 * float(np.mean(values or [math.nan])) for name, values in figures.items()}
    return means | {"accuracy_paper_percent": 100 * right / max(seen, 1)}


def present_marks(marks: np.ndarray) -> list[np.ndarray]:
    """The marks [28] of [28, 4] that are seen at two row anchors or more."""
    return [mark for mark in marks.T if np.isfinite(mark).sum() >= 2]


def corners(box: np.ndarray) -> np.ndarray:
    """The footprint [4, 2] of a box, counter-clockwise."""
    c, s = math.cos(box[6]), math.sin(box[6])
    half = np.array(((1, 1), (-1, 1), (-1, -1), (1, -1))) * box[3:5] / 2
    return half @ np.array(((c, s), (-s, c))) + box[:2]


def area(polygon: np.ndarray) -> float:
    x, y = polygon.T
    return 0.5 * float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1)))


def bev_iou(a: np.ndarray, b: np.ndarray) -> float:
    """Overlap of two footprints over their union, by clipping one at the other's edges."""
    if np.hypot(*(a[:2] - b[:2])) > (np.hypot(*a[3:5]) + np.hypot(*b[3:5])) / 2:
        return 0.0
    polygon, clip = list(corners(a)), corners(b)
    for start, end in zip(clip, np.roll(clip, -1, axis=0)):
        edge = end - start
        side = [edge[0] * (p[1] - start[1]) - edge[1] * (p[0] - start[0]) for p in polygon]
        kept = []
        for i, p in enumerate(polygon):
            q, here, there = polygon[i - 1], side[i], side[i - 1]
            if (here >= 0) != (there >= 0):
                kept.append(q + (p - q) * there / (there - here))
            if here >= 0:
                kept.append(p)
        polygon = kept
        if len(polygon) < 3:
            return 0.0
    both = area(np.array(polygon))
    return both / (a[3] * a[4] + b[3] * b[4] - both)


@dataclass
class Frame:
    """Detections (best first) and ground truth of one frame."""

    boxes: np.ndarray
    classes: np.ndarray
    scores: np.ndarray
    truth: np.ndarray


def pillar_features(session: onnxruntime.InferenceSession) -> pp.FoldedPillarFeatures:
    """The part of an exported detector that comes before its graph."""
    return pp.FoldedPillarFeatures.from_toml(session.get_modelmeta().custom_metadata_map[PILLAR_FEATURES])


def detect(
    detector: pp.Detector, session: onnxruntime.InferenceSession, points: np.ndarray, anchors: np.ndarray
) -> Frame:
    """Boxes above a score of 0.05, after suppression of overlaps whatever their class."""
    image = canvas(points, detector, pillar_features(session))
    return boxes_of(*session.run(None, {"canvas": image.contiguous().numpy()}), anchors)


def boxes_of(logits: np.ndarray, deltas: np.ndarray, directions: np.ndarray, anchors: np.ndarray) -> Frame:
    """The boxes in the network's outputs."""
    deltas, directions = by_anchor(deltas, 7), by_anchor(directions, 2)
    logits = by_anchor(logits, 1)
    scores = 1 / (1 + np.exp(-logits.reshape(-1)))
    best = np.argsort(-scores)[:300]
    best = best[scores[best] > 0.05]
    boxes = pp.decode(deltas[best], directions[best], anchors[best])
    kept: list[int] = []
    for i, box in enumerate(boxes):
        if all(bev_iou(box, boxes[k]) <= NMS_IOU for k in kept):
            kept.append(i)
    chosen = best[kept]
    classes = chosen % pp.PER_CELL // len(pp.ANCHOR_YAWS)
    return Frame(boxes[kept], classes, scores[chosen], np.zeros((0, 9)))


def by_anchor(output: np.ndarray, numbers: int) -> np.ndarray:
    """An output [1, 4 * numbers, map y, map x] as [anchors, numbers], in the order of the anchors."""
    return output[0].reshape(pp.PER_CELL, numbers, -1).transpose(2, 0, 1).reshape(-1, numbers)


def match(frame: Frame, iou: float, detections: np.ndarray, truths: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """For the chosen detections, best first, the truth each takes (-1 none) and whether it counts."""
    taken: set[int] = set()
    matched = np.full(len(detections), -1)
    counts = np.ones(len(detections), bool)
    for d, i in enumerate(detections):
        overlaps = [(bev_iou(frame.boxes[i], frame.truth[t]), t) for t in truths if t not in taken]
        overlap, t = max(overlaps, default=(0.0, -1))
        if overlap >= iou:
            taken.add(t)
            matched[d] = t
            counts[d] = frame.truth[t, 8] >= MIN_POINTS
        else:
            counts[d] = all(bev_iou(frame.boxes[i], g) < 0.1 for g in frame.truth[frame.truth[:, 8] < MIN_POINTS])
    return matched, counts


def average_precision(frames: list[Frame], cls: int, iou: float) -> float:
    """AP over 40 recall samples, in percent."""
    scores, hits, total = [], [], 0
    for frame in frames:
        truths = np.flatnonzero(frame.truth[:, 7] == cls)
        total += int((frame.truth[truths, 8] >= MIN_POINTS).sum())
        detections = np.flatnonzero(frame.classes == cls)
        matched, counts = match(frame, iou, detections, truths)
        scores.extend(frame.scores[detections[counts]])
        hits.extend(matched[counts] >= 0)
    order = np.argsort(-np.array(scores))
    true_positives = np.cumsum(np.array(hits, float)[order])
    recall = true_positives / max(total, 1)
    precision = true_positives / (np.arange(len(order)) + 1)
    samples = [precision[recall >= r].max(initial=0) for r in np.linspace(1 / 40, 1, 40)]
    return 100 * float(np.mean(samples))


def evaluate_detector(detector: pp.Detector, root: Path, model: Path, limit: int) -> dict[str, float]:
    """AP by class and IoU; at the card's score threshold recall, precision and errors by distance."""
    session, anchors = open_model(model), anchors_of(detector, model)
    frames = []
    for name in tqdm(complete_frames(root)[:limit], desc=detector.id, mininterval=5):
        frame = detect(detector, session, read_points(root, name), anchors)
        objects = read_objects(root, name)
        frame.truth = objects[in_range(objects, detector)]
        frames.append(frame)
    metrics: dict[str, float] = {"frames": len(frames)}
    for cls, label in enumerate(pp.CLASSES):
        for iou in IOUS:
            metrics[f"ap_bev_{label}_iou{int(100 * iou)}"] = average_precision(frames, cls, iou)
    for low, high in DISTANCE_BINS_M:
        metrics |= operating_point(frames, low, high)
    metrics |= {k: v for k, v in operating_point(frames, 0, math.inf, "").items()}
    return metrics


def operating_point(frames: list[Frame], low: float, high: float, suffix: str | None = None) -> dict[str, float]:
    """Recall, precision (any class, IoU 0.5) and errors of the boxes at the score threshold."""
    hits = false = total = right_class = 0
    offsets, turns = [], []
    for frame in frames:
        distance = np.hypot(frame.truth[:, 0], frame.truth[:, 1])
        total += int(((distance >= low) & (distance < high) & (frame.truth[:, 8] >= MIN_POINTS)).sum())
        detections = np.flatnonzero(frame.scores >= SCORE_THRESHOLD)
        matched, counts = match(frame, 0.5, detections, np.arange(len(frame.truth)))
        for i, t, counted in zip(detections, matched, counts):
            box = frame.boxes[i]
            place = distance[t] if t >= 0 else np.hypot(box[0], box[1])
            if not (low <= place < high and counted):
                continue
            if t < 0:
                false += 1
                continue
            truth = frame.truth[t]
            hits += 1
            right_class += frame.classes[i] == truth[7]
            offsets.append(np.hypot(*(box[:2] - truth[:2])))
            turns.append(abs((box[6] - truth[6] + math.pi) % (2 * math.pi) - math.pi))
    suffix = f"_{low}_{high}m" if suffix is None else suffix
    return {
        f"recall{suffix}_percent": 100 * hits / max(total, 1),
        f"precision{suffix}_percent": 100 * hits / max(hits + false, 1),
        f"false_per_frame{suffix}": false / max(len(frames), 1),
        f"class_accuracy{suffix}_percent": 100 * float(right_class) / max(hits, 1),
        f"mean_center_error{suffix}_m": float(np.mean(offsets or [math.nan])),
        f"mean_yaw_error{suffix}_rad": float(np.mean(turns or [math.nan])),
        f"truths{suffix}": total,
    }


EVALUATE: dict[str, Callable[[Path, Path, int], dict[str, float]]] = {"lanes": evaluate_lanes}
for detector in pp.DETECTORS.values():
    EVALUATE[detector.id] = partial(evaluate_detector, detector)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=EVALUATE)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--model", type=Path, required=True)
    parser.add_argument("--frames", type=int, default=10**9, help="at most this many")
    args = parser.parse_args()
    torch.set_num_threads(1)
    metrics = EVALUATE[args.network](args.data, args.model, args.frames)
    print(json.dumps({k: round(v, 3) for k, v in metrics.items()}, indent=2))


if __name__ == "__main__":
    main()
