"""Draws the pictures of docs/sensors.md: `python pictures.py frames|cloud --data DIR [--real DIR]`.

    frames  four camera frames, the first two freeways and the first two streets of the folder,
            with the boxes of label_2 and the marks of lanes
    cloud   the sweep of a street, coloured by object, beside a real one from the same viewpoint

The folder is one that `covista dataset --truth points` writes. The real sweep is not ours to pass
on: where it is absent, one line says so.
"""

from __future__ import annotations

import argparse
import json
import math
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib import font_manager
from PIL import Image, ImageDraw, ImageFont

from data import complete_frames, read_calibration, read_points, to_lidar

HERE = Path(__file__).parent

# Okabe and Ito's colours, told apart by the colour-blind, too.
ORANGE, SKY_BLUE, GREEN, YELLOW = (230, 159, 0), (86, 180, 233), (0, 158, 115), (240, 228, 66)
VERMILLION, PURPLE = (213, 94, 0), (204, 121, 167)
MARK_COLORS = (ORANGE, SKY_BLUE, GREEN, PURPLE)
BOX_COLORS = {"Car": YELLOW, "Van": VERMILLION, "Truck": VERMILLION}
OBJECT_COLORS = (YELLOW, ORANGE, SKY_BLUE, VERMILLION, GREEN, PURPLE)
INK, PAPER = (40, 40, 40), (255, 255, 255)
SMOOTH = 3
"""Pixels of a drawing for each of the picture's, across and down."""

EDGES = [e for i in range(4) for e in ((i, (i + 1) % 4), (i + 4, (i + 1) % 4 + 4), (i, i + 4))]
"""Of a box, by the numbers of its corners."""

FRAME_WIDTH_PX = 900
LARGELY_HIDDEN = 2
NEAR_M = 0.1
STROKE_M = 0.8

CLOUD_PX = (800, 540)
CLOUD_FOCAL_PX = 880
EYE_M, AIM_M = np.array((-13.0, 0.0, 7.0)), np.array((14.0, 0.0, -2.2))
POINT_M = 0.05
OWN_BOX = np.array((0.45, 0.0, -1.0, 4.6, 1.8, 1.46, 0.0))
"""About the vehicle that carries the LIDAR, for the eye."""
NIGHT = np.array((13, 17, 23))
GROUND_CLASS, SCENERY_CLASS = 49, 99
HEIGHTS_M = (-1.9, 1.6)


def font(size_px: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(font_manager.findfont("DejaVu Sans"), size_px)


def frames_picture(root: Path, out: Path) -> None:
    kinds = {frame: record(root, frame)["kind"] for frame in complete_frames(root)}
    chosen = [[f for f in kinds if kinds[f] == kind][:2] for kind in ("freeway", "street")]
    pictures = [[labelled(root, frame, kinds[frame]) for frame in row] for row in chosen]
    width, height = pictures[0][0].size
    gap, foot = 8, 34
    sheet = Image.new("RGB", (2 * width + gap, 2 * (height + gap) + foot), PAPER)
    for row, line in enumerate(pictures):
        for column, picture in enumerate(line):
            sheet.paste(picture, (column * (width + gap), row * (height + gap)))
    legend(ImageDraw.Draw(sheet), sheet.height - foot)
    save(sheet, [*MARK_COLORS, YELLOW, VERMILLION, INK, PAPER], out)


def record(root: Path, frame: str) -> dict:
    return json.loads((root / "scenes" / f"{frame}.json").read_text())


def labelled(root: Path, frame: str, kind: str) -> Image.Image:
    """The camera's picture with its boxes, nearest last, and its marks."""
    picture = Image.open(root / "image_2" / f"{frame}.png").convert("RGB")
    scale = FRAME_WIDTH_PX / picture.width
    size = (FRAME_WIDTH_PX, round(scale * picture.height))
    overlay = Image.new("RGBA", (SMOOTH * size[0], SMOOTH * size[1]))
    draw = ImageDraw.Draw(overlay)
    camera_from_lidar, projection = read_calibration(root / "calib" / f"{frame}.txt")
    lines = [line.split() for line in (root / "label_2" / f"{frame}.txt").read_text().splitlines()]
    for words in sorted(lines, key=lambda words: -float(words[13])):
        draw_box(draw, words, camera_from_lidar, projection, SMOOTH * scale)
    draw_marks(draw, root, frame, SMOOTH * scale)
    picture = picture.resize(size, Image.Resampling.LANCZOS)
    overlay = overlay.resize(size, Image.Resampling.BOX)
    picture.paste(overlay, (0, 0), overlay)
    draw = ImageDraw.Draw(picture, "RGBA")
    text = f"{int(frame)}: {kind}"
    draw.rectangle((0, 0, 14 + draw.textlength(text, font(14)), 23), fill=(0, 0, 0, 150))
    draw.text((7, 3), text, PAPER, font(14))
    return picture


def draw_box(
    draw: ImageDraw.ImageDraw, words: list[str], camera_from_lidar: np.ndarray, projection: np.ndarray, scale: float
) -> None:
    """The edges of a label's box and a stroke to where it heads; thin where it is largely hidden."""
    box = to_lidar(words, camera_from_lidar)
    middle = box[:3] - (0, 0, box[5] / 2)
    ahead = middle + (box[3] / 2 + STROKE_M) * np.array((math.cos(box[6]), math.sin(box[6]), 0))
    points = np.concatenate((corners_of(box), (middle, ahead)))
    seen = np.c_[points, np.ones(len(points))] @ (projection @ camera_from_lidar).T
    hidden = int(words[2]) >= LARGELY_HIDDEN
    color, width = BOX_COLORS[words[0]], SMOOTH * (0.8 if hidden else 1.6)
    paths = [[pixel(p, scale) for p in clipped(seen[a], seen[b])] for a, b in [*EDGES, (8, 9)]]
    paths = [path for path in paths if path]
    if not hidden:
        for path in paths:
            draw.line(path, fill=(0, 0, 0, 150), width=round(width + 2 * SMOOTH))
    for path in paths:
        draw.line(path, fill=(*color, 170 if hidden else 255), width=round(width))


def corners_of(box: np.ndarray) -> np.ndarray:
    """The corners [8, 3] of a box: the lower four, the first and the last of them in front, then the upper."""
    x, y = np.array((1, -1, -1, 1)) * box[3] / 2, np.array((1, 1, -1, -1)) * box[4] / 2
    c, s = math.cos(box[6]), math.sin(box[6])
    around = np.stack((c * x - s * y, s * x + c * y), 1) + box[:2]
    return np.concatenate([np.c_[around, np.full(4, box[2] + side * box[5] / 2)] for side in (-1, 1)])


def clipped(a: np.ndarray, b: np.ndarray) -> list[np.ndarray]:
    """The part of an edge before the near plane."""
    near, far = sorted((a, b), key=lambda p: p[2])
    if far[2] <= NEAR_M:
        return []
    share = max(0.0, (NEAR_M - near[2]) / (far[2] - near[2])) if near[2] < NEAR_M else 0.0
    return [near + share * (far - near), far]


def pixel(point: np.ndarray, scale: float) -> tuple[float, float]:
    return (scale * (point[0] / point[2] + 0.5), scale * (point[1] / point[2] + 0.5))


def draw_marks(draw: ImageDraw.ImageDraw, root: Path, frame: str, scale: float) -> None:
    """The marks through their row anchors, from the left one to the right one."""
    label = json.loads((root / "lanes" / f"{frame}.json").read_text())
    for us, color in zip(label["lanes"], MARK_COLORS):
        at = [(scale * (u + 0.5), scale * (v + 0.5)) for u, v in zip(us, label["h_samples"]) if u >= 0]
        if not at:
            continue
        for line, width in (((0, 0, 0, 150), 4.5 * SMOOTH), ((*color, 255), 2 * SMOOTH)):
            draw.line(at, fill=line, width=round(width), joint="curve")
        for u, v in at:
            radius = 2.6 * SMOOTH
            draw.ellipse((u - radius, v - radius, u + radius, v + radius), (*color, 255), (0, 0, 0, 200), SMOOTH // 2)


def legend(draw: ImageDraw.ImageDraw, top: int) -> None:
    entries = [(f"mark {m} from the left", color) for m, color in enumerate(MARK_COLORS)]
    entries += [("car", YELLOW), ("van, truck, bus", VERMILLION), ("thin: largely hidden; stroke: points ahead", None)]
    x = 4
    for text, color in entries:
        if color:
            draw.rectangle((x, top + 9, x + 20, top + 21), fill=color, outline=INK)
            x += 28
        draw.text((x, top + 5), text, INK, font(17))
        x += draw.textlength(text, font(17)) + 30


def cloud_picture(root: Path, real: Path, frame: str, out: Path) -> None:
    points = read_points(root, frame)
    labels = np.fromfile(root / "labels" / f"{frame}.label", np.uint32)
    sweep = np.fromfile(real / "kitti_000008.bin", np.float32).reshape(-1, 4)
    width, height = CLOUD_PX
    gap, foot = 8, 34
    sheet = Image.new("RGB", (2 * width + gap, height + foot), PAPER)
    sheet.paste(splatted(points, object_colors(points, labels)), (0, 0))
    sheet.paste(splatted(sweep, height_colors(sweep)), (width + gap, 0))
    draw = ImageDraw.Draw(sheet)
    for x, text in ((4, "covista, coloured by object"), (width + gap + 4, "KITTI 000008, coloured by height (CC BY-NC-SA 3.0)")):
        draw.text((x, height + 7), text, INK, font(17))
    save(sheet, [*OBJECT_COLORS, INK, PAPER], out)


def save(sheet: Image.Image, kept: list[tuple[int, int, int]], out: Path) -> None:
    """A PNG of 256 colours, those of the drawing among them."""
    colors = sheet.quantize(256 - len(kept), kmeans=4).getpalette()
    palette = Image.new("P", (1, 1))
    palette.putpalette([*colors, *(channel for color in kept for channel in color)])
    sheet.quantize(palette=palette, dither=Image.Dither.NONE).save(out, optimize=True)


def object_colors(points: np.ndarray, labels: np.ndarray) -> np.ndarray:
    """Vehicles in strong colours, scenery in pale ones, the ground in grey by its reflectance."""
    kind, instance = labels & 0xFFFF, labels >> 16
    strong = np.array(OBJECT_COLORS, float)
    pale = np.array(((120, 134, 156), (146, 131, 138), (110, 146, 139), (150, 146, 120), (126, 122, 160)), float)
    colors = pale[instance % len(pale)]
    vehicle = (kind != GROUND_CLASS) & (kind != SCENERY_CLASS)
    colors[vehicle] = strong[instance[vehicle] % len(strong)]
    ground = kind == GROUND_CLASS
    colors[ground] = (50 + 130 * points[ground, 3:].clip(0, 1)) * (0.92, 0.96, 1.0)
    return colors


def height_colors(points: np.ndarray) -> np.ndarray:
    low, high = HEIGHTS_M
    share = ((points[:, 2] - low) / (high - low)).clip(0, 1)
    return 255 * matplotlib.colormaps["viridis"](0.12 + 0.88 * share)[:, :3]


def splatted(points: np.ndarray, colors: np.ndarray) -> Image.Image:
    """The points as discs, seen from behind and above the vehicle."""
    ahead = (AIM_M - EYE_M) / np.linalg.norm(AIM_M - EYE_M)
    right = np.cross(ahead, (0, 0, 1))
    right /= np.linalg.norm(right)
    focal = SMOOTH * CLOUD_FOCAL_PX
    width, height = (SMOOTH * side for side in CLOUD_PX)

    def seen(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        offset = positions - EYE_M
        depth = offset @ ahead
        up = np.cross(right, ahead)
        return width / 2 + focal * (offset @ right) / depth, height / 2 - focal * (offset @ up) / depth, depth

    shown = (points[:, :3] - EYE_M) @ ahead > 1
    points, colors = points[shown], colors[shown]
    u, v, depth = seen(points[:, :3])
    canvas = Image.new("RGB", (width, height), tuple(NIGHT))
    draw = ImageDraw.Draw(canvas)
    own_u, own_v, _ = seen(corners_of(OWN_BOX))
    for a, b in EDGES:
        draw.line((own_u[a], own_v[a], own_u[b], own_v[b]), (120, 126, 136), SMOOTH)
    for i in np.argsort(-depth):
        radius = max(focal * POINT_M / 2 / depth[i], 0.62 * SMOOTH)
        fade = min(1.0, 0.35 + 0.65 * 45 / max(depth[i], 45))
        fill = tuple(int(c) for c in NIGHT + fade * (colors[i] - NIGHT))
        draw.ellipse((u[i] - radius, v[i] - radius, u[i] + radius, v[i] + radius), fill)
    return canvas.resize(CLOUD_PX, Image.Resampling.BOX)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("frames", "cloud"))
    parser.add_argument("--data", type=Path, required=True, help="folder of `covista dataset --truth points`")
    parser.add_argument("--frame", type=int, default=0, help="which sweep")
    parser.add_argument("--real", type=Path, default=HERE.parents[2] / "shared" / "data")
    parser.add_argument("--out", type=Path, default=HERE.parents[1] / "docs", help="folder of the pictures")
    args = parser.parse_args()
    if args.what == "frames":
        frames_picture(args.data, args.out / "frames.png")
    elif (args.real / "kitti_000008.bin").exists():
        cloud_picture(args.data, args.real, f"{args.frame:06}", args.out / "cloud.png")
    else:
        print(f"{args.real}/kitti_000008.bin: no such sample; give its folder with --real; skipped")


if __name__ == "__main__":
    main()
