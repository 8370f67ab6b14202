"""Figures with Matplotlib, an optional dependency, written as small files."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image as Pillow

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width: float, height: float, dpi: int) -> "Figure":
    """An empty figure, inches; it needs no display."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=dpi, layout="constrained")


def save(figure: "Figure", path: Path) -> None:
    """Writes a PNG of 160 colours, a third of the size; lone bright ones, such as a thin line's, are among them."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Pillow.fromarray(np.asarray(canvas.buffer_rgba())[..., :3])
    picture.quantize(160, Pillow.Quantize.MAXCOVERAGE, dither=Pillow.Dither.NONE).save(path, optimize=True)
