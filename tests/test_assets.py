"""The shipped demo: the clip and the ad open, agree with the ground truth, and the truth agrees with the pixels."""

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

ASSETS = Path(__file__).parent.parent / "assets"
PRINT_SIZE = (160, 200)  # the rectified print, pixels


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((ASSETS / "demo.json").read_text())
    return loaded


@pytest.fixture(scope="module")
def prints(truth: dict[str, Any]) -> list[NDArray[np.float32]]:
    """Every 30th frame's print, rectified by the truth, grey."""
    right, bottom = PRINT_SIZE[0] - 1, PRINT_SIZE[1] - 1
    straight = np.array([[0, 0], [right, 0], [right, bottom], [0, bottom]], np.float32)
    found = []
    with av.open(str(ASSETS / "demo.mp4")) as container:
        for index, frame in enumerate(container.decode(video=0)):
            if index % 30 == 0:
                matrix = cv2.getPerspectiveTransform(np.array(truth["corners"][index], np.float32), straight)
                grey = frame.to_ndarray(format="gray").astype(np.float32)
                found.append(cv2.warpPerspective(grey, matrix, PRINT_SIZE, flags=cv2.INTER_AREA))
    return found


def correlation(a: NDArray[np.float32], b: NDArray[np.float32]) -> float:
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1])


@pytest.mark.parametrize(("name", "size", "seconds"), [("demo.mp4", (1280, 720), 10), ("ad.mp4", (640, 800), 5)])
def test_video(name: str, size: tuple[int, int], seconds: int) -> None:
    with av.open(str(ASSETS / name)) as container:
        video, audio = container.streams.video[0], container.streams.audio[0]
        assert (video.width, video.height) == size
        assert (video.codec_context.name, video.pix_fmt) == ("h264", "yuv420p")
        assert video.average_rate == Fraction(30)
        assert video.frames == seconds * 30
        tags = video.codec_context
        assert (tags.colorspace, tags.color_primaries, tags.color_trc, tags.color_range) == (1, 1, 1, 1)
        heard = np.concatenate([frame.to_ndarray() for frame in container.decode(audio)], axis=1)
    assert heard.shape[1] / audio.rate == pytest.approx(seconds, abs=0.1)
    assert 0.01 < heard.std() < 0.3
    assert np.abs(heard).max() < 1


def test_sizes() -> None:
    assert sum((ASSETS / name).stat().st_size for name in ("demo.mp4", "demo.json", "ad.mp4")) < 6_000_000


def test_truth_describes_the_clip(truth: dict[str, Any]) -> None:
    with av.open(str(ASSETS / "demo.mp4")) as container:
        video = container.streams.video[0]
        assert (truth["width"], truth["height"]) == (video.width, video.height)
        assert Fraction(truth["fps"]) == video.average_rate
        assert len(truth["corners"]) == len(truth["visible"]) == video.frames
    assert truth["quad"] == truth["corners"][0]


def test_quads_are_convex_clockwise_and_inside(truth: dict[str, Any]) -> None:
    quads = np.array(truth["corners"])
    sides = np.roll(quads, -1, axis=1) - quads
    turns = np.roll(sides, -1, axis=1)
    assert (sides[..., 0] * turns[..., 1] - sides[..., 1] * turns[..., 0] > 0).all()
    assert (quads >= 0).all()
    assert (quads <= [truth["width"] - 1, truth["height"] - 1]).all()
    assert np.linalg.norm(np.diff(quads, axis=0), axis=-1).max() < 25  # a hand-held camera, no jump


def test_the_clip_has_its_hazards(truth: dict[str, Any]) -> None:
    quads, visible = np.array(truth["corners"]), np.array(truth["visible"])
    area = np.array([cv2.contourArea(quad.astype(np.float32)) for quad in quads])
    assert (area.max() / area[0]) ** 0.5 > 1.45
    assert visible[0] == 1
    assert visible[-1] == 1
    assert visible.min() < 0.4
    assert 0.5 < (visible < 0.9).sum() / 30 < 2.5


@pytest.mark.parametrize("second", [1, 2, 3, 4, 7, 8, 9])
def test_truth_matches_the_pixels(second: int, truth: dict[str, Any], prints: list[NDArray[np.float32]]) -> None:
    assert truth["visible"][30 * second] > 0.99
    assert correlation(prints[0], prints[second]) > 0.9


def test_a_wrong_truth_would_show(prints: list[NDArray[np.float32]]) -> None:
    first, later = prints[0][20:-20, 20:-20], prints[8]
    right = correlation(first, later[20:-20, 20:-20])
    for dx, dy in ((3, 0), (-3, 0), (0, 3), (0, -3)):
        assert correlation(first, later[20 + dy : -20 + dy or None, 20 + dx : -20 + dx or None]) < right - 0.02
