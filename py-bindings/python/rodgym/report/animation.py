"""Pictures of several episodes side by side, as a looping GIF or as a strip of stills."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from rodgym.evaluation import Record
from rodgym.report.style import COLOURS, INK

TITLE_HEIGHT = 34
GAP = 12
#: Width of a still [pixels]: it is drawn in this size, so that its text can be read.
STILL = 240


def _font(size: int) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(size)


def _titled(frame: NDArray[np.uint8], title: str, colour: str, width: int) -> Image.Image:
    """A picture scaled to ``width`` pixels below its title."""
    picture = Image.fromarray(frame)
    height = round(picture.height * width / picture.width)
    if picture.size != (width, height):
        picture = picture.resize((width, height), Image.Resampling.LANCZOS)
    canvas = Image.new("RGB", (width, height + TITLE_HEIGHT), "white")
    canvas.paste(picture, (0, TITLE_HEIGHT))
    draw = ImageDraw.Draw(canvas)
    draw.rounded_rectangle((2, 10, 16, 24), 4, fill=colour)
    draw.text((24, 17), title, fill=INK, font=_font(17), anchor="lm")
    return canvas


def _row(pictures: Sequence[Image.Image]) -> Image.Image:
    width = sum(p.width for p in pictures) + GAP * (len(pictures) - 1)
    canvas = Image.new("RGB", (width, max(p.height for p in pictures)), "white")
    x = 0
    for picture in pictures:
        canvas.paste(picture, (x, 0))
        x += picture.width + GAP
    return canvas


def side_by_side(records: Sequence[Record], width: int = 400) -> list[Image.Image]:
    """One picture per moment, every policy beside the others; who is done earlier stands still."""
    count = max(len(record.frames) for record in records)
    return [
        _row(
            [
                _titled(
                    record.frames[min(k, len(record.frames) - 1)],
                    record.policy,
                    COLOURS[i % len(COLOURS)],
                    width,
                )
                for i, record in enumerate(records)
            ]
        )
        for k in range(count)
    ]


def write_mp4(path: Path, pictures: Sequence[Image.Image], frame_dt: float) -> None:
    """A film that every browser plays (H.264), ``frame_dt`` seconds a picture. Needs
    imageio-ffmpeg.
    """
    import imageio_ffmpeg

    # The codec wants even sides.
    width, height = (side + side % 2 for side in pictures[0].size)
    film = imageio_ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=1 / frame_dt,
        quality=8,
        macro_block_size=2,
        ffmpeg_log_level="error",
    )
    film.send(None)
    for picture in pictures:
        canvas = Image.new("RGB", (width, height), "white")
        canvas.paste(picture, (0, 0))
        film.send(np.ascontiguousarray(canvas))
    film.close()


def moments(record: Record, count: int) -> list[int]:
    """Numbers of ``count`` pictures of an episode, close together where much moves.

    From the first to the last; a fifth of them would be evenly spaced in time.
    """
    last = len(record.frames) - 1
    turned = np.abs(np.diff(np.unwrap(record.angles, axis=0), axis=0)).sum(axis=1)
    time = record.time[1:] / record.time[-1]
    total = turned.sum()
    moved = turned.cumsum() / total if total > 0 else time
    passed = np.concatenate([[0.0], 0.2 * time + 0.8 * moved])
    at = np.interp(np.linspace(0, 1, count), passed / passed[-1], record.time)
    chosen = np.minimum((at / record.frame_dt).round().astype(int), last)
    chosen[0], chosen[-1] = 0, last
    return chosen.tolist()


def at_times(record: Record, times: Sequence[float]) -> list[int]:
    """Numbers of the pictures nearest to these times [s]; the last one where it is over."""
    last = len(record.frames) - 1
    return [min(last, round(time / record.frame_dt)) for time in times]


def strip(record: Record, chosen: Sequence[int], width: int = STILL) -> Image.Image:
    """The pictures of these numbers side by side, with their times."""
    pictures = [
        _titled(record.frames[k], f"{k * record.frame_dt:.2f} s", COLOURS[0], width) for k in chosen
    ]
    return _row(pictures)
