"""Lightwell: light probes, spherical harmonics and light fields (pure: arrays in, arrays out).

Import what you need from the subpackages; this module stays light so that the wire format can be used without the
numerical kernels.
"""

from lightwell._version import __version__ as __version__
