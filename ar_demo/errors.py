"""What goes wrong, in one sentence for the person at the keyboard; and what ends work early."""

from hdn.errors import InputError, RunError

__all__ = ["InputError", "NotFound", "RunError", "Stopped"]


class Stopped(RunError):
    """Somebody asked the work to stop before it was done; nothing half made is left."""


class NotFound(RunError):
    """A picture is not seen in a video: the message has the best candidate. Command lines exit with 3."""

    exit_status = 3
