"""Spherical harmonics: basis, rotation, lobes, shading, engine conventions, windows, temporal filters, dominant light.

Pure functions and small classes: arrays in, arrays out. Conventions are those of `lightwell.conventions`.
"""
