"""Scores of result files in BOP's format: ADD(-S) and the challenge's average recall.

Never refines a pose.
"""
