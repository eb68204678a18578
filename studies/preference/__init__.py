"""Asks people which of two compensation methods they prefer, and analyses what they answer."""
