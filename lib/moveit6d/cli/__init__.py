"""The command line: one small file a verb.

Never holds anything but arguments, the order of calls, and printing.
"""
