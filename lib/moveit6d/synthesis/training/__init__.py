"""Training pairs: what they are drawn from, how they are generated, and how they are stored.

Never trains.
"""
