"""Prunes a detector to a part of its work: `python prune.py NETWORK --weights FILE --part 8 ...`.

A stage goes from one network to a smaller one: a sensitivity scan gives the widths, ADMM chooses
the filters while it trains, they are removed, and the smaller network is trained on labels and on
what the teacher says. Stages follow each other: 1/2, 1/4, ... each from the checkpoint before. A
network that is small enough already is only trained on.
With `--steps` a stage repeats itself on a CPU; `--resume` goes on with its training.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader
from tqdm import tqdm

import distill
import pointpillars as pp
from admm import Admm, importance
from budgets import allocate, cost, multiply_accumulates, normalisations_of, sensitivity, shrunken, widths_by_name
from data import DetectorDataset
from reload import load_onnx, stored_weights
from students import Batch, add_arguments, batches_of, forward, train
from train import LOG_EVERY, TASKS, begin_with_file

SCAN_BATCHES = 3
IMPORTANCE_BATCHES = 12
ADMM_RATE = 5e-4
ADMM_EVERY = 10
RHO = (1e-3, 1e-1)  # first and last, geometric between


def load(network: str, weights: Path, data: Path) -> tuple[pp.Detector, pp.PointPillars]:
    """The network of a deployed file or of a checkpoint, and its detector of those widths."""
    deployed = weights.suffix == ".onnx"
    state = stored_weights(weights) if deployed else torch.load(weights, map_location="cpu")["average"]
    detector = replace(pp.DETECTORS[network], widths=pp.widths_of(state))
    model = pp.PointPillars(detector)
    if deployed:
        begin_with_file(TASKS[network], model, weights, data)
    else:
        model.load_state_dict(state)
    return detector, model


def total_loss(model: nn.Module, batch: Batch) -> Tensor:
    return sum(distill.loss(forward(model, batch), batch).values())


def freeze_statistics(model: nn.Module, frozen: bool) -> None:
    """Whether running statistics stay as they are while batches are normalised by their own."""
    for module in model.modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm):
            module.momentum = 0.0 if frozen else 0.1


def choose_widths(
    model: pp.PointPillars, detector: pp.Detector, target: float, batches: list[Batch]
) -> tuple[pp.Widths, dict[str, Tensor]]:
    """The budgets of a network of `target` multiply-accumulates, and each filter's importance."""
    normalisations = normalisations_of(model)
    freeze_statistics(model, True)
    important = importance(normalisations, (lambda b=b: total_loss(model, b) for b in batches))
    few = batches[:SCAN_BATCHES]
    scan = sensitivity(normalisations, important, lambda: float(np.mean([float(total_loss(model, b)) for b in few])))
    freeze_statistics(model, False)
    for name, losses in scan.items():
        print(f"{name:12} {' '.join(f'{loss:7.3f}' for loss in losses)}", flush=True)
    return allocate(detector, scan, target), important


def apply_admm(
    model: pp.PointPillars, widths: dict[str, int], important: dict[str, Tensor], loader: DataLoader, steps: int
) -> dict[str, Tensor]:
    """Trains until the filters that are to go are near zero; the indices of the others."""
    admm = Admm(normalisations_of(model), important, widths)
    optimizer = torch.optim.AdamW(model.parameters(), ADMM_RATE, weight_decay=0.01, fused=True)
    first = {name: set(index.tolist()) for name, index in admm.kept().items()}
    sums = []
    bar = tqdm(islice(loader, steps), total=steps, desc="admm", mininterval=10)
    for step, batch in enumerate(bar):
        loss = total_loss(model, batch)
        optimizer.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 10)
        optimizer.step()
        admm.pull(RHO[0] * (RHO[1] / RHO[0]) ** (step / steps))
        sums.append(float(loss.detach()))
        if (step + 1) % ADMM_EVERY == 0:
            admm.update()
        if (step + 1) % LOG_EVERY == 0:
            tqdm.write(f"admm step {step + 1}: loss {np.mean(sums):.3f}, residual {admm.residual():.3f}")
            sums = []
    swapped = sum(len(set(index.tolist()) - first[name]) for name, index in admm.kept().items())
    print(f"ADMM exchanged {swapped} of {sum(map(len, first.values()))} filters", flush=True)
    return admm.kept()


def lessons_of(args: argparse.Namespace) -> distill.Lessons:
    """The training frames with the comments of the dense network."""
    dense = pp.DETECTORS[args.network]
    teacher = pp.PointPillars(dense)
    load_onnx(teacher, args.teacher)
    dataset = DetectorDataset(args.data, augmented=True, detector=dense)
    return distill.Lessons(dataset, distill.Teacher(teacher), args.lessons)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    add_arguments(parser)
    parser.add_argument("--part", type=int, required=True, help="8 keeps 1/8 of the dense multiply-accumulates")
    parser.add_argument("--admm-steps", type=int, default=200)
    args = parser.parse_args()

    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    dense = pp.DETECTORS[args.network]
    checkpoint = args.out / f"{args.network}-p{args.part}.pt"
    lessons = lessons_of(args)
    state = torch.load(checkpoint, map_location="cpu") if args.resume and checkpoint.exists() else None
    detector, model = load(args.network, checkpoint if state else args.weights, args.data)
    model = model.to(memory_format=torch.channels_last).train()
    target = multiply_accumulates(dense) / args.part
    if not state and multiply_accumulates(detector) > target:
        batches = list(islice(batches_of(lessons, args.batch, args.seed + 1, 0), IMPORTANCE_BATCHES))
        widths, important = choose_widths(model, detector, target, batches)
        print(f"{checkpoint.stem}: {widths}", flush=True)
        loader = batches_of(lessons, args.batch, args.seed + 2, 0)
        kept = apply_admm(model, widths_by_name(widths), important, loader, args.admm_steps)
        model = shrunken(model, detector, kept).to(memory_format=torch.channels_last).train()
    widths = widths_by_name(pp.widths_of(model.state_dict()))
    print(f"{checkpoint.stem}: {cost(dense, widths)[0] / 1e9:.2f} GMAC", flush=True)
    train(model, lessons, checkpoint, args, state)


if __name__ == "__main__":
    main()
