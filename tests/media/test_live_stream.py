"""Live sources: what goes wrong in the thread that decodes arrives where frames are taken."""

from collections.abc import Iterator
from pathlib import Path
from threading import Event, enumerate

import pytest

from ar_demo.media import live_stream
from ar_demo.media.live_stream import Stream

from .. import clips


def test_an_error_of_the_thread_arrives_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    error, original = MemoryError("no room for a frame"), live_stream.decode

    def failing(*args: object) -> Iterator[object]:
        frames = original(*args)  # type: ignore[arg-type]
        yield next(frames)
        yield next(frames)
        raise error

    monkeypatch.setattr(live_stream, "decode", failing)
    before = enumerate()
    with Stream(str(clips.make_clip(tmp_path / "a.mp4", clips.numbered(5)))) as stream:
        with pytest.raises(MemoryError) as caught:
            list(stream.frames(Event()))
        assert caught.value is error
    assert enumerate() == before


def test_closing_twice_does_nothing(tmp_path: Path) -> None:
    stream = Stream(str(clips.make_clip(tmp_path / "a.mp4", clips.numbered(5))))
    stream.close()
    stream.close()
