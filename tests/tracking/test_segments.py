import pytest

from ar_demo.tracking.segments import segments


@pytest.mark.parametrize(
    ("flags", "cuts", "runs"),
    [
        ([], [], []),
        ([True], [], [(0, 1)]),
        ([False, True, True, False, True], [], [(1, 3), (4, 5)]),
        ([False, True, True, False, True], [1, 2, 3], [(1, 2), (2, 3), (4, 5)]),
    ],
)
def test_segments(flags: list[bool], cuts: list[int], runs: list[tuple[int, int]]) -> None:
    assert segments(flags, cuts) == runs
