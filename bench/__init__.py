"""Measurements: one module a bench, each printing ratios against a baseline of the same run."""
