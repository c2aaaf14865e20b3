"""What one chapter does once: experiments, data, tables of runs."""
