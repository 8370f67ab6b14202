"""Layers: laid over the source by FFmpeg's `overlay` they make the picture that -o has, within a grey level."""

import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import imageio_ffmpeg
import numpy as np
import pytest

from ar_demo import OutputOptions, Session, Surface
from ar_demo.errors import InputError, Stopped
from ar_demo.media.srgb import to_coded, to_linear
from hdn.imaging.arrays import Image

from ..clips import make_clip, tone
from ..scenes import Scene, texture
from ..test_session import Still
from ..videos import floats_of

SCENE, FRAMES = Scene(), 3
LOSSLESS: dict[str, Any] = {"backend": "opencv", "codec": "animation"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Has src.mov, lossless, in which a disc comes before the poster and its light falls; and ad.png."""
    folder = tmp_path_factory.mktemp("layers")
    images = [SCENE.draw(SCENE.quad)]
    for index in range(1, FRAMES):
        disc = np.zeros((SCENE.height, SCENE.width), np.float32)
        cv2.circle(disc, (140 + 20 * index, 120), 26, 1, -1)
        share = cv2.GaussianBlur(disc, (0, 0), 1.2)[..., None]
        mixed = SCENE.draw(SCENE.quad) * (1 - share) + np.array([200, 150, 120]) * share
        images.append((mixed * (1 - 0.2 * (index - 1))).astype(np.uint8))
    make_clip(folder / "src.mov", images, codec="qtrle", pix_fmt="rgb24", sound=tone(FRAMES / 25))
    cv2.imwrite(str(folder / "ad.png"), texture(2, 160, 120))
    return folder


def decoded(*arguments: object) -> Image:
    """What FFmpeg, which is not ours, makes of its arguments: frames (n, h, w, 3)."""
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", *map(str, arguments)]
    command += ["-f", "rawvideo", "-pix_fmt", "rgb24", "-"]
    data = subprocess.run(command, capture_output=True, check=True).stdout
    return np.frombuffer(data, np.uint8).reshape(-1, SCENE.height, SCENE.width, 3)


def render(folder: Path, surfaces: Sequence[Surface], options: dict[str, Any], **outputs: Path) -> None:
    with Session(folder / "src.mov", make_tracker=Still) as session:
        session.render(session.track(surfaces), options=OutputOptions(**options), **outputs)


@pytest.fixture(scope="module")
def surfaces(folder: Path) -> dict[str, list[Surface]]:
    ad, quad = folder / "ad.png", SCENE.quad
    return {
        "in the scene": [Surface(ad, quad)],
        "multiplied": [Surface(ad, quad, blend="multiply", opacity=0.8, feather=3)],
        "overlaid, and another effect over it": [
            Surface(ad, quad, blend="overlay", flat=True),
            Surface(effect="mosaic", quad=quad + 20),
        ],
    }


STRAIGHT = "[1:v]zscale=dither=none,format=gbrap[l];[0:v][l]overlay=format=gbrp"
PREMULTIPLIED = "[1:v]setparams=alpha_mode=premultiplied[l];[0:v][l]overlay=format=rgb"


@pytest.mark.parametrize(
    ("case", "name", "options", "graph"),
    [
        ("in the scene", "l.%05d.png", {}, STRAIGHT),
        ("multiplied", "l.mkv", {}, STRAIGHT),  # FFV1
        ("overlaid, and another effect over it", "l.mov", {"layer_codec": "animation"}, "overlay=format=gbrp"),
        ("in the scene", "l.mov", {"layer_codec": "animation", "alpha": "premultiplied"}, PREMULTIPLIED),
    ],
)
def test_a_layer_over_the_source_is_the_output(
    folder: Path, surfaces: dict[str, list[Surface]], case: str, name: str, options: Any, graph: str, tmp_path: Path
) -> None:
    render(folder, surfaces[case], LOSSLESS | options, output=tmp_path / "o.mov", layer=tmp_path / name)
    wanted = decoded("-i", tmp_path / "o.mov")
    rate = ["-framerate", 25] if "%" in name else []
    made = decoded("-i", folder / "src.mov", *rate, "-i", tmp_path / name, "-filter_complex", graph)
    assert made.shape == wanted.shape == (FRAMES, SCENE.height, SCENE.width, 3)
    assert np.abs(made.astype(int) - wanted).max() <= 1
    assert np.abs(wanted.astype(int) - decoded("-i", folder / "src.mov")).max() > 50


def test_openexr_over_the_source_in_linear_light_is_the_output(
    folder: Path, surfaces: dict[str, list[Surface]], tmp_path: Path
) -> None:
    render(folder, surfaces["in the scene"], LOSSLESS, output=tmp_path / "o.mov", layer=tmp_path / "l.##.exr")
    for index, (wanted, source) in enumerate(
        zip(decoded("-i", tmp_path / "o.mov"), decoded("-i", folder / "src.mov"), strict=True)
    ):
        layer = floats_of(tmp_path / f"l.{index:02d}.exr")
        made = to_coded(layer[..., :3] + (1 - layer[..., 3:]) * to_linear(source))
        assert np.abs(np.rint(made * 255) - wanted).max() <= 1


@pytest.mark.parametrize(("name", "options", "loss"), [("l.mov", {}, 4), ("l.webm", {}, None)])
def test_lossy_layers_come_close(
    folder: Path, surfaces: dict[str, list[Surface]], name: str, options: Any, loss: int | None, tmp_path: Path
) -> None:
    render(folder, surfaces["in the scene"], LOSSLESS | options, output=tmp_path / "o.mov", layer=tmp_path / name)
    wanted = decoded("-i", tmp_path / "o.mov").astype(int)
    decoder = ["-c:v", "libvpx-vp9"] if name == "l.webm" else []
    made = decoded("-i", folder / "src.mov", *decoder, "-i", tmp_path / name, "-filter_complex", "overlay=format=gbrp")
    assert np.abs(made - wanted).mean() < 1
    if loss is not None:
        assert np.abs(made - wanted).max() <= loss


def test_the_matte_is_the_layers_alpha_and_clear_under_an_occluder(
    folder: Path, surfaces: dict[str, list[Surface]], tmp_path: Path
) -> None:
    options = {"backend": "opencv"}
    render(folder, surfaces["in the scene"], options, layer=tmp_path / "l.%d.png", matte=tmp_path / "m.%d.png")
    assert not (tmp_path / "o.mov").exists()
    for index in range(FRAMES):
        layer, matte = (cv2.imread(str(tmp_path / f"{name}.{index}.png"), cv2.IMREAD_UNCHANGED) for name in "lm")
        assert matte.dtype == np.uint16
        assert np.array_equal(matte, np.repeat(layer[..., 3:], 3, axis=2))
        assert matte[85, 115].min() == 65535
        assert matte[30, 30].max() == 0
    assert matte[120, 180].max() < 1000  # the disc, at last
    assert len(list(tmp_path.iterdir())) == 2 * FRAMES


def test_a_layer_has_the_times_of_the_video_and_no_sound(folder: Path, tmp_path: Path) -> None:
    surfaces = [Surface(folder / "ad.png", SCENE.quad, flat=True)]
    with Session(folder / "src.mov", make_tracker=Still) as session:
        result = session.render(session.track(surfaces), layer=tmp_path / "l.mov")
        assert (result.output, result.layer, result.frames) == (None, tmp_path / "l.mov", FRAMES)
        assert result.summary()["layer"] == str(tmp_path / "l.mov")
    with Session(tmp_path / "l.mov") as layer:
        assert (layer.reader.info.rate, layer.reader.info.has_audio) == (25, False)
        assert layer.reader.times == session.reader.times


@pytest.mark.parametrize(
    ("outputs", "options", "said"),
    [
        ({}, {}, "name an output with -o, --layer or --save-matte"),
        ({"layer": "l.mp4"}, {}, "let the name end in .mov, .mkv, .webm or .webp"),
        ({"layer": "l.%d.exr"}, {"alpha": "straight"}, "OpenEXR is premultiplied"),
        ({"layer": "l.mov"}, {"codec": "h264"}, "--codec is for the video that -o names"),
        ({"matte": "m.mov"}, {"crf": 20}, "--crf is for the video that -o names"),
        ({"layer": "l.mov"}, {"location": False}, "--no-location is for the video that -o names"),
        ({"layer": "l.mov"}, {"depth": "8"}, "--depth is for the video that -o names"),
        ({"output": "o.gif"}, {"audio": "mix"}, "--audio is for sound, and .gif holds none"),
        ({"output": "o.%d.png"}, {"streams": "first"}, "--streams is for sound, and .png holds none"),
        ({"output": "o.mov"}, {"alpha": "straight"}, "--alpha does nothing without --layer"),
        ({"matte": "m.mov"}, {"layer_codec": "animation"}, "--layer-codec does nothing without --layer"),
        ({"layer": "l.%d.png"}, {"layer_codec": "animation"}, "has one way to be written"),
        ({"layer": "l.png"}, {}, r"name a sequence, as l.%05d.png"),
        ({"output": "o.%d.png"}, {"crf": 20}, "--crf does nothing for .png"),
        ({"layer": "l.mov"}, {"start_number": 1001}, "--start-number is for image sequences"),
    ],
)
def test_what_does_not_go_together_is_refused(
    folder: Path, outputs: dict[str, str], options: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError) as caught:
        render(
            folder,
            [Surface(effect="mosaic", quad=SCENE.quad)],
            options,
            **{name: tmp_path / file for name, file in outputs.items()},
        )
    assert said in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_stopping_leaves_nothing_of_any_output(folder: Path, tmp_path: Path) -> None:
    with Session(folder / "src.mov", make_tracker=Still) as session:
        surfaces = session.track([Surface(effect="mosaic", quad=SCENE.quad)])
        session.listen = lambda event: session.stop()
        with pytest.raises(Stopped):
            session.render(surfaces, tmp_path / "o.mov", layer=tmp_path / "l.%d.png", matte=tmp_path / "m.mov")
    assert list(tmp_path.iterdir()) == []
