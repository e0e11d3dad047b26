"""Draws docs/fusion.png from `covista eval fusion --json FILE`: `python fusion_plot.py FILE`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).parent

# Okabe and Ito's colours, told apart by the colour-blind, too.
LINES = {
    ("network", "network"): ("both networks", "#D55E00", "-"),
    ("network", "exact"): ("marks by the network, exact boxes", "#E69F00", "--"),
    ("exact", "network"): ("exact marks, boxes by the network", "#0072B2", "-"),
    ("exact", "exact"): ("exact marks and boxes", "#009E73", "--"),
}
BIN_M = 10.0
FEWEST = 10
"""Bins of fewer vehicles are not drawn."""


def draw_distance(axes: plt.Axes, rows: list[dict], road: str) -> None:
    for (marks, boxes), (label, color, style) in LINES.items():
        bins = [
            row
            for row in rows
            if (row["marks"], row["boxes"], row["road"], row["view"]) == (marks, boxes, road, "all")
            and row["to_m"] - row["from_m"] <= BIN_M
            and row["vehicles"] >= FEWEST
        ]
        middles = [(row["from_m"] + row["to_m"]) / 2 for row in bins]
        shares = [row["lane_index_accuracy"] for row in bins]
        axes.plot(middles, shares, style, color=color, marker="o", markersize=4, label=label)
    axes.axhline(95, color="0.7", linewidth=0.8)
    axes.set(title=road, xlabel="distance, m", xlim=(0, 70), ylim=(0, 102))


def draw_reliability(axes: plt.Axes, rows: list[dict]) -> None:
    axes.plot([50, 100], [50, 100], color="0.7", linewidth=0.8)
    for marks, color in (("network", "#D55E00"), ("exact", "#0072B2")):
        given = [row for row in rows if row["marks"] == marks and row["from_probability"] >= 0.5]
        given = [row for row in given if row["vehicles"] >= FEWEST]
        expected = [row["expected_accuracy"] for row in given]
        found = [row["lane_index_accuracy"] for row in given]
        axes.plot(expected, found, "o", color=color, label=f"{marks} marks")
    axes.set(title="how sure, how often right", xlabel="probability given, %", ylabel="in that lane, %")
    axes.legend(frameon=False, fontsize=8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("json", type=Path)
    parser.add_argument("--out", type=Path, default=HERE.parents[1] / "docs" / "fusion.png")
    args = parser.parse_args()
    rows = json.loads(args.json.read_text())["rows"]
    lanes = [row for row in rows if row["figure"] == "lane_index"]
    figure, (straight, curve, reliability) = plt.subplots(1, 3, figsize=(11, 3.6), layout="constrained")
    draw_distance(straight, lanes, "straight")
    draw_distance(curve, lanes, "curve")
    straight.set_ylabel("lane index right, % of visible vehicles")
    straight.legend(frameon=False, fontsize=8, loc="lower left")
    draw_reliability(reliability, [row for row in rows if row["figure"] == "reliability"])
    figure.savefig(args.out, dpi=110)


if __name__ == "__main__":
    main()
