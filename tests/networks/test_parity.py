"""The paper's configuration against what the authors' implementation computed with the same weights."""

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from hdn.imaging.homography import normalised, transform
from hdn.networks.authors import AuthorsTracker
from hdn.networks.importing import to_network
from hdn.networks.pytorch import Hdn

PARITY = Path(__file__).parents[3] / "shared" / "parity"

pytestmark = pytest.mark.skipif(
    not PARITY.is_dir(), reason="the authors' outputs are not here: ../shared/parity beside the repository"
)


def close(ours: Any, theirs: Any) -> float:
    """Largest difference, relative to the largest value."""
    return float(np.abs(np.asarray(ours) - theirs).max() / np.abs(theirs).max())


def rgb(crop: Any) -> Any:
    """Their BGR crop (1, 3, n, n) as an RGB image (n, n, 3)."""
    return np.ascontiguousarray(crop[0].transpose(1, 2, 0)[..., ::-1]).round().astype(np.uint8)


@pytest.fixture(scope="module")
def theirs() -> dict[str, Any]:
    with np.load(PARITY / "hdn_reference_io.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def paper_network() -> Hdn:
    spec = importlib.util.spec_from_file_location("parity_weights", PARITY / "weights.py")
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    rows = json.loads((PARITY / "hdn_checkpoint_keys.json").read_text())
    return to_network({key: torch.from_numpy(value) for key, value in module.reference_weights(rows).items()})


@pytest.fixture(scope="module")
def tracker(paper_network: Hdn, theirs: dict[str, Any]) -> AuthorsTracker:
    tracker = AuthorsTracker(paper_network)
    tracker.init(frame(theirs, 0), theirs["quad"].astype(float))
    return tracker


def search_to_template(matrix: Any) -> Any:
    """The authors' homography of the residual is the inverse of ours."""
    return normalised(np.linalg.inv(matrix))


def frame(theirs: dict[str, Any], index: int) -> Any:
    return np.ascontiguousarray(theirs[f"frame{index}"][..., ::-1])


def test_windows_and_template_crops(tracker: AuthorsTracker, theirs: dict[str, Any]) -> None:
    assert (tracker.side, tracker.residual_side) == (theirs["s_z"], theirs["s_z_sm"])
    np.testing.assert_allclose(tracker.fill[::-1], theirs["channel_average"])
    for crop, reference in (
        (tracker.template, theirs["z_crop"][:, :3]),
        (tracker.template_polar, theirs["z_crop"][:, 3:]),
        (tracker.residual_template, theirs["z_crop_sm"]),
    ):
        assert np.abs(crop.astype(float) - rgb(reference)).mean() < 1


def test_search_crops(tracker: AuthorsTracker, theirs: dict[str, Any]) -> None:
    image = frame(theirs, 1)
    assert np.abs(tracker.search_crop(image, tracker.centre).astype(float) - rgb(theirs["x_crop"])).mean() < 1
    centre = moved_centre(tracker, theirs)
    assert np.abs(tracker.search_crop(image, centre).astype(float) - rgb(theirs["x_crop_moved"])).mean() < 1
    assert close(tracker.search_polar(rgb(theirs["x_crop_moved"])).numpy()[:, ::-1], theirs["x_lp"]) < 1e-3


def test_template_features(paper_network: Hdn, theirs: dict[str, Any]) -> None:
    s = paper_network.similarity
    maps = s.backbone(torch.from_numpy(theirs["z_crop"][:, [2, 1, 0]]))
    assert close(s.translation.neck(maps)[0][:, :, 4:11, 4:11], theirs["zf0"]) < 1e-3
    polar = s.backbone(torch.from_numpy(theirs["z_crop"][:, [5, 4, 3]]))
    assert close(s.polar.neck(polar)[2][:, ::8], theirs["zf_lp2"]) < 1e-3


@torch.inference_mode()
def test_translation_outputs(paper_network: Hdn, theirs: dict[str, Any]) -> None:
    s = paper_network.similarity
    kernel = s.encode_template(s.backbone(torch.from_numpy(theirs["z_crop"][:, [2, 1, 0]])))
    cls, loc = s.translation(kernel, s.encode_search(s.backbone(torch.from_numpy(theirs["x_crop"][:, [2, 1, 0]]))))
    assert close(cls, theirs["cls"]) < 1e-3
    assert close(loc, theirs["loc_c"]) < 1e-3


@torch.inference_mode()
def test_log_polar_outputs(paper_network: Hdn, theirs: dict[str, Any]) -> None:
    s = paper_network.similarity
    kernel = s.encode_polar_template(s.backbone(torch.from_numpy(theirs["z_crop"][:, [5, 4, 3]])))
    cls, loc = s.polar(kernel, s.encode_polar_search(s.backbone(torch.from_numpy(theirs["x_lp"][:, [2, 1, 0]]))))
    assert close(cls, theirs["cls_lp"]) < 1e-3
    assert close(loc, theirs["loc_lp"]) < 1e-3


@torch.inference_mode()
def test_residual_outputs(tracker: AuthorsTracker, theirs: dict[str, Any]) -> None:
    assert close(tracker.residual_grey[0], theirs["init_homo_tmp"]) < 1e-5
    matrix, distance = tracker.residual(torch.from_numpy(theirs["residual_input"][:, 1:]))
    assert close(search_to_template(matrix), theirs["H_mat"][0]) < 1e-3
    assert distance == pytest.approx(float(theirs["homo_score"]), rel=1e-3)


@torch.inference_mode()
def test_residual_crop(tracker: AuthorsTracker, theirs: dict[str, Any]) -> None:
    scale, rotation = tracker.scale_and_rotation(theirs["cls_lp"], theirs["loc_lp"])
    crop = tracker.residual_crop(frame(theirs, 1), moved_centre(tracker, theirs), scale, rotation)
    difference = np.abs(tracker.grey(crop)[0, 0].numpy() - theirs["residual_input"][0, 1]).mean()
    assert difference * 70 < 1  # their unit is a standard deviation: 70 grey levels


def test_decoding_and_composition(tracker: AuthorsTracker, theirs: dict[str, Any]) -> None:
    assert tracker.locate(theirs["cls"], theirs["loc_c"]).score == pytest.approx(float(theirs["best_score"]), abs=1e-6)
    scale, rotation = tracker.scale_and_rotation(theirs["cls_lp"], theirs["loc_lp"])
    total = tracker.compose(
        moved_centre(tracker, theirs), scale, rotation, search_to_template(theirs["H_mat"][0].astype(float))
    )
    corners = transform(total, theirs["quad"].astype(float))
    np.testing.assert_allclose(corners, transform(theirs["H_total_1"], theirs["quad"].astype(float)), atol=0.01)
    np.testing.assert_allclose(corners, theirs["polygon_1"], atol=0.01)


def moved_centre(tracker: AuthorsTracker, theirs: dict[str, Any]) -> Any:
    shift = tracker.locate(theirs["cls"], theirs["loc_c"])
    return tracker.centre + np.array([shift.x, shift.y]) * tracker.side / tracker.config.template_size


def test_tracks_from_frame_to_frame(tracker: AuthorsTracker, theirs: dict[str, Any]) -> None:
    # No figures: among random weights two cells score alike, and a grey level decides between them.
    homography = tracker.track(frame(theirs, 1))
    assert homography[2, 2] == 1
    assert np.isfinite(transform(homography, theirs["quad"].astype(float))).all()
    assert tracker.rectify(frame(theirs, 1)).shape == theirs["frame1"].shape
