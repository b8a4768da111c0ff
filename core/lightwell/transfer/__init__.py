"""Precomputed radiance transfer: how each vertex of a mesh answers to light (paper 003 §3.7; MATHS §9).

No input or output here.
"""
