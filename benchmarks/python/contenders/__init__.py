"""One module per library that is measured, each with a class `Contender`; run by worker.py."""
