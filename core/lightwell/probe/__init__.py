"""From pictures of light probes to spherical-harmonic coefficients: mappings, downsampling and projection.

Pure: arrays in, arrays out. `lightwell.probe.factory.make_mapping` chooses the mapping, `Downsampler` reduces the
picture, `projector` gives the coefficients.
"""
