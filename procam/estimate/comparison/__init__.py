"""Two calibrations of one rig compared within their error bars."""
