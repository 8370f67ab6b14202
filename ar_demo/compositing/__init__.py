"""Drawing of ads onto quads."""
