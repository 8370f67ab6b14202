"""What the training samples promise is what they show."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hdn.errors import InputError
from hdn.imaging.quads import square
from hdn.networks.geometry import dlt, project
from hdn.synthesis import Hiding, Photos, covers, looks, residual_batch, similarity_batch
from hdn.synthesis.drawings import screens
from hdn.synthesis.photos import pixel_grid
from hdn.synthesis.shapes import Outlines
from hdn.training.recipes import RECIPES, Recipe

from ..scenes import texture


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Photos:
    folder = tmp_path_factory.mktemp("photos")
    for seed in range(4):
        cv2.imwrite(str(folder / f"{seed}.png"), texture(seed, 300, 220))
    return Photos.read(sorted(folder.iterdir()))


@pytest.fixture(autouse=True)
def plain(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without light, blur and noise, pairs can be compared pixel by pixel."""
    torch.manual_seed(0)
    for name in ("relight", "blur", "coarsen"):
        monkeypatch.setattr(looks, name, lambda *args: next(a for a in args if isinstance(a, torch.Tensor)))


def difference(template: torch.Tensor, search: torch.Tensor, matrix: torch.Tensor, box: torch.Tensor) -> torch.Tensor:
    """Mean grey difference (B,) inside boxes (B, 2) of half sizes, the template warped onto the search and back."""
    n, m = template.shape[-1], search.shape[-1]
    grid = pixel_grid(n, template.device)
    seen = project(matrix, grid).reshape(-1, n, n, 2) * (2 / m)
    back = torch.nn.functional.grid_sample(search, seen, align_corners=False)
    inside = (grid.abs() < 0.6 * box[:, None]).all(-1).reshape(-1, 1, n, n)
    return ((back - template).abs() * inside).sum((1, 2, 3)) / (3 * inside.sum((1, 2, 3)))


def test_search_shows_the_target_moved_by_the_homography(photos: Photos) -> None:
    batch = similarity_batch(photos, 16, 127, 255, 0.5, negatives=0.3)
    off = difference(batch.template, batch.search, batch.motion.matrix, batch.target)
    assert off[batch.positive].max() < 12
    assert off[~batch.positive].mean() > 25


def test_the_homography_is_the_similarity_at_the_target_s_centre(photos: Photos) -> None:
    motion = similarity_batch(photos, 16, 127, 255, 0.5).motion
    centre = project(motion.matrix, torch.zeros(1, 2))[:, 0]
    torch.testing.assert_close(centre, motion.shift, atol=1e-4, rtol=0)


def test_residual_offsets_are_where_the_corners_went(photos: Photos) -> None:
    batch = residual_batch(photos, 16, 128, reach=12, negatives=0.3)
    corners = torch.from_numpy(square(128)).float() - 63.5
    matrix = dlt(batch.offsets, corners)
    off = difference(batch.template, batch.search, matrix, torch.full((16, 2), 60.0))
    assert off[batch.positive].max() < 12
    assert off[~batch.positive].mean() > 25
    assert batch.offsets[batch.positive].abs().max() <= 12
    assert (batch.offsets[~batch.positive] == 0).all()


def test_what_hides_the_target_is_known(photos: Photos) -> None:
    torch.manual_seed(0)
    crops = torch.zeros(32, 3, 64, 64)
    occluded, hidden = covers.occlude(photos, crops, torch.ones(32, dtype=torch.bool), torch.zeros(32, 2), 64)
    assert (occluded[(hidden == 0).expand_as(crops)] == 0).all()
    assert (hidden.amax((1, 2, 3)) > 0.5).float().mean() > 0.9
    share = hidden.mean((1, 2, 3))
    assert share.max() < 0.85
    assert share.std() > 0.1


BAR, SLIVER, HAND, NOTHING = 1, 2, 3, 4


@pytest.mark.parametrize(
    ("kind", "least", "most"), [(BAR, 0.2, 0.9), (SLIVER, 0.6, 0.97), (HAND, 0.0, 0.9), (NOTHING, 0.0, 0.0)]
)
def test_bars_slivers_and_hands_hide_what_they_say(photos: Photos, kind: int, least: float, most: float) -> None:
    torch.manual_seed(0)
    crops = torch.zeros(32, 3, 64, 64)
    shown, hidden = covers.hide(photos, crops, torch.full((32,), kind), torch.zeros(32, 2), 64, torch.zeros(32))
    assert (shown[(hidden == 0).expand_as(crops)] == 0).all()
    share = hidden.mean((1, 2, 3))
    assert share.min() >= least
    assert share.max() <= most
    if kind != NOTHING:
        assert (shown.amax((1, 2, 3)) > 0).float().mean() > 0.9
        assert share.std() > 0.02


def test_a_bar_lies_along_the_target_s_sides(photos: Photos) -> None:
    """Of a target that is turned by 45 degrees the bar is turned alike: its edge runs nowhere near the crop's rows."""
    turn = torch.full((16,), np.pi / 4)
    _, hidden = covers.hide(photos, torch.zeros(16, 3, 96, 96), torch.full((16,), BAR), torch.zeros(16, 2), 48, turn)
    across, down = ((hidden.diff(dim=axis).abs().sum((1, 2, 3))) for axis in (2, 3))
    steepness = torch.atan2(across, down)
    assert (steepness - np.pi / 4).abs().max() < covers.COVERS.sliver_turn + 0.1


def test_each_target_is_hidden_by_one_thing_at_most_in_the_shares_given() -> None:
    torch.manual_seed(0)
    kinds = Hiding(quads=0.1, bars=0.2, slivers=0.3, hands=0.1).kinds(4000, torch.device("cpu"))
    shares = torch.bincount(kinds, minlength=5) / 4000
    torch.testing.assert_close(shares, torch.tensor([0.1, 0.2, 0.3, 0.1, 0.3]), atol=0.03, rtol=0)


@pytest.mark.parametrize("recipe", RECIPES.values(), ids=RECIPES)
def test_the_recipes_hide_no_more_than_all_targets(recipe: Recipe) -> None:
    for hiding in (recipe.similarity_hiding, recipe.residual_hiding):
        assert hiding.quads + hiding.bars + hiding.slivers + hiding.hands <= 1


def test_screens_have_little_texture(photos: Photos) -> None:
    torch.manual_seed(0)
    drawn = screens(Outlines(photos, 16), 16)
    steps = (drawn.pixels.float().diff(dim=3).abs().mean((1, 2, 3)), photos.pixels.float().diff(dim=3).abs().mean())
    assert steps[0].mean() < 0.2 * steps[1]
    assert (drawn.pixels.float().std((2, 3)) > 0).all()
    batch = residual_batch(photos, 12, 96, reach=6, negatives=0, plain=1)
    matrix = dlt(batch.offsets, torch.from_numpy(square(96)).float() - 47.5)
    assert difference(batch.template, batch.search, matrix, torch.full((12, 2), 44.0)).max() < 6


def test_what_hides_a_template_is_known(photos: Photos) -> None:
    batch = residual_batch(photos, 16, 96, reach=0, negatives=0, hiding=Hiding(template=1))
    known = (batch.known == 1).expand_as(batch.template)
    assert (batch.clear == 1).all()
    assert (batch.known < 0.5).flatten(1).any(1).float().mean() > 0.8
    assert (batch.template - batch.search).abs()[:, :, 4:-4, 4:-4][known[:, :, 4:-4, 4:-4]].max() < 1e-2
    assert (batch.template - batch.search).abs()[~known].mean() > 20


def test_unreadable_images_are_named(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(b"not a picture")
    with pytest.raises(InputError, match=r"a\.png"):
        Photos.read([tmp_path / "a.png"])


def test_masks_are_soft_over_a_pixel() -> None:
    quad = torch.tensor([[[-2.0, -2], [2, -2], [2, 2], [-2, 2]]])
    mask = covers.inside(quad, pixel_grid(8, quad.device)[None], 8)[0, 0]
    assert mask[4, 4] == 1
    assert mask[0, 0] == 0
    np.testing.assert_allclose(float(mask.sum()), 16, atol=1.5)


def test_batches_join_sample_by_sample(photos: Photos) -> None:
    one, two = (residual_batch(photos, n, 64, reach=6) for n in (2, 3))
    both = one + two
    assert len(both.template) == len(both.clear) == len(both.labelled) == 5
    assert torch.equal(both.offsets[2:], two.offsets)
    assert both.labelled.all()
