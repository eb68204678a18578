"""The closed loop: show, photograph, compare with the prediction, correct."""
