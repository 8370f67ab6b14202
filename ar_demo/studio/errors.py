"""What the page is told where something cannot be done: a status and one sentence."""

import re


class Refusal(Exception):
    """A request that is not fulfilled.

    Attributes:
        status: HTTP's.
        message: one sentence for the person at the page.
        field: what it concerns, as 'surfaces.0.opacity'; None where it is nothing that is on the page.
        extra: what else the answer holds.
    """

    def __init__(self, status: int, message: str, field: str | None = None, **extra: object) -> None:
        super().__init__(message)
        self.status, self.message, self.field, self.extra = status, message, field, extra

    @property
    def content(self) -> dict[str, object]:
        """As JSON can hold it."""
        field = {} if self.field is None else {"field": self.field}
        return {"error": self.message, **field, **self.extra}


def on_page(message: str, advice: str) -> str:
    """An error's sentence, with advice for the page where its own names an option of the command line."""
    what, colon, own = message.rpartition(": ")
    return f"{what}: {advice}" if colon and re.search(r"(^|[\s(])--?[a-z]", own) else message
