"""The paper's tables and figures, one module each: our figures beside the printed ones.

Never draws (`visualization.plots` does) and never changes what the paper prints
(`published_figures`).
"""
