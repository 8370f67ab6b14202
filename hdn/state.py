"""What a tracker says of a frame."""

from typing import Literal, get_args

State = Literal["tracked", "held", "lost"]
STATES: tuple[State, ...] = get_args(State)
