"""Tests of the lane network: `python -m unittest test_lanes`."""

from __future__ import annotations

import tempfile
import unittest
from pathlib import Path

import torch
from torch import Tensor, nn

import lanes
import prune_lanes
from cost import cost
from deploy import deployed
from export import export_onnx
from reload import load_onnx, measure_normalisation


def network(inner: tuple[int, ...] | None = None) -> lanes.Ufld:
    """A network whose normalisations are as different as after training."""
    torch.manual_seed(1)
    model = lanes.Ufld(inner=inner).eval()
    with torch.no_grad():
        for module in model.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.weight.uniform_(0.5, 1.5)
                module.running_var.uniform_(0.5, 1.5)
                module.bias.normal_(0, 0.3)
                module.running_mean.normal_(0, 0.3)
    return model


def image() -> Tensor:
    return torch.randn(1, 3, lanes.INPUT_HEIGHT_PX, lanes.INPUT_WIDTH_PX, generator=torch.Generator().manual_seed(2))


@torch.no_grad()
def difference(a: nn.Module, b: nn.Module) -> float:
    """Largest difference of two networks' logits, in their spread."""
    expected = a(image())
    return float((b(image()) - expected).abs().max() / expected.std())


class Removal(unittest.TestCase):
    def test_without_filters_that_are_zero_the_network_computes_the_same(self) -> None:
        model, kept = network(), {}
        for name, bn in prune_lanes.normalisations_of(model).items():
            order = torch.randperm(len(bn.weight))
            gone, kept[name] = order[: len(order) // 4], order[len(order) // 4 :].sort().values
            with torch.no_grad():
                bn.weight[gone] = bn.bias[gone] = 0
        small = prune_lanes.shrunken(model, kept).eval()
        self.assertEqual(lanes.inner_of(small.state_dict()), (24, 24, 48, 48, 96, 96, 192, 192))
        self.assertLess(difference(model, small), 1e-4)

    def test_a_filter_that_speaks_is_missed(self) -> None:
        model = network()
        kept = {name: torch.arange(len(bn.weight)) for name, bn in prune_lanes.normalisations_of(model).items()}
        kept["layers.2.1.conv1"] = kept["layers.2.1.conv1"][1:]
        self.assertGreater(difference(model, prune_lanes.shrunken(model, kept).eval()), 1e-4)


class Reload(unittest.TestCase):
    def test_a_file_is_reloaded_and_its_work_is_what_pruning_counts(self) -> None:
        inner = (16, 32, 48, 64, 64, 96, 160, 240)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "network.onnx"
            file = deployed(network(inner))
            export_onnx("lanes", file, path)
            self.assertEqual(cost(path)["multiply_accumulates"], prune_lanes.cost(prune_lanes.widths_by_name(inner))[0])
            model = lanes.Ufld(inner=inner)
            load_onnx(model, path)
            self.assertLess(difference(file, model.eval()), 1e-4)
            with self.assertRaises(SystemExit):
                load_onnx(lanes.Ufld(), path)

    def test_measured_normalisation_changes_nothing_and_is_that_of_the_data(self) -> None:
        model, before = network(), network()
        measure_normalisation(model, [image()], lambda network, batch: network(batch))
        self.assertLess(difference(before, model), 1e-4)
        seen: list[Tensor] = []
        model.layers[1][0].bn1.register_forward_pre_hook(lambda _, inputs: seen.append(inputs[0]))
        with torch.no_grad():
            model(image())
        mean = seen[0].mean((0, 2, 3))
        torch.testing.assert_close(model.layers[1][0].bn1.running_mean, mean, rtol=1e-3, atol=1e-4)


class Freezing(unittest.TestCase):
    def test_frozen_stages_compute_the_same_in_bf16_and_do_not_learn(self) -> None:
        for stages in (0, 1):
            model, frozen = network(), network()
            lanes.freeze_low(frozen, frozen, stages)
            with torch.autocast("cpu", torch.bfloat16):
                self.assertLess(difference(model, frozen), 0.2)
            self.assertFalse(frozen.stem[0].weight.requires_grad)
            self.assertEqual(frozen.layers[0][0].conv1.weight.requires_grad, stages == 0)


class Decoding(unittest.TestCase):
    def test_a_mark_is_seen_in_its_surest_row_and_where_it_is_nearly_as_likely(self) -> None:
        likely = torch.tensor([[0.9, 0.5, 0.45], [0.4, 0.2, 0.4], [0.35, 0.19, 0.3]])
        cells = torch.full((1, lanes.CELLS + 1, 3, 3), -50.0)
        cells[0, 50], cells[0, lanes.NONE] = likely.logit(), 0
        seen = lanes.decode(cells)[0].isfinite()
        part = likely / likely.amax(0)
        self.assertEqual(seen.tolist(), ((part > lanes.SEEN_FROM) & (likely.amax(0) > 0.5)).tolist())


class Imitation(unittest.TestCase):
    def test_a_student_that_says_the_same_is_not_corrected(self) -> None:
        cells = torch.randn(2, lanes.CELLS + 1, lanes.ROWS, lanes.MARKS)
        self.assertAlmostEqual(float(lanes.imitation(cells + 3, cells)), 0, places=5)
        self.assertGreater(float(lanes.imitation(cells.flip(1), cells)), 0.1)


if __name__ == "__main__":
    unittest.main()
