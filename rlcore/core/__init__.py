"""What the algorithms stand on: checks, compilation, worlds, results."""
