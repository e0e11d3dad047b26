"""The other side of `covista bench perception --against`: the same networks from Python.

covista starts it as `python3 peer.py onnxruntime-python|pytorch`, writes one JSON object a line to
its standard input and reads one from its output for each:

    {"do": "hello"} -> {"versions": ...}
    {"do": "open", "card": FILE, "folder": DIR, "threads": N} -> {}; networks are counted from 0
    {"do": "time", "network": K, "stage": "network" | "end_to_end", "frames": [...], "warm_up": W}
        -> {"seconds": [...], "found": boxes or places of marks in all}, both without the first W

An answer {"error": "..."} ends the run. DIR holds, without headers: `I.sweep` and `I.ahead`, points
[N, 4] float32; `I.rgb`, the picture [height, width, 3] uint8; and for each network what covista
feeds to it: `ID-I.image` float32, or the occupied cells of a canvas, `ID-I.cells` [P] uint32, and
their features, `ID-I.values` [P, C] float32.

`network` is the network alone on these inputs, through I/O binding where there is such a thing.
`end_to_end` is the way from points or picture to boxes or marks as Python pipelines go it: pillars
padded to their full number of points, as in OpenPCDet, and everything but the network in NumPy.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
import tomllib
from pathlib import Path
from typing import Callable

import numpy as np

WINDOW_CELLS, SEEN_FROM = 4, 0.4
MAX_CANDIDATES, MAX_BOXES, MAX_LOG_SIZE = 1000, 100, 1.0


class Card:
    """A model card, and shapes that follow from it."""

    def __init__(self, path: Path) -> None:
        card = tomllib.loads(path.read_text())
        self.id, self.file = card["id"], path.parent / card["file"]
        self.is_detector = card["kind"] == "pointpillars"
        self.preprocess, self.anchors = card["preprocess"], card.get("anchors", [])
        self.input_name, self.input_shape = card["inputs"][0]["name"], card["inputs"][0]["shape"]
        self.outputs = [(tensor["name"], tensor["shape"]) for tensor in card["outputs"]]


# The network: a function from the input array to the arrays of its outputs.


def open_onnxruntime(card: Card, threads: int) -> tuple[np.ndarray, Callable[[], list], dict]:
    """The network's input, which is to be written to, what runs it, and the file's metadata."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    # As covista has it; the rest, arena and memory pattern included, are ONNX Runtime's defaults.
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    session = onnxruntime.InferenceSession(str(card.file), options, providers=["CPUExecutionProvider"])
    image = np.zeros(card.input_shape, np.float32)
    outputs = [np.zeros(shape, np.float32) for _, shape in card.outputs]
    binding = session.io_binding()
    binding.bind_input(card.input_name, "cpu", 0, np.float32, image.shape, image.ctypes.data)
    for (name, shape), array in zip(card.outputs, outputs):
        binding.bind_output(name, "cpu", 0, np.float32, shape, array.ctypes.data)

    def run() -> list:
        session.run_with_iobinding(binding)
        return outputs

    return image, run, session.get_modelmeta().custom_metadata_map


def open_pytorch(card: Card, threads: int) -> tuple[np.ndarray, Callable[[], list], dict]:
    """The same with PyTorch: the ONNX file's operators one after the other, in eager mode."""
    import onnx
    import torch
    from onnx import helper, numpy_helper

    torch.set_num_threads(threads)
    model = onnx.load(card.file)
    image = np.zeros(card.input_shape, np.float32)
    values = {t.name: torch.from_numpy(numpy_helper.to_array(t).copy()) for t in model.graph.initializer}
    known, steps = set(values), []
    for node in model.graph.node:
        attributes = {a.name: helper.get_attribute_value(a) for a in node.attribute}
        step = torch_operator(node.op_type, attributes)
        if known.issuperset(node.input):  # of constants alone: once, here
            known.update(node.output)
            values.update(zip(node.output, step(*(values[name] for name in node.input))))
        else:
            steps.append((list(node.input), list(node.output), step))

    def run() -> list:
        with torch.inference_mode():
            values[card.input_name] = torch.from_numpy(image)
            for inputs, outputs, step in steps:
                values.update(zip(outputs, step(*(values[name] for name in inputs))))
            return [values[name].numpy() for name, _ in card.outputs]

    return image, run, {p.key: p.value for p in model.metadata_props}


def torch_operator(op: str, a: dict) -> Callable[..., tuple]:
    """An operator of ONNX with its attributes, as a function from tensors to a tuple of tensors."""
    import torch
    from onnx import numpy_helper
    from torch.nn import functional as F

    pads, strides = a.get("pads", [0, 0, 0, 0]), a.get("strides", [1, 1])
    if pads[:2] != pads[2:]:
        raise ValueError(f"this peer does not rebuild the padding {pads}")
    how = {"stride": strides, "padding": pads[:2]}
    operators = {
        "Constant": lambda: (torch.from_numpy(numpy_helper.to_array(a["value"]).copy()),),
        "Cast": lambda x: (x.float(),),
        "Identity": lambda x: (x,),
        "Relu": lambda x: (torch.relu(x),),
        "Add": lambda x, y: (x + y,),
        "Conv": lambda x, w, b=None: (F.conv2d(x, w, b, groups=a.get("group", 1), **how),),
        "ConvTranspose": lambda x, w, b=None: (F.conv_transpose2d(x, w, b, **how),),
        "MaxPool": lambda x: (F.max_pool2d(x, a["kernel_shape"], strides, pads[:2]),),
        "Flatten": lambda x: (torch.flatten(x, a.get("axis", 1)),),
        "Gemm": lambda x, w, b=None: (F.linear(x, w if a.get("transB") else w.T, b),),
        "Reshape": lambda x, shape: (x.reshape(shape.tolist()),),
        "Concat": lambda *x: (torch.cat(x, a["axis"]),),
        "Split": lambda x, sizes: x.split(sizes.tolist(), a.get("axis", 0)),
    }
    if op not in operators:
        raise ValueError(f"this peer does not rebuild the operator {op}")
    return operators[op]


# What surrounds the detector.


def pillars(points: np.ndarray, spec: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points [N, 4] to pillars [P, max_points, 9], zero padded, how many points each has, and its
    cell, iy * nx + ix: the first points and pillars of the sweep stay."""
    low, high = np.float32(spec["range_m"][:3]), np.float32(spec["range_m"][3:])
    side, most = np.float32(spec["pillar_m"]), spec["max_points_per_pillar"]
    nx, ny = (round(float((high[i] - low[i]) / side)) for i in range(2))
    points = points[np.all((points[:, :3] >= low) & (points[:, :3] < high), axis=1)]
    cell = np.minimum(((points[:, :2] - low[:2]) / side).astype(np.int64), (nx - 1, ny - 1))
    key = cell[:, 1] * nx + cell[:, 0]
    order = np.argsort(key, kind="stable")
    points, key = points[order], key[order]
    starts = np.flatnonzero(np.diff(key, prepend=-1))
    counts = np.diff(starts, append=len(key))
    rank = np.arange(len(key)) - np.repeat(starts, counts)
    pillar = np.repeat(np.arange(len(starts)), counts)
    taken = (rank < most) & (pillar < spec["max_pillars"])
    points, rank, pillar = points[taken], rank[taken], pillar[taken]
    cells, counts = key[starts][: spec["max_pillars"]], np.minimum(counts, most)[: spec["max_pillars"]]
    padded = np.zeros((len(cells), most, 9), np.float32)
    padded[pillar, rank, :4] = points
    mean = padded[..., :3].sum(1) / counts[:, None]
    center = (np.stack((cells % nx, cells // nx), 1) + 0.5) * side + low[:2]
    padded[..., 4:7] = padded[..., :3] - mean[:, None]
    padded[..., 7:9] = padded[..., :2] - center[:, None].astype(np.float32)
    padded *= (np.arange(most) < counts[:, None])[..., None]
    return padded, counts, cells


def pillar_features(padded: np.ndarray, counts: np.ndarray, weight: np.ndarray, shift: np.ndarray) -> np.ndarray:
    """[P, C]: the largest of each pillar's points, padding left out."""
    linear = padded @ weight.T + shift
    linear[np.arange(padded.shape[1]) >= counts[:, None]] = 0
    return np.maximum(linear, 0).max(1)


def boxes(maps: list[np.ndarray], card: Card) -> np.ndarray:
    """Boxes [K, 8]: x, y, z, length, width, height, yaw, score; the surest first."""
    spec = card.preprocess
    scores, deltas, directions = (m[0] for m in maps)
    anchors, rows, columns = scores.shape
    threshold = spec["score_threshold"]
    logit = np.log(threshold / (1 - threshold))
    anchor, row, column = np.nonzero(scores >= logit)
    best = np.argsort(-scores[anchor, row, column])[:MAX_CANDIDATES]
    anchor, row, column = anchor[best], row[best], column[best]
    delta = deltas.reshape(anchors, 7, rows, columns)[anchor, :, row, column].astype(np.float64)
    turned = directions.reshape(anchors, 2, rows, columns)[anchor, :, row, column]
    size = np.array([a["size_m"] for a in card.anchors])[anchor // 2]
    height = np.array([a["center_z_m"] for a in card.anchors])[anchor // 2]
    step = 2 * spec["pillar_m"]
    diagonal = np.hypot(size[:, 0], size[:, 1])
    x = spec["range_m"][0] + (column + 0.5) * step + delta[:, 0] * diagonal
    y = spec["range_m"][1] + (row + 0.5) * step + delta[:, 1] * diagonal
    z = height + delta[:, 2] * size[:, 2]
    size = size * np.exp(np.clip(delta[:, 3:6], -MAX_LOG_SIZE, MAX_LOG_SIZE))
    yaw = (anchor % 2) * np.pi / 2 + delta[:, 6]
    yaw = (yaw + np.pi / 2) % np.pi - np.pi / 2 + np.pi * (turned[:, 1] > turned[:, 0])
    score = 1 / (1 + np.exp(-scores[anchor, row, column].astype(np.float64)))
    found = np.column_stack((x, y, z, size, yaw, score))
    return found[np.isfinite(found).all(1)]


def footprint(box: np.ndarray) -> np.ndarray:
    """Corners [4, 2] of a box seen from above, counter-clockwise."""
    along = np.array((np.cos(box[6]), np.sin(box[6]))) * box[3] / 2
    across = np.array((-np.sin(box[6]), np.cos(box[6]))) * box[4] / 2
    return box[:2] + np.array((along + across, across - along, -along - across, along - across))


def shared_m2(polygon: np.ndarray, clip: np.ndarray) -> float:
    """Area shared by two convex polygons: Sutherland-Hodgman."""
    for start, end in zip(clip, np.roll(clip, -1, 0)):
        if len(polygon) == 0:
            return 0.0
        side = end - start
        depth = side[0] * (polygon[:, 1] - start[1]) - side[1] * (polygon[:, 0] - start[0])
        kept = []
        for here, there, point, following in zip(depth, np.roll(depth, -1), polygon, np.roll(polygon, -1, 0)):
            if here >= 0:
                kept.append(point)
            if here * there < 0:
                kept.append(point + (following - point) * here / (here - there))
        polygon = np.array(kept)
    if len(polygon) == 0:
        return 0.0
    (x, y), (u, v) = polygon.T, np.roll(polygon, -1, 0).T
    return max(float((x * v - u * y).sum()) / 2, 0.0)


def suppressed(found: np.ndarray, most: float) -> np.ndarray:
    """Without boxes whose footprints overlap a better one's by more than `most`."""
    reach = np.hypot(found[:, 3], found[:, 4]) / 2
    kept: list[int] = []
    for i in range(len(found)):
        near = [k for k in kept if np.hypot(*(found[i, :2] - found[k, :2])) < reach[i] + reach[k]]
        area = found[i, 3] * found[i, 4]
        for k in near:
            both = shared_m2(footprint(found[i]), footprint(found[k]))
            if both > most * (area + found[k, 3] * found[k, 4] - both):
                break
        else:
            kept.append(i)
    return found[kept[:MAX_BOXES]]


# What surrounds the lane network.


def resized(picture: np.ndarray, shape: list[int], spec: dict) -> np.ndarray:
    """[3, height, width]: bilinear, pixel centres aligned, normalised."""

    def taps(source: int, target: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        at = np.maximum((np.arange(target) + 0.5) * source / target - 0.5, 0)
        low = np.minimum(at.astype(np.int64), source - 1)
        return low, np.minimum(low + 1, source - 1), (at - low).astype(np.float32)

    low, high, weight = taps(picture.shape[0], shape[2])
    rows = picture[low] + weight[:, None, None] * (picture[high].astype(np.float32) - picture[low])
    low, high, weight = taps(picture.shape[1], shape[3])
    image = rows[:, low] + weight[:, None] * (rows[:, high] - rows[:, low])
    image = (image / 255 - np.float32(spec["mean"])) / np.float32(spec["std"])
    return np.ascontiguousarray(image.transpose(2, 0, 1))


def marks(logits: np.ndarray, spec: dict) -> np.ndarray:
    """u in pixels [rows, marks], NaN where a mark is not seen."""
    logits, cells = logits[0].astype(np.float64), spec["grid_cells"]
    weight = np.exp(logits - logits[:cells].max(0))
    likely = weight[:cells].sum(0) / weight.sum(0)
    surest = likely.max(0)
    seen = (surest > 0.5) & (likely > SEEN_FROM * surest)
    index = np.arange(cells)[:, None, None]
    window = np.abs(index - logits[:cells].argmax(0)) <= WINDOW_CELLS
    near = weight[:cells] * window
    place = ((near * index).sum(0) / near.sum(0) + 0.5) * spec["image_width_px"] / cells
    return np.where(seen, place, np.nan)


class Network:
    """A network and the frames that it is timed on."""

    def __init__(self, card: Card, opened: tuple, folder: Path) -> None:
        self.card, self.folder = card, folder
        self.input, self.run, metadata = opened
        if card.is_detector and "pillar_features" in metadata:
            table = tomllib.loads(metadata["pillar_features"])
            self.weight, self.shift = np.float32(table["weight"]), np.float32(table["shift"])

    def read(self, name: str, dtype: str) -> np.ndarray:
        return np.fromfile(self.folder / name, dtype)

    def scatter(self, cells: np.ndarray, values: np.ndarray) -> None:
        self.input.fill(0)
        self.input.reshape(self.input.shape[1], -1)[:, cells] = values.T

    def time_network(self, frame: int) -> tuple[float, int]:
        prefix = f"{self.card.id}-{frame}"
        if self.card.is_detector:
            cells = self.read(f"{prefix}.cells", "<u4")
            self.scatter(cells, self.read(f"{prefix}.values", "<f4").reshape(len(cells), -1))
        else:
            self.input[...] = self.read(f"{prefix}.image", "<f4").reshape(self.input.shape)
        began = time.perf_counter()
        maps = self.run()
        took = time.perf_counter() - began
        return took, self.found(maps)

    def time_end_to_end(self, frame: int) -> tuple[float, int]:
        if self.card.is_detector:
            ahead = self.card.preprocess["range_m"][0] >= 0
            points = self.read(f"{frame}.ahead" if ahead else f"{frame}.sweep", "<f4").reshape(-1, 4)
            began = time.perf_counter()
            padded, counts, cells = pillars(points, self.card.preprocess)
            self.scatter(cells, pillar_features(padded, counts, self.weight, self.shift))
        else:
            spec = self.card.preprocess
            shape = (spec["image_height_px"], spec["image_width_px"], 3)
            picture = self.read(f"{frame}.rgb", "u1").reshape(shape)
            began = time.perf_counter()
            self.input[0] = resized(picture, self.input.shape, spec)
        found = self.found(self.run())
        return time.perf_counter() - began, found

    def found(self, maps: list[np.ndarray]) -> int:
        if not self.card.is_detector:
            return int(np.isfinite(marks(maps[0], self.card.preprocess)).sum())
        return len(suppressed(boxes(maps, self.card), self.card.preprocess["nms_iou"]))


def versions(packages: tuple[str, ...]) -> str:
    """Imports the packages and says which they are."""
    return ", ".join(f"{name} {importlib.import_module(name).__version__}" for name in packages)


def main() -> None:
    opener, packages = {
        "onnxruntime-python": (open_onnxruntime, ("onnxruntime", "numpy")),
        "pytorch": (open_pytorch, ("torch", "onnx", "numpy")),
    }[sys.argv[1]]
    networks: list[Network] = []

    def answer(asked: dict) -> dict:
        if asked["do"] == "hello":
            return {"versions": versions(packages)}
        if asked["do"] == "open":
            card = Card(Path(asked["card"]))
            networks.append(Network(card, opener(card, asked["threads"]), Path(asked["folder"])))
            return {}
        network = networks[asked["network"]]
        timed = network.time_network if asked["stage"] == "network" else network.time_end_to_end
        results = [timed(frame) for frame in asked["frames"]][asked["warm_up"] :]
        return {"seconds": [took for took, _ in results], "found": sum(found for _, found in results)}

    for line in sys.stdin:
        try:
            said = answer(json.loads(line))
        except Exception as error:  # covista tells it and ends
            said = {"error": f"{type(error).__name__}: {error}"}
        print(json.dumps(said), flush=True)


if __name__ == "__main__":
    main()
