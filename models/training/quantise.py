"""Quantises an exported network to int8: `python quantise.py ID --data DIR`.

Static quantisation as QDQ pairs: unsigned activations with ranges calibrated on frames of the
training split, signed weights with a scale for each output channel. A layer that, quantised alone,
changes an output by more than `--tolerance` of its spread stays in floating point. Outputs are not
quantised. Writes ID-int8.onnx and its card.
"""

from __future__ import annotations

import argparse
import hashlib
import tempfile
import tomllib
from pathlib import Path

import numpy as np
import onnx
import torch
from onnx import TensorProto, numpy_helper
from onnxruntime.quantization import CalibrationDataReader, QuantType
from onnxruntime.quantization.calibrate import CalibrationMethod, TensorsData, create_calibrator
from onnxruntime.quantization.qdq_quantizer import QDQQuantizer
from onnxruntime.quantization.shape_inference import quant_pre_process
from tqdm import tqdm

import lanes
import pointpillars as pp
from cost import cost
from data import complete_frames, read_image, read_points
from deploy import canvas
from evaluate import open_model, pillar_features
from export import measure, toml_table

Feed = dict[str, np.ndarray]
LAYERS = ["Conv", "ConvTranspose", "Gemm", "MatMul"]
PERCENTILE = 99.99
SCANNED = 4  # frames with which the layers are tried one by one


class Frames(CalibrationDataReader):
    """Hands ONNX Runtime's calibration one frame after the other."""

    def __init__(self, feeds: list[Feed]) -> None:
        self.feeds = iter(feeds)

    def get_next(self) -> Feed | None:
        return next(self.feeds, None)


def feeds_of(card: dict, model: Path, data: Path, count: int) -> list[Feed]:
    """Inputs of `count` frames, evenly spaced over the training split."""
    frames = complete_frames(data)
    frames = frames[:: max(len(frames) // count, 1)][:count]
    if card["kind"] == "ufld":
        images = (torch.from_numpy(read_image(data, frame))[None] for frame in frames)
        return [{"image": lanes.normalise(image).contiguous().numpy()} for image in images]
    detector = pp.DETECTORS[card["id"].split("-p")[0]]
    features = pillar_features(open_model(model))
    canvases = (canvas(read_points(data, frame), detector, features) for frame in frames)
    return [{"canvas": each.contiguous().numpy()} for each in canvases]


def with_plain_weights(source: Path, target: Path) -> None:
    """The model with its fp16 weights cast to fp32 for good, and its shapes inferred."""
    model = onnx.load(source)
    graph = model.graph
    weights = {tensor.name: tensor for tensor in graph.initializer}
    for node in [node for node in graph.node if node.op_type == "Cast" and node.input[0] in weights]:
        value = numpy_helper.to_array(weights[node.input[0]]).astype(np.float32)
        weights[node.input[0]].CopyFrom(numpy_helper.from_array(value, node.output[0]))
        graph.node.remove(node)
    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / "plain.onnx"
        onnx.save(model, plain)
        quant_pre_process(plain, target, skip_symbolic_shape=True)


def calibrate(model: Path, folder: Path, feeds: list[Feed]) -> TensorsData:
    """The range of each tensor over the frames, but for the rarest of values: a few cells of the
    first maps are many times as strong as all others."""
    calibrator = create_calibrator(
        model, LAYERS, folder / "augmented.onnx", CalibrationMethod.Percentile,
        extra_options={"percentile": PERCENTILE, "symmetric": False},
    )  # fmt: skip
    calibrator.collect_data(Frames(feeds))
    return calibrator.compute_data()


def quantise(model: Path, target: Path, ranges: TensorsData, layers: list[str]) -> None:
    """Quantises the named layers of `model`."""
    quantizer = QDQQuantizer(
        onnx.load(model), per_channel=True, reduce_range=False,
        weight_qType=QuantType.QInt8, activation_qType=QuantType.QUInt8, tensors_range=ranges,
        nodes_to_quantize=layers, nodes_to_exclude=[], op_types_to_quantize=LAYERS,
        extra_options={"WeightSymmetric": True},
    )  # fmt: skip
    quantizer.quantize_model()
    quantizer.model.save_model_to_file(str(target))
    without_quantised_outputs(target)


def without_quantised_outputs(path: Path) -> None:
    """Takes the QDQ pair before each output of the model away."""
    model = onnx.load(path)
    graph, made_by = model.graph, {}
    for node in graph.node:
        made_by |= {name: node for name in node.output}
    for output in graph.output:
        dequantise = made_by[output.name]
        if dequantise.op_type != "DequantizeLinear":
            continue
        quantise_node = made_by[dequantise.input[0]]
        made_by[quantise_node.input[0]].output[0] = output.name
        graph.node.remove(dequantise)
        graph.node.remove(quantise_node)
    onnx.checker.check_model(model)
    onnx.save(model, path)


def change(model: Path, feeds: list[Feed], expected: list[list[np.ndarray]]) -> float:
    """Root mean square change of an output over its spread, of the output that changes most."""
    session = open_model(model, threads=2)
    squares = np.zeros(len(expected[0]))
    for feed, outputs in zip(feeds, expected):
        squares += [np.square(f - e).mean() / e.var() for f, e in zip(session.run(None, feed), outputs)]
    return float(np.sqrt(squares.max() / len(feeds)))


def robust_layers(plain: Path, folder: Path, ranges: TensorsData, feeds: list[Feed], tolerance: float) -> tuple[list[str], dict[str, float]]:
    """The layers that may be quantised, and by how much each that may not changes the outputs."""
    session = open_model(plain, threads=2)
    expected = [session.run(None, feed) for feed in feeds]
    layers = [node.name for node in onnx.load(plain).graph.node if node.op_type in LAYERS]
    changes = {}
    for layer in tqdm(layers, desc="sensitivity", mininterval=5):
        quantise(plain, folder / "one.onnx", ranges, [layer])
        changes[layer] = change(folder / "one.onnx", feeds, expected)
    sensitive = {name: value for name, value in changes.items() if value > tolerance}
    return [name for name in layers if name not in sensitive], sensitive


def write_card(card: dict, target: Path, command: str, data: Path, covista: str) -> None:
    """The card of the quantised file: the float one's, but for what the file is and how it does."""
    top = {key: value for key, value in card.items() if not isinstance(value, dict | list)}
    top |= {
        "id": target.stem,
        "file": target.name,
        "sha256": hashlib.sha256(target.read_bytes()).hexdigest(),
        "description": f"{card['description'].rstrip('.')}; quantised to int8.",
    }
    training = card["training"] | {"weights_from": f"models/{card['file']}, sha256 {card['sha256'][:12]}", "quantised": command}
    parts = [toml_table("", top).lstrip("\n")]
    for name in ("inputs", "outputs", "preprocess", "anchors"):
        tables = card.get(name, [])
        header, tables = (f"[[{name}]]", tables) if isinstance(tables, list) else (f"[{name}]", [tables])
        parts += [toml_table(header, table) for table in tables]
    parts += [toml_table("[cost]", cost(target)), toml_table("[training]", training)]
    path = target.with_suffix(".toml")
    path.write_text("\n".join([*parts, "[metrics]\n"]))
    network = "lanes" if card["kind"] == "ufld" else card["id"]
    path.write_text("\n".join([*parts, measure(network, target, data, covista)]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("id", help="of an exported network in floating point")
    parser.add_argument("--models", type=Path, default=Path(".."))
    parser.add_argument("--data", type=Path, required=True, help="folder of the training split")
    parser.add_argument("--val", type=Path, required=True, help="folder of the split that the card's metrics are of")
    parser.add_argument("--frames", type=int, default=64, help="frames to calibrate with")
    parser.add_argument("--tolerance", type=float, default=0.05)
    parser.add_argument("--covista", default="covista", help="the program that measures the quantised file")
    args = parser.parse_args()
    source = args.models / f"{args.id}.onnx"
    card = tomllib.loads(source.with_suffix(".toml").read_text())
    feeds = feeds_of(card, source, args.data, args.frames)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        plain, partial = folder / "plain.onnx", folder / "int8.onnx"
        with_plain_weights(source, plain)
        ranges = calibrate(plain, folder, feeds)
        layers, sensitive = robust_layers(plain, folder, ranges, feeds[:SCANNED], args.tolerance)
        for layer, by in sensitive.items():
            print(f"{layer} stays in floating point: alone it changes an output by {by:.3f} of its spread")
        quantise(plain, partial, ranges, layers)
        target = args.models / f"{args.id}-int8.onnx"
        target.write_bytes(partial.read_bytes())
    command = f"python quantise.py {args.id} --data data/train --val data/val --frames {args.frames} --tolerance {args.tolerance}"
    write_card(card, target, command, args.val, args.covista)
    print(f"{target}: {len(layers)} layers in int8, {target.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
