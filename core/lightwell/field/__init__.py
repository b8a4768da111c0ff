"""Incident light fields: from probes to a grid of SH coefficients (paper 000; MATHS §6). No input or output here."""
