"""Every algorithm of the companion, implemented once."""

__version__ = "0.1.0"
