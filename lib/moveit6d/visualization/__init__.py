"""Pictures for people: poses drawn on frames, and videos of them.

Never changes a pose and never scores one.
"""
