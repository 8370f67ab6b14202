"""What is closed when its `with` block ends."""

from abc import abstractmethod
from types import TracebackType
from typing import Protocol, Self


class Closing(Protocol):
    """A context manager that only closes; `contextlib.closing` built in."""

    @abstractmethod
    def close(self) -> None:
        """Lets go of what is held; calling again does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
