"""Charts and pictures.

`figure` has the canvas and its style, `charts` the colour scales and charts of a report; the others draw
clips, forecasts and figures over time. matplotlib is imported only when something is drawn.
"""
