"""Tests of pruning: `python -m unittest test_prune`."""

from __future__ import annotations

import unittest
from dataclasses import replace

import torch
from torch import Tensor, nn

import distill
import pointpillars as pp
from admm import Admm, importance, project
from budgets import allocate, cost, multiply_accumulates, normalisations_of, shrunken, widths_by_name

SMALL = replace(
    pp.KITTI, range_m=(0.0, -2.56, -3.0, 5.12, 2.56, 1.0), widths=pp.uniform(16, 32, 48, 32, up=32)
)


def network(seed: int) -> pp.PointPillars:
    """A network whose normalisations are as different as after training."""
    generator = torch.Generator().manual_seed(seed)
    torch.manual_seed(seed)
    model = pp.PointPillars(SMALL).eval()
    with torch.no_grad():
        for bn in normalisations_of(model).values():
            for value in (bn.weight, bn.running_var):
                value.uniform_(0.5, 1.5, generator=generator)
            for value in (bn.bias, bn.running_mean):
                value.normal_(0, 0.3, generator=generator)
    return model


def pillars() -> tuple[Tensor, Tensor, Tensor]:
    generator = torch.Generator().manual_seed(3)
    numbers = torch.randint(1, 9, (200,), generator=generator)
    coords = torch.randperm(32 * 32, generator=generator)[:200]
    return torch.randn(int(numbers.sum()), 9, generator=generator), coords, numbers


class Removal(unittest.TestCase):
    def test_without_filters_that_are_zero_the_network_computes_the_same(self) -> None:
        model, kept = network(1), {}
        for number, (name, bn) in enumerate(normalisations_of(model).items()):
            order = torch.randperm(len(bn.weight), generator=torch.Generator().manual_seed(number))
            gone, kept[name] = order[: 3 + number % 8], order[3 + number % 8 :].sort().values
            with torch.no_grad():
                bn.weight[gone] = bn.bias[gone] = 0
        small = shrunken(model, SMALL, kept).eval()
        self.assertEqual(widths_by_name(pp.widths_of(small.state_dict())), {n: len(k) for n, k in kept.items()})
        with torch.no_grad():
            for whole, part in zip(model(*pillars()), small(*pillars())):
                torch.testing.assert_close(part, whole, rtol=1e-4, atol=1e-5)

    def test_a_filter_that_speaks_is_missed(self) -> None:
        model = network(1)
        kept = {name: torch.arange(len(bn.weight)) for name, bn in normalisations_of(model).items()}
        kept["blocks.1.6"] = kept["blocks.1.6"][1:]
        small = shrunken(model, SMALL, kept).eval()
        with torch.no_grad():
            self.assertGreater(float((small(*pillars())[0] - model(*pillars())[0]).abs().max()), 1e-4)

    def test_widths_are_read_from_weights(self) -> None:
        self.assertEqual(pp.widths_of(pp.PointPillars(pp.KITTI).state_dict()), pp.KITTI.widths)


class Budgets(unittest.TestCase):
    def test_multiply_accumulates_are_those_that_run(self) -> None:
        model, counted = pp.PointPillars(SMALL).eval(), []

        def count(layer: nn.Module, inputs: tuple[Tensor], output: Tensor) -> None:
            per_value = layer.weight[:, 0] if isinstance(layer, nn.ConvTranspose2d) else layer.weight[0]
            values = output.numel() / (layer.stride[0] ** 2 if isinstance(layer, nn.ConvTranspose2d) else 1)
            counted.append(per_value.numel() * values)

        for layer in model.modules():
            if isinstance(layer, (nn.Conv2d, nn.ConvTranspose2d)):
                layer.register_forward_hook(count)
        with torch.no_grad():
            model(*pillars())
        self.assertEqual(multiply_accumulates(SMALL), sum(counted))

    def test_the_layer_that_is_not_needed_goes_first(self) -> None:
        names = widths_by_name(pp.KITTI.widths)
        needed = [4.0, 3.0, 2.0, 1.5, 1.0]
        scan = {name: needed for name in names} | {"blocks.1.6": [1.0] * 5}
        half = multiply_accumulates(pp.KITTI) / 2
        widths = widths_by_name(allocate(pp.KITTI, scan, half))
        self.assertEqual(widths["blocks.1.6"], 16)
        self.assertLessEqual(cost(pp.KITTI, widths)[0], half)
        self.assertGreater(cost(pp.KITTI, widths)[0], 0.9 * half)
        self.assertTrue(all(width % 8 == 0 for width in widths.values()))

    def test_what_cannot_be_said_is_an_error(self) -> None:
        scan = {name: [1.0] * 5 for name in widths_by_name(pp.KITTI.widths)}
        with self.assertRaises(SystemExit):
            allocate(pp.KITTI, scan, 1e6)


class AdmmOfScales(unittest.TestCase):
    def test_projection_is_the_nearest(self) -> None:
        w = torch.tensor([0.1, -3.0, 2.0, 0.5])
        self.assertEqual(project(w, 2).tolist(), [0, -3, 2, 0])

    def test_finds_the_best_scales_of_a_quadratic(self) -> None:
        """f = sum c (w - a)^2: keep those with the most c a^2; W starts elsewhere."""
        a, c = torch.tensor([1.0, 1.0, 1.0, 1.0]), torch.tensor([0.1, 2.0, 0.2, 3.0])
        bn = nn.BatchNorm1d(4)
        with torch.no_grad():
            bn.weight.copy_(torch.tensor([1.5, 0.6, 0.9, 0.7]))
        admm = Admm({"layer": bn}, {"layer": bn.weight.detach().clone()}, {"layer": 2})
        self.assertEqual(admm.kept()["layer"].tolist(), [0, 2])
        for step in range(400):
            loss = (c * (bn.weight - a) ** 2).sum()
            (gradient,) = torch.autograd.grad(loss, bn.weight)
            with torch.no_grad():
                bn.weight -= 0.05 * gradient
            admm.pull(0.02 if step < 200 else 0.3)
            if step % 5 == 4:
                admm.update()
        self.assertEqual(admm.kept()["layer"].tolist(), [1, 3])
        self.assertLess(admm.residual(), 0.15)

    def test_importance_is_the_change_of_a_loss_that_is_linear(self) -> None:
        bn = nn.BatchNorm1d(3).train()
        x, by = torch.randn(64, 3), torch.tensor([0.0, 1.0, -2.0])
        with torch.no_grad():
            bn.bias.copy_(torch.tensor([1.0, 1.0, 0.5]))
        found = importance({"layer": bn}, [lambda: (bn(x) * by).mean(0).sum()])["layer"]
        torch.testing.assert_close(found, (by * bn.bias).abs().detach(), rtol=1e-4, atol=1e-5)


class Imitation(unittest.TestCase):
    def test_a_student_that_says_the_same_is_not_corrected(self) -> None:
        logits, deltas, directions = torch.randn(1, 4, 5, 4), torch.randn(1, 4, 5, 4, 7), torch.randn(1, 4, 5, 4, 2)
        sure = (logits.sigmoid().reshape(-1) > distill.SURE).nonzero()[:, 0]
        batch = {
            "labels": torch.zeros(1, 4, 5, 4, dtype=torch.int8),
            "anchor": torch.zeros(0, dtype=torch.long),
            "delta": torch.zeros(0, 7),
            "direction": torch.zeros(0, dtype=torch.long),
            "soft": logits.sigmoid(),
            "sure": sure,
            "sure_delta": deltas.reshape(-1, 7)[sure],
            "sure_direction": directions.reshape(-1, 2)[sure],
        }
        own = distill.loss((logits, deltas, directions), batch)
        self.assertAlmostEqual(float(own["teacher_classes"]), 0, places=6)
        self.assertAlmostEqual(float(own["teacher_boxes"]), 0, places=6)
        other = distill.loss((logits + 1, deltas + 0.1, directions), batch)
        self.assertGreater(float(other["teacher_classes"]), 0.01)
        self.assertGreater(float(other["teacher_boxes"]), 0.01)


if __name__ == "__main__":
    unittest.main()
