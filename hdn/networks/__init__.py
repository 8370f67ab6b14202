"""The networks of HDN, and what runs them."""
