"""Takes the constant error out of a detector's boxes: `python calibrate.py ID --data DIR`.

Trained on augmented sweeps, a detector can lay its boxes too low or make them too small on sweeps as
they are. On unaugmented frames of the training split the medians of what its sure boxes lack in
height above the ground and in size are added to the biases of the head, and the card says so.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import re
from pathlib import Path

import numpy as np
import onnx
from onnx import numpy_helper
from tqdm import tqdm

import pointpillars as pp
from data import MIN_POINTS, complete_frames, in_range, read_objects, read_points
from evaluate import SCORE_THRESHOLD, anchors_of, bev_iou, detect, open_model

LEAST_IOU = 0.5
LEAST_BOXES = 100
Z, SIZE = 2, slice(3, 6)


def shortfalls(network: str, model: Path, data: Path, count: int) -> list[np.ndarray]:
    """For each class what sure boxes lack, as SECOND's deltas of z, l, w, h: [boxes, 4]."""
    detector, session = pp.DETECTORS[network], open_model(model)
    anchors, lacks = anchors_of(detector, model), [[] for _ in pp.CLASSES]
    frames = complete_frames(data)
    for frame in tqdm(frames[:: max(len(frames) // count, 1)][:count], desc="calibration", mininterval=5):
        found = detect(detector, session, read_points(data, frame), anchors)
        objects = read_objects(data, frame)
        objects = objects[in_range(objects, detector) & (objects[:, 8] >= MIN_POINTS)]
        for box, kind in zip(found.boxes[found.scores >= SCORE_THRESHOLD], found.classes[found.scores >= SCORE_THRESHOLD]):
            same = objects[objects[:, 7] == kind]
            overlaps = [bev_iou(box, truth[:7]) for truth in same]
            if max(overlaps, default=0) > LEAST_IOU:
                truth = same[int(np.argmax(overlaps))]
                dz = (truth[Z] - box[Z]) / pp.ANCHORS[int(kind)].size_m[2]
                lacks[int(kind)].append((dz, *np.log(truth[SIZE] / box[SIZE])))
    return [np.array(rows).reshape(-1, 4) for rows in lacks]


def correct(path: Path, lacks: list[np.ndarray]) -> list[list[float]]:
    """Adds the medians to the biases in the file; classes with too few boxes stay as they are."""
    model = onnx.load(path)
    tensor = next(t for t in model.graph.initializer if re.search(r"boxes\.bias", t.name))
    bias = numpy_helper.to_array(tensor).reshape(len(pp.CLASSES), len(pp.ANCHOR_YAWS), 7).copy()
    medians = [np.median(rows, 0) if len(rows) >= LEAST_BOXES else np.zeros(4) for rows in lacks]
    for of_class, median in zip(bias, medians):
        of_class[:, [Z, 3, 4, 5]] += median.astype(bias.dtype)
    tensor.CopyFrom(numpy_helper.from_array(bias.reshape(-1), tensor.name))
    onnx.save(model, path)
    return [[round(float(x), 4) for x in median] for median in medians]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("id", help="of an exported detector")
    parser.add_argument("--models", type=Path, default=Path(".."))
    parser.add_argument("--data", type=Path, required=True, help="folder of the training split")
    parser.add_argument("--frames", type=int, default=150)
    args = parser.parse_args()
    path, card = args.models / f"{args.id}.onnx", args.models / f"{args.id}.toml"
    network = next(name for name in sorted(pp.DETECTORS, key=len, reverse=True) if args.id.startswith(name))
    medians = correct(path, shortfalls(network, path, args.data, args.frames))
    text = re.sub(r'sha256 = "\w+"', f'sha256 = "{hashlib.sha256(path.read_bytes()).hexdigest()}"', card.read_text(), count=1)
    said = json.dumps(f"python calibrate.py {args.id} --data data/train --frames {args.frames}")
    text = text.replace("[training]\n", f"[training]\ncalibrated = {said}\nadded_z_l_w_h = {json.dumps(medians)}\n", 1)
    card.write_text(text)
    print(f"{args.id}: added to the deltas of z, l, w, h: {medians}")


if __name__ == "__main__":
    main()
