#!/usr/bin/env python3
"""The demo on many seeds, as a Markdown table.

    python3 tests/seeds.py obstacle-at-corner --seeds 1000-1009

Runs `target/release/covista demo` once for each seed (both runs, with networks unless
`-- --perception truth` says otherwise) and keeps each summary under out/seeds, so that it can be
cut off and continued. Everything after `--` goes to the demo.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEAD = (
    "seed | sharing | stuck | CAVs of the obstacles' lane: sight / lane change, s | "
    "hardest braking, m/s^2 | collisions | unsafe | unattributed | by cause | wall, s"
)


def summary(scenario: str, seed: int, out: Path, extra: list[str]) -> dict:
    """The summary of one seed, run where it is not there yet."""
    folder = out / "-".join([scenario, str(seed), *(word.strip("-") for word in extra)])
    file = folder / "summary.json"
    if not file.exists():
        command = [str(ROOT / "target/release/covista"), "demo", scenario, "--seed", str(seed)]
        command += ["--out", str(folder), "--trace", str(folder / "trace.csv"), *extra]
        subprocess.run(command, check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    return json.loads(file.read_text())


def cell(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def row(seed: int, run: dict, lane: int) -> str:
    cavs = [cav for cav in run["vehicles"] if cav["initial_lane"] == lane]
    times = ", ".join(
        f"{cell(cav['first_line_of_sight_s'])} / {cell(cav['lane_change_start_s'])}" for cav in cavs
    )
    causes = ", ".join(f"{name} {n}" for name, n in run["violations_by_cause"].items()) or "-"
    return (
        f"{seed} | {'on' if run['sharing'] else 'off'} | {run['vehicles_stuck']} | {times} | "
        f"{run['hardest_braking_mps2']:.1f} | {run['collisions']} | {run['unsafe_actions']} | "
        f"{run['violations_unattributed']} | {causes} | {run['wall_s']:.0f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario")
    parser.add_argument("--seeds", default="1000-1009", help="first-last")
    parser.add_argument("--lane", type=int, default=0, help="the obstacles' lane, 0 the leftmost")
    parser.add_argument("--out", type=Path, default=ROOT / "out/seeds")
    own, _, extra = " ".join(sys.argv[1:]).partition(" -- ")
    args = parser.parse_args(own.split())
    first, last = (int(seed) for seed in args.seeds.split("-"))
    print(f"| {HEAD} |\n|{'---|' * (HEAD.count('|') + 1)}")
    for seed in range(first, last + 1):
        for run in summary(args.scenario, seed, args.out, extra.split())["runs"]:
            print(f"| {row(seed, run, args.lane)} |")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
