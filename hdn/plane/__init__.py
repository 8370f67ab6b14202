"""The plane that a target lies on: what of it is known, how it moves, and what hides it."""
