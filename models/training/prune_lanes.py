"""Prunes the lane network to a part of its work: `python prune_lanes.py --teacher FILE --part 2 ...`.

As `prune.py` does of detectors: a sensitivity scan gives the widths, ADMM chooses the filters while
it trains, they are removed, and the smaller network is trained on labels and on what the teacher,
the dense network, says. The identities bind the channels between the blocks together, so the
filters that go are those inside the blocks. The stem stays as it is.
"""

from __future__ import annotations

import argparse
import copy
import json
import time
from itertools import islice
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import DataLoader
from tqdm import tqdm

import lanes
from admm import Admm, importance
from budgets import VALUE_IN_MACS, narrowed, sensitivity
from data import Batches, LaneDataset
from deploy import fold
from reload import load_onnx
from train import LOG_EVERY, TASKS, begin_with_file, one_cycle, plot, update_average, validate

TASK = TASKS["lanes"]
ADMM_RATE, ADMM_EVERY, RHO = 2e-4, 10, (1e-3, 1e-1)
SCAN_BATCHES, IMPORTANCE_BATCHES = 1, 6
TEACHER_WEIGHT = 4.0
BLOCKS = tuple((stage, block) for stage in range(len(lanes.WIDTHS)) for block in range(2))
Batch = dict[str, Tensor]


def layer(stage: int, block: int) -> str:
    return f"layers.{stage}.{block}.conv1"


def cost(inner: dict[str, int]) -> tuple[float, float]:
    """Multiply-accumulates of a frame, and the same with the values that are written and read."""
    cells = lanes.INPUT_HEIGHT_PX * lanes.INPUT_WIDTH_PX // 4
    first = lanes.WIDTHS[0]
    macs, values = cells * 3 * 49 * first, cells * first
    before = first
    for stage, width in enumerate(lanes.WIDTHS):
        cells //= 4
        for block in range(2):
            inside = inner[layer(stage, block)]
            macs += cells * (9 * inside * (before + width) + (before * width if before != width else 0))
            values += cells * (before + 2 * inside + 3 * width)
            before = width
    macs += cells * before * 8 + 8 * cells * lanes.HIDDEN
    macs += lanes.HIDDEN * (lanes.CELLS + 1) * lanes.ROWS * lanes.MARKS
    return macs, macs + VALUE_IN_MACS * values


def widths_by_name(inner: tuple[int, ...]) -> dict[str, int]:
    return {layer(*place): width for place, width in zip(BLOCKS, inner)}


def normalisations_of(model: lanes.Ufld) -> dict[str, nn.Module]:
    """The normalisation behind each layer that may lose filters, by the layer's name."""
    return {layer(i, j): model.layers[i][j].bn1 for i, j in BLOCKS}


def shrunken(model: lanes.Ufld, kept: dict[str, Tensor]) -> lanes.Ufld:
    """The network without the filters inside its blocks that aren't `kept`."""
    small = lanes.Ufld(inner=tuple(len(kept[layer(*place)]) for place in BLOCKS))
    weights = model.state_dict()
    for i, j in BLOCKS:
        block, index = f"layers.{i}.{j}", kept[layer(i, j)]
        weights[f"{block}.conv1.weight"] = weights[f"{block}.conv1.weight"][index]
        weights[f"{block}.conv2.weight"] = weights[f"{block}.conv2.weight"][:, index]
        for part in ("weight", "bias", "running_mean", "running_var"):
            weights[f"{block}.bn1.{part}"] = weights[f"{block}.bn1.{part}"][index]
    small.load_state_dict(weights)
    return small


class Lesson:
    """The loss of a student: on the labels, and its distance from what the teacher says."""

    def __init__(self, teacher: lanes.Ufld) -> None:
        self.teacher = fold(copy.deepcopy(teacher).eval()).bfloat16()

    def __call__(self, student: lanes.Ufld, batch: Batch) -> dict[str, Tensor]:
        image = lanes.normalise(batch["image"])
        with torch.no_grad():
            taught = torch.cat([self.teacher(part.bfloat16()) for part in image.split(2)]).float()
        with torch.autocast("cpu", torch.bfloat16):
            cells = student(image)[0].float()
        return lanes.mark_loss(cells, batch["marks"]) | {"teacher": TEACHER_WEIGHT * lanes.imitation(cells, taught)}


def batches_of(dataset: LaneDataset, batch: int, seed: int, first_step: int) -> DataLoader:
    sampler = Batches(dataset, batch, seed, first_step)
    return DataLoader(dataset, batch_sampler=sampler, collate_fn=dataset.collate)


def pruned(model: lanes.Ufld, lesson: Lesson, dataset: LaneDataset, args: argparse.Namespace) -> lanes.Ufld:
    """Scan, ADMM, removal."""
    normalisations = normalisations_of(model)
    for bn in model.modules():
        if isinstance(bn, nn.BatchNorm2d):
            bn.momentum = 0.0

    def loss(batch: Batch) -> Tensor:
        return sum(lesson(model, batch).values())

    batches = list(islice(batches_of(dataset, args.batch, args.seed + 1, 0), IMPORTANCE_BATCHES))
    important = importance(normalisations, (lambda b=b: loss(b) for b in batches))
    few = batches[:SCAN_BATCHES]
    scan = sensitivity(normalisations, important, lambda: float(np.mean([float(loss(b)) for b in few])))
    for name, losses in scan.items():
        print(f"{name:18} {' '.join(f'{value:7.3f}' for value in losses)}", flush=True)
    for bn in model.modules():
        if isinstance(bn, nn.BatchNorm2d):
            bn.momentum = 0.1
    full = widths_by_name(lanes.inner_of(model.state_dict()))
    widths = narrowed(full, scan, cost, cost(full)[0] / args.part)
    print(widths, flush=True)

    admm = Admm(normalisations, important, widths)
    optimizer = torch.optim.AdamW(model.parameters(), ADMM_RATE, weight_decay=0.01, fused=True)
    loader = islice(batches_of(dataset, args.batch, args.seed + 2, 0), args.admm_steps)
    for step, batch in enumerate(tqdm(loader, total=args.admm_steps, desc="admm", mininterval=10)):
        value = loss(batch)
        optimizer.zero_grad(set_to_none=True)
        value.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 10)
        optimizer.step()
        admm.pull(RHO[0] * (RHO[1] / RHO[0]) ** (step / args.admm_steps))
        if (step + 1) % ADMM_EVERY == 0:
            admm.update()
        if (step + 1) % LOG_EVERY == 0:
            tqdm.write(f"admm step {step + 1}: loss {float(value.detach()):.3f}, residual {admm.residual():.3f}")
    return shrunken(model, admm.kept())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--teacher", type=Path, required=True, help="ONNX file of the dense network, with which it begins")
    parser.add_argument("--part", type=int, required=True, help="2 keeps half of the dense multiply-accumulates")
    parser.add_argument("--data", type=Path, required=True, help="folder of the training split")
    parser.add_argument("--val", type=Path, required=True, help="folder of the validation split")
    parser.add_argument("--val-frames", type=int, default=40)
    parser.add_argument("--out", type=Path, default=Path("runs"))
    parser.add_argument("--admm-steps", type=int, default=60)
    parser.add_argument("--minutes", type=float, required=True, help="training time, ADMM not counted")
    parser.add_argument("--batch", type=int, default=16)
    parser.add_argument("--learning-rate", type=float, default=6e-4)
    parser.add_argument("--save-every-minutes", type=float, default=4)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--resume", action="store_true", help="go on with the training in --out")
    args = parser.parse_args()

    torch.set_num_threads(args.threads)
    torch.manual_seed(args.seed)
    checkpoint = args.out / f"lanes-p{args.part}.pt"
    dataset = LaneDataset(args.data, augmented=True)
    teacher = lanes.Ufld()
    load_onnx(teacher, args.teacher)
    lesson = Lesson(teacher)
    state = torch.load(checkpoint, map_location="cpu") if args.resume and checkpoint.exists() else None
    if state:
        model = lanes.Ufld(inner=lanes.inner_of(state["model"]))
        model.load_state_dict(state["model"])
    else:
        dense = lanes.Ufld()
        begin_with_file(TASK, dense, args.teacher, args.data)
        model = prepared(dense)
        model = pruned(model, lesson, dataset, args)
    print(f"{checkpoint.stem}: {cost(widths_by_name(lanes.inner_of(model.state_dict())))[0] / 1e9:.2f} GMAC", flush=True)
    train(prepared(model), lesson, dataset, checkpoint, args, state)


def prepared(model: lanes.Ufld) -> lanes.Ufld:
    """For training without the segmentation head and with the stem as it is."""
    model = model.to(memory_format=torch.channels_last).train()
    model.auxiliary = False
    lanes.freeze_low(model, model, stages=0)
    return model


def train(
    model: lanes.Ufld, lesson: Lesson, dataset: LaneDataset, checkpoint: Path, args: argparse.Namespace, state: dict | None
) -> None:
    """One cycle of the learning rate; `state` is the checkpoint to go on with."""
    average = copy.deepcopy(model)
    optimizer = torch.optim.AdamW(model.parameters(), args.learning_rate, weight_decay=0.01, fused=True)
    step, trained_s, curves = 0, 0.0, []
    if state:
        average.load_state_dict(state["average"])
        optimizer.load_state_dict(state["optimizer"])
        step, trained_s, curves = state["step"], state["trained_s"], state["curves"]
    split = LaneDataset(args.val, augmented=False)
    items = [[(i, 0)] for i in range(0, len(split), max(len(split) // args.val_frames, 1))]
    held_out = DataLoader(split, batch_sampler=items, collate_fn=split.collate)

    def save() -> None:
        loss = validate(TASK, average, held_out, torch.device("cpu"))
        curves.append({"step": step, "validation": loss})
        tqdm.write(f"step {step}, {trained_s / 60:.1f} min: validation loss {loss:.4f}")
        state = {
            "model": model.state_dict(),
            "average": average.state_dict(),
            "optimizer": optimizer.state_dict(),
            "step": step,
            "trained_s": trained_s,
            "curves": curves,
            "frames": len(dataset),
            "arguments": {k: str(v) for k, v in vars(args).items()} | {"steps": "None"},
        }
        args.out.mkdir(parents=True, exist_ok=True)
        partial = checkpoint.with_suffix(".partial")
        torch.save(state, partial)
        partial.replace(checkpoint)
        plot(curves, checkpoint.with_suffix(".png"))
        checkpoint.with_name(f"{checkpoint.stem}-curves.json").write_text(json.dumps(curves))

    started = last_save = time.monotonic()
    earlier_s, sums = trained_s, {}
    bar = tqdm(initial=step, desc=checkpoint.stem, mininterval=10)
    for batch in batches_of(dataset, args.batch, args.seed, step):
        progress = trained_s / (60 * args.minutes)
        if progress >= 1:
            break
        for group in optimizer.param_groups:
            group["lr"] = args.learning_rate * one_cycle(progress)
        parts = lesson(model, batch)
        total = sum(parts.values())
        optimizer.zero_grad(set_to_none=True)
        total.backward()
        nn.utils.clip_grad_norm_(model.parameters(), 10)
        optimizer.step()
        step += 1
        update_average(average, model, step)
        trained_s = earlier_s + time.monotonic() - started
        for name, part in {"total": total, **parts}.items():
            sums.setdefault(name, []).append(float(part.detach()))
        bar.update()
        if step % LOG_EVERY == 0:
            curves.append({"step": step, "minutes": trained_s / 60} | {k: float(np.mean(v)) for k, v in sums.items()})
            sums = {}
        if time.monotonic() - last_save > 60 * args.save_every_minutes:
            save()
            last_save = time.monotonic()
    save()
    bar.close()


if __name__ == "__main__":
    main()
