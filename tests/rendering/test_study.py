"""Which frames are looked at for the light of a first view, and how often."""

from collections.abc import Collection, Iterable
from fractions import Fraction
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ar_demo.rendering import study
from ar_demo.rendering.study import MODEL, first_lights, views_of
from ar_demo.tracks import Source, Track
from hdn.state import State

from ..scenes import Scene

SCENE = Scene(320, 240, seed=4)
SCENE.quad = np.array([[80.0, 60], [240, 64], [236, 180], [84, 176]])


def track(count: int, lost: Collection[int] = (), reference: int = 0) -> Track:
    corners = np.repeat(SCENE.quad[None], count, 0)
    states: list[State] = ["lost" if k in lost else "tracked" for k in range(count)]
    times = [Fraction(k, 30) for k in range(count)]
    source = Source("clip.mp4", 320, 240, Fraction(30), count)
    return Track(source, reference, SCENE.quad, times, corners, states, np.ones(count), np.zeros(count))


def test_views_are_evenly_chosen_of_frames_that_show_the_surface() -> None:
    chosen = views_of(track(200, lost=range(50, 100)))
    assert len(chosen) == MODEL.views
    assert not chosen & {0, *range(50, 100)}
    assert min(chosen) < 10
    assert max(chosen) > 190
    assert views_of(track(3)) == {1, 2}
    far = views_of(track(3000, reference=1500))
    assert max(abs(k - 1500) for k in far) <= MODEL.reach_frames


def test_a_surface_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "_known", {})
    picture, picked = SCENE.draw(SCENE.quad), []

    def frames(start: int, stop: int, only: Collection[int] | None = None, /) -> Iterable[Any]:
        indices = range(start, stop) if only is None else only
        picked.append(sorted(indices))
        return [SimpleNamespace(index=k, view=picture, damaged=k == 3) for k in sorted(indices)]

    clip = track(12)
    [light] = first_lights("clip.mp4", frames, [clip])
    assert light is not None
    assert picked == [[0], list(range(1, 12))]
    again = first_lights("clip.mp4", frames, [None, clip])
    assert again == [None, light]
    assert len(picked) == 2
    first_lights("other.mp4", frames, [clip])
    assert len(picked) == 4
    assert first_lights("clip.mp4", frames, [track(1)]) == [None]
