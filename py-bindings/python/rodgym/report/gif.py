"""Looping GIFs of pictures. Needs Pillow."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import BinaryIO

import numpy as np
from PIL import Image, ImageColor

from rodgym.report.style import COLOURS, INK

#: How long the last picture stays before the loop begins again [s].
HOLD = 1.2


def write_gif(
    path: Path | BinaryIO, pictures: Sequence[Image.Image], frame_dt: float, hold: float = HOLD
) -> None:
    """A looping GIF, ``frame_dt`` seconds a picture; waits ``hold`` seconds at its end.

    All pictures share one palette, so that what does not move is the same bytes in each and small.
    """
    palette = _palette([pictures[k] for k in np.linspace(0, len(pictures) - 1, 8).astype(int)])
    indexed = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    duration = [round(1000 * frame_dt)] * len(indexed)
    duration[-1] += round(1000 * hold)
    indexed[0].save(
        path, "GIF", save_all=True, append_images=indexed[1:], duration=duration, loop=0
    )


def _palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """128 colours that serve all pictures; those by which policies are known are among them.

    Of the others each counts by the square root of its area: thin lines would else lose their
    colour to the shades of a wide background.
    """
    pixels = np.concatenate([np.asarray(picture).reshape(-1, 3) for picture in pictures])
    colours, area = np.unique(pixels @ np.array([65536, 256, 1]), return_counts=True)
    weighted = np.repeat(colours, np.ceil(np.sqrt(area)).astype(int))
    rgb = np.stack([weighted >> 16, weighted >> 8 & 255, weighted & 255], axis=-1)
    known = [ImageColor.getrgb(colour) for colour in (*COLOURS, INK, "#ffffff")]
    found = Image.fromarray(rgb[None].astype(np.uint8)).quantize(
        128 - len(known), Image.Quantize.MEDIANCUT, kmeans=2
    )
    palette = Image.new("P", (1, 1))
    palette.putpalette([*np.ravel(known).tolist(), *(found.getpalette() or ())])
    return palette
