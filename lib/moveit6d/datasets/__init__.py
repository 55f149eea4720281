"""Readers and writers: small pose files, videos, sequence folders, BOP data sets.

Never judges poses and never moves them.
"""
