"""Makeup patches in head-camera video: from brightness to action units to curves of weights."""
