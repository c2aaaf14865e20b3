"""Every algorithm of the companion, implemented once."""
