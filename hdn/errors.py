"""What goes wrong, in one sentence for the person at the keyboard."""


class InputError(ValueError):
    """The input is wrong: the message says what, and what to do. Command lines exit with 2."""


class RunError(RuntimeError):
    """Something failed while working on good input. Command lines exit with 1, or as a kind of it says."""

    exit_status = 1


TORCH_MISSING = "PyTorch, which is not installed: install it with pip install 'ar-replace[torch]'"
