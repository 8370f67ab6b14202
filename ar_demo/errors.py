"""What goes wrong, in one sentence for the person at the keyboard; and what ends work early."""

from hdn.errors import InputError, RunError

__all__ = ["InputError", "RunError", "Stopped"]


class Stopped(RunError):
    """Somebody asked the work to stop before it was done; nothing half made is left."""
