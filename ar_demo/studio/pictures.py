"""Pictures on their way to the page: made smaller, and encoded."""

from io import BytesIO

import cv2
import numpy as np
from PIL import Image as Pillow

from hdn.imaging.arrays import Image, Picture

JPEG_QUALITY = 92
WEBP_QUALITY = 90


def scaled(image: Picture, height: int | None) -> Picture:
    """A picture (H, W, n) at a height, px; the same array where it is no higher."""
    if height is None or height >= image.shape[0]:
        return image
    width = max(1, round(image.shape[1] * height / image.shape[0]))
    return cv2.resize(image, (width, max(1, height)), interpolation=cv2.INTER_AREA)


def jpeg(image: Image) -> bytes:
    """An RGB picture (H, W, 3) as JPEG."""
    return _encoded(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


def from_jpeg(data: bytes) -> Image:
    """The RGB picture (H, W, 3) in a JPEG of ours."""
    return cv2.cvtColor(_decoded(data), cv2.COLOR_BGR2RGB)


def smaller(data: bytes, height: int) -> bytes:
    """A JPEG of ours at another height, px."""
    return _encoded(scaled(_decoded(data), height))


def _encoded(bgr: Image) -> bytes:
    done, data = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done
    return data.tobytes()


def _decoded(data: bytes) -> Image:
    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert bgr is not None
    return bgr


def webp(image: Picture) -> bytes:
    """A picture (H, W, 3 or 4), with its transparency, as WebP."""
    file = BytesIO()
    Pillow.fromarray(image).save(file, "WEBP", quality=WEBP_QUALITY, method=0)
    return file.getvalue()
