"""Markers, dots, lines and words on pictures."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from blendcap.data import Camera
from blendcap.rendering import project

TARGET, FITTED, LINE = (214, 48, 49), (30, 96, 196), (70, 70, 78)


def mark(picture: np.ndarray, camera: Camera, targets: np.ndarray | None, fitted: np.ndarray | None) -> None:
    """Draw markers (M, 3), red, their places on the face (M, 3), blue, and lines between, mm, on a picture."""
    radius = max(picture.shape[0] / 220, 2.7)
    places = {}
    for what, points in (("target", targets), ("fitted", fitted)):
        if points is not None:
            places[what] = project(points, camera)[0]
    if len(places) == 2:
        draw_lines(picture, places["target"], places["fitted"], LINE)
    if "fitted" in places:
        draw_dots(picture, places["fitted"], FITTED, radius)
    if "target" in places:
        draw_dots(picture, places["target"], TARGET, radius)


def explain(picture: np.ndarray, targets: np.ndarray | None, fitted: np.ndarray | None) -> None:
    """Write into the upper left corner what the dots of `mark` are."""
    letters, border = max(picture.shape[0] // 54, 10), picture.shape[0] // 36
    left, middle = border, border + letters // 2
    for points, word, color in ((targets, "marker", TARGET), (fitted, "its place on the face", FITTED)):
        if points is not None:
            draw_dots(picture, np.array([[left + letters / 2, middle]]), color, letters / 3)
            draw_text(picture, word, (left + round(1.5 * letters), middle), height=letters, anchor="lm")
            left += round(3.5 * letters) + text_width(word, letters)


def draw_dots(picture: np.ndarray, pixels: np.ndarray, color: tuple[int, int, int], radius: float) -> None:
    """Draw discs at `pixels` (M, 2), antialiased, on a picture; what is NaN or outside is left out."""
    import cv2

    height, width = picture.shape[:2]
    inside = np.isfinite(pixels).all(1) & (np.abs(pixels) < 4 * max(width, height)).all(1)
    for x, y in np.round(pixels[inside] * 16).astype(int):  # 4 bits below the pixel
        cv2.circle(picture, (int(x), int(y)), round(radius * 16), color, -1, cv2.LINE_AA, 4)


def draw_lines(picture: np.ndarray, start: np.ndarray, end: np.ndarray, color: tuple[int, int, int]) -> None:
    """Draw lines between `start` and `end` (M, 2), pixels, antialiased, on a picture; NaN is left out."""
    import cv2

    limit = 4 * max(picture.shape[:2])
    both = np.concatenate([start, end], 1)
    inside = np.isfinite(both).all(1) & (np.abs(both) < limit).all(1)
    for x0, y0, x1, y1 in np.round(both[inside] * 16).astype(int):
        cv2.line(picture, (int(x0), int(y0)), (int(x1), int(y1)), color, 1, cv2.LINE_AA, 4)


def draw_text(
    picture: np.ndarray, text: str, at: tuple[int, int], *, height: int, anchor: str = "la", color=(45, 48, 54)
) -> None:
    """Write a line of text of `height` pixels at a place (x, y) on a picture; `anchor` as in Pillow."""
    from PIL import Image, ImageDraw

    font = _font(height)
    box = np.reshape(font.getbbox(text, anchor=anchor), (2, 2)) + at + [[-1], [1]]  # a pixel more on each side
    (left, top), (right, bottom) = np.clip(box, 0, picture.shape[1::-1]).astype(int)
    if left >= right or top >= bottom:
        return
    patch = Image.fromarray(picture[top:bottom, left:right])
    ImageDraw.Draw(patch).text((at[0] - left, at[1] - top), text, fill=color, font=font, anchor=anchor)
    picture[top:bottom, left:right] = patch


def text_width(text: str, height: int) -> int:
    """Pixels that a line of text takes."""
    return round(_font(height).getlength(text))


@cache
def _font(height: int):
    """The typeface that the plots use too."""
    import matplotlib
    from PIL import ImageFont

    return ImageFont.truetype(str(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf"), height)
