"""Which station contradicts the others, and leaving it out."""
