"""Prunes single weights, not filters, to show what zeros alone bring: `python zeros.py NETWORK --like FILE ...`.

The network keeps its shape and as many weights that are not zero as the file `--like` has: those of
the largest magnitude in the deployed network, over all layers alike. Then it is trained as the
pruned ones are, its zeros held.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import torch
from torch import Tensor, nn

import pointpillars as pp
from cost import cost
from prune import lessons_of, load
from reload import filters, normalisation_after
from students import add_arguments, train


@torch.no_grad()
def masks(model: nn.Module, keep: int) -> dict[nn.Module, Tensor]:
    """Which weights of each layer stay, so that with all shifts `keep` numbers are not zero."""
    after, magnitudes = normalisation_after(model), {}
    for layer in model.modules():
        if isinstance(layer, (nn.Linear, nn.Conv2d, nn.ConvTranspose2d)):
            rows = filters(layer, layer.weight).abs()
            if bn := after.get(layer):
                rows = rows * (bn.weight.abs() * (bn.running_var + bn.eps).rsqrt())[:, None]
            magnitudes[layer] = rows
            keep -= len(rows)
    largest = torch.cat([rows.flatten() for rows in magnitudes.values()]).sort(descending=True).values
    found = {}
    for layer, rows in magnitudes.items():
        mask = rows > largest[max(keep, 0)]
        if isinstance(layer, nn.ConvTranspose2d):
            found[layer] = mask.view(layer.out_channels, layer.in_channels, *layer.kernel_size).transpose(0, 1)
        else:
            found[layer] = mask.view_as(layer.weight)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_arguments(parser)
    parser.add_argument("--like", type=Path, required=True, help="ONNX file with as many numbers")
    parser.add_argument("--part", type=int, required=True, help="what the file is pruned to, for the name")
    args = parser.parse_args()

    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    checkpoint = args.out / f"{args.network}-zeros{args.part}.pt"
    state = torch.load(checkpoint, map_location="cpu") if args.resume and checkpoint.exists() else None
    _, model = load(args.network, args.weights, args.data)
    kept = masks(model, cost(args.like)["nonzero_parameters"])
    model = model.to(memory_format=torch.channels_last).train()

    @torch.no_grad()
    def hold() -> None:
        for layer, mask in kept.items():
            layer.weight *= mask

    hold()
    train(model, lessons_of(args), checkpoint, args, state, hold)


if __name__ == "__main__":
    main()
