"""Trains a student network on lessons: labels and what the teacher says."""

from __future__ import annotations

import argparse
import copy
import json
import time
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader
from tqdm import tqdm

import distill
import pointpillars as pp
from data import Batches, DetectorDataset
from train import LOG_EVERY, TASKS, one_cycle, plot, update_average, validate

Batch = dict[str, Tensor]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What every training of a student takes."""
    parser.add_argument("network", choices=pp.DETECTORS)
    parser.add_argument("--weights", type=Path, required=True, help="ONNX file or checkpoint to begin with")
    parser.add_argument("--teacher", type=Path, required=True, help="ONNX file of the dense network")
    parser.add_argument("--data", type=Path, required=True, help="folder of the training split")
    parser.add_argument("--val", type=Path, required=True, help="folder of the validation split")
    parser.add_argument("--val-frames", type=int, default=30)
    parser.add_argument("--lessons", type=Path, default=Path("runs/lessons"), help="samples with the teacher's comment")
    parser.add_argument("--out", type=Path, default=Path("runs"))
    budget = parser.add_mutually_exclusive_group(required=True)
    budget.add_argument("--minutes", type=float, help="training time, ADMM not counted")
    budget.add_argument("--steps", type=int)
    parser.add_argument("--batch", type=int, default=2)
    parser.add_argument("--learning-rate", type=float, default=1.5e-3)
    parser.add_argument("--save-every-minutes", type=float, default=4)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="go on with the training in --out")


def forward(model: nn.Module, batch: Batch) -> tuple[Tensor, ...]:
    with torch.autocast("cpu", torch.bfloat16):
        grid = tuple(batch["grid"].tolist())
        return model(batch["pillars"], batch["coords"], batch["numbers"], len(batch["labels"]), grid)


def batches_of(lessons: distill.Lessons, batch: int, seed: int, first_step: int) -> DataLoader:
    sampler = Batches(lessons, batch, seed, first_step)
    return DataLoader(lessons, batch_sampler=sampler, collate_fn=lessons.collate)


def train(
    model: pp.PointPillars,
    lessons: distill.Lessons,
    checkpoint: Path,
    args: argparse.Namespace,
    state: dict | None,
    after_step: Callable[[], None] = lambda: None,
) -> None:
    """One cycle of the learning rate; `state` is the checkpoint to go on with, `after_step` what
    keeps a constraint. Checkpoints are those of `train.py`."""
    average = copy.deepcopy(model)
    optimizer = torch.optim.AdamW(model.parameters(), args.learning_rate, weight_decay=0.01, fused=True)
    step, trained_s, curves = 0, 0.0, []
    if state:
        model.load_state_dict(state["model"])
        average.load_state_dict(state["average"])
        optimizer.load_state_dict(state["optimizer"])
        step, trained_s, curves = state["step"], state["trained_s"], state["curves"]
    split = DetectorDataset(args.val, augmented=False, detector=pp.DETECTORS[args.network])
    items = [[(i, 0)] for i in range(0, len(split), max(len(split) // args.val_frames, 1))]
    held_out = DataLoader(split, batch_sampler=items, collate_fn=split.collate)

    def save() -> None:
        loss = validate(TASKS[args.network], average, held_out, torch.device("cpu"))
        curves.append({"step": step, "validation": loss})
        tqdm.write(f"step {step}, {trained_s / 60:.1f} min: validation loss {loss:.4f}")
        state = {
            "model": model.state_dict(),
            "average": average.state_dict(),
            "optimizer": optimizer.state_dict(),
            "step": step,
            "trained_s": trained_s,
            "curves": curves,
            "frames": len(lessons),
            "widths": asdict(pp.widths_of(model.state_dict())),
            "arguments": {k: str(v) for k, v in vars(args).items()},
        }
        args.out.mkdir(parents=True, exist_ok=True)
        partial = checkpoint.with_suffix(".partial")
        torch.save(state, partial)
        partial.replace(checkpoint)
        plot(curves, checkpoint.with_suffix(".png"))
        checkpoint.with_name(f"{checkpoint.stem}-curves.json").write_text(json.dumps(curves))

    started = last_save = time.monotonic()
    earlier_s, sums = trained_s, {}
    bar = tqdm(total=args.steps, initial=step, desc=checkpoint.stem, mininterval=10)
    for batch in batches_of(lessons, args.batch, args.seed, step):
        progress = step / args.steps if args.steps else trained_s / (60 * args.minutes)
        if progress >= 1:
            break
        for group in optimizer.param_groups:
            group["lr"] = args.learning_rate * one_cycle(progress)
        parts = distill.loss(forward(model, batch), batch)
        total = sum(parts.values())
        optimizer.zero_grad(set_to_none=True)
        total.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 10)
        optimizer.step()
        after_step()
        step += 1
        update_average(average, model, step)
        trained_s = earlier_s + time.monotonic() - started
        for name, part in {"total": total, **parts}.items():
            sums.setdefault(name, []).append(float(part.detach()))
        bar.update()
        if step % LOG_EVERY == 0:
            means = {name: float(np.mean(values)) for name, values in sums.items()}
            curves.append({"step": step, "minutes": trained_s / 60, **means})
            bar.set_postfix({k: f"{v:.3f}" for k, v in means.items()}, refresh=False)
            sums = {}
        if time.monotonic() - last_save > 60 * args.save_every_minutes:
            save()
            last_save = time.monotonic()
    save()
    bar.close()
