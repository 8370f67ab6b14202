"""Words for numbers, wherever something is told."""


def counted(count: int, noun: str) -> str:
    """As in '3 frames' and '1 frame'."""
    return f"{count} {noun}" + ("" if count == 1 else "s")
