"""Says how good poses are: metrics, the scores of whole sequences, tables, benchmarks.

Never changes a pose and is never known to what makes them.
"""
