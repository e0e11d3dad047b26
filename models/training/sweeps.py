"""Real and synthetic sweeps side by side, both cut to the camera's view as KITTI's samples are."""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

import lanes
from data import complete_frames, read_calibration, read_objects, read_points, to_lidar, count_inside

RANGE_EDGES_M = np.arange(0, 125, 5)
ELEVATION_EDGES_DEG = np.linspace(-16, 4, 81)
REFLECTANCE_EDGES = np.linspace(0, 1, 51)
GROUND_BANDS_M = ((4, 8), (8, 12), (12, 20), (20, 30), (30, 50))
SYNTHETIC_FRAMES = 40
Car = tuple[float, int, np.ndarray]


def in_view(points: np.ndarray, camera_from_lidar: np.ndarray, projection: np.ndarray) -> np.ndarray:
    """The points [N, 4] that the camera sees."""
    matrix = projection @ camera_from_lidar
    u, v, depth = matrix[:, :3] @ points[:, :3].T + matrix[:, 3:]
    seen = (depth > 0) & (u >= 0) & (u < lanes.IMAGE_WIDTH_PX * depth)
    return points[seen & (v >= 0) & (v < lanes.IMAGE_HEIGHT_PX * depth)]


def real_sweeps(real: Path) -> tuple[list[np.ndarray], list[Car]]:
    """The sweeps in the camera's view, and of every labelled car distance, points and size."""
    sweeps, cars = [], []
    for path in sorted(real.glob("*.bin")):
        camera_from_lidar, projection = read_calibration(path.with_name(f"{path.stem}_calib.txt"))
        points = np.fromfile(path, np.float32).reshape(-1, 4)
        sweeps.append(in_view(points, camera_from_lidar, projection))
        label = path.with_name(f"{path.stem}_label.txt")
        for line in label.read_text().splitlines() if label.exists() else ():
            if line.startswith("Car"):
                box = to_lidar(line.split(), camera_from_lidar)
                cars.append((float(np.hypot(*box[:2])), count_inside(points, box), box[3:6]))
    return sweeps, cars


def synthetic_sweeps(root: Path) -> tuple[list[np.ndarray], list[Car]]:
    """The same of the first synthetic frames."""
    sweeps, cars = [], []
    for frame in complete_frames(root)[:SYNTHETIC_FRAMES]:
        camera_from_lidar, projection = read_calibration(root / "calib" / f"{frame}.txt")
        sweeps.append(in_view(read_points(root, frame), camera_from_lidar, projection))
        for box in read_objects(root, frame):
            bearing = np.degrees(np.arctan2(box[1], box[0]))
            if box[7] == 0 and box[8] >= 5 and abs(bearing) < 38:
                cars.append((float(np.hypot(*box[:2])), int(box[8]), box[3:6]))
    return sweeps, cars


def beams(points: np.ndarray) -> np.ndarray:
    """Elevation of every point in degrees, seen from the sensor's origin."""
    return np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))


def ground_spread(points: np.ndarray) -> list[float]:
    """Between the 1st and 25th percentile of height ahead, by band of distance, in metres.

    Ahead most returns are ground: on a flat road this is the noise, else the slope and camber.
    """
    distance = np.hypot(points[:, 0], points[:, 1])
    spread = []
    for low, high in GROUND_BANDS_M:
        z = points[(distance >= low) & (distance < high) & (np.abs(points[:, 1]) < 5), 2]
        spread.append(float(np.subtract(*np.percentile(z, (25, 1)))) if len(z) > 20 else np.nan)
    return spread


def statistics(name: str, sweeps: list[np.ndarray], cars: list[Car]) -> dict[str, float]:
    points = np.concatenate(sweeps)
    ranges = np.linalg.norm(points[:, :3], axis=1)
    reflectance = points[:, 3]
    size = np.mean([c[2] for c in cars], 0)
    pairs = {
        "sweeps": len(sweeps),
        "points_per_sweep": len(points) / len(sweeps),
        "reflectance_zero_percent": 100 * np.mean(reflectance < 0.005),
        "reflectance_median": np.median(reflectance),
        "reflectance_p95": np.percentile(reflectance, 95),
        "reflectance_std": reflectance.std(),
        "range_median_m": np.median(ranges),
        "range_max_m": ranges.max(),
        "beyond_30m_percent": 100 * np.mean(ranges > 30),
        "elevation_max_deg": beams(points).max(),
        "car_length_m": size[0],
        "car_width_m": size[1],
        "car_height_m": size[2],
    }
    for (low, high), spread in zip(GROUND_BANDS_M, np.nanmedian([ground_spread(s) for s in sweeps], 0)):
        pairs[f"ground_spread_{low}_{high}m_m"] = spread
    return {f"{name}_{key}": float(value) for key, value in pairs.items()}


def compare(real: Path, root: Path, out: Path) -> dict[str, float]:
    """Statistics of both, and one picture of four panels."""
    figure, axes = plt.subplots(2, 2, figsize=(11, 7))
    metrics: dict[str, float] = {}
    kinds = (("real", *real_sweeps(real), "tab:orange"), ("synthetic", *synthetic_sweeps(root), "tab:blue"))
    for name, sweeps, cars, color in kinds:
        points = np.concatenate(sweeps)
        ranges = np.linalg.norm(points[:, :3], axis=1)
        panels = (
            (axes[0, 0], points[:, 3], REFLECTANCE_EDGES),
            (axes[0, 1], ranges, RANGE_EDGES_M),
            (axes[1, 0], beams(points), ELEVATION_EDGES_DEG),
        )
        for axis, values, edges in panels:
            counts, _ = np.histogram(values, edges)
            axis.stairs(100 * counts / len(values), edges, color=color, label=f"{name} ({len(sweeps)} sweeps)")
        distance, count = np.array([(c[0], c[1]) for c in cars]).T
        axes[1, 1].scatter(distance, count, s=30 if name == "real" else 5, color=color, label=name)
        metrics |= statistics(name, sweeps, cars)
    axes[0, 0].set(xlabel="reflectance", ylabel="points, %")
    axes[0, 1].set(xlabel="range, m", ylabel="points, %", yscale="log")
    axes[1, 0].set(xlabel="elevation, degrees", ylabel="points, %")
    axes[1, 1].set(xlabel="distance of the car, m", ylabel="points on it", yscale="log", xlim=(0, 70))
    for axis in axes.flat:
        axis.grid(alpha=0.3)
        axis.legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=90)
    plt.close(figure)
    return metrics
