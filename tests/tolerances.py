"""Tolerances of the tests, each with its reason. Noisy results are judged in sigmas instead."""

# a few roundings of float64 between two forms of the same expression
CLOSED_FORM = 1e-12
# an iteration stopped by its own criterion, or a linear solve of moderate condition
SOLVER = 1e-8
# a few roundings of float32 along a chain of products
FLOAT32 = 1e-5
# OpenCV and procam evaluate the same polynomial in float64, in another order [px at some 1000 px]
OPENCV_PX = 1e-9
# OpenCV's remap rounds a position to about 1/32768 px [px]
SAMPLE_PX = 3e-5
# half a step of an 8-bit picture
CODE_8BIT = 0.5 / 255
# two-sided normal: one false alarm in 16 000; seeds are fixed, so results repeat
SIGMAS = 4.0
