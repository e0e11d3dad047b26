"""Exports a trained network: `python export.py lanes|pointpillars --checkpoint FILE --val DIR --out DIR`.

Writes the ONNX file (weights stored as fp16 behind Cast nodes, computed in fp32), checks it against
PyTorch, measures it on the validation split and writes the model card.
"""

from __future__ import annotations

import argparse
import copy
import datetime
import hashlib
import json
import shutil
import subprocess
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn
from torch.nn import functional as F

import lanes
import pointpillars as pp
from cost import cost
from deploy import canvas, deployed, fold, write_reference
from evaluate import NMS_IOU, PILLAR_FEATURES, SCORE_THRESHOLD, open_model
from reload import load_onnx
from train import TASKS

OPSET = 17
LANES_ID = "ufld-resnet18"
LANE_OPTIONS = ("batch", "learning_rate", "admm_steps", "freeze_low", "no_auxiliary", "elsewhere")  # on the card, if given
LANES_DESCRIPTION = (
    "UFLD row-anchor lane network on a half-width ResNet-18: the road's four marks, from the left edge line."
)


def identity(network: str, checkpoint: Path) -> str:
    """Id of the model that a checkpoint is exported to, its suffix (`-p8`) kept."""
    return (LANES_ID if network == "lanes" else network) + checkpoint.stem.removeprefix(network)


def inputs_of(network: str, model: nn.Module) -> dict[str, tuple[str, list[int]]]:
    """Dtype and shape of each input."""
    if network == "lanes":
        return {"image": ("float32", [1, 3, lanes.INPUT_HEIGHT_PX, lanes.INPUT_WIDTH_PX])}
    channels = len(model.features.shift)
    return {"canvas": ("float32", [1, channels, *pp.DETECTORS[network].grid])}


def outputs_of(network: str) -> dict[str, list[int]]:
    """Shape of each output."""
    if network == "lanes":
        return {"cells": [1, lanes.CELLS + 1, lanes.ROWS, lanes.MARKS]}
    channels = {"class_logits": 1, "box_deltas": 7, "direction_logits": 2}
    return {name: [1, pp.PER_CELL * k, *pp.DETECTORS[network].map] for name, k in channels.items()}


def network_of(network: str, weights: dict[str, Tensor]) -> nn.Module:
    """The network with trained weights, pruned or not."""
    if network == "lanes":
        model = lanes.Ufld(inner=lanes.inner_of(weights))
    else:
        model = pp.PointPillars(replace(pp.DETECTORS[network], widths=pp.widths_of(weights)))
    model.load_state_dict(weights)
    return model


@torch.no_grad()
def averaged(model: nn.Module, path: Path) -> nn.Module:
    """The network whose weights are the mean of a trained one's and of the file's that it began
    with, normalisations folded: between the two it often does better than at either end."""
    began = copy.deepcopy(model)
    load_onnx(began, path)
    mean, other = fold(model.eval()), fold(began.eval()).state_dict()
    mean.load_state_dict({name: (value + other[name]) / 2 for name, value in mean.state_dict().items()})
    return mean


class Maps(nn.Module):
    """The part of a deployed detector that the ONNX file computes: from the canvas to the maps.

    The three heads are one convolution, which reads their input once. It is put together from their
    weights in the graph, so that these keep their names; ONNX Runtime does so when it loads the file.
    """

    def __init__(self, model: pp.PointPillars) -> None:
        super().__init__()
        self.model = model

    def forward(self, canvas: Tensor) -> tuple[Tensor, ...]:
        heads = self.model.classes, self.model.boxes, self.model.directions
        weight, bias = (torch.cat(parts) for parts in zip(*((head.weight, head.bias) for head in heads)))
        maps = F.conv2d(self.model.neck(canvas), weight, bias)
        return maps.split([head.out_channels for head in heads], 1)


def example(network: str, model: nn.Module) -> dict[str, Tensor]:
    """Random inputs of the right kind."""
    generator = torch.Generator().manual_seed(1)
    if network == "lanes":
        shape = (1, lanes.INPUT_HEIGHT_PX, lanes.INPUT_WIDTH_PX, 3)
        image = torch.randint(0, 256, shape, dtype=torch.uint8, generator=generator)
        return {"image": lanes.normalise(image).contiguous()}
    detector = pp.DETECTORS[network]
    low, high = torch.tensor(detector.range_m[:3]), torch.tensor(detector.range_m[3:])
    xyz = low + (high - low) * torch.rand(20000, 3, generator=generator)
    points = torch.cat((xyz, torch.rand(20000, 1, generator=generator)), 1)
    return {"canvas": canvas(points.numpy(), detector, model.features).contiguous()}


def store_as_fp16(model: onnx.ModelProto) -> None:
    """Stores every fp32 weight as fp16 and casts it back to fp32 before its use."""
    graph = model.graph
    casts = []
    for tensor in list(graph.initializer):
        if tensor.data_type != TensorProto.FLOAT or np.prod(tensor.dims) < 2:
            continue
        half = numpy_helper.to_array(tensor).astype(np.float16)
        if not np.isfinite(half).all():
            raise ValueError(f"weight {tensor.name} does not fit in fp16")
        name = tensor.name
        tensor.CopyFrom(numpy_helper.from_array(half, f"{name}.fp16"))
        casts.append(helper.make_node("Cast", [f"{name}.fp16"], [name], f"cast {name}", to=TensorProto.FLOAT))
    nodes = casts + list(graph.node)
    del graph.node[:]
    graph.node.extend(nodes)


def export_onnx(network: str, model: nn.Module, path: Path) -> None:
    """Writes the ONNX file of a deployed model with named inputs and outputs; a detector's pillar
    features go into its metadata."""
    inputs = example(network, model)
    graph = model if network == "lanes" else Maps(model)
    torch.onnx.export(
        graph, tuple(inputs.values()), path, dynamo=False, opset_version=OPSET,
        input_names=list(inputs), output_names=list(outputs_of(network)), do_constant_folding=False,
    )  # fmt: skip
    exported = onnx.load(path)
    store_as_fp16(exported)
    if network != "lanes":
        helper.set_model_props(exported, {PILLAR_FEATURES: model.features.to_toml()})
    onnx.checker.check_model(exported)
    onnx.save(exported, path)


@torch.no_grad()
def check(network: str, model: nn.Module, path: Path) -> float:
    """Largest difference of ONNX Runtime from PyTorch, relative to the spread of each output."""
    inputs = example(network, model)
    expected = (model if network == "lanes" else Maps(model))(*inputs.values())
    expected = (expected,) if isinstance(expected, Tensor) else expected
    session = open_model(path)
    actual = session.run(None, {k: v.numpy() for k, v in inputs.items()})
    shapes = list(outputs_of(network).values())
    assert [list(a.shape) for a in actual] == shapes, "the outputs don't have the contract's shapes"
    worst = max(float(np.abs(a - e.numpy()).max() / e.std()) for a, e in zip(actual, expected))
    if worst > 1e-3:
        raise ValueError(f"ONNX Runtime differs from PyTorch by {worst:.3f} standard deviations")
    return worst


def toml_value(value: object) -> str:
    """A TOML value; JSON's notation of strings, numbers and flat lists is also TOML's."""
    if isinstance(value, float):
        return repr(round(value, 6))
    return json.dumps(value)


def toml_table(header: str, entries: dict[str, object]) -> str:
    lines = [f"{key} = {toml_value(value)}" for key, value in entries.items()]
    return "\n".join([header, *lines, ""])


def preprocess(network: str) -> dict[str, object]:
    if network == "lanes":
        return {
            "mean": list(lanes.MEAN),
            "std": list(lanes.STD),
            "row_anchors": lanes.ROW_ANCHORS_PX.tolist(),
            "grid_cells": lanes.CELLS,
            "image_width_px": lanes.IMAGE_WIDTH_PX,
            "image_height_px": lanes.IMAGE_HEIGHT_PX,
        }
    detector = pp.DETECTORS[network]
    return {
        "range_m": list(detector.range_m),
        "pillar_m": pp.PILLAR_M,
        "max_pillars": detector.max_pillars,
        "max_points_per_pillar": detector.max_points,
        "score_threshold": SCORE_THRESHOLD,
        "nms_iou": NMS_IOU,
    }


def card(
    network: str, model: nn.Module, path: Path, state: dict, data_command: str, weights_from: str
) -> str:
    """The model card, but for its metrics."""
    arguments = state["arguments"]
    budget = "minutes" if arguments["minutes"] != "None" else "steps"
    folders = f"--data data/train --val data/val --{budget} {arguments[budget]} --out runs"
    description = LANES_DESCRIPTION if network == "lanes" else pp.DETECTORS[network].description
    command = f"python train.py {network} {folders}"
    if part := arguments.get("part"):
        zeros, files = "like" in arguments, [k for k in ("weights", "teacher", "like") if k in arguments]
        what = f"As many weights that are not zero as 1/{part} of its work has" if zeros else f"Pruned to 1/{part} of its multiply-accumulates"
        description += f" {what}."
        options = " ".join(f"--{name} {Path(arguments[name]).name}" for name in files)
        script = "zeros.py" if zeros else "prune_lanes.py" if network == "lanes" else "prune.py"
        what = "" if network == "lanes" else f"{network} "
        command = f"python {script} {what}--part {part} {options} {folders}"
    given = {k: v for k in LANE_OPTIONS if (v := arguments.get(k, "None")) not in ("None", "False")}
    if network == "lanes":
        command += "".join(f" --{k.replace('_', '-')}" + ("" if v == "True" else f" {v}") for k, v in given.items())
    if weights_from:
        earlier = f"{LANES_ID}.onnx" if network == "lanes" else f"{network}.pt"
        command += f" --from-weights earlier/{earlier}"
    top = {
        "id": path.stem,
        "kind": "ufld" if network == "lanes" else "pointpillars",
        "file": path.name,
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "license": "MIT OR Apache-2.0",
        "date": datetime.date.today().isoformat(),
        "description": description,
    }
    training = {
        "command": command,
        "data_command": data_command,
        "seeds": [int(arguments["seed"])],
        "frames": state["frames"],
        "steps": state["step"],
    }
    if weights_from:
        training["weights_from"] = weights_from
    parts = [toml_table("", top).lstrip("\n")]
    for name, (dtype, shape) in inputs_of(network, model).items():
        parts.append(toml_table("[[inputs]]", {"name": name, "dtype": dtype, "shape": shape}))
    for name, shape in outputs_of(network).items():
        parts.append(toml_table("[[outputs]]", {"name": name, "dtype": "float32", "shape": shape}))
    parts.append(toml_table("[preprocess]", preprocess(network)))
    if network != "lanes":
        for name, anchor in zip(pp.CLASSES, pp.ANCHORS):
            entries = {"class": name, "size_m": list(anchor.size_m), "center_z_m": anchor.center_z_m}
            parts.append(toml_table("[[anchors]]", entries))
    parts.append(toml_table("[cost]", cost(path)))
    parts.append(toml_table("[training]", training))
    return "\n".join(parts)


def measure(network: str, path: Path, data: Path, covista: str) -> str:
    """The card's metrics, as `covista eval` takes them of the file itself."""
    what = "lanes" if network == "lanes" else "detector"
    with tempfile.TemporaryDirectory() as folder:
        rows = Path(folder) / "rows.json"
        command = ["eval", what, "--model", path.stem]
        places = ["--models", str(path.parent), "--data", str(data), "--json", str(rows)]
        subprocess.run([covista, *command, *places], check=True)
        report = json.loads(rows.read_text())
    metrics: dict[str, object] = {"command": f"covista {' '.join(command)} --data data/{data.name}"}
    for row in report["rows"]:
        kind = "" if what == "lanes" else f"{row['class']}_"
        for name, value in row.items():
            if isinstance(value, int | float) and "_r11" not in name:
                metrics[name if kind in f"{name}_" else kind + name] = value
    return toml_table("[metrics]", metrics)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("network", choices=TASKS)
    parser.add_argument("--checkpoint", type=Path, required=True)
    parser.add_argument("--val", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path(".."))
    parser.add_argument(
        "--data-command", default="covista dataset --out data/train --frames 2600 --seed 1 --split train"
    )
    parser.add_argument("--reference", type=Path, default=Path("../../tests/networks"), help="for the tests in Rust")
    parser.add_argument("--weights-from", default="", help="what `--from-weights` began with, for the card")
    parser.add_argument("--mean-with", type=Path, help="exported file of the same shape; the mean of the weights is exported")
    parser.add_argument("--covista", default="covista", help="the program that measures the exported file")
    args = parser.parse_args()
    torch.set_num_threads(1)
    state = torch.load(args.checkpoint, map_location="cpu")
    model = network_of(args.network, state["average"])
    if args.mean_with:
        model = averaged(model, args.mean_with)
    model = deployed(model)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / f"{identity(args.network, args.checkpoint)}.onnx"
    partial = args.checkpoint.with_suffix(".onnx")  # moved to its place once it is checked
    export_onnx(args.network, model, partial)
    difference = check(args.network, model, partial)
    shutil.move(partial, path)
    write_reference(args.network, model, args.reference / f"{args.checkpoint.stem}.json")
    text = card(args.network, model, path, state, args.data_command, args.weights_from)
    path.with_suffix(".toml").write_text(text + "\n[metrics]\n")
    text += "\n" + measure(args.network, path, args.val, args.covista)
    path.with_suffix(".toml").write_text(text)
    size_mb = path.stat().st_size / 1e6
    print(f"{path}: {size_mb:.1f} MB, differs from PyTorch by at most {difference:.4f} sigma")
    print(text[text.index("[training]") :])


if __name__ == "__main__":
    main()
