"""Training of moveit6d's networks with Lightning: module, data and command line.

Never needed at run time: `import moveit6d` does not load it.
"""
