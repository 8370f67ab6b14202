"""Folders as data sets have them, what of them is in memory, and the samples cut from clips."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from hdn.errors import InputError
from hdn.synthesis import Photos, unlabelled_batch
from hdn.training.data import Clips, Pool, find_clips, find_images, split

from ..clips import make_clip, number_image, number_of, numbered
from ..scenes import texture

CPU = torch.device("cpu")


def write(path: Path, number: int) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), number_image(number))
    return path


def shown(photos: Photos) -> list[int]:
    """The numbers that the images in memory say."""
    return [number_of(p.permute(1, 2, 0).numpy()) for p in photos.pixels]


def test_coco_s_validation_images_are_held_out(tmp_path: Path) -> None:
    for i in range(3):
        write(tmp_path / "train2017" / f"{i:012}.jpg", i)
    write(tmp_path / "val2017" / "000000000009.jpg", 9)
    trained, kept, rule = split(find_images([tmp_path]))
    assert {p.parent.name for p in trained} == {"train2017"}
    assert [p.parent.name for p in kept] == ["val2017"]
    assert rule == "held out: val2017"


def test_without_a_held_out_source_every_fiftieth_is_kept() -> None:
    paths = [Path(f"photos/{i}.jpg") for i in range(200)]
    trained, kept, rule = split(paths)
    assert (len(trained), len(kept)) == (196, 4)
    assert not set(trained) & set(kept)
    assert set(split(paths[::-1])[1]) == set(kept)
    assert "fiftieth" in rule


def test_no_images_and_nothing_to_train_on(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no images under"):
        find_images([tmp_path])
    with pytest.raises(InputError, match="all 1 images are of held-out sources"):
        split([Path("kodak/a.png")])


def test_of_many_images_some_are_in_memory_and_all_come_round(tmp_path: Path) -> None:
    paths = [write(tmp_path / f"{i}.png", i) for i in range(7)]
    pool = Pool(paths, CPU, seed=0, limit=3)
    assert len(pool) == 3
    seen, before = set(shown(pool)), shown(pool)
    assert shown(Pool(paths, CPU, seed=0, limit=3)) == before
    for _ in range(4):
        pool.refresh()
        now = shown(pool)
        assert sum(a != b for a, b in zip(before, now, strict=True)) == 1  # the oldest gave way
        assert len(set(now)) == 3
        seen, before = seen | set(now), now
    assert seen == set(range(7))


def test_few_images_stay(tmp_path: Path) -> None:
    pool = Pool([write(tmp_path / f"{i}.png", i) for i in range(3)], CPU, seed=0)
    pool.refresh()
    assert shown(pool) == [0, 1, 2]


def test_clips_are_videos_and_folders_of_numbered_frames(tmp_path: Path) -> None:
    got = tmp_path / "train" / "GOT-10k_Train_000001"
    for i in (2, 10, 1):
        write(got / f"{i:08}.jpg", i)
    write(got / "cover_page.jpg", 0)  # not numbered
    write(tmp_path / "single" / "1.jpg", 1)
    video = make_clip(tmp_path / "a.mp4", numbered(3))
    write(tmp_path / "kodak" / "1.jpg", 1)
    write(tmp_path / "kodak" / "2.jpg", 2)  # held out
    file, frames = find_clips([tmp_path])
    assert frames == [got / f"{i:08}.jpg" for i in (1, 2, 10)]
    assert file == video
    assert find_clips([video]) == [video]
    with pytest.raises(InputError, match="no clips under"):
        find_clips([tmp_path / "single"])


def test_frames_keep_their_order_and_pairs_stay_in_their_clip(tmp_path: Path) -> None:
    video = make_clip(tmp_path / "a.mp4", numbered(5))
    folder = [write(tmp_path / "b" / f"{i}.png", i) for i in range(100, 103)]
    clips = Clips([video, folder], CPU, seed=0)
    assert (clips.count, len(clips)) == (2, 8)
    numbers = torch.tensor(shown(clips))
    assert sorted(numbers.tolist()) == [0, 1, 2, 3, 4, 100, 101, 102]
    index, later = clips.pairs(200, gap=2)
    assert (index != later).all()
    assert ((numbers[index] - numbers[later]).abs() <= 2).all()


def test_of_long_clips_a_stretch_is_kept(tmp_path: Path) -> None:
    video = make_clip(tmp_path / "a.mp4", numbered(80))
    folders = [[write(tmp_path / str(c) / f"{i}.png", i) for i in range(40)] for c in range(2)]
    clips = Clips([video, *folders], CPU, seed=1, limit=60)
    assert len(clips) == 60  # two of the three
    numbers = torch.tensor(shown(clips))
    assert (numbers.reshape(2, 30).diff(dim=1) == 1).all()


def test_a_damaged_video_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.mp4").write_bytes(b"not a video")
    with pytest.raises(InputError, match=r"a\.mp4 is not a video that can be read"):
        Clips(find_clips([tmp_path]), CPU, seed=0)


def test_one_quad_is_cut_from_both_frames() -> None:
    torch.manual_seed(0)
    picture = texture(1, 304, 304)
    frames = np.stack([picture, picture, np.roll(picture, 3, 1)]).transpose(0, 3, 1, 2)
    clips = Photos(torch.from_numpy(frames.copy()))
    batch = unlabelled_batch(clips, torch.tensor([0, 0]), torch.tensor([1, 2]), 64)
    assert batch.template.shape == batch.search.shape == (2, 3, 64, 64)
    assert torch.equal(batch.template[0], batch.search[0])
    assert (batch.template[1] - batch.search[1]).abs().mean() > 1
    assert not batch.labelled.any()
    assert batch.positive.all()
