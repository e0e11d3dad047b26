"""Augmentation: the paper's mirror, rotation and scaling, and what else makes up for reality.

Every draw comes from the generator that is passed in, so that a sample repeats itself.
"""

from __future__ import annotations

import io
import math

import numpy as np
from PIL import Image, ImageDraw, ImageFilter

import lanes

MARGIN_M = 1.5
GROUND_M = 0.15
HORIZON = np.array((609.56, 172.85))


def scene(
    points: np.ndarray, objects: np.ndarray, range_m: tuple[float, ...], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Points [N, 4] and boxes [M, 8+] of one sweep, moved and measured differently; the points
    about `range_m` (x, y, z from and to)."""
    columns, objects = np.ascontiguousarray(points.T), objects.copy()
    resize_vehicles(columns, objects, rng)
    turn(columns, objects, rng)
    x0, y0, _, x1, y1, _ = range_m
    x, y = columns[:2]
    columns = columns[:, (x > x0 - MARGIN_M) & (x < x1 + MARGIN_M) & (y > y0 - MARGIN_M) & (y < y1 + MARGIN_M)]
    columns = measure_again(columns, rng)
    if rng.random() < 0.4:
        columns = cut_to_view(columns, rng)
    return np.ascontiguousarray(columns.T), objects


def resize_vehicles(columns: np.ndarray, objects: np.ndarray, rng: np.random.Generator) -> None:
    """Scales vehicles with their points, each axis on its own, standing where they stood; in place."""
    for box in objects:
        factor = (rng.uniform(0.9, 1.1) * rng.uniform(0.9, 1.1, 3)).astype(np.float32)
        c, s = math.cos(box[6]), math.sin(box[6])
        axes = np.array(((c, s, 0), (-s, c, 0), (0, 0, 1)), np.float32)
        base = (box[:3] - (0, 0, box[5] / 2)).astype(np.float32)
        reach = box[3] / 2 + box[4]
        near = np.flatnonzero((np.abs(columns[0] - box[0]) < reach) & (np.abs(columns[1] - box[1]) < reach))
        local = axes @ (columns[:3, near] - base[:, None])
        half = (box[3:6] / (2, 2, 1) + 0.1)[:, None]
        inside = (np.abs(local) <= half).all(0) & (local[2] > GROUND_M)
        columns[:3, near[inside]] = axes.T @ (local[:, inside] * factor[:, None]) + base[:, None]
        box[3:6] *= factor
        box[2] = base[2] + box[5] / 2


def turn(columns: np.ndarray, objects: np.ndarray, rng: np.random.Generator) -> None:
    """Mirror along the forward axis, rotation, scaling, and another ground; in place.

    The rotation is up to 45 degrees, mostly below 20, and half of the sweeps look back. The ground tilts, bends and shifts; that is
    small enough to move points and boxes up and down only.
    """
    mirror = rng.choice((-1, 1))
    objects[:, (1, 6)] *= mirror
    angle = rng.triangular(-math.pi / 4, 0, math.pi / 4) + math.pi * rng.integers(2)
    c, s = math.cos(angle), math.sin(angle)
    pitch, roll = np.radians(rng.normal(0, 0.5, 2))
    bend_per_m = rng.normal(0, 1e-4, 2)
    scale = rng.uniform(0.95, 1.05)
    moved = (scale * np.array(((c, -s, 0), (s, c, 0), (pitch, roll, 1)))).astype(np.float32)
    shift_m = rng.uniform(-0.1, 0.1)
    columns[:3] = (moved * (1, mirror, 1)).astype(np.float32) @ columns[:3]
    objects[:, :3] = objects[:, :3] @ moved.T
    for x, y, z in (columns[:3], objects[:, :3].T):
        z += np.float32(bend_per_m[0]) * x**2 + np.float32(bend_per_m[1]) * y**2 + np.float32(shift_m)
    objects[:, 3:6] *= scale
    objects[:, 6] += angle


def measure_again(columns: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Lost points and beams, noise of the range, another scale of reflectance."""
    count = columns.shape[1]
    kept = np.ones(count, bool)
    distance = np.sqrt(columns[0] ** 2 + columns[1] ** 2 + columns[2] ** 2)
    if rng.random() < 0.5:
        kept &= rng.random(count, np.float32) > rng.uniform(0, 0.3)
    if rng.random() < 0.4:  # weak returns are lost far away
        kept &= rng.random(count, np.float32) * rng.uniform(20, 80) > distance - 30
    if rng.random() < 0.2:
        beam = (columns[2] / (distance + 1e-3) / math.radians(0.4)).astype(int)
        kept &= (rng.random(256) > rng.uniform(0, 0.3))[beam % 256]
    columns, distance = columns[:, kept], distance[kept]
    count = columns.shape[1]
    noise = rng.standard_normal(count, np.float32) * np.float32(rng.uniform(0, 0.02))
    columns[:3] *= 1 + noise / (distance + 1e-3)
    reflectance = columns[3].clip(0, 1) ** np.float32(rng.uniform(0.6, 1.6)) * np.float32(rng.uniform(0.7, 1.3))
    reflectance += rng.standard_normal(count, np.float32) * np.float32(rng.uniform(0, 0.06))
    if rng.random() < 0.4:
        reflectance[reflectance < rng.uniform(0, 0.2)] = 0
    if rng.random() < 0.1:
        reflectance[:] = 0
    columns[3] = reflectance.round(2).clip(0, 0.99)
    return columns


def cut_to_view(columns: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What a camera ahead sees, as public samples are cut."""
    x, y, z = columns[:3]
    half = math.tan(math.radians(rng.uniform(38, 44)))
    return columns[:, (x > 0) & (np.abs(y) < half * x) & (z > -0.28 * x - 0.08) & (z < 0.24 * x)]


def road(
    image: np.ndarray, marks: np.ndarray, rng: np.random.Generator, elsewhere: float = 0.6
) -> tuple[np.ndarray, np.ndarray]:
    """The image [288, 800, 3] and marks [28, 4] in another light, `elsewhere` of them of another camera."""
    if rng.random() < 0.5:
        image = np.ascontiguousarray(image[:, ::-1])
        marks = lanes.IMAGE_WIDTH_PX - 1 - marks[:, ::-1]
    picture = Image.fromarray(image)
    wide = rng.random()
    if wide < elsewhere:
        picture, marks = look_from_elsewhere(picture, marks, 1.0 if wide < elsewhere / 3 else 0.4, rng)
    if rng.random() < 0.1:
        add_bonnet(picture, rng)
    inside = (marks >= 0) & (marks < lanes.IMAGE_WIDTH_PX)
    marks = np.where(inside, marks, np.nan).astype(np.float32)
    return relight(picture, rng), marks


def look_from_elsewhere(
    picture: Image.Image, marks: np.ndarray, reach: float, rng: np.random.Generator
) -> tuple[Image.Image, np.ndarray]:
    """Another focal length, height, lateral place, roll and pitch of the camera.

    On a flat road all of them are affine about the vanishing point, in pixels: a focal length
    scales, a height stretches below the horizon, a lateral step shears, pitch and yaw shift.
    `reach` scales how far off the other camera is.
    """
    zoom = math.exp(reach * rng.triangular(math.log(0.8), 0, math.log(1.9)))
    height = zoom * math.exp(reach * rng.uniform(-0.3, 0.2))
    shear, roll = reach * rng.uniform(-0.35, 0.35), reach * rng.normal(0, 0.015)
    across = reach * rng.normal(0, 40)
    down = reach * (rng.normal(0, 15) if rng.random() < 0.8 else rng.uniform(-90, 40))
    forward = np.array(((zoom, shear * height), (0, height))) @ ((1, -roll), (roll, 1))
    target = HORIZON + (across, down)

    to_view = np.array((lanes.INPUT_WIDTH_PX / lanes.IMAGE_WIDTH_PX, lanes.INPUT_HEIGHT_PX / lanes.IMAGE_HEIGHT_PX))
    inverse = np.linalg.inv(forward) * to_view[:, None] / to_view
    corner = 0.5  # of a pixel's centre from its corner, where Pillow has its origin
    offset = (HORIZON + corner) * to_view - inverse @ ((target + corner) * to_view)
    affine = (*inverse[0], offset[0], *inverse[1], offset[1])
    fill = (0, 0, 0) if rng.random() < 0.5 else tuple(int(v) for v in rng.integers(0, 120, 3))
    picture = picture.transform(
        picture.size, Image.Transform.AFFINE, affine, Image.Resampling.BILINEAR, fillcolor=fill
    )
    moved = np.full_like(marks, np.nan)
    for m in range(lanes.MARKS):
        seen = np.isfinite(marks[:, m])
        if seen.sum() < 2:
            continue
        points = np.stack((marks[seen, m], lanes.ROW_ANCHORS_PX[seen]), 1)
        u, v = ((points - HORIZON) @ forward.T + target).T
        if (np.diff(v) > 0).all():
            moved[:, m] = np.interp(lanes.ROW_ANCHORS_PX, v, u, np.nan, np.nan)
    return picture, moved


def add_bonnet(picture: Image.Image, rng: np.random.Generator) -> None:
    """The camera's own car along the bottom, through which marks are labelled as through others; in place."""
    width, height = picture.size
    top = rng.uniform(0.82, 1.0) * height
    color = tuple(int(v) for v in rng.integers(0, 160) + rng.integers(0, 40, 3))
    side = top + rng.uniform(0, 0.06) * height
    ImageDraw.Draw(picture).polygon(
        ((0, height), (0, side), (0.3 * width, top), (0.7 * width, top), (width, side), (width, height)), color
    )


def relight(picture: Image.Image, rng: np.random.Generator) -> np.ndarray:
    """Shadow bands, blur, saturation, gamma, contrast, colour, compression and noise."""
    if rng.random() < 0.25:
        picture = cast_shadow(picture, rng)
    if rng.random() < 0.25:
        picture = picture.filter(ImageFilter.BoxBlur(rng.uniform(0.3, 1.2)))
    saturation = rng.uniform(0.4, 1.5)
    gray = np.array((0.299, 0.587, 0.114)) * (1 - saturation)
    mix = np.tile(gray, (3, 1)) + saturation * np.eye(3)
    rows = np.pad(mix, ((0, 0), (0, 1))).reshape(-1)
    picture = picture.convert("RGB", tuple(rows))
    levels = (np.arange(256) / 255) ** rng.uniform(0.6, 1.6)
    levels = (levels - 0.5) * rng.uniform(0.7, 1.35) + 0.5 + rng.uniform(-0.1, 0.1)
    gains = 255 * rng.uniform(0.7, 1.3) * rng.uniform(0.9, 1.1, 3)
    table = (levels[None] * gains[:, None]).clip(0, 255).astype(np.uint8)
    picture = picture.point(table.reshape(-1).tolist())
    if rng.random() < 0.15:
        file = io.BytesIO()
        picture.save(file, "JPEG", quality=int(rng.integers(25, 80)))
        picture = Image.open(file)
    image = np.array(picture)
    if rng.random() < 0.15:
        noise = rng.standard_normal(image.shape, np.float32) * rng.uniform(0, 10)
        image = (image + noise).clip(0, 255).astype(np.uint8)
    return image


def cast_shadow(picture: Image.Image, rng: np.random.Generator) -> Image.Image:
    """One to three dark bands across the road."""
    mask = Image.new("L", picture.size, 255)
    draw = ImageDraw.Draw(mask)
    for _ in range(rng.integers(1, 4)):
        (a, b), thick = rng.uniform(0.45, 1.1, 2) * picture.height, rng.uniform(4, 60)
        corners = ((0, a), (picture.width, b), (picture.width, b + thick), (0, a + thick))
        draw.polygon(corners, int(255 * rng.uniform(0.35, 0.85)))
    mask = mask.filter(ImageFilter.BoxBlur(rng.uniform(0.5, 3)))
    dark = Image.new("RGB", picture.size)
    return Image.composite(picture, dark, mask)
