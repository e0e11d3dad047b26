"""Writes the lane network of the paper's exact shape: `python paper_shape.py --out DIR`.

ResNet-18 of full width and a hidden layer of 2048: 38 M parameters, 76 MB. The weights are random,
for timing only; the trained network is narrower to keep `models/` small.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch

import lanes
from deploy import deployed
from export import LANES_DESCRIPTION, card, check, export_onnx

DESCRIPTION = "UFLD of the paper's exact shape, ResNet-18 of full width, with random weights: for timing only."


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    args = parser.parse_args()
    torch.manual_seed(1)
    args.out.mkdir(parents=True, exist_ok=True)
    path = args.out / "ufld-resnet18-paper.onnx"
    model = deployed(lanes.Ufld(lanes.PAPER_WIDTHS, lanes.PAPER_HIDDEN))
    export_onnx("lanes", model, path)
    check("lanes", model, path)
    untrained = {"arguments": {"minutes": "None", "steps": "0", "seed": "1"}, "frames": 0, "step": 0}
    text = card("lanes", model, path, untrained, "none", "random, seed 1").replace(LANES_DESCRIPTION, DESCRIPTION)
    path.with_suffix(".toml").write_text(text + "\n[metrics]\n")
    parameters = sum(weight.numel() for weight in model.parameters())
    print(f"{path}: {parameters / 1e6:.1f} M parameters (with the auxiliary head), {path.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
