"""Spherical-harmonic gradients: light that knows where you are (paper 001; MATHS §7).

The derivative ``G = ∂c/∂(x, y, z)`` of coefficients, ``(bands², 3, 3)`` per metre: coefficient, colour, axis.

`proxy` says how far away light comes from, `image` and `sphere` make gradients of it, `trust` says how far they hold,
`extrapolate` and `interpolate` use them, `freespace` is what all light in empty space obeys, `placement` finds where
samples are needed. `forms` holds the integrals that everything here is checked against.
"""
