"""What goes wrong, in one sentence for the person at the keyboard."""

from hdn.errors import InputError, RunError

__all__ = ["InputError", "RunError"]
