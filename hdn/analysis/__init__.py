"""`hdn-analyse`: what the paper's choices, and our states, are worth."""
