"""Two runs to one output: the name is claimed at the start, and the second run is refused."""

from pathlib import Path

import pytest

from ar_demo import OutputOptions, Progress, Session, Surface, replace, track
from ar_demo.errors import InputError
from ar_demo.media.reader import VideoReader

from ..clips import make_clip
from ..scenes import Scene, path
from ..test_session import Still

FRAMES = 4


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    scene = Scene()
    (tmp_path / "in").mkdir()
    return make_clip(tmp_path / "in" / "a.mp4", [scene.draw(corners) for corners in path(scene.quad, FRAMES)])


@pytest.mark.parametrize("overwrite", [False, True])
def test_the_second_is_refused_while_the_first_works(clip: Path, tmp_path: Path, overwrite: bool) -> None:
    done = track(clip, Surface(quad=Scene().quad), make_tracker=Still)
    surface, options = Surface(effect="blur", track=done), OutputOptions(backend="opencv", overwrite=overwrite)
    refused: list[str] = []

    def second(event: Progress) -> None:
        if event.done == 1:
            with pytest.raises(InputError, match="written by another run") as caught:
                replace(clip, surface, tmp_path / "o.mp4", None, options)
            refused.append(str(caught.value))

    replace(clip, surface, tmp_path / "o.mp4", None, options, second)
    assert len(refused) == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "o.mp4"]
    with VideoReader(tmp_path / "o.mp4") as reader:
        assert sum(1 for _ in reader.frames()) == FRAMES


def test_the_name_is_claimed_before_tracking(clip: Path, tmp_path: Path) -> None:
    refused: list[str] = []

    def second(event: Progress) -> None:
        if not refused:
            with pytest.raises(InputError, match="written by another run") as caught:
                track(clip, Surface(quad=Scene().quad), make_tracker=Still, save_track=tmp_path / "t.json")
            refused.append(event.stage)
            assert "t.json" in str(caught.value)

    track(clip, Surface(quad=Scene().quad), listen=second, make_tracker=Still, save_track=tmp_path / "t.json")
    assert refused == ["track"]
    with Session(clip, make_tracker=Still) as session:
        session.track([Surface(quad=Scene().quad)])
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "t.json"]
