"""Measures the networks on real samples: `python reality.py detector|lanes|sweeps --real DIR`.

    detector  the labelled KITTI sweep, label by label, and the boxes that match no label
    lanes     highway photographs against the marks in photographs.json, which we drew by eye
    sweeps    real and synthetic sweeps side by side, both cut to the camera's view

The samples are not ours to pass on: where they are absent, one line says so.

A photograph is brought to the network's view in two ways. `filled` scales it to the view's width;
`focal` scales it to the focal length of the training camera, with black beside it. Both put the
horizon at the training camera's. In photographs.json the horizon is where an image's straight
marks meet. The focal length f follows from the marks' spacing: lanes 3.66 m apart give the
camera's height h by the marks' slopes, and dashes 14.63 m apart at rows v1, v2 below the horizon
give f h = 14.63 / (1 / v2 - 1 / v1). That makes 1179 px of straight_lines1, whose calibrated
camera is known to have 1157.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image, ImageDraw

import evaluate as ev
import lanes
import pointpillars as pp
import sweeps
from data import CLASS_OF_TYPE, count_inside, read_calibration, to_lidar
from evaluate import LANE_TOLERANCE_PX, SCORE_THRESHOLD

HERE = Path(__file__).parent
FOCAL_PX, CENTER_PX = 721.5377, (609.5593, 172.854)
NEAR_M = 40
LANE_M, TOLERANCE_M = 3.66, 0.3
MARK_COLORS = ((230, 159, 0), (86, 180, 233), (0, 158, 115), (204, 121, 167))
VIEWS = ("filled", "focal")
NEEDED = {"detector": "kitti_000008.bin", "lanes": "highway_test1.jpg", "sweeps": "kitti_000008.bin"}


def detector(real: Path, model: Path, frame: str = "kitti_000008") -> dict[str, float]:
    """Every label's best detection above the score threshold, and the false boxes."""
    camera_from_lidar, projection = read_calibration(real / f"{frame}_calib.txt")
    points = np.fromfile(real / f"{frame}.bin", np.float32).reshape(-1, 4)
    network = pp.DETECTORS[model.stem]
    if network.range_m[0] >= 0:
        points = sweeps.in_view(points, camera_from_lidar, projection)
    found = ev.detect(network, ev.open_model(model), points, ev.anchors_of(network, model))
    keep = found.scores >= SCORE_THRESHOLD
    boxes, scores, classes = found.boxes[keep], found.scores[keep], found.classes[keep]
    lines = [line.split() for line in (real / f"{frame}_label.txt").read_text().splitlines()]
    labels = [words for words in lines if words[0] in CLASS_OF_TYPE]
    truth = [to_lidar(words, camera_from_lidar) for words in labels]
    overlaps = np.array([[ev.bev_iou(t, b) for b in boxes] for t in truth]).reshape(len(truth), len(boxes))
    print(f"{frame}: score >= {SCORE_THRESHOLD}")
    print("| label | distance m | truncated | occluded | points | size m | best IoU | found size m | called | score | at 0.5 | at 0.7 |")
    print("| " + "--- | " * 12)
    for words, box, row in zip(labels, truth, overlaps):
        best = int(row.argmax()) if len(boxes) else -1
        iou = row[best] if len(boxes) else 0.0
        match = "- | - | -"
        if iou > 0.1:
            match = f"{sizes(boxes[best])} | {pp.CLASSES[classes[best]]} | {scores[best]:.2f}"
        print(
            f"| {words[0]} | {np.hypot(*box[:2]):.1f} | {words[1]} | {words[2]} | {count_inside(points, box)}"
            f" | {sizes(box)} | {iou:.2f} | {match} | {'yes' if iou >= 0.5 else 'no'} | {'yes' if iou >= 0.7 else 'no'} |"
        )
    found_50 = (overlaps.max(1, initial=0) >= 0.5).sum()
    found_70 = (overlaps.max(1, initial=0) >= 0.7).sum()
    whole = np.array([float(words[1]) <= 0.5 for words in labels])
    near = np.hypot(boxes[:, 0], boxes[:, 1]) < NEAR_M
    ignored = [[float(v) for v in words[4:8]] for words in lines if words[0] == "DontCare"]
    seen = np.array([counts(b[:3], camera_from_lidar, projection, ignored) for b in boxes], bool)
    unmatched = near & seen & (overlaps.max(0, initial=0) < 0.5)
    print(f"boxes of no label (IoU < 0.5) in the camera's view within {NEAR_M} m:")
    for i in np.flatnonzero(unmatched):
        x, y, z = boxes[i, :3]
        touches = overlaps[:, i].max(initial=0)
        print(f"  {pp.CLASSES[classes[i]]} {scores[i]:.2f} at ({x:.1f}, {y:.1f}, {z:.1f}) {sizes(boxes[i])}, best IoU {touches:.2f}")
    return {
        "labels": len(labels),
        "found_iou50": int(found_50),
        "found_iou70": int(found_70),
        "labels_not_cut_off": int(whole.sum()),
        "found_not_cut_off_iou50": int((overlaps.max(1, initial=0)[whole] >= 0.5).sum()),
        "false_within_40m": int(unmatched.sum()),
    }


def sizes(box: np.ndarray) -> str:
    return "x".join(f"{v:.2f}" for v in box[3:6])


def counts(
    point: np.ndarray, camera_from_lidar: np.ndarray, projection: np.ndarray, ignored: list[list[float]]
) -> bool:
    """Whether a point in the LIDAR frame is in the image and in no region that nobody labelled."""
    u, v, depth = projection @ camera_from_lidar @ (*point, 1)
    u, v = u / depth, v / depth
    regions = [[0, 0, lanes.IMAGE_WIDTH_PX - 1, lanes.IMAGE_HEIGHT_PX - 1], *ignored]
    inside, *others = [left <= u <= right and top <= v <= bottom for left, top, right, bottom in regions]
    return bool(depth > 0 and inside and not any(others))


def view_of(entry: dict, view: str) -> tuple[float, float, float]:
    """Scale and offset in pixels that bring a photograph into the network's view."""
    width, _ = entry["size_px"]
    if view == "filled":
        scale = lanes.IMAGE_WIDTH_PX / width
        left = 0.0
    else:
        scale = FOCAL_PX / entry["focal_px"]
        left = CENTER_PX[0] - scale * width / 2
    return scale, left, CENTER_PX[1] - scale * entry["horizon_px"]


def bring(image: Image.Image, scale: float, left: float, top: float) -> Image.Image:
    """The photograph in the network's 1242x375 view, black where it doesn't reach."""
    size = (round(image.width * scale), round(image.height * scale))
    view = Image.new("RGB", (lanes.IMAGE_WIDTH_PX, lanes.IMAGE_HEIGHT_PX))
    view.paste(image.resize(size, Image.Resampling.BILINEAR), (round(left), round(top)))
    return view


def drawn_marks(entry: dict, scale: float, left: float, top: float) -> np.ndarray:
    """Our marks at the row anchors, [28, 4] in pixels of the view, NaN where absent."""
    us = np.full((lanes.ROWS, lanes.MARKS), np.nan)
    for m, polyline in enumerate(entry["marks"]):
        u, v = (np.array(sorted(polyline, key=lambda p: p[1])) * scale + (left, top)).T
        us[:, m] = np.interp(lanes.ROW_ANCHORS_PX, v, u, np.nan, np.nan)
    us[(us < 0) | (us >= lanes.IMAGE_WIDTH_PX)] = np.nan
    return us


def pixels_per_m(truth: np.ndarray) -> np.ndarray:
    """Pixels across the road per metre at each row anchor: lanes are 3.66 m apart on level ground."""
    below = np.maximum(lanes.ROW_ANCHORS_PX - CENTER_PX[1], 1)[:, None]
    spacing = np.diff(truth, axis=1)
    known = np.isfinite(spacing)
    slope = (spacing * below)[known].sum() / np.broadcast_to(below**2, known.shape)[known].sum()
    return slope * below[:, 0] / LANE_M


def photographs(real: Path, model: Path, out: Path) -> dict[str, float]:
    """The network's marks against ours, photograph by photograph and view by view."""
    session = ev.open_model(model)
    entries = json.loads((HERE / "photographs.json").read_text())
    metrics: dict[str, float] = {}
    print("| photograph | view | mark | anchors | within 20 px % | within 0.3 m % | median px | p95 px | missed | spurious |")
    print("| " + "--- | " * 10)
    for view in VIEWS:
        pictures, errors, errors_m, close, total = [], [], [], 0, 0
        for name, entry in entries.items():
            place = view_of(entry, view)
            image = bring(Image.open(real / f"{name}.jpg").convert("RGB"), *place)
            truth = drawn_marks(entry, *place)
            small = lanes.resize(torch.from_numpy(np.array(image)))[None]
            (cells,) = session.run(None, {"image": lanes.normalise(small).contiguous().numpy()})
            found = lanes.decode(torch.from_numpy(cells))[0].numpy()
            per_m = pixels_per_m(truth)
            for m in range(lanes.MARKS):
                there, here = np.isfinite(truth[:, m]), np.isfinite(found[:, m])
                error = np.abs(found[:, m] - truth[:, m])[there & here]
                error_m = error / per_m[there & here]
                within_m = int((error_m <= TOLERANCE_M).sum())
                within = int((error <= LANE_TOLERANCE_PX).sum())
                close, total = close + within, total + int(there.sum())
                errors.extend(error)
                errors_m.extend(error_m)
                middle, far = np.percentile(error, (50, 95)) if len(error) else (math.nan, math.nan)
                print(
                    f"| {name} | {view} | {m} | {there.sum()} | {100 * within / max(there.sum(), 1):.0f}"
                    f" | {100 * within_m / max(there.sum(), 1):.0f} | {middle:.1f}"
                    f" | {far:.1f} | {(there & ~here).sum()} | {(here & ~there).sum()} |"
                )
            pictures.append(overlay(image, truth, found))
        metrics[f"{view}_within_20px_percent"] = 100 * close / max(total, 1)
        metrics[f"{view}_within_30cm_percent"] = 100 * float((np.array(errors_m) <= TOLERANCE_M).sum()) / max(total, 1)
        metrics[f"{view}_median_m"] = float(np.median(errors_m or [math.nan]))
        metrics[f"{view}_p95_m"] = float(np.percentile(errors_m or [math.nan], 95))
        metrics[f"{view}_median_px"] = float(np.median(errors or [math.nan]))
        metrics[f"{view}_p95_px"] = float(np.percentile(errors or [math.nan], 95))
        Image.fromarray(np.concatenate(pictures)).save(out / f"reality-lanes-{view}.png")
    return metrics


def overlay(image: Image.Image, truth: np.ndarray, found: np.ndarray) -> np.ndarray:
    """Our marks as thin white lines, the network's as dots in the marks' colours."""
    draw = ImageDraw.Draw(image)
    for m, color in enumerate(MARK_COLORS):
        line = [(u, v) for u, v in zip(truth[:, m], lanes.ROW_ANCHORS_PX) if np.isfinite(u)]
        draw.line(line, fill=(255, 255, 255), width=1)
        for u, v in zip(found[:, m], lanes.ROW_ANCHORS_PX):
            if np.isfinite(u):
                draw.ellipse((u - 4, v - 4, u + 4, v + 4), fill=color, outline=(0, 0, 0))
    return np.array(image)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=NEEDED)
    parser.add_argument("--real", type=Path, required=True, help="folder of the real samples")
    parser.add_argument("--model", type=Path, help="an ONNX file, by default the committed one")
    parser.add_argument("--data", type=Path, default=Path("data/val"), help="synthetic frames (sweeps)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="folder of the pictures")
    args = parser.parse_args()
    torch.set_num_threads(1)
    needed = args.real / NEEDED[args.what]
    if not needed.exists():
        print(f"{needed}: no such sample; give the folder of the real samples with --real; skipped")
        return
    args.out.mkdir(parents=True, exist_ok=True)
    if args.what == "detector":
        metrics = detector(args.real, args.model or HERE.parent / "pointpillars.onnx")
    elif args.what == "lanes":
        metrics = photographs(args.real, args.model or HERE.parent / "ufld-resnet18.onnx", args.out)
    else:
        metrics = sweeps.compare(args.real, args.data, args.out / "reality-sweeps.png")
    print(json.dumps({k: round(v, 3) for k, v in metrics.items()}, indent=2))


if __name__ == "__main__":
    main()
