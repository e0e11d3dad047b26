"""Trains one of the networks: `python train.py lanes|pointpillars --data DIR --val DIR --out DIR`.

A run can be stopped at any time and goes on with `--resume`. With `--steps` it repeats itself on a
CPU, the detectors' also across `--resume`; with `--minutes` the learning rate follows the clock.
"""

from __future__ import annotations

import argparse
import copy
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from types import ModuleType

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader
from tqdm import tqdm

import lanes
import pointpillars
from data import Batches, DetectorDataset, LaneDataset
from reload import load_onnx, measure_normalisation

EMA_DECAY = 0.998
WARM_UP = 0.05
LOG_EVERY = 20
STATISTICS_BATCHES = 8


@dataclass(frozen=True)
class Task:
    """What differs between the two networks."""

    module: ModuleType
    network: Callable[[], nn.Module]
    dataset: Callable[..., LaneDataset | DetectorDataset]
    batch: int
    learning_rate: float

    def run(
        self, model: nn.Module, batch: dict[str, Tensor], rehearsal: lanes.Rehearsal | None = None
    ) -> dict[str, Tensor]:
        """The parts of the loss of one batch."""
        with torch.autocast(batch_device(batch).type, torch.bfloat16):
            outputs = self.forward(model, batch)
        if rehearsal:
            rehearsal.add(outputs[2], batch["marks"])
        return self.module.loss(outputs, batch)

    def forward(self, model: nn.Module, batch: dict[str, Tensor]) -> Tensor | tuple[Tensor, ...]:
        """The network's outputs for one batch."""
        if self.module is lanes:
            return model(lanes.normalise(batch["image"]))
        frames, grid = len(batch["labels"]), tuple(batch["grid"].tolist())
        return model(batch["pillars"], batch["coords"], batch["numbers"], frames, grid)


TASKS = {
    "lanes": Task(lanes, lanes.Ufld, LaneDataset, 8, 1e-3),
}
for detector in pointpillars.DETECTORS.values():
    network = partial(pointpillars.PointPillars, detector)
    dataset = partial(DetectorDataset, detector=detector)
    TASKS[detector.id] = Task(pointpillars, network, dataset, 2, 1.5e-3)


def batch_device(batch: dict[str, Tensor]) -> torch.device:
    return next(iter(batch.values())).device


def one_cycle(progress: float) -> float:
    """Learning rate over its peak: linear warm-up, then a cosine down to 1/100."""
    if progress < WARM_UP:
        return 0.04 + 0.96 * progress / WARM_UP
    phase = min((progress - WARM_UP) / (1 - WARM_UP), 1)
    return 0.01 + 0.99 * 0.5 * (1 + float(np.cos(np.pi * phase)))


def begin_with_file(task: Task, model: nn.Module, path: Path, data: Path) -> None:
    """The weights of a deployed file, its normalisations measured on the first training batches."""
    load_onnx(model, path)
    dataset = task.dataset(data, augmented=True)
    draws = islice(Batches(dataset, task.batch, 0, 0), STATISTICS_BATCHES)
    batches = (dataset.collate([dataset[item] for item in draw]) for draw in draws)
    device = next(model.parameters()).device
    on_device = ({k: v.to(device) for k, v in batch.items()} for batch in batches)
    measure_normalisation(model, on_device, task.forward)


@torch.no_grad()
def update_average(average: nn.Module, model: nn.Module, step: int) -> None:
    """Exponential moving average of weights and statistics: what is validated and exported."""
    decay = min(EMA_DECAY, (1 + step) / (10 + step))
    current = model.state_dict()
    for name, value in average.state_dict().items():
        if value.is_floating_point():
            value.lerp_(current[name], 1 - decay)
        else:
            value.copy_(current[name])


@torch.no_grad()
def validate(task: Task, model: nn.Module, loader: DataLoader, device: torch.device) -> float:
    """Mean loss of held-out batches; in training mode (heads and loss as trained), frozen BN."""
    model.train()
    frozen = [m for m in model.modules() if isinstance(m, nn.modules.batchnorm._BatchNorm)]
    for module in frozen:
        module.eval()
    losses = []
    for batch in loader:
        parts = task.run(model, {k: v.to(device) for k, v in batch.items()})
        losses.append(float(sum(parts.values())))
    return float(np.mean(losses))


def plot(curves: list[dict[str, float]], path: Path) -> None:
    """Training and validation loss over steps, as a small PNG."""
    path.parent.mkdir(parents=True, exist_ok=True)
    figure, axes = plt.subplots(figsize=(6, 4))
    for key in sorted({k for row in curves for k in row} - {"step", "minutes", "learning_rate"}):
        rows = [(r["step"], r[key]) for r in curves if key in r]
        axes.plot(*zip(*rows), "o-" if key == "validation" else "-", label=key, linewidth=1, markersize=3)
    axes.set(xlabel="step", ylabel="loss", yscale="log")
    axes.legend(fontsize=7)
    axes.grid(alpha=0.3)
    figure.tight_layout()
    figure.savefig(path, dpi=90)
    plt.close(figure)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("task", choices=TASKS)
    parser.add_argument("--data", type=Path, required=True, help="folder of the training split")
    parser.add_argument("--val", type=Path, help="folder of the validation split")
    parser.add_argument("--val-frames", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("runs"))
    budget = parser.add_mutually_exclusive_group(required=True)
    budget.add_argument("--minutes", type=float, help="training time, earlier parts counted in")
    budget.add_argument("--steps", type=int)
    parser.add_argument("--batch", type=int)
    parser.add_argument("--learning-rate", type=float)
    parser.add_argument("--save-every-minutes", type=float, default=3)
    parser.add_argument("--workers", type=int, default=0)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--no-augment", action="store_true")
    parser.add_argument("--freeze-low", action="store_true", help="lanes: stem and first stage as they are, faster")
    parser.add_argument("--no-auxiliary", action="store_true", help="lanes: without the segmentation head")
    parser.add_argument("--elsewhere", type=float, help="lanes: part of the frames seen by another camera, 0.6")
    start = parser.add_mutually_exclusive_group()
    start.add_argument("--resume", action="store_true", help="go on with the run in --out")
    start.add_argument("--from-weights", type=Path, help="begin a new run with the weights of a checkpoint or of an exported file")
    args = parser.parse_args()

    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    task = TASKS[args.task]
    device = torch.device("cuda" if torch.cuda.is_available() else "cpu")
    model = task.network().to(device, memory_format=torch.channels_last).train()
    if args.from_weights and args.from_weights.suffix == ".onnx":
        begin_with_file(task, model, args.from_weights, args.data)
    elif args.from_weights:
        weights = torch.load(args.from_weights, map_location=device)["average"]
        if task.module is pointpillars:
            weights = pointpillars.widen(weights, model)
        model.load_state_dict(weights)
    average = copy.deepcopy(model)
    peak = args.learning_rate or task.learning_rate
    optimizer = torch.optim.AdamW(model.parameters(), peak, weight_decay=0.01, fused=True)
    checkpoint = args.out / f"{args.task}.pt"
    step, trained_s, curves = 0, 0.0, []
    if args.resume and checkpoint.exists():
        state = torch.load(checkpoint, map_location=device)
        model.load_state_dict(state["model"])
        average.load_state_dict(state["average"])
        optimizer.load_state_dict(state["optimizer"])
        step, trained_s, curves = state["step"], state["trained_s"], state["curves"]

    if args.freeze_low:
        lanes.freeze_low(model, average)
    if args.no_auxiliary:
        model.auxiliary = average.auxiliary = False
    dataset = task.dataset(args.data, augmented=not args.no_augment)
    if args.elsewhere is not None:
        dataset.elsewhere = args.elsewhere
    batches = Batches(dataset, args.batch or task.batch, args.seed, step)
    loader = DataLoader(dataset, batch_sampler=batches, collate_fn=dataset.collate, num_workers=args.workers)
    held_out = None
    if args.val:
        split = task.dataset(args.val, augmented=False)
        items = [[(i, 0)] for i in range(0, len(split), max(len(split) // args.val_frames, 1))]
        held_out = DataLoader(split, batch_sampler=items, collate_fn=split.collate)

    def save() -> None:
        if held_out:
            loss = validate(task, average, held_out, device)
            curves.append({"step": step, "validation": loss})
            tqdm.write(f"step {step}: validation loss {loss:.4f}")
        state = {
            "model": model.state_dict(),
            "average": average.state_dict(),
            "optimizer": optimizer.state_dict(),
            "step": step,
            "trained_s": trained_s,
            "curves": curves,
            "frames": len(dataset),
            "arguments": {k: str(v) for k, v in vars(args).items()},
        }
        args.out.mkdir(parents=True, exist_ok=True)
        partial = checkpoint.with_suffix(".partial")
        torch.save(state, partial)
        partial.replace(checkpoint)
        (args.out / f"{args.task}-curves.json").write_text(json.dumps(curves))
        plot(curves, args.out / f"{args.task}.png")

    rehearsal = lanes.Rehearsal() if task.module is lanes else None
    started = last_save = time.monotonic()
    earlier_s, sums = trained_s, {}
    bar = tqdm(total=args.steps, initial=step, desc=args.task, mininterval=5, dynamic_ncols=True)
    for batch in loader:
        progress = step / args.steps if args.steps else trained_s / (60 * args.minutes)
        if progress >= 1:
            break
        for group in optimizer.param_groups:
            group["lr"] = peak * one_cycle(progress)
        parts = task.run(model, {k: v.to(device) for k, v in batch.items()}, rehearsal)
        total = sum(parts.values())
        optimizer.zero_grad(set_to_none=True)
        total.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 10)
        optimizer.step()
        for again in rehearsal.losses(model, step) if rehearsal else ():
            optimizer.zero_grad(set_to_none=True)
            again.backward()
            optimizer.step()
        step += 1
        update_average(average, model, step)
        trained_s = earlier_s + time.monotonic() - started
        for name, part in {"total": total, **parts}.items():
            sums.setdefault(name, []).append(float(part.detach()))
        bar.update()
        if step % LOG_EVERY == 0:
            rate = optimizer.param_groups[0]["lr"]
            means = {name: float(np.mean(values)) for name, values in sums.items()}
            curves.append({"step": step, "minutes": trained_s / 60, "learning_rate": rate, **means})
            bar.set_postfix({k: f"{v:.3f}" for k, v in means.items()}, refresh=False)
            sums = {}
        if time.monotonic() - last_save > 60 * args.save_every_minutes:
            save()
            last_save = time.monotonic()
    save()
    bar.close()


if __name__ == "__main__":
    main()
